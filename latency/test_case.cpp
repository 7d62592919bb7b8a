#include "latency/test_case.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "wire/footprint.hpp"

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

void check(const TestCase& test) {
  constexpr double kMaxArrivals = 1e7;  // stored on both sides, 24 bytes each
  const bool raw = test.transport == Transport::kRawUdp;
  if (test.transport == Transport::kCyclone) {
    if (!has_cyclone()) throw LatencyError("transport cyclone: built without Cyclone DDS (Debian: cyclonedds-dev)");
    if (test.topic != Topic::kProbeState || (test.load_mbit != 0 && test.load_mbit != kUnpaced))
      throw LatencyError(
          "transport cyclone: expected topic probe_state, and a load of 0 or max: it cannot pace a writer");
  }
  if (test.profile == Profile::kTuned && test.transport != Transport::kUdp)
    throw LatencyError("profile tuned: expected transport udp");
  // Under this load, the flow control of version 3.1 ends the process with a failed assertion.
  if (test.profile == Profile::kTuned && !wire::library_version().starts_with("2."))
    throw LatencyError("profile tuned: expected Fast DDS 2.9, found " + wire::library_version());
  check_range("rate, Hz,", test.rate_hz, 0.1, 20'000);
  if (test.coding == Coding::kDeadbandCoded && test.topic != Topic::kProbeState)
    throw LatencyError("coding coded: expected topic probe_state");
  check_range("readers", test.readers, 1, 64);
  check_range("seconds", test.seconds, 0.1, 3600);
  check_range("rate x seconds", test.rate_hz * test.seconds, 10, kMaxArrivals);
  check_range("rate x seconds x readers", test.rate_hz * test.seconds * test.readers, 10, kMaxArrivals);
  if (test.load_mbit != kUnpaced) check_range("load, Mbit/s,", test.load_mbit, 0, 100'000);
  if (raw) {
    check_range("payload, bytes,", test.payload, kMinPayload, 1472);
  } else if (test.topic == Topic::kRecords) {
    check_range("payload of records, bytes,", test.payload, kMinPayload, 1200);
  } else if (test.payload != kProbeStateBytes) {
    throw LatencyError("payload, bytes, is " + std::to_string(test.payload) + "; a probe state always has " +
                       std::to_string(kProbeStateBytes) +
                       ": choose payloads with --topic records or --transport raw-udp");
  }
  if (test.link != "none" && (test.transport == Transport::kShm || test.transport == Transport::kBuiltin))
    throw LatencyError(std::string{"transport "} + kTransportNames[static_cast<std::size_t>(test.transport)] +
                       " bypasses link " + test.link +
                       ": shared memory is common to both sides; expected udp or raw-udp");
}

std::string describe(const TestCase& test) {
  char text[160];
  std::string label = kTransportNames[static_cast<std::size_t>(test.transport)];
  if (test.transport != Transport::kRawUdp && test.transport != Transport::kCyclone)
    label += std::string{" "} + kProfileNames[static_cast<std::size_t>(test.profile)] + " " +
             kTopicNames[static_cast<std::size_t>(test.topic)];
  const char* const coded = test.coding == Coding::kDeadbandCoded ? " coded" : "";
  std::snprintf(text, sizeof text, " %u B %g Hz%s x%u", test.payload, test.rate_hz, coded, test.readers);
  label += text;
  if (test.load_mbit == kUnpaced) {
    label += ", load unpaced";
  } else if (test.load_mbit > 0) {
    std::snprintf(text, sizeof text, ", load %g Mbit/s", test.load_mbit);
    label += text;
  }
  return test.link == "none" ? label : label + ", link " + test.link;
}

nlohmann::ordered_json to_json(const TestCase& test) {
  return {{"transport", kTransportNames[static_cast<std::size_t>(test.transport)]},
          {"profile", kProfileNames[static_cast<std::size_t>(test.profile)]},
          {"topic", kTopicNames[static_cast<std::size_t>(test.topic)]},
          {"payload", test.payload},
          {"rate_hz", test.rate_hz},
          {"coding", kCodingNames[static_cast<std::size_t>(test.coding)]},
          {"readers", test.readers},
          {"load_mbit", test.load_mbit},
          {"link", test.link},
          {"seconds", test.seconds}};
}

TestCase test_from_json(const nlohmann::ordered_json& json) try {
  TestCase test;
  test.transport = from_name<Transport>("transport", json.at("transport").get<std::string>(), kTransportNames);
  test.profile = from_name<Profile>("profile", json.at("profile").get<std::string>(), kProfileNames);
  test.topic = from_name<Topic>("topic", json.at("topic").get<std::string>(), kTopicNames);
  json.at("payload").get_to(test.payload);
  json.at("rate_hz").get_to(test.rate_hz);
  test.coding = from_name<Coding>("coding", json.at("coding").get<std::string>(), kCodingNames);
  json.at("readers").get_to(test.readers);
  json.at("load_mbit").get_to(test.load_mbit);
  json.at("link").get_to(test.link);
  json.at("seconds").get_to(test.seconds);
  check(test);
  return test;
} catch (const nlohmann::json::exception& error) {
  throw LatencyError(std::string{"test: "} + error.what());
}

std::vector<TestCase> Grid::tests() const {
  std::vector<TestCase> all;
  TestCase test;
  test.seconds = seconds;
  const auto add = [&] {
    check(test);
    all.push_back(test);
  };
  const std::vector<std::uint32_t> sizes = payloads.empty() ? std::vector<std::uint32_t>{kProbeStateBytes} : payloads;
  std::vector<std::pair<double, Coding>> paces;
  for (const double rate : rates)
    for (const Coding coding : codings) paces.emplace_back(rate, coding);
  for (std::uint32_t round = 0; round < repetitions; ++round)
    for (const std::string& link : links)
      for (const double load : loads)
        for (const std::uint32_t count : readers)
          for (const auto& [rate, coding] : paces)
            for (const std::uint32_t size : sizes)
              for (const Transport transport : transports)
                for (const Profile profile : profiles)
                  for (const Topic topic : topics) {
                    const bool is_repeated = (transport == Transport::kRawUdp || transport == Transport::kCyclone) &&
                                             (profile != profiles.front() || topic != topics.front());
                    if (is_repeated) continue;
                    test.transport = transport;
                    test.profile = profile;
                    test.topic = topic;
                    test.payload = size;
                    test.rate_hz = rate;
                    test.coding = coding;
                    test.readers = count;
                    test.load_mbit = load;
                    test.link = link;
                    add();
                  }
  return all;
}

}  // namespace tactus::latency
