// tactus-watch: prints the samples of one topic of a session, as text or as lines of JSON.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <iostream>
#include <optional>
#include <set>
#include <thread>

#include "realtime/standard_output.hpp"
#include "session/printable.hpp"
#include "tools/watch/sample_text.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"
#include "wire/inbox.hpp"
#include "wire/tap.hpp"
#include "wire/topics.hpp"

namespace {

using namespace tactus;
using realtime::monotonic_ns;

constexpr char kExamples[] = R"(
Examples:
  tactus-watch probe_state --session lab --domain 40 --user ann
  tactus-watch metrics --session lab --domain 40 --from desk --count 1
  tactus-watch probe_state --session lab --domain 40 --json --for 10 | jq -r '.sample.status | join(" ")'

The program only reads, and does not appear in the roster. While it watches tactus_base or tactus_records, hosts send
each chunk once more.
Exit status: 0 --count or --for ended it, 1 --for ended it before --count samples, or before any sample, or the output
could not be written, 2 wrong input, 130 interrupted.)";

constexpr std::size_t kMaxWaiting = 1u << 14;  // samples that wait until they are printed
constexpr auto kPollPeriod = std::chrono::milliseconds{50};
/// Time until the first sample is printed, in which roster and catalogue publish most names.
constexpr std::int64_t kNamesNs = 500'000'000;
constexpr std::int64_t kHintNs = 3'000'000'000;  // time without a sample after which the program prints a hint

struct Options {
  wire::SessionAddress address;
  std::string topic;
  watch::SampleFilter filter;
  std::uint64_t count = 0;  // 0: no limit
  double seconds = 0;       // 0: no limit
  bool json = false;
};

/// A sample in encoded form, with the index of its topic in the tap.
struct Encoded {
  std::size_t topic;
  std::vector<std::uint8_t> bytes;
};

std::int64_t since_1970_ns() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

/// Returns the full name of a topic, which `given` may have without "tactus_". Throws an error that lists all topics.
std::string full_name(const std::string& given) {
  const std::string prefix = "tactus_";
  std::string known;
  std::string found;
  wire::topics::for_each([&](const auto& spec) {
    const std::string name = spec.name;
    if (given == name || prefix + given == name) found = name;
    const bool is_repeated = known.size() >= name.size() && known.ends_with(name);  // a topic with two profiles
    if (!is_repeated) known += (known.empty() ? "" : ", ") + name;
  });
  if (found.empty()) throw std::runtime_error("found no topic '" + given + "', expected one of " + known);
  return found;
}

/// Decodes the samples of a tap, and prints those that the options select.
class Printer {
 public:
  explicit Printer(const Options& options) : options_{options}, reader_{wire::idl_text()} {
    for (const std::string& name : {options.address.session, options.filter.user, options.filter.from})
      reader_.add_name(name);
  }

  /// Throws an error if samples of the watched topic, which have this type, lack the fields that the options need.
  void expect_fields(const std::string& type) const {
    if (const auto reason = reader_.refusal(type, options_.filter))
      throw std::runtime_error("topic " + options_.topic + ", " + *reason);
  }

  /// Adds the names in a roster or catalogue entry.
  void add_names(const wire::TapTopic& topic, std::span<const std::uint8_t> encoded) {
    const bool is_roster = topic.name == wire::topics::kRoster.name;
    if (!is_roster && topic.name != wire::topics::kCatalogue.name) return;
    const auto fields = decoded(topic, encoded);
    if (!fields) return;
    reader_.add_names(*fields);
    if (!is_roster) return;
    if (participants_.size() < kMaxNames) participants_.insert(fields->at("name").get<std::string>());
    for (const char* const list : {"users", "served_users"})
      for (const watch::Fields& user : fields->at(list))
        if (users_.size() < kMaxNames) users_.insert(user.at("user").get<std::string>());
  }
  /// Prints a sample if the options select it.
  void add(const wire::TapTopic& topic, std::span<const std::uint8_t> encoded, std::int64_t arrival_ns) {
    if (topic.name != options_.topic || is_complete()) return;
    if (auto fields = decoded(topic, encoded); fields && watch::SampleReader::is_selected(*fields, options_.filter))
      print(topic, *fields, arrival_ns);
  }

  [[nodiscard]] std::uint64_t printed() const { return printed_; }
  [[nodiscard]] bool is_complete() const { return options_.count != 0 && printed_ >= options_.count; }
  /// Names what the options select and what the session contains, as text.
  [[nodiscard]] std::string search() const {
    std::string text = options_.topic;
    if (!options_.filter.user.empty()) text += " of user " + options_.filter.user;
    if (!options_.filter.from.empty()) text += " from " + options_.filter.from;
    return text + " in session " + options_.address.session + ", domain " + std::to_string(options_.address.domain) +
           " (participants: " + joined(participants_) + "; users: " + joined(users_) + ")";
  }

