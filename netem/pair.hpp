/// Two network namespaces joined by a link: two machines on one, for tests, benchmarks and users.
///
///     namespace tactus-link-PID-a                              namespace tactus-link-PID-b
///     link0 10.77.0.1/24  <--tap-->  relay (this process)  <--tap-->  link0 10.77.0.2/24
///
/// With Medium::kVeth the kernel joins the two and there is no relay. Multicast goes through the link, neighbours are
/// known beforehand (no ARP to lose), there is no IPv6 and no way out. Files, clock and shared memory are common to
/// both.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>
#include <vector>

#include "netem/profile.hpp"
#include "netem/relay.hpp"

namespace tactus::netem {

enum class Side { kA = 0, kB = 1 };

/// Why this process cannot make namespaces here, with the mend; empty when it can. Leaves nothing behind.
[[nodiscard]] std::string missing_privilege();

/// Removes namespaces of pairs whose process is gone, and gives their names; what others sweep meanwhile is theirs.
std::vector<std::string> remove_stale();

/// Starts a program where the caller is, found as a shell finds it, in a process group of its own; the caller waits for
/// it. It dies with the thread that started it. A program that cannot be run ends with 127. Throws LinkError.
[[nodiscard]] pid_t start_program(std::vector<std::string> command);

/// Owns both namespaces; destroying it removes their names, and the namespaces when nothing runs in them any more.
/// Threads: that of its maker, but `enter` and `figures` any.
class LinkedPair {
 public:
  /// Sweeps what killed ones left, then makes both. Takes about 50 ms. Throws LinkError: settings out of range, or what
  /// the system refuses and how that is mended.
  explicit LinkedPair(const LinkSettings& settings);
  ~LinkedPair();
  LinkedPair(const LinkedPair&) = delete;
  LinkedPair& operator=(const LinkedPair&) = delete;

  /// Of the namespace, as in /run/netns.
  [[nodiscard]] const std::string& name(Side side) const;
  [[nodiscard]] static const char* address(Side side) noexcept { return side == Side::kA ? "10.77.0.1" : "10.77.0.2"; }

  /// Moves the calling thread, and all that it starts from then on, into a namespace. Throws LinkError.
  void enter(Side side) const;

  /// As start_program, in a namespace.
  [[nodiscard]] pid_t start(Side side, std::vector<std::string> command) const;

  /// All zero with Medium::kVeth.
  [[nodiscard]] RelayFigures figures() const;
  /// Whether the relay runs at a real-time priority; true without one, which needs none.
  [[nodiscard]] bool realtime() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::netem
