#include "latency/measure.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "latency/carrier.hpp"
#include "latency/load.hpp"
#include "latency/schedule.hpp"
#include "latency/serve_process.hpp"
#include "realtime/realtime.hpp"

namespace tactus::latency {
namespace {

using namespace std::chrono_literals;

constexpr int kVersion = 2;  // of the protocol between the two sides
constexpr auto kAnswerTimeout = 30s;
constexpr auto kMatchTimeout = 20s;    // discovery over a lossy link takes less
constexpr auto kLastEchoTimeout = 2s;  // after the last ping

/// Identifies the CLOCK_MONOTONIC of this process: boot of the kernel, and time namespace.
std::string clock_identity() {
  std::string id;
  std::getline(std::ifstream{"/proc/sys/kernel/random/boot_id"}, id);
  std::error_code none;
  return id + std::filesystem::read_symlink("/proc/self/ns/time", none).string();
}

wire::SessionAddress address_of(const std::string& session, const std::string& participant, const SideSettings& side) {
  wire::SessionAddress address;
  address.session = session;
  address.participant = participant;
  address.domain = side.domain;
  address.discovery = side.discovery;
  address.qos = side.qos;
  address.keys = side.keys;
  address.is_test = true;
  address.naming = wire::Naming::kInstance;
  address.probe_priority = side.priority;
  return address;
}

#if !TACTUS_HAS_CYCLONE
}  // namespace
std::unique_ptr<Carrier> make_cyclone(Role, int, int, OnPacket) { throw LatencyError("built without Cyclone DDS"); }
std::unique_ptr<LoadSource> make_cyclone_load(int) { throw LatencyError("built without Cyclone DDS"); }
std::unique_ptr<LoadSink> make_cyclone_sink(int, double) { throw LatencyError("built without Cyclone DDS"); }
namespace {
#endif

/// One end of the load of a Cyclone DDS test, in a process of its own that runs serve_load. In one process, the domains
/// of pings and load would share locks; in separate processes they do not.
class CycloneLoad final : public LoadSource, public LoadSink {
 public:
  /// `end` is "source" or "sink".
  CycloneLoad(const char* end, double seconds, const SideSettings& side, const std::atomic<bool>& cancelled)
      : process_{"tactus-latency", {}, cancelled} {
    const int load_domain = side.domain + 1;  // the pings use side.domain
    process_.control().send({{"version", kVersion}, {"load", end}, {"domain", load_domain}, {"seconds", seconds}});
  }
  [[nodiscard]] bool matched() const noexcept override { return matched_; }
  void wait_for_match() {
    (void)process_.control().receive(kMatchTimeout);
    matched_ = true;
  }
  void start() override { process_.control().send({{"start", true}}); }
  [[nodiscard]] double bytes_per_s() override {
    process_.control().send({{"finish", true}});
    return process_.control().receive(kAnswerTimeout).at("bytes_per_s").get<double>();
  }

 private:
  ServeProcess process_;
  bool matched_ = false;
};

/// One reader of the pings: stores the arrival of each ping and echoes it.
class Echoer {
 public:
  Echoer(const TestCase& test, std::uint32_t number, const std::string& session, const SideSettings& side)
      : number_{number} {
    arrivals_.reserve(test.ticks() + test.ticks() / 4 + 1000);
    const auto callback = [this](const Packet& ping, std::int64_t now) { answer(ping, now); };
    if (test.transport == Transport::kRawUdp) {
      carrier_ = make_udp(Role::kEchoer, test.payload, {{}, {}, side.priority}, callback);
      port_ = port_of(*carrier_);
    } else if (test.transport == Transport::kCyclone) {
      carrier_ = make_cyclone(Role::kEchoer, side.domain, side.priority, callback);
    } else {
      participants_ = join_session(test, address_of(session, "echo-" + std::to_string(number), side));
      carrier_ = make_dds(Role::kEchoer, test, *participants_, callback);
    }
    ready_ = true;
  }
  [[nodiscard]] std::uint16_t port() const noexcept { return port_; }
  [[nodiscard]] wire::Participants* participants() const noexcept { return participants_.get(); }  ///< null: not DDS
  [[nodiscard]] bool matched() const noexcept { return port_ != 0 || carrier_->matched() > 0; }
  [[nodiscard]] bool realtime() const noexcept {
    return participants_ == nullptr || participants_->probe_is_realtime();
  }
  /// Ends the echoes and returns the arrivals.
  const std::vector<Arrival>& finish() {
    carrier_.reset();
    return arrivals_;
  }

