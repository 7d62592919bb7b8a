// Measures the effect of many HRTCs on a host and on each other. Starts tactus-host and tactus-hrtc as a user does.
//
//   trouble   One HRTC is impaired: it is frozen, or it runs for a tenth of the time. Measures the delay of records and
//             probe states for the other programs, and the memory of the host. In a second series, all programs but the
//             impaired HRTC have real-time priority.
//   joining   32 HRTCs start within a second. Measures the time until the last of them has an exact contact. The tips
//             rest at 32 points, or move. Repeats this with fewer HRTCs. In a second session, measures the delay of
//             records and probe states for earlier programs before and while the HRTCs start.
//   secured   8 HRTCs start within a second, with keys and without.
//   coded     64 probes at 1 kHz, 8 to an HRTC, follow 64 paths. Compares the deadband-coded states that the HRTCs sent
//             with those that an observer received, and measures CPU time. Repeats this with fewer probes.
//   crowding  8 HRTCs follow one path. Divides the bytes that the host sends to 8 by the bytes that it sends to one.
//   state     Measures the heap that the delivery server of a host uses for 32 HRTCs and 10,000 regions.
#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cstdio>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "bench/counts.hpp"
#include "bench/fetcher.hpp"
#include "bench/latency_bench.hpp"
#include "bench/models.hpp"
#include "bench/process_status.hpp"
#include "bench/session_observer.hpp"
#include "bench/testbed.hpp"
#include "session/delivery_server.hpp"
#include "session/figures.hpp"
#include "spm/codec/model_codec.hpp"
#include "tests/support/process.hpp"

namespace tactus::bench {
namespace {

using e2e::Process;
using std::chrono::milliseconds;

constexpr std::int64_t kSecond = 1'000'000'000;

/// Terminates a program and waits for its end.
void terminate(Process& program) {
  program.signal(SIGTERM);
  (void)program.wait();
}

/// Waits until `done` returns true, which is tested every 5 ms. Returns false if `limit_ns` passes first.
template <class Done>
bool wait_until(std::int64_t limit_ns, Done&& done) {
  for (const std::int64_t until = realtime::monotonic_ns() + limit_ns; !done();
       std::this_thread::sleep_for(milliseconds{5}))
    if (realtime::monotonic_ns() > until || realtime::stop_signal()) return false;
  return true;
}

// ---- trouble

/// Gives this thread, and the programs and threads that it starts, the policy SCHED_RR, if the system grants it. Work
/// of other programs at ordinary priority then has no effect on a window's p99, the third largest of about 260 values.
class RealTimePriority {
 public:
  RealTimePriority() {
    const sched_param lowest{1};
    granted_ = pthread_setschedparam(pthread_self(), SCHED_RR, &lowest) == 0;
  }
  ~RealTimePriority() {
    const sched_param none{0};
    if (granted_) pthread_setschedparam(pthread_self(), SCHED_OTHER, &none);
  }
  RealTimePriority(const RealTimePriority&) = delete;
  RealTimePriority& operator=(const RealTimePriority&) = delete;
  [[nodiscard]] bool granted() const noexcept { return granted_; }

