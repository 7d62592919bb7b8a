/// Two network namespaces joined by a link: two machines in one, for tests, benchmarks and users.
///
///     namespace tactus-link-PID-a                              namespace tactus-link-PID-b
///     link0 10.77.0.1/24  <--tap-->  relay (this process)  <--tap-->  link0 10.77.0.2/24
///
/// With Medium::kVeth the kernel joins the two without a relay. Multicast passes the link, neighbours are preset (no
/// ARP that could be lost), and there is no IPv6 and no route to other networks. Both share files, clock and shared
/// memory.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>
#include <vector>

#include "netem/profile.hpp"
#include "netem/relay.hpp"

namespace tactus::netem {

enum class Side { kA = 0, kB = 1 };

/// The reason why this process cannot make namespaces, with the remedy; empty when it can. Leaves no namespace.
[[nodiscard]] std::string missing_privilege();

/// Removes namespaces of pairs whose process has ended; returns the names that it removed.
std::vector<std::string> remove_stale();

/// Starts a program in the caller's namespace, found in PATH, in its own process group; the caller waits for it. It
/// ends when the starting thread ends. A program that cannot be run ends with status 127. Throws LinkError.
[[nodiscard]] pid_t start_program(std::vector<std::string> command);

/// Owns both namespaces; destroying it removes their names, and the namespaces when no process uses them. Threads: its
/// creator's; `enter` and `figures` from any thread.
class LinkedPair {
 public:
  /// Removes namespaces that killed programs left, then makes both. Takes about 50 ms. Throws LinkError for settings
  /// out of range, and for a refusal of the system, with the remedy.
  explicit LinkedPair(const LinkSettings& settings);
  ~LinkedPair();
  LinkedPair(const LinkedPair&) = delete;
  LinkedPair& operator=(const LinkedPair&) = delete;

  /// Name of the namespace in /run/netns.
  [[nodiscard]] const std::string& name(Side side) const;
  [[nodiscard]] static const char* address(Side side) noexcept { return side == Side::kA ? "10.77.0.1" : "10.77.0.2"; }

  /// Moves the calling thread and its later children into a namespace. Throws LinkError.
  void enter(Side side) const;

  /// As start_program, in a namespace.
  [[nodiscard]] pid_t start(Side side, std::vector<std::string> command) const;

  /// All zero with Medium::kVeth.
  [[nodiscard]] RelayFigures figures() const;
  /// True when the relay runs at a real-time priority, or when there is none.
  [[nodiscard]] bool realtime() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::netem
