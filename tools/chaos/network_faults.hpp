/// Drops received packets of a session, by a rule of nftables. Needs root and the program nft.
#pragma once

#include <string>

namespace tactus::chaos {

class NetworkFaults {
 public:
  /// `domain`: first of the three DDS domains of the session. Removes the rules that a killed program has left.
  explicit NetworkFaults(int domain);
  ~NetworkFaults();
  NetworkFaults(const NetworkFaults&) = delete;
  NetworkFaults& operator=(const NetworkFaults&) = delete;

  /// Returns why this machine cannot drop packets, or an empty string.
  [[nodiscard]] static std::string obstacle();
  /// Drops `percent` of the packets that arrive for the session's domains in this process's network namespace, also
  /// those from the machine itself, for `seconds`. The kernel ends the fault even if this process is killed. Throws
  /// std::runtime_error.
  void lose(int percent, double seconds);
  /// Ends the fault.
  void end();

 private:
  int domain_;
};

}  // namespace tactus::chaos
