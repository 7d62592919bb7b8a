/// The IPv4 addresses of this machine, or of the network namespace of the calling thread.
#pragma once

#include <cstdint>
#include <mutex>
#include <set>

#include "wire/library.hpp"

namespace tactus::wire {

/// Threads: any.
class LocalAddresses {
 public:
  LocalAddresses();
  /// Returns whether the locator has a loopback address, or an address of one of the interfaces. Reads the addresses
  /// again if they are 5 s old, because the machine may have lost this one, and at most once in a second if it does not
  /// know this one.
  [[nodiscard]] bool contains(const rtps::Locator_t& locator, std::int64_t now_ns);

 private:
  std::mutex mutex_;
  std::set<std::uint32_t> addresses_;  // in network order
  std::int64_t read_ns_;
};

}  // namespace tactus::wire
