/// The exception that wire/ throws for invalid settings of a program.
#pragma once

#include <stdexcept>
#include <string>

namespace tactus::wire {

/// A bad address, domain or profile; the message names the item, the place, the value found and the value expected.
class WireError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace tactus::wire
