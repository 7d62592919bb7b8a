#include "tools/doctor/vulnerabilities.hpp"

namespace tactus::doctor {
namespace {

// Mitigations.
constexpr char kProcess[] =
    "the gateway ends or is taken over, not the servo: forces stay limited, and the HRTC starts another gateway; a "
    "host, client or viewer ends";
constexpr char kKeys[] =
    "with keys, the transport drops such messages before the library reads them; without keys, the gateway ends or is "
    "taken over, not the servo, and a host, client or viewer ends";
constexpr char kMembers[] = "Tactus checks the certificates of all members every 5 s itself";
constexpr char kOwnDocuments[] = "tactus keys writes these documents";
constexpr char kUnused[] = "Tactus does not use it";

using Versions = unsigned;
constexpr Versions kDebian12 = 1, kDebian13 = 2, kBoth = 3;
struct Entry {
  Versions open_in;
  Vulnerability vulnerability;
};
constexpr Entry kAll[] = {
    {kDebian12,
     {"CVE-2023-50257", 1, "state that a participant has left", "one packet",
      "with keys, the transport drops such messages; without keys, use one machine or a trusted network"}},
    {kDebian12, {"CVE-2024-28231", 1, "heap overflow in the handling of samples", "one packet", kKeys}},
    {kDebian12, {"CVE-2024-30258, 30259", 2, "crash or overflow by malformed RTPS", "one packet", kKeys}},
    {kDebian12, {"CVE-2025-24807", 1, "permissions of an expired authority", "keys", kMembers}},
    {kBoth,
     {"CVE-2025-62599 to 62603, 64098", 6, "overflow or lack of memory by security tokens",
      "one packet, if the session uses keys", kProcess}},
    {kBoth,
     {"CVE-2025-62799, 65865, 2026-22590", 3, "buffer overflow in the handling of fragments", "one packet", kKeys}},
    {kBoth, {"CVE-2025-64438", 1, "endless loop and lack of memory", "one packet", kKeys}},
    {kBoth, {"CVE-2025-65016", 1, "wrong order of notifications", "one packet", kKeys}},
    {kBoth, {"CVE-2025-63829", 1, "endless loop by times in QoS", "one packet", kProcess}},
    {kBoth, {"CVE-2025-67108", 1, "stay in the session after the certificate has expired", "a certificate", kMembers}},
    {kBoth, {"CVE-2026-22591", 1, "large filter expression", "one packet", kProcess}},
    {kBoth, {"CVE-2026-45092", 1, "lack of memory", "many packets, if the session uses keys", kProcess}},
    {kBoth, {"CVE-2026-45093, 53588", 2, "wrong framing of TCP", "TCP", kUnused}},
    {kBoth, {"CVE-2026-45094 to 45096", 3, "crash by governance or permissions", "a local file", kOwnDocuments}},
    {kDebian13, {"CVE-2026-45097", 1, "bounds in dynamic data", "dynamic types", kUnused}},
    {kBoth,
     {"CVE-2026-45098, 49861 to 49863, 53589, 53590, 55063", 7, "further missing bounds in the decoder", "one packet",
      kProcess}}};

}  // namespace

std::vector<Vulnerability> vulnerabilities(const std::string& version) {
  const Versions wanted = version.starts_with("2.9.") ? kDebian12 : version.starts_with("3.1.") ? kDebian13 : 0u;
  std::vector<Vulnerability> open;
  for (const Entry& entry : kAll)
    if ((entry.open_in & wanted) != 0) open.push_back(entry.vulnerability);
  return open;
}

std::string text(const std::vector<Vulnerability>& open, const std::string& version) {
  if (open.empty()) return "no list for Fast DDS " + version + "; expected 2.9 or 3.1\n";
  std::string all =
      "Published vulnerabilities without a correction in the Debian package of Fast DDS " + version + ":\n";
  for (const Vulnerability& one : open) {
    all.append("\n").append(one.ids).append("\n  impact:       ").append(one.impact);
    all.append("\n  precondition: ")
        .append(one.precondition)
        .append("\n  mitigation:   ")
        .append(one.mitigation)
        .append("\n");
  }
  return all;
}

}  // namespace tactus::doctor
