#include "latency/measure.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "latency/carrier.hpp"
#include "latency/helper.hpp"
#include "latency/load.hpp"
#include "latency/schedule.hpp"
#include "wire/realtime.hpp"

namespace tactus::latency {
namespace {

using namespace std::chrono_literals;

constexpr int kVersion = 2;  // of the protocol between the two sides
constexpr auto kAnswerTimeout = 30s;
constexpr auto kMatchTimeout = 20s;  // time for discovery, long enough for a lossy link
constexpr auto kLastEchoes = 2s;

/// Equal on two sides that read the same CLOCK_MONOTONIC: one boot of one kernel, one time namespace.
std::string clock_id() {
  std::string id;
  std::getline(std::ifstream{"/proc/sys/kernel/random/boot_id"}, id);
  std::error_code none;
  return id + std::filesystem::read_symlink("/proc/self/ns/time", none).string();
}

wire::SessionAddress address_of(const std::string& session, const std::string& who, const SideSettings& side) {
  wire::SessionAddress address;
  address.session = session;
  address.participant = who;
  address.domain = side.domain;
  address.discovery = side.discovery;
  address.qos = side.qos;
  address.probe_priority = side.priority;
  return address;
}

#if !TACTUS_HAS_CYCLONE
}  // namespace
std::unique_ptr<Carrier> make_cyclone(Part, int, int, OnPacket) { throw LatencyError("built without Cyclone DDS"); }
std::unique_ptr<LoadSource> make_cyclone_load(int) { throw LatencyError("built without Cyclone DDS"); }
std::unique_ptr<LoadSink> make_cyclone_sink(int) { throw LatencyError("built without Cyclone DDS"); }
namespace {
#endif

/// The load of a Cyclone DDS test has a process of its own at each side, as programs of Cyclone DDS on one machine
/// would: within a process, its domains share locks. In it runs serve_load.
class CycloneLoad final : public LoadSource, public LoadSink {
 public:
  CycloneLoad(const char* end, const SideSettings& side, const std::atomic<bool>& stop)
      : helper_{"tactus-latency", {}, stop} {
    constexpr int kLoadDomain = 1;  // after that of the pings
    helper_.channel().send({{"version", kVersion}, {"load", end}, {"domain", side.domain + kLoadDomain}});
  }
  [[nodiscard]] bool matched() const noexcept override { return matched_; }
  /// Waits for the match.
  void meet() {
    (void)helper_.channel().receive(kMatchTimeout);
    matched_ = true;
  }
  void start() override { helper_.channel().send({{"start", true}}); }
  [[nodiscard]] double bytes_per_s() override {
    helper_.channel().send({{"finish", true}});
    return helper_.channel().receive(kAnswerTimeout).at("bytes_per_s").get<double>();
  }

 private:
  Helper helper_;
  bool matched_ = false;
};

/// One reader: records each ping and answers it.
class Echoer {
 public:
  Echoer(const Cell& cell, std::uint32_t number, const std::string& session, const SideSettings& side)
      : number_{number} {
    arrivals_.reserve(cell.pings() + cell.pings() / 4 + 1000);
    const auto callback = [this](const Packet& ping, std::int64_t now) { answer(ping, now); };
    if (cell.transport == Transport::kRawUdp) {
      carrier_ = make_udp(Part::kEchoer, cell.payload, {{}, {}, side.priority}, callback);
      port_ = port_of(*carrier_);
    } else if (cell.transport == Transport::kCyclone) {
      carrier_ = make_cyclone(Part::kEchoer, side.domain, side.priority, callback);
    } else {
      participants_ = join(cell, address_of(session, "echo-" + std::to_string(number), side));
      carrier_ = make_dds(Part::kEchoer, cell, *participants_, callback);
    }
    ready_ = true;
  }
  [[nodiscard]] std::uint16_t port() const noexcept { return port_; }
  [[nodiscard]] wire::Participants* participants() const noexcept { return participants_.get(); }  ///< null: raw UDP
  [[nodiscard]] bool matched() const noexcept { return port_ != 0 || carrier_->matched() > 0; }
  [[nodiscard]] bool realtime() const noexcept {
    return participants_ == nullptr || participants_->probe_is_realtime();
  }
  /// Stops listening.
  const std::vector<Arrival>& finish() {
    carrier_.reset();
    return arrivals_;
  }