 private:
  void answer(const Packet& ping, std::int64_t now) {
    if (!ready_) return;  // the constructor still makes the carrier
    carrier_->send({ping.sequence, number_, now, realtime::monotonic_ns()});
    if (arrivals_.size() < arrivals_.capacity()) arrivals_.push_back({ping.sequence, number_, now});
  }

  const std::uint32_t number_;
  std::atomic<bool> ready_{false};
  std::vector<Arrival> arrivals_;
  std::unique_ptr<wire::Participants> participants_;
  std::unique_ptr<Carrier> carrier_;
  std::uint16_t port_ = 0;
};

template <class Condition>
bool wait_until(Condition&& condition, std::chrono::milliseconds timeout, const std::atomic<bool>& cancelled) {
  const auto end = std::chrono::steady_clock::now() + timeout;
  while (!condition()) {
    if (cancelled) throw LatencyError("interrupted");
    if (std::chrono::steady_clock::now() >= end) return false;
    std::this_thread::sleep_for(5ms);  // nothing notifies of a match; nothing is measured now
  }
  return true;
}

/// Runs one end of the load of a Cyclone DDS test until the process that requested it finishes or closes.
void serve_load(const nlohmann::ordered_json& requested, ControlConnection& control,
                const std::atomic<bool>& cancelled) {
  const int domain = requested.at("domain").get<int>();
  if (requested.at("load").get<std::string>() == "sink") {
    const std::unique_ptr<LoadSink> sink = make_cyclone_sink(domain, requested.at("seconds").get<double>());
    if (!control.wait()) return;
    (void)control.receive(kAnswerTimeout);
    control.send({{"bytes_per_s", sink->bytes_per_s()}});
    return;
  }
  const std::unique_ptr<LoadSource> source = make_cyclone_load(domain);
  if (!wait_until([&] { return source->matched(); }, kMatchTimeout, cancelled))
    throw LatencyError("the load of Cyclone DDS found no reader within 20 s");
  control.send({{"matched", true}});
  (void)control.receive(kAnswerTimeout + kMatchTimeout);
  source->start();
  (void)control.wait();
}

void serve_test(const nlohmann::ordered_json& requested, ControlConnection& control, SideSettings side,
                const std::atomic<bool>& cancelled) {
  if (requested.value("version", 0) != kVersion)
    throw LatencyError("version " + std::to_string(requested.value("version", 0)) + " of the other side; expected " +
                       std::to_string(kVersion) + ": use the same release on both sides");
  if (requested.contains("load")) return serve_load(requested, control, cancelled);
  const TestCase test = test_from_json(requested.at("cell"));
  const auto session = requested.at("session").get<std::string>();
  requested.at("domain").get_to(side.domain);
  side.priority = std::clamp(requested.at("priority").get<int>(), 0, side.priority);

  std::vector<std::unique_ptr<Echoer>> echoers;
  nlohmann::ordered_json ports = nlohmann::ordered_json::array();
  bool realtime = true;
  for (std::uint32_t i = 0; i < test.readers; ++i) {
    echoers.push_back(std::make_unique<Echoer>(test, i, session, side));
    ports.push_back(echoers.back()->port());
    realtime &= echoers.back()->realtime();
  }
  std::unique_ptr<LoadSink> sink;
  wire::Participants* const shared = test.profile == Profile::kShared ? echoers.front()->participants() : nullptr;
  if (test.load_mbit != 0 && test.transport == Transport::kCyclone)
    sink = std::make_unique<CycloneLoad>("sink", test.seconds, side, cancelled);
  else if (test.load_mbit != 0)
    sink = std::make_unique<MeshSink>(test, address_of(session, "sink", side), 0, shared);
  control.send({{"ports", ports}, {"clock", clock_identity()}, {"realtime", realtime || side.priority == 0}});

  (void)control.receive(std::chrono::duration_cast<std::chrono::milliseconds>(kAnswerTimeout + kMatchTimeout));
  const bool matched = wait_until(
      [&] {
        for (const auto& echoer : echoers)
          if (!echoer->matched()) return false;
        return true;
      },
      kMatchTimeout, cancelled);
  if (!matched) throw LatencyError("echoers found no pinger within 20 s");
  control.send({{"matched", true}});

  (void)control.receive(std::chrono::milliseconds{static_cast<std::int64_t>(test.seconds * 2e3) + 60'000});
  std::vector<Arrival> arrivals;
  for (const auto& echoer : echoers) {
    const std::vector<Arrival>& own = echoer->finish();
    arrivals.insert(arrivals.end(), own.begin(), own.end());
  }
  control.send({{"arrivals", arrivals.size()}, {"load_bytes_per_s", sink ? sink->bytes_per_s() : 0.0}});
  control.send_block(arrivals.data(), arrivals.size() * sizeof(Arrival));
}

/// Makes the load of the test; null if it has none.
std::unique_ptr<LoadSource> make_load(const TestCase& test, const std::string& session, const SideSettings& side,
                                      wire::Participants* shared, const std::atomic<bool>& cancelled) {
  if (test.load_mbit == 0) return nullptr;
  if (test.transport != Transport::kCyclone)
    return std::make_unique<MeshSource>(test, address_of(session, "load", side), shared);
  auto source = std::make_unique<CycloneLoad>("source", test.seconds, side, cancelled);
  source->wait_for_match();
  return source;
}

/// Sends the pings in `selection`, or all if it is empty, each at its intended time.
void send_pings(const TestCase& test, const PingSelection& selection, Carrier& carrier, Timestamps& timestamps,
                const std::atomic<bool>& cancelled) {
  const double period_ns = 1e9 / test.rate_hz;
  const std::int64_t start = realtime::monotonic_ns() + 20'000'000;
  const std::int64_t give_up = start + static_cast<std::int64_t>(test.seconds * 1e9) + 1'000'000'000;
  const std::vector<std::uint32_t> ticks = ticks_of(test);
  for (std::size_t i = 0; i < timestamps.pings.size(); ++i)
    timestamps.pings[i].intended_ns = start + static_cast<std::int64_t>(ticks[i] * period_ns);
  const std::size_t count = selection.empty() ? timestamps.pings.size() : selection.size();
  for (std::uint32_t number = 0; number < count; ++number) {
    const std::uint32_t i = selection.empty() ? number : selection[number];
    Ping& ping = timestamps.pings.at(i);
    if (cancelled) throw LatencyError("interrupted");
    if (realtime::monotonic_ns() < ping.intended_ns) {
      realtime::sleep_until(ping.intended_ns);
      ping.waited = true;
    }
    const std::int64_t now = realtime::monotonic_ns();
    if (now > give_up) return;
    ping.sent_ns = now;
    ping.refused = !carrier.send({i, 0, ping.intended_ns, now});
  }
}

}  // namespace

Timestamps measure(const TestCase& test, ControlConnection& control, const SideSettings& side,
                   const std::atomic<bool>& cancelled, const PingSelection& selection) {
  static std::atomic<int> count{0};
  const std::string session = "latency." + std::to_string(::getpid()) + "." + std::to_string(++count);
  control.send({{"version", kVersion},
                {"cell", to_json(test)},
                {"session", session},
                {"domain", side.domain},
                {"priority", side.priority}});
  const auto answer = control.receive(kAnswerTimeout);

  Timestamps timestamps;
  timestamps.test = test;
  timestamps.pings.resize(ticks_of(test).size());
  timestamps.shares_clock = answer.at("clock").get<std::string>() == clock_identity();
  if (!answer.at("realtime").get<bool>()) timestamps.notes.emplace_back("echoers: no real-time priority");

  // The carrier's thread writes the echoes; this thread reads them after the carrier's thread has ended.
  timestamps.echoes.reserve(static_cast<std::size_t>(test.ticks()) * test.readers * 5 / 4 + 1000);
  std::atomic<std::size_t> received{0};
  const auto callback = [&](const Packet& echo, std::int64_t now) {
    if (timestamps.echoes.size() == timestamps.echoes.capacity()) return;
    timestamps.echoes.push_back({echo.sequence, echo.reader, echo.event_ns, echo.sent_ns, now});
    received = timestamps.echoes.size();
  };
  std::unique_ptr<wire::Participants> participants;
  std::unique_ptr<Carrier> carrier;
  if (test.transport == Transport::kRawUdp) {
    carrier =
        make_udp(Role::kPinger, test.payload,
                 {side.echo_address, answer.at("ports").get<std::vector<std::uint16_t>>(), side.priority}, callback);
  } else if (test.transport == Transport::kCyclone) {
    carrier = make_cyclone(Role::kPinger, side.domain, side.priority, callback);
  } else {
    participants = join_session(test, address_of(session, "ping", side));
    carrier = make_dds(Role::kPinger, test, *participants, callback);
  }
  wire::Participants* const shared = test.profile == Profile::kShared ? participants.get() : nullptr;
  std::unique_ptr<LoadSource> load = make_load(test, session, side, shared, cancelled);
  const auto matched = [&] { return carrier->matched() >= test.readers && (!load || load->matched()); };
  if (!wait_until(matched, kMatchTimeout, cancelled))
    throw LatencyError(
        "found " + std::to_string(carrier->matched()) + " of " + std::to_string(test.readers) +
        " readers within 20 s; expected all: does the network pass multicast to 239.255.0.1, and do both sides have "
        "the same domain and discovery?");
  control.send({{"met", true}});
  (void)control.receive(std::chrono::duration_cast<std::chrono::milliseconds>(kAnswerTimeout + kMatchTimeout));

  if (load) load->start();
  // Only now, because threads inherit the priority of the thread that creates them.
  timestamps.notes.push_back(side.priority > 0 ? realtime::enter_realtime("pinger", side.priority)
                                               : "pinger: no real-time priority requested");
  send_pings(test, selection, *carrier, timestamps, cancelled);
  const std::size_t all = (selection.empty() ? timestamps.pings.size() : selection.size()) * test.readers;
  (void)wait_until([&] { return received >= all; }, kLastEchoTimeout, cancelled);
  load.reset();
  carrier.reset();

  control.send({{"finish", true}});
  const auto result = control.receive(kAnswerTimeout);
  const auto arrivals = result.at("arrivals").get<std::size_t>();
  if (arrivals > 2 * all + 1000 * test.readers)
    throw LatencyError("the other side reports " + std::to_string(arrivals) + " arrivals; expected about " +
                       std::to_string(all));
  timestamps.arrivals.resize(arrivals);
  control.receive_block(timestamps.arrivals.data(), arrivals * sizeof(Arrival), kAnswerTimeout);
  result.at("load_bytes_per_s").get_to(timestamps.load_bytes_per_s);
  return timestamps;
}

void serve(ControlConnection& control, const SideSettings& side, const std::atomic<bool>& cancelled) {
  try {
    while (control.wait()) serve_test(control.receive(kAnswerTimeout), control, side, cancelled);
  } catch (const std::exception& error) {
    try {
      control.send({{"error", error.what()}});
    } catch (const LatencyError&) {  // the other side has closed
    }
    throw LatencyError(error.what());
  }
}

}  // namespace tactus::latency
