/// The exception that wire/ throws for invalid settings of a program.
#pragma once

#include <stdexcept>
#include <string>

namespace tactus::wire {

/// Thrown for an invalid address, domain or profile. The message names the item, its file, the value found and the
/// value expected.
class WireError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace tactus::wire
