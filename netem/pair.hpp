/// Two network namespaces on one machine, which an emulated link joins as if they were two machines.
///
///     namespace tactus-link-PID-a                              namespace tactus-link-PID-b
///     link0 10.77.0.1/24  <--tap-->  relay (this process)  <--tap-->  link0 10.77.0.2/24
///
/// With Medium::kVeth the kernel joins the namespaces without a relay. Multicast passes the link. The ARP entries of
/// both sides are preset, because the link could lose ARP requests. There is no IPv6 and no route to other networks.
/// The namespaces share files, clock and shared memory.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>
#include <vector>

#include "netem/profile.hpp"
#include "netem/relay.hpp"

namespace tactus::netem {

enum class Side { kA = 0, kB = 1 };

/// Returns the reason why this process cannot make namespaces, with the remedy; empty when it can. Leaves no namespace.
[[nodiscard]] std::string missing_privilege();

/// Removes the namespaces of pairs whose process has ended, and returns their names.
std::vector<std::string> remove_stale();

/// Searches PATH for a program and starts it in the caller's namespace, in a process group of its own. The caller must
/// wait for the returned process. The process ends when the starting thread ends. If the program cannot be run, the
/// process ends with status 127. Throws LinkError.
[[nodiscard]] pid_t start_program(std::vector<std::string> command);

/// Owns both namespaces. The destructor removes their names; the kernel removes a namespace when no process uses it.
/// Only `enter_namespace` and `figures` may be called from other threads than the creator's.
class LinkedPair {
 public:
  /// Calls remove_stale, then makes both namespaces. Takes about 50 ms. Throws LinkError for settings out of range, and
  /// with the remedy if the system refuses.
  explicit LinkedPair(const LinkSettings& settings);
  ~LinkedPair();
  LinkedPair(const LinkedPair&) = delete;
  LinkedPair& operator=(const LinkedPair&) = delete;

  /// Name of the namespace in /run/netns.
  [[nodiscard]] const std::string& name(Side side) const;
  [[nodiscard]] static const char* address(Side side) noexcept { return side == Side::kA ? "10.77.0.1" : "10.77.0.2"; }

  /// Moves the calling thread into a namespace. Processes and threads that it creates later are in it too. Throws
  /// LinkError.
  void enter_namespace(Side side) const;

  /// Starts a program in the namespace of `side`. All else is as in start_program.
  [[nodiscard]] pid_t start(Side side, std::vector<std::string> command) const;

  /// Replaces the profiles of both directions for later frames. Only with Medium::kRelay. Throws LinkError for settings
  /// out of range.
  void set_profiles(const LinkProfile& a_to_b, const LinkProfile& b_to_a);

  /// Figures of the relay; all zero with Medium::kVeth.
  [[nodiscard]] RelayFigures figures() const;
  /// Returns whether the relay runs at a real-time priority; true with Medium::kVeth.
  [[nodiscard]] bool realtime() const noexcept;

 private:
  struct Impl;
  LinkSettings settings_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::netem
