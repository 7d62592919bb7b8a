#include "tools/chaos/network_faults.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <stdexcept>

namespace tactus::chaos {
namespace {

/// The table of a domain, so that a run in another domain removes only its own.
std::string table_of(int domain) { return "table inet tactus_chaos_" + std::to_string(domain); }
std::string removal_of(const std::string& table) { return "add " + table + "\ndelete " + table + "\n"; }

/// Runs a script of nft. Returns whether nft has accepted it.
bool run_nft(const std::string& script, bool is_quiet) {
  std::FILE* const input = ::popen(is_quiet ? "/usr/sbin/nft -f - 2>/dev/null" : "/usr/sbin/nft -f -", "w");
  if (input == nullptr) return false;
  std::fputs(script.c_str(), input);
  return ::pclose(input) == 0;
}

}  // namespace

NetworkFaults::NetworkFaults(int domain) : domain_{domain} { end(); }

NetworkFaults::~NetworkFaults() { end(); }

std::string NetworkFaults::obstacle() {
  if (::access("/usr/sbin/nft", X_OK) != 0) return "there is no /usr/sbin/nft (Debian: apt-get install nftables)";
  if (::geteuid() != 0) return "they need root";
  if (!run_nft(removal_of(table_of(0)), true)) return "nft is refused, as in a container without CAP_NET_ADMIN";
  return {};
}

void NetworkFaults::lose(int percent, double seconds) {
  constexpr int kFirstPort = 7400, kPortsOfADomain = 250, kDomains = 3;  // of RTPS (wire/address/address.hpp)
  const int first = kFirstPort + kPortsOfADomain * domain_, last = first + kPortsOfADomain * kDomains - 1;
  const std::string share = percent >= 100 ? "" : "numgen random mod 100 < " + std::to_string(percent);
  const std::string table = table_of(domain_);
  char rules[600];
  // The set makes the kernel end the fault: its only element has a time limit. The ports are those of any transport
  // header ("th"), because nft 1.1 refuses those of UDP beside a set of protocols.
  std::snprintf(rules, sizeof rules,
                "%s {\n"
                "  set active { type inet_proto; flags timeout; elements = { udp timeout %ldms } }\n"
                "  chain in {\n"
                "    type filter hook input priority -10; policy accept;\n"
                "    meta l4proto @active th dport %d-%d %s drop\n"
                "  }\n"
                "}\n",
                table.c_str(), std::max(1L, std::lround(seconds * 1e3)), first, last, share.c_str());
  if (!run_nft(removal_of(table) + rules, false)) throw std::runtime_error("nft refuses a rule for packets to lose");
}

void NetworkFaults::end() { (void)run_nft(removal_of(table_of(domain_)), true); }

}  // namespace tactus::chaos