 private:
  void answer(const Packet& ping, std::int64_t now) {
    if (!ready_) return;  // the carrier cannot answer yet
    carrier_->send({ping.sequence, number_, now, wire::monotonic_ns()});
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
bool wait_until(Condition&& condition, std::chrono::milliseconds patience, const std::atomic<bool>& stop) {
  const auto end = std::chrono::steady_clock::now() + patience;
  while (!condition()) {
    if (stop) throw LatencyError("interrupted");
    if (std::chrono::steady_clock::now() >= end) return false;
    std::this_thread::sleep_for(5ms);  // readers and writers match without notification; not in a timed phase
  }
  return true;
}

/// One end of the load of a Cyclone DDS test, until the other side finishes it or closes.
void serve_load(const nlohmann::ordered_json& requested, Channel& channel, const std::atomic<bool>& stop) {
  const int domain = requested.at("domain").get<int>();
  if (requested.at("load").get<std::string>() == "sink") {
    const std::unique_ptr<LoadSink> sink = make_cyclone_sink(domain);
    if (!channel.wait()) return;
    (void)channel.receive(kAnswerTimeout);
    channel.send({{"bytes_per_s", sink->bytes_per_s()}});
    return;
  }
  const std::unique_ptr<LoadSource> source = make_cyclone_load(domain);
  if (!wait_until([&] { return source->matched(); }, kMatchTimeout, stop))
    throw LatencyError("the load of Cyclone DDS found no reader within 20 s");
  channel.send({{"matched", true}});
  (void)channel.receive(kAnswerTimeout + kMatchTimeout);
  source->start();
  (void)channel.wait();
}

void serve_one(const nlohmann::ordered_json& requested, Channel& channel, SideSettings side,
               const std::atomic<bool>& stop) {
  if (requested.value("version", 0) != kVersion)
    throw LatencyError("version " + std::to_string(requested.value("version", 0)) + " of the other side; expected " +
                       std::to_string(kVersion) + ": use the same release on both sides");
  if (requested.contains("load")) return serve_load(requested, channel, stop);
  const Cell cell = cell_from_json(requested.at("cell"));
  const auto session = requested.at("session").get<std::string>();
  requested.at("domain").get_to(side.domain);
  side.priority = std::clamp(requested.at("priority").get<int>(), 0, side.priority);

  std::vector<std::unique_ptr<Echoer>> echoers;
  nlohmann::ordered_json ports = nlohmann::ordered_json::array();
  bool realtime = true;
  for (std::uint32_t i = 0; i < cell.readers; ++i) {
    echoers.push_back(std::make_unique<Echoer>(cell, i, session, side));
    ports.push_back(echoers.back()->port());
    realtime &= echoers.back()->realtime();
  }
  std::unique_ptr<LoadSink> sink;
  wire::Participants* const shared = cell.profile == Profile::kShared ? echoers.front()->participants() : nullptr;
  if (cell.load_mbit != 0 && cell.transport == Transport::kCyclone)
    sink = std::make_unique<CycloneLoad>("sink", side, stop);
  else if (cell.load_mbit != 0)
    sink = std::make_unique<Sink>(cell, address_of(session, "sink", side), 0, shared);
  channel.send({{"ports", ports}, {"clock", clock_id()}, {"realtime", realtime || side.priority == 0}});

  (void)channel.receive(std::chrono::duration_cast<std::chrono::milliseconds>(kAnswerTimeout + kMatchTimeout));
  const bool met = wait_until(
      [&] {
        for (const auto& echoer : echoers)
          if (!echoer->matched()) return false;
        return true;
      },
      kMatchTimeout, stop);
  if (!met) throw LatencyError("echoers found no pinger within 20 s");
  channel.send({{"matched", true}});

  (void)channel.receive(std::chrono::milliseconds{static_cast<std::int64_t>(cell.seconds * 2e3) + 60'000});
  std::vector<Arrival> arrivals;
  for (const auto& echoer : echoers) {
    const std::vector<Arrival>& own = echoer->finish();
    arrivals.insert(arrivals.end(), own.begin(), own.end());
  }
  channel.send({{"arrivals", arrivals.size()}, {"load_bytes_per_s", sink ? sink->bytes_per_s() : 0.0}});
  channel.send_block(arrivals.data(), arrivals.size() * sizeof(Arrival));
}

/// Sends the pings of a cell on time: those in `plan`, or all.
void send_pings(const Cell& cell, const Plan& plan, Carrier& carrier, Stamps& stamps, const std::atomic<bool>& stop) {
  const double period_ns = 1e9 / cell.rate_hz;
  const std::int64_t start = wire::monotonic_ns() + 20'000'000;
  const std::int64_t give_up = start + static_cast<std::int64_t>(cell.seconds * 1e9) + 1'000'000'000;
  const std::vector<std::uint32_t> ticks = ticks_of(cell);
  for (std::size_t i = 0; i < stamps.pings.size(); ++i)
    stamps.pings[i].intended_ns = start + static_cast<std::int64_t>(ticks[i] * period_ns);
  const std::size_t count = plan.empty() ? stamps.pings.size() : plan.size();
  for (std::uint32_t number = 0; number < count; ++number) {
    const std::uint32_t i = plan.empty() ? number : plan[number];
    Ping& ping = stamps.pings.at(i);
    if (stop) throw LatencyError("interrupted");
    if (wire::monotonic_ns() < ping.intended_ns) {
      wire::sleep_until(ping.intended_ns);
      ping.waited = true;
    }
    const std::int64_t now = wire::monotonic_ns();
    if (now > give_up) return;
    ping.sent_ns = now;
    if (!carrier.send({i, 0, ping.intended_ns, now})) ++stamps.refused;
  }
}

}  // namespace

Stamps measure(const Cell& cell, Channel& channel, const SideSettings& side, const std::atomic<bool>& stop,
               const Plan& plan) {
  static std::atomic<int> count{0};
  const std::string session = "latency." + std::to_string(::getpid()) + "." + std::to_string(++count);
  channel.send({{"version", kVersion},
                {"cell", to_json(cell)},
                {"session", session},
                {"domain", side.domain},
                {"priority", side.priority}});
  const auto other = channel.receive(kAnswerTimeout);

  Stamps stamps;
  stamps.cell = cell;
  stamps.pings.resize(ticks_of(cell).size());
  stamps.one_clock = other.at("clock").get<std::string>() == clock_id();
  if (!other.at("realtime").get<bool>()) stamps.notes.emplace_back("echoers: no real-time priority");

  // Written by the carrier's thread, read after that thread has ended.
  stamps.echoes.reserve(static_cast<std::size_t>(cell.pings()) * cell.readers * 5 / 4 + 1000);
  std::atomic<std::size_t> received{0};
  const auto callback = [&](const Packet& echo, std::int64_t now) {
    if (stamps.echoes.size() == stamps.echoes.capacity()) return;
    stamps.echoes.push_back({echo.sequence, echo.reader, echo.event_ns, echo.sent_ns, now});
    received = stamps.echoes.size();
  };
  std::unique_ptr<wire::Participants> participants;
  std::unique_ptr<Carrier> carrier;
  if (cell.transport == Transport::kRawUdp) {
    carrier =
        make_udp(Part::kPinger, cell.payload,
                 {side.echo_address, other.at("ports").get<std::vector<std::uint16_t>>(), side.priority}, callback);
  } else if (cell.transport == Transport::kCyclone) {
    carrier = make_cyclone(Part::kPinger, side.domain, side.priority, callback);
  } else {
    participants = join(cell, address_of(session, "ping", side));
    carrier = make_dds(Part::kPinger, cell, *participants, callback);
  }
  std::unique_ptr<LoadSource> load;
  wire::Participants* const shared = cell.profile == Profile::kShared ? participants.get() : nullptr;
  if (cell.load_mbit != 0 && cell.transport == Transport::kCyclone) {
    auto source = std::make_unique<CycloneLoad>("source", side, stop);
    source->meet();
    load = std::move(source);
  } else if (cell.load_mbit != 0) {
    load = std::make_unique<Load>(cell, address_of(session, "load", side), shared);
  }
  const auto met = [&] { return carrier->matched() >= cell.readers && (!load || load->matched()); };
  if (!wait_until(met, kMatchTimeout, stop))
    throw LatencyError(
        "found " + std::to_string(carrier->matched()) + " of " + std::to_string(cell.readers) +
        " readers within 20 s; expected all: does multicast (239.255.0.1) pass, are domain and discovery the same?");
  channel.send({{"met", true}});
  (void)channel.receive(std::chrono::duration_cast<std::chrono::milliseconds>(kAnswerTimeout + kMatchTimeout));

  if (load) load->start();
  // Not earlier: threads created before would inherit the priority.
  stamps.notes.push_back(side.priority > 0 ? wire::enter_realtime("pinger", side.priority)
                                           : "pinger: no real-time priority requested");
  send_pings(cell, plan, *carrier, stamps, stop);
  const std::size_t all = (plan.empty() ? stamps.pings.size() : plan.size()) * cell.readers;
  (void)wait_until([&] { return received >= all; }, kLastEchoes, stop);
  load.reset();
  carrier.reset();

  channel.send({{"finish", true}});
  const auto result = channel.receive(kAnswerTimeout);
  const auto arrivals = result.at("arrivals").get<std::size_t>();
  if (arrivals > 2 * all + 1000 * cell.readers)
    throw LatencyError("the other side has " + std::to_string(arrivals) + " arrivals of " + std::to_string(all) +
                       " pings");
  stamps.arrivals.resize(arrivals);
  channel.receive_block(stamps.arrivals.data(), arrivals * sizeof(Arrival), kAnswerTimeout);
  result.at("load_bytes_per_s").get_to(stamps.load_bytes_per_s);
  return stamps;
}

void serve(Channel& channel, const SideSettings& side, const std::atomic<bool>& stop) {
  try {
    while (channel.wait()) serve_one(channel.receive(kAnswerTimeout), channel, side, stop);
  } catch (const std::exception& error) {
    try {
      channel.send({{"error", error.what()}});
    } catch (const LatencyError&) {  // the other side has closed
    }
    throw LatencyError(error.what());
  }
}

}  // namespace tactus::latency