 private:
  [[nodiscard]] static std::string joined(const std::set<std::string>& names) {
    std::string text;
    for (const std::string& name : names) text += (text.empty() ? "" : ", ") + session::printable(name);
    return text.empty() ? "none" : text;
  }
  [[nodiscard]] std::optional<watch::Fields> decoded(const wire::TapTopic& topic,
                                                     std::span<const std::uint8_t> encoded) const {
    try {
      return reader_.decode(topic.type, encoded);
    } catch (const trace::SchemaError& error) {
      std::cerr << "tactus-watch: dropped a sample of " << topic.name << ": " << session::printable(error.what())
                << '\n';
      return std::nullopt;
    }
  }
  void print(const wire::TapTopic& topic, watch::Fields& fields, std::int64_t arrival_ns) {
    ++printed_;
    reader_.name(fields);
    const bool is_of_group = topic.partitions == "g/*";
    if (options_.json) {
      const watch::Fields line{{"topic", topic.name},
                               {"group", is_of_group},
                               {"arrival_ns", arrival_ns + epoch_offset_ns_},
                               {"sample", std::move(fields)}};
      std::cout << watch::json_line(line) << '\n';
    } else {
      std::array<char, 32> seconds{};
      std::snprintf(seconds.data(), seconds.size(), "%.6f", static_cast<double>(arrival_ns - begin_ns_) / 1e9);
      std::cout << "--- " << topic.name << (is_of_group ? " of a group" : "") << ", " << seconds.data() << " s\n"
                << watch::text(fields);
    }
  }

  static constexpr std::size_t kMaxNames = 1024;  // of each kind

  const Options& options_;
  watch::SampleReader reader_;
  std::set<std::string> participants_, users_;
  std::uint64_t printed_ = 0;
  const std::int64_t begin_ns_ = monotonic_ns();
  const std::int64_t epoch_offset_ns_ = since_1970_ns() - begin_ns_;  // from the monotonic clock to the time since 1970
};

/// Reports missing samples, and returns the exit status.
int report_end(const Options& options, const Printer& printer) {
  const std::uint64_t expected = std::max<std::uint64_t>(options.count, 1);
  if (printer.printed() >= expected) return 0;
  std::cerr << "tactus-watch: found " << printer.printed() << " samples, expected at least " << expected << " of "
            << printer.search() << '\n';
  return 1;
}

int print_samples(const Options& options, const std::atomic<bool>& cancelled) {
  Printer printer{options};
  wire::Inbox<Encoded> inbox{kMaxWaiting};
  wire::Participants participants{options.address};
  const wire::Tap tap{participants,
                      [&](const std::string& name, wire::TrafficClass) {
                        return name == options.topic || name == wire::topics::kRoster.name ||
                               name == wire::topics::kCatalogue.name;  // these two contain the names of ids
                      },
                      [&](std::size_t topic, std::span<const std::uint8_t> encoded) {
                        inbox.put({topic, {encoded.begin(), encoded.end()}});
                      }};
  for (const wire::TapTopic& topic : tap.topics())
    if (topic.name == options.topic) printer.expect_fields(topic.type);
  const auto print_arrived = [&](std::chrono::milliseconds timeout) {
    const auto samples = inbox.take(timeout);
    for (const auto& [at_ns, sample] : samples) printer.add_names(tap.topics()[sample.topic], sample.bytes);
    for (const auto& [at_ns, sample] : samples) printer.add(tap.topics()[sample.topic], sample.bytes, at_ns);
    return static_cast<bool>(std::cout.flush());
  };
  const std::int64_t begin_ns = monotonic_ns();
  bool has_hinted = false;
  while (!cancelled && !printer.is_complete()) {
    const std::int64_t now_ns = monotonic_ns();
    if (options.seconds > 0 && now_ns - begin_ns >= static_cast<std::int64_t>(options.seconds * 1e9)) break;
    if (now_ns - begin_ns < kNamesNs) {
      std::this_thread::sleep_for(kPollPeriod);
      continue;
    }
    if (!print_arrived(kPollPeriod)) return realtime::failed_output_status("tactus-watch", errno);
    if (has_hinted || printer.printed() > 0 || now_ns - begin_ns < kHintNs) continue;
    has_hinted = true;
    std::cerr << "tactus-watch: no sample yet of " << printer.search() << '\n';
  }
  // Prints the samples that arrived after the last call, or before the first one.
  if (!print_arrived(std::chrono::milliseconds{0})) return realtime::failed_output_status("tactus-watch", errno);
  if (inbox.dropped() > 0)
    std::cerr << "tactus-watch: dropped " << inbox.dropped()
              << " samples, which arrived faster than they were printed\n";
  return cancelled && !printer.is_complete() ? 130 : report_end(options, printer);
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  options.address.session = "tactus";
  options.address.participant = "watch-" + std::to_string(getpid());
  options.address.naming = wire::Naming::kInstance;
  options.address.only_reads_bulk = true;
  CLI::App app{"Prints the samples of a topic of a session.", "tactus-watch"};
  app.footer(kExamples);
  app.add_option("TOPIC", options.topic, "Topic, with or without 'tactus_'")->required();
  wire::add_address_options(app, options.address, "program");
  app.add_flag("--json", options.json, "Print each sample as one JSON object on one line");
  app.add_option("--count", options.count, "End after this number of samples")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1'000'000'000'000}));
  app.add_option("--for", options.seconds, "End after this time in seconds")->check(wire::finite_range(0.1, 1e6));
  app.add_option("--user", options.filter.user, "Print only samples of this user");
  app.add_option("--from", options.filter.from, "Print only samples of this participant");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& cancelled = realtime::stop_signal();
  std::signal(SIGPIPE, SIG_IGN);  // a failed write ends the program, which then leaves the session
  try {
    options.topic = full_name(options.topic);
    return print_samples(options, cancelled);
  } catch (const std::exception& error) {
    std::cerr << "tactus-watch: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
