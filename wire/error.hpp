/// What wire/ throws when a program starts with something that it cannot use.
#pragma once

#include <stdexcept>
#include <string>

namespace tactus::wire {

/// A bad address, domain or profile: says what, where, the value found and the value expected.
class WireError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace tactus::wire