 private:
  bool granted_;
};

enum class Impairment { kNone, kFrozen, kThrottled };
enum class OthersPriority { kOrdinary, kRealTime };  // of all programs but the impaired HRTC

/// Results of the windows with one impairment, one sample a window.
struct WindowResults {
  Samples records_p99_ms, age_p99_us;
  Samples silence_ms;      // longest time without a probe state of the user whose ages are measured
  Samples host_growth_mb;  // of the memory of the host, without the pages of the files that it maps
};

/// Lets a process run for 10 ms of every 100 ms.
class Throttle {
 public:
  explicit Throttle(Process& program)
      : thread_{[this, &program] {
          while (!done_) {
            program.signal_all(SIGSTOP);
            std::this_thread::sleep_for(milliseconds{90});  // stopped
            program.signal_all(SIGCONT);
            std::this_thread::sleep_for(milliseconds{10});
          }
        }} {}
  ~Throttle() {
    done_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> done_{false};
  std::thread thread_;
};

void run_fetcher(Fetcher& fetcher, double seconds, Samples* times) {
  fetcher.run(realtime::monotonic_ns() + static_cast<std::int64_t>(seconds * 1e9), times);
}

/// Runs all windows with the others at priority `others`. Returns the results by Impairment.
std::array<WindowResults, 3> run_trouble(const Testbed& testbed, const ScaleSettings& settings, OthersPriority others) {
  const std::string session = others == OthersPriority::kOrdinary ? "trouble" : "trouble-rt";
  // The impaired HRTC represents an HRTC on another machine, which takes no CPU time from the others. Therefore its
  // priority is always ordinary.
  const std::vector<std::string> ordinary_priority{"--priority", "0"};
  const auto impaired = testbed.hrtc(session, "impaired", "fast", ordinary_priority);
  std::optional<RealTimePriority> real_time;
  if (others == OthersPriority::kRealTime && !real_time.emplace().granted())
    std::fprintf(stderr, "trouble: SCHED_RR is not permitted, so that other programs affect the times\n");
  const auto host = testbed.host(session);
  const auto healthy = testbed.hrtc(
      session, "healthy", "slow", others == OthersPriority::kOrdinary ? ordinary_priority : std::vector<std::string>{});
  SessionObserver observer{testbed.address(session, "observer")};
  Fetcher fetcher{testbed.address(session, "fetcher")};
  for (int tries = 0; !(fetcher.ready() && observer.exact_users() >= 2); ++tries) {
    if (tries > 100)
      throw std::runtime_error("the HRTCs have no exact contact:\n" + healthy->output() + impaired->output());
    run_fetcher(fetcher, 0.1, nullptr);
  }
  std::array<WindowResults, 3> runs;
  for (int window = 0; window < settings.windows && !realtime::stop_signal(); ++window) {
    std::fprintf(stderr, "trouble: %d of %d\n", window + 1, settings.windows);
    for (const Impairment impairment : {Impairment::kNone, Impairment::kFrozen, Impairment::kThrottled}) {
      run_fetcher(fetcher, 1, nullptr);  // the impaired HRTC recovers from the window before
      Samples times_ms, ages_us;
      observer.add_ages_of("healthy", &ages_us);
      const double host_bytes = status_bytes(host->pid(), "RssAnon");
      {
        std::optional<Throttle> throttle;
        if (impairment == Impairment::kFrozen) impaired->signal_all(SIGSTOP);
        if (impairment == Impairment::kThrottled) throttle.emplace(*impaired);
        run_fetcher(fetcher, settings.seconds, &times_ms);
      }
      const double silence_ms = observer.longest_silence_ms();
      fetcher.add_unanswered(times_ms);
      observer.add_ages_of("healthy", nullptr);
      const double host_bytes_after = status_bytes(host->pid(), "RssAnon");  // 0: the host has ended
      const double host_growth_mb = host_bytes_after > 0 ? (host_bytes_after - host_bytes) * 1e-6 : kUnfinished;
      impaired->signal_all(SIGCONT);
      WindowResults& results = runs[static_cast<std::size_t>(impairment)];
      results.records_p99_ms.add(times_ms.percentile(0.99));
      results.age_p99_us.add(ages_us.empty() ? kUnfinished : ages_us.percentile(0.99));
      results.silence_ms.add(silence_ms);
      results.host_growth_mb.add(host_growth_mb);
    }
  }
  for (const auto& program : {host.get(), healthy.get(), impaired.get()}) terminate(*program);
  return runs;
}

// ---- joining

/// Results of one start of many HRTCs. Times begin before the first is started.
struct JoiningRun {
  double started_s = 0;         // time until all HRTCs were started
  double ready_s = 0;           // time until the last exact contact, or until the wait ended
  double cpu_s = 0;             // CPU time of host and HRTCs until `ready_s`
  double cores = 0;             // CPU time of host and HRTCs per second afterwards
  std::size_t exact_users = 0;  // number of users that have had an exact contact
};

enum class Tips { kResting, kMoving };

/// Starts an HRTC of a session that many HRTCs join.
std::unique_ptr<Process> start_joining(const Testbed& testbed, const std::string& session, int index, Tips tips) {
  return testbed.hrtc(session, "hrtc-" + std::to_string(index),
                      tips == Tips::kMoving ? "slow" : Testbed::resting_recording(index),
                      {"--priority", "0", "--users", "1", "--pool", "16384", "--rate", "100", "--state-rate", "20"});
}

JoiningRun run_joining(const Testbed& testbed, int count, Tips tips) {
  std::fprintf(stderr, "joining: %d HRTCs\n", count);
  const std::string session = "joining";
  const auto host = testbed.host(session);
  SessionObserver observer{testbed.address(session, "observer")};
  std::vector<std::unique_ptr<Process>> hrtcs;
  const std::int64_t began = realtime::monotonic_ns();
  for (int i = 0; i < count; ++i) hrtcs.push_back(start_joining(testbed, session, i, tips));
  JoiningRun joining;
  joining.started_s = static_cast<double>(realtime::monotonic_ns() - began) / 1e9;
  (void)wait_until(20 * kSecond, [&] { return observer.exact_users() >= hrtcs.size(); });
  joining.ready_s = static_cast<double>(realtime::monotonic_ns() - began) / 1e9;
  joining.exact_users = observer.exact_users();
  std::fprintf(stderr, "joining: %zu users have an exact contact after %.2f s\n", joining.exact_users, joining.ready_s);
  const auto cpu_of_all = [&] {
    double sum = cpu_seconds(*host);
    for (const auto& hrtc : hrtcs) sum += cpu_seconds(*hrtc);
    return sum;
  };
  joining.cpu_s = cpu_of_all();
  constexpr int kSteady = 2;                                   // s
  std::this_thread::sleep_for(std::chrono::seconds{kSteady});  // the CPU time of this interval is measured
  joining.cores = (cpu_of_all() - joining.cpu_s) / kSteady;
  for (const auto& hrtc : hrtcs) hrtc->signal(SIGTERM);
  for (const auto& hrtc : hrtcs) (void)hrtc->wait();
  terminate(*host);
  return joining;
}

/// Runs `fetcher` with real-time priority until the returned thread is destroyed. Adds the times of its regions to
/// `times`, unless this is null.
std::jthread run_in_thread(Fetcher& fetcher, Samples* times) {
  return std::jthread{[&fetcher, times](const std::stop_token& token) {
    const RealTimePriority real_time;
    while (!token.stop_requested() && !realtime::stop_signal()) run_fetcher(fetcher, 0.05, times);
  }};
}

struct EarlierPrograms {
  WindowResults before, joining;  // the results of the windows before and while HRTCs join
};

/// Lets `count` HRTCs join a session again and again, and measures the delays of programs that have joined it earlier.
/// The HRTCs that join represent HRTCs on other machines, which take no CPU time from the earlier programs. So the
/// earlier programs have real-time priority.
EarlierPrograms run_earlier_programs(const Testbed& testbed, const ScaleSettings& settings, int count) {
  const std::string session = "joining-later";
  std::optional<RealTimePriority> real_time;
  if (!real_time.emplace().granted())
    std::fprintf(stderr, "joining: SCHED_RR is not permitted, so that other programs affect the times\n");
  const auto host = testbed.host(session);
  const auto healthy = testbed.hrtc(session, "healthy", "slow");
  Fetcher fetcher{testbed.address(session, "fetcher")};
  for (int tries = 0; !fetcher.ready(); ++tries) {
    if (tries > 200) throw std::runtime_error("the base mesh does not arrive:\n" + host->output());
    run_fetcher(fetcher, 0.1, nullptr);
  }
  EarlierPrograms results;
  for (int window = 0; window < settings.windows && !realtime::stop_signal(); ++window) {
    std::fprintf(stderr, "joining: %d HRTCs, window %d of %d\n", count, window + 1, settings.windows);
    std::optional<SessionObserver> observer;  // a new one, which has not received the exact contacts of the last window
    {
      // The fetcher runs all the time, because the host would remove a participant without heartbeats.
      const std::jthread fetching = run_in_thread(fetcher, nullptr);
      real_time.emplace();  // for the threads of the observer
      observer.emplace(testbed.address(session, "observer"));
      real_time.reset();
      std::this_thread::sleep_for(std::chrono::seconds{1});  // so that the end of the last HRTCs has no effect
      if (!wait_until(20 * kSecond, [&] { return observer->exact_users() >= 1; }))
        throw std::runtime_error("the HRTC has no exact contact:\n" + healthy->output());
    }
    std::vector<std::unique_ptr<Process>> hrtcs;
    for (WindowResults* const to : {&results.before, &results.joining}) {
      Samples times_ms, ages_us;
      observer->add_ages_of("healthy", &ages_us);
      bool has_joined = true;
      {
        const std::jthread fetching = run_in_thread(fetcher, &times_ms);
        const std::int64_t end_ns =
            realtime::monotonic_ns() + static_cast<std::int64_t>(settings.seconds * static_cast<double>(kSecond));
        if (to == &results.joining) {
          for (int i = 0; i < count; ++i) hrtcs.push_back(start_joining(testbed, session, i, Tips::kResting));
          has_joined = wait_until(20 * kSecond, [&] { return observer->exact_users() >= hrtcs.size() + 1; });
        }
        (void)wait_until(20 * kSecond, [&] { return realtime::monotonic_ns() >= end_ns; });
      }
      const double silence_ms = observer->longest_silence_ms();
      fetcher.add_unanswered(times_ms);
      observer->add_ages_of("healthy", nullptr);
      to->records_p99_ms.add(has_joined ? times_ms.percentile(0.99) : kUnfinished);
      to->age_p99_us.add(has_joined && !ages_us.empty() ? ages_us.percentile(0.99) : kUnfinished);
      to->silence_ms.add(silence_ms);
    }
    const std::jthread fetching = run_in_thread(fetcher, nullptr);
    for (const auto& hrtc : hrtcs) hrtc->signal(SIGTERM);
    for (const auto& hrtc : hrtcs) (void)hrtc->wait();
  }
  for (const auto& program : {healthy.get(), host.get()}) terminate(*program);
  return results;
}

// ---- coded

/// Results of one number of probes.
struct CodedRun {
  StateDelivery delivery;
  double seconds = 0;
  double exact_users = 0;  // number of users that have had an exact contact
  double cores = 0;        // CPU time of host and HRTCs per second
  double cycles = 0;       // number of cycles of all HRTCs; the counts below are of these
  double overruns = 0, preempted = 0, unknown = 0, skipped = 0;
};

CodedRun run_coded(const Testbed& testbed, const ScaleSettings& settings, int probes) {
  constexpr int kProbesPerHrtc = 8;  // the limit of an HRTC
  std::fprintf(stderr, "coded: %d probes\n", probes);
  const std::string session = "coded-" + std::to_string(probes);
  const auto host = testbed.host(session);
  SessionObserver observer{testbed.address(session, "observer")};
  std::vector<std::unique_ptr<Process>> hrtcs;
  std::vector<std::string> names;
  for (int first = 0; first < probes; first += kProbesPerHrtc) {
    std::vector<std::string> paths;
    for (int probe = first; probe < std::min(first + kProbesPerHrtc, probes); ++probe)
      paths.push_back(Testbed::moving_recording(probe * settings.probes / probes));
    names.push_back("hrtc-" + std::to_string(names.size()));
    hrtcs.push_back(testbed.hrtc(session, names.back(), paths));
  }
  (void)wait_until(10 * kSecond, [&] { return observer.exact_users() >= static_cast<std::size_t>(probes); });
  std::this_thread::sleep_for(std::chrono::seconds{1});  // so that joining has ended before the measurement begins
  CodedRun coded;
  coded.exact_users = static_cast<double>(observer.exact_users());
  const auto sum_of = [&](const char* figure) {
    double sum = 0;
    for (const std::string& name : names) sum += observer.figure(name, figure);
    return sum;
  };
  const auto add_totals = [&](double sign) {
    coded.cores += sign * cpu_seconds(*host);
    for (const auto& hrtc : hrtcs) coded.cores += sign * cpu_seconds(*hrtc);
    coded.seconds += sign * static_cast<double>(realtime::monotonic_ns()) / 1e9;
    coded.cycles += sign * sum_of(session::figures::kCycles);
    coded.overruns += sign * sum_of(session::figures::kOverruns);
    coded.preempted += sign * sum_of(session::figures::kPreempted);
    coded.unknown += sign * sum_of(session::figures::kLateUnknown);
    coded.skipped += sign * sum_of(session::figures::kSkipped);
  };
  add_totals(-1);
  observer.start_counting();
  // An HRTC publishes its counts once a second, so a shorter measurement would compare too few of them.
  constexpr double kMinSeconds = 10;
  // The observer counts the states of this interval.
  std::this_thread::sleep_for(std::chrono::duration<double>{std::max(settings.seconds, kMinSeconds)});
  coded.delivery = observer.stop_counting();
  add_totals(1);
  coded.cores /= coded.seconds;
  for (const auto& hrtc : hrtcs) hrtc->signal(SIGTERM);
  for (const auto& hrtc : hrtcs) (void)hrtc->wait();
  terminate(*host);
  return coded;
}

// ---- crowding

/// Returns the bytes that a host sends to `count` HRTCs on one path, from its start until 6 s after the last exact
/// contact.
double run_crowding(const Testbed& testbed, int count) {
  std::fprintf(stderr, "crowding: %d HRTCs\n", count);
  const std::string session = "crowding-" + std::to_string(count);
  const auto host = testbed.host(session);
  SessionObserver observer{testbed.address(session, "observer")};
  std::vector<std::unique_ptr<Process>> hrtcs;
  for (int i = 0; i < count; ++i)
    hrtcs.push_back(testbed.hrtc(session, "hrtc-" + std::to_string(i), "slow", {"--users", "1", "--state-rate", "50"}));
  (void)wait_until(20 * kSecond, [&] { return observer.exact_users() >= hrtcs.size(); });
  std::this_thread::sleep_for(std::chrono::seconds{6});  // the HRTCs move and receive regions
  const double bytes = observer.figure("host", session::figures::kHostBytes);
  for (const auto& hrtc : hrtcs) terminate(*hrtc);
  terminate(*host);
  return bytes;
}

// ---- state

constexpr std::size_t kDemandingHrtcs = 32;

struct DeliveryState {
  std::uint32_t regions = 0;  // of the model
  double heap_bytes = 0;      // of the delivery server, for all HRTCs
};

/// Lets a delivery server answer the demands of 32 HRTCs. Each lists a thousand intervals as present and more regions
/// as wanted, of which the server sends some.
DeliveryState run_state(const ScaleSettings& settings) {
  std::fprintf(stderr, "state: 32 HRTCs\n");
  constexpr std::uint64_t kSession = 1, kObject = 2, kHost = 3;
  const LoadedModel subject = load_model({}, settings.state_faces);
  const spm::codec::EncodedModel encoded{subject.model};
  const session::Origin host{kSession, kHost, 1, 0};
  session::DeliveryServer server{host};
  server.add(kObject, encoded.compressed());
  const std::uint32_t regions = subject.model.summary.regions;
  const auto before = static_cast<double>(mallinfo2().uordblks);
  for (std::uint64_t hrtc = 100; hrtc < 100 + kDemandingHrtcs; ++hrtc) {
    session::Demand demand;
    demand.origin = {kSession, hrtc, 1, 0};
    demand.object_id = kObject;
    demand.digest = subject.model.summary.digest;
    demand.serving_host = kHost;
    demand.epoch = 1;
    demand.stream = session::stream_id(host, demand.origin, kObject);
    demand.credit = 1 << 20;
    // Of each block of regions, the HRTC has a quarter. It wants the first region of every fourth block.
    const std::uint32_t blocks = std::min<std::uint32_t>(session::kMaxHaveIntervals, regions / 4);
    const std::uint32_t block_size = regions / blocks;
    for (std::uint32_t block = 0; block < blocks; ++block)
      demand.have.push_back({block * block_size + block_size / 2, block_size / 4});
    for (std::uint32_t block = hrtc % 4; block < blocks && demand.wanted.size() < session::kMaxWanted; block += 4)
      demand.wanted.push_back({block * block_size, block * 1000});
    if (server.on_demand(demand, 0) != session::DeliveryServer::DemandResult::kApplied)
      throw std::runtime_error("the server refuses a demand");
  }
  for (int chunk = 0; chunk < 3200; ++chunk) (void)server.next(chunk * INT64_C(100'000));
  return {regions, static_cast<double>(mallinfo2().uordblks) - before};
}

/// A state that does not arrive has no age, so only this row shows that states are missing.
void add_silence(const std::string& windows, const WindowResults& results, Report& report) {
  report.add_at_most("longest time without a probe state in a window", {windows, results.silence_ms.size()}, "ms",
                     results.silence_ms.max(), 500);
}

void report_trouble(const Testbed& testbed, const ScaleSettings& settings, Report& report) {
  const std::array<const char*, 3> names{"all HRTCs run", "one HRTC frozen", "one HRTC throttled to 10 %"};
  for (const OthersPriority others : {OthersPriority::kOrdinary, OthersPriority::kRealTime}) {
    const std::array<WindowResults, 3> trouble = run_trouble(testbed, settings, others);
    const std::string priority =
        others == OthersPriority::kOrdinary ? ", ordinary priority" : ", real-time priority of the others";
    for (std::size_t i = 0; i < 3; ++i) {
      report.add_percentiles("delivery time of a region, p99", names[i] + priority + ", windows", "ms",
                             trouble[i].records_p99_ms);
      report.add_percentiles("age of probe states, p99", names[i] + priority + ", windows", "us",
                             trouble[i].age_p99_us);
      if (i == 0) continue;
      report.add_at_most("median p99 of the delivery time of a region, divided by that when all HRTCs run",
                         {names[i] + priority + ", windows", trouble[i].age_p99_us.size()}, "times",
                         ratio(trouble[i].records_p99_ms.percentile(0.5), trouble[0].records_p99_ms.percentile(0.5)),
                         1.1);
      report.add_at_most("median p99 of the age of probe states, divided by that when all HRTCs run",
                         {names[i] + priority + ", windows", trouble[i].age_p99_us.size()}, "times",
                         ratio(trouble[i].age_p99_us.percentile(0.5), trouble[0].age_p99_us.percentile(0.5)), 1.1);
      add_silence(names[i] + priority + ", windows", trouble[i], report);
      report.add_at_most("max growth of the host's memory in a window",
                         {names[i] + priority + ", windows", trouble[i].host_growth_mb.size()}, "MB",
                         trouble[i].host_growth_mb.max(), 1);
    }
  }
}

void report_joining(const Testbed& testbed, const ScaleSettings& settings, Report& report) {
  for (const Tips tips : {Tips::kResting, Tips::kMoving}) {
    const int max = tips == Tips::kResting ? settings.joining_hrtcs : settings.joining_hrtcs / 2;
    const int min = settings.min_joining_hrtcs > 0 ? settings.min_joining_hrtcs : settings.joining_hrtcs / 8;
    for (const int count : doubled_counts(min, std::max(max, 1))) {
      if (realtime::stop_signal()) return;
      const JoiningRun joining = run_joining(testbed, count, tips);
      const Population population{std::string{"HRTCs, tips "} + (tips == Tips::kResting ? "at rest" : "at 5 cm/s"),
                                  static_cast<std::size_t>(count)};
      report.add_value("time until all HRTCs are started", population, "s", joining.started_s);
      report.add_value("CPU time of host and HRTCs until the last exact contact", population, "s", joining.cpu_s);
      report.add_value("CPU time of host and HRTCs per second afterwards", population, "s", joining.cores);
      if (tips == Tips::kResting && count == settings.joining_hrtcs) {
        report.add_at_least("users with an exact contact", population, "", static_cast<double>(joining.exact_users),
                            count);
        report.add_at_most("time until the last exact contact", population, "s", joining.ready_s, 5);
      } else {
        report.add_value("users with an exact contact", population, "", static_cast<double>(joining.exact_users));
        report.add_value("time until the last exact contact", population, "s", joining.ready_s);
      }
    }
  }
}

void report_earlier_programs(const Testbed& testbed, const ScaleSettings& settings, Report& report) {
  const int count = settings.joining_hrtcs;
  const auto [before, joining] = run_earlier_programs(testbed, settings, count);
  const Population windows{"windows in which " + std::to_string(count) + " HRTCs join", joining.age_p99_us.size()};
  for (const WindowResults* const results : {&before, &joining}) {
    const std::string when = results == &before ? "windows before HRTCs join" : windows.name;
    report.add_percentiles("delivery time of a region for an earlier HRTC, p99", when, "ms", results->records_p99_ms);
    report.add_percentiles("age of probe states of an earlier user, p99", when, "us", results->age_p99_us);
  }
  report.add_at_most(
      "median p99 of the delivery time of a region for an earlier HRTC, divided by that before HRTCs join", windows,
      "times", ratio(joining.records_p99_ms.percentile(0.5), before.records_p99_ms.percentile(0.5)), 1.1);
  report.add_at_most("median p99 of the age of probe states of an earlier user, divided by that before HRTCs join",
                     windows, "times", ratio(joining.age_p99_us.percentile(0.5), before.age_p99_us.percentile(0.5)),
                     1.1);
  add_silence(windows.name, joining, report);
}

void report_secured(Testbed& testbed, const ScaleSettings& settings, Report& report) {
  Samples plain_s, secured_s, plain_cpu_s, secured_cpu_s;
  std::size_t exact_users = 0;
  for (int pair = 0; pair < settings.secured_pairs && !realtime::stop_signal(); ++pair) {
    for (const bool has_keys : {pair % 2 != 0, pair % 2 == 0}) {
      testbed.set_keys(has_keys);
      const JoiningRun joining = run_joining(testbed, settings.secured_hrtcs, Tips::kResting);
      (has_keys ? secured_s : plain_s).add(joining.ready_s);
      (has_keys ? secured_cpu_s : plain_cpu_s).add(joining.cpu_s);
      exact_users += joining.exact_users;
    }
  }
  testbed.set_keys(false);
  const std::string count = std::to_string(settings.secured_hrtcs);
  const Population runs{"runs of " + count + " HRTCs", secured_s.size()};
  report.add_value("time until the last exact contact, without keys, median", runs, "s", plain_s.percentile(0.5));
  report.add_value("time until the last exact contact, with keys, median", runs, "s", secured_s.percentile(0.5));
  const std::string cpu_time = "CPU time of host and HRTCs until the last exact contact";
  report.add_value(cpu_time + ", without keys, median", runs, "s", plain_cpu_s.percentile(0.5));
  report.add_value(cpu_time + ", with keys, median", runs, "s", secured_cpu_s.percentile(0.5));
  report.add_at_most("time until the last exact contact, with keys minus without, medians", runs, "s",
                     secured_s.percentile(0.5) - plain_s.percentile(0.5), 2);
  report.add_at_least("users with an exact contact, with and without keys", runs, "", static_cast<double>(exact_users),
                      2 * settings.secured_hrtcs * settings.secured_pairs);
}

void report_coded(const Testbed& testbed, const ScaleSettings& settings, Report& report) {
  for (const int probes : doubled_counts(settings.probes / 8, settings.probes)) {
    if (realtime::stop_signal()) return;
    const CodedRun coded = run_coded(testbed, settings, probes);
    const std::string name = std::to_string(probes) + " probes at 5 cm/s";
    const Population population{"probes at 5 cm/s", static_cast<std::size_t>(probes)};
    const Population cycles{"cycles, " + name, static_cast<std::size_t>(coded.cycles)};
    const Population sent{"states sent, " + name, static_cast<std::size_t>(coded.delivery.sent)};
    report.add_percentiles("age of deadband-coded states", "states, " + name, "us", coded.delivery.ages_us);
    report.add_value("deadband-coded states received, for each probe", population, "1/s",
                     static_cast<double>(coded.delivery.ages_us.size()) / coded.seconds / probes);
    report.add_value("deadband-coded states sent, by the metrics of the HRTCs", population, "", coded.delivery.sent);
    report.add_value("deadband-coded states received in the same time", population, "", coded.delivery.arrived);
    report.add_value("CPU time of host and HRTCs per second", population, "s", coded.cores);
    report.add_value("overruns divided by cycles", cycles, "%", 100 * coded.overruns / coded.cycles);
    report.add_value("preempted late cycles divided by cycles", cycles, "%", 100 * coded.preempted / coded.cycles);
    report.add_value("late cycles of unknown cause divided by cycles", cycles, "%", 100 * coded.unknown / coded.cycles);
    report.add_value("skipped cycles divided by cycles", cycles, "%", 100 * coded.skipped / coded.cycles);
    report.add_value("users with an exact contact", population, "", coded.exact_users);
    const double share = 100 * coded.delivery.arrived / coded.delivery.sent;
    if (probes == settings.probes) {
      report.add_at_least("deadband-coded states received divided by those sent", sent, "%", share, 99.9);
      report.add_at_least("users with an exact contact", population, "", coded.exact_users, probes);
    } else {
      report.add_value("deadband-coded states received divided by those sent", sent, "%", share);
    }
  }
}

void report_crowding(const Testbed& testbed, const ScaleSettings&, Report& report) {
  const double one = run_crowding(testbed, 1), eight = run_crowding(testbed, 8);
  report.add_value("bytes sent to 8 HRTCs on one path, divided by bytes sent to one", {"runs", 2}, "times",
                   eight / one);
}

void report_state(const ScaleSettings& settings, Report& report) {
  const DeliveryState state = run_state(settings);
  report.add_value("regions of the model", {"model", 1}, "", state.regions);
  report.add_at_most("heap of the delivery server", {"HRTCs", kDemandingHrtcs}, "MiB", state.heap_bytes / (1 << 20), 1);
}

Report run(const ScaleSettings& settings) {
  const auto wanted = [&](const char* part) { return settings.part.empty() || settings.part == part; };
  Testbed testbed{settings};
  char text[160];
  std::snprintf(text, sizeof text, "organ of %u faces, %d windows of %g s of each kind, tips at 5 and 30 cm/s",
                settings.faces, settings.windows, settings.seconds);
  Report report{{"organ", testbed.digest(), settings.faces, text}};
  if (wanted("trouble")) report_trouble(testbed, settings, report);
  if (wanted("joining")) {
    report_joining(testbed, settings, report);
    report_earlier_programs(testbed, settings, report);
  }
  if (wanted("secured")) report_secured(testbed, settings, report);
  if (wanted("coded")) report_coded(testbed, settings, report);
  if (wanted("crowding")) report_crowding(testbed, settings, report);
  if (wanted("state")) report_state(settings, report);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::ScaleSettings settings;
  tactus::bench::App app{
      "scale",
      "Measures the effect of many HRTCs on a host and on each other: delays caused by an impaired HRTC, joining of 32 "
      "HRTCs, and of 8 with keys, delivery of deadband-coded states of 64 probes, bytes sent to 8 HRTCs on one path, "
      "memory of the host",
      "smaller models, 2 windows of each kind, 4 HRTCs that join, 8 probes"};
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(10'000, 10'000'000));
  app.add_option("--pairs", settings.windows, "windows of each kind")->check(CLI::Range(1, 100));
  app.add_option("--seconds", settings.seconds, "length of each window, s")
      ->check(tactus::wire::finite_range(0.5, 60.0));
  app.add_option("--joining", settings.joining_hrtcs, "max number of HRTCs that join")->check(CLI::Range(1, 64));
  app.add_option("--fewest", settings.min_joining_hrtcs,
                 "min number of HRTCs that join, doubled up to --joining; by default an eighth of --joining")
      ->check(CLI::Range(1, 64));
  app.add_option("--probes", settings.probes, "max number of probes in part coded, 8 to an HRTC")
      ->check(CLI::Range(1, 64));
  app.add_option("--domain", settings.domain, "first of the three DDS domains used")->check(CLI::Range(1, 95));
  app.add_option("--part", settings.part, "runs only this part")
      ->check(CLI::IsMember({"trouble", "joining", "secured", "coded", "crowding", "state"}));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.faces = settings.state_faces = 200'000;
      settings.windows = 2;
      settings.joining_hrtcs = 4;
      settings.secured_hrtcs = 4;
      settings.secured_pairs = 1;
      settings.probes = 8;
    }
    if (settings.min_joining_hrtcs > settings.joining_hrtcs)
      throw CLI::ValidationError{"--fewest", "found " + std::to_string(settings.min_joining_hrtcs) +
                                                 ", expected at most --joining, " +
                                                 std::to_string(settings.joining_hrtcs)};
    return tactus::bench::run(settings);
  });
}
