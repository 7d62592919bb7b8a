#include "latency/cell.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

namespace tactus::latency {
namespace {

void check_range(const char* what, double value, double low, double high) {
  if (value >= low && value <= high) return;
  char text[128];
  std::snprintf(text, sizeof text, "%s is %g; expected %g to %g", what, value, low, high);
  throw LatencyError(text);
}

template <class Enum, std::size_t n>
Enum from_name(const char* axis, const std::string& name, const std::array<const char*, n>& names) {
  std::string expected;
  for (std::size_t i = 0; i < n; ++i) {
    if (name == names[i]) return static_cast<Enum>(i);
    expected += std::string{i == 0 ? "" : ", "} + names[i];
  }
  throw LatencyError(std::string{axis} + " is '" + name + "'; expected " + expected);
}

}  // namespace

bool has_cyclone() noexcept { return TACTUS_HAS_CYCLONE != 0; }

void check(const Cell& cell) {
  constexpr double kMaxArrivals = 1e7;  // stored on both sides, 24 bytes each
  const bool raw = cell.transport == Transport::kRawUdp;
  if (cell.transport == Transport::kCyclone) {
    if (!has_cyclone()) throw LatencyError("transport cyclone: built without Cyclone DDS (Debian: cyclonedds-dev)");
    if (cell.topic != Topic::kProbeState || (cell.load_mbit != 0 && cell.load_mbit != kUnpaced))
      throw LatencyError(
          "transport cyclone: expected topic probe_state, and a load of 0 or max: it cannot pace a writer");
  }
  if (cell.profile == Profile::kTuned && cell.transport != Transport::kUdp)
    throw LatencyError("profile tuned: expected transport udp");
  check_range("rate, Hz,", cell.rate_hz, 0.1, 20'000);
  if (cell.coding == Coding::kDeadbandCoded && cell.topic != Topic::kProbeState)
    throw LatencyError("coding coded: expected topic probe_state");
  check_range("readers", cell.readers, 1, 64);
  check_range("seconds", cell.seconds, 0.1, 3600);
  check_range("rate x seconds", cell.rate_hz * cell.seconds, 10, kMaxArrivals);
  check_range("rate x seconds x readers", cell.rate_hz * cell.seconds * cell.readers, 10, kMaxArrivals);
  if (cell.load_mbit != kUnpaced) check_range("load, Mbit/s,", cell.load_mbit, 0, 100'000);
  if (raw) {
    check_range("payload, bytes,", cell.payload, kMinPayload, 1472);
  } else if (cell.topic == Topic::kRecords) {
    check_range("payload of records, bytes,", cell.payload, kMinPayload, 1200);
  } else if (cell.payload != kProbeStateBytes) {
    throw LatencyError("payload, bytes, is " + std::to_string(cell.payload) + "; a probe state always has " +
                       std::to_string(kProbeStateBytes) +
                       ": choose payloads with --topic records or --transport raw-udp");
  }
  if (cell.link != "none" && (cell.transport == Transport::kShm || cell.transport == Transport::kBuiltin))
    throw LatencyError(std::string{"transport "} + kTransportNames[static_cast<std::size_t>(cell.transport)] +
                       " bypasses link " + cell.link +
                       ": shared memory is common to both sides; expected udp or raw-udp");
}

std::string describe(const Cell& cell) {
  char text[160];
  std::string label = kTransportNames[static_cast<std::size_t>(cell.transport)];
  if (cell.transport != Transport::kRawUdp && cell.transport != Transport::kCyclone)
    label += std::string{" "} + kProfileNames[static_cast<std::size_t>(cell.profile)] + " " +
             kTopicNames[static_cast<std::size_t>(cell.topic)];
  const char* const coded = cell.coding == Coding::kDeadbandCoded ? " coded" : "";
  std::snprintf(text, sizeof text, " %u B %g Hz%s x%u", cell.payload, cell.rate_hz, coded, cell.readers);
  label += text;
  if (cell.load_mbit == kUnpaced) {
    label += ", load unpaced";
  } else if (cell.load_mbit > 0) {
    std::snprintf(text, sizeof text, ", load %g Mbit/s", cell.load_mbit);
    label += text;
  }
  return cell.link == "none" ? label : label + ", link " + cell.link;
}

nlohmann::ordered_json to_json(const Cell& cell) {
  return {{"transport", kTransportNames[static_cast<std::size_t>(cell.transport)]},
          {"profile", kProfileNames[static_cast<std::size_t>(cell.profile)]},
          {"topic", kTopicNames[static_cast<std::size_t>(cell.topic)]},
          {"payload", cell.payload},
          {"rate_hz", cell.rate_hz},
          {"coding", kCodingNames[static_cast<std::size_t>(cell.coding)]},
          {"readers", cell.readers},
          {"load_mbit", cell.load_mbit},
          {"link", cell.link},
          {"seconds", cell.seconds}};
}

Cell cell_from_json(const nlohmann::ordered_json& json) try {
  Cell cell;
  cell.transport = from_name<Transport>("transport", json.at("transport").get<std::string>(), kTransportNames);
  cell.profile = from_name<Profile>("profile", json.at("profile").get<std::string>(), kProfileNames);
  cell.topic = from_name<Topic>("topic", json.at("topic").get<std::string>(), kTopicNames);
  json.at("payload").get_to(cell.payload);
  json.at("rate_hz").get_to(cell.rate_hz);
  cell.coding = from_name<Coding>("coding", json.at("coding").get<std::string>(), kCodingNames);
  json.at("readers").get_to(cell.readers);
  json.at("load_mbit").get_to(cell.load_mbit);
  json.at("link").get_to(cell.link);
  json.at("seconds").get_to(cell.seconds);
  check(cell);
  return cell;
} catch (const nlohmann::json::exception& error) {
  throw LatencyError(std::string{"cell: "} + error.what());
}

std::vector<Cell> Grid::cells() const {
  std::vector<Cell> all;
  Cell cell;
  cell.seconds = seconds;
  const auto add = [&] {
    check(cell);
    all.push_back(cell);
  };
  const std::vector<std::uint32_t> sizes = payloads.empty() ? std::vector<std::uint32_t>{kProbeStateBytes} : payloads;
  std::vector<std::pair<double, Coding>> paces;
  for (const double rate : rates)
    for (const Coding coding : codings) paces.emplace_back(rate, coding);
  for (std::uint32_t round = 0; round < repeat; ++round)
    for (const std::string& link : links)
      for (const double load : loads)
        for (const std::uint32_t count : readers)
          for (const auto& [rate, coding] : paces)
            for (const std::uint32_t size : sizes)
              for (const Transport transport : transports)
                for (const Profile profile : profiles)
                  for (const Topic topic : topics) {
                    const bool repeats = (transport == Transport::kRawUdp || transport == Transport::kCyclone) &&
                                         (profile != profiles.front() || topic != topics.front());
                    if (repeats) continue;
                    cell.transport = transport;
                    cell.profile = profile;
                    cell.topic = topic;
                    cell.payload = size;
                    cell.rate_hz = rate;
                    cell.coding = coding;
                    cell.readers = count;
                    cell.load_mbit = load;
                    cell.link = link;
                    add();
                  }
  return all;
}

}  // namespace tactus::latency
