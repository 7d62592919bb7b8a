// tactus-record: records every topic of a session in one MCAP file, as encoded on the wire, with its IDL.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "trace/idl_schema.hpp"
#include "trace/mcap.hpp"
#include "wire/command_line.hpp"
#include "wire/process.hpp"
#include "wire/tap.hpp"

namespace {

using namespace tactus;
using Clock = std::chrono::steady_clock;

constexpr char kExamples[] = R"(
Examples:
  tactus-record lab.mcap --session lab --domain 40
  tactus-record probes.mcap --session lab --domain 40 --without-bulk --seconds 60

  tactus-record lab.mcap --to-csv lab.csv

The recording ends with Ctrl-C, or after --seconds. Messages are encoded as CDR, and the schemas are the IDL of Tactus.
MCAP readers that support omgidl can show them. To hosts the recorder is one more HRTC, unless --without-bulk omits the
meshes.
Exit status: 0 recorded, 1 the file could not be written completely, 2 wrong input, 130 interrupted before any
message.)";

constexpr auto kFlushPeriod = std::chrono::seconds{1};  // a kill loses at most the messages of this time

std::uint64_t since_1970() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
}

/// The MCAP file with its channels and its first write error.
class Recording {
 public:
  explicit Recording(const std::string& file) : mcap_{file, "tactus " TACTUS_VERSION} {}

  void set_topics(const std::vector<wire::TapTopic>& topics) {
    const std::lock_guard lock{mutex_};
    std::map<std::string, trace::McapWriter::Schema> schemas;
    for (const wire::TapTopic& topic : topics) {
      const auto [schema, is_new] = schemas.try_emplace(topic.type);
      if (is_new) schema->second = mcap_.add_schema(topic.type, "omgidl", wire::idl_text());
      channels_.push_back(mcap_.add_channel(schema->second, topic.name, "cdr", {{"partitions", topic.partitions}}));
    }
    sequences_.resize(channels_.size());
    has_topics_ = true;
    for (const EarlySample& early : std::exchange(early_, {})) write(early.topic, early.time, early.bytes);
  }

  /// Writes a sample. Before set_topics(), stores it: a running session sends its catalogue as soon as a reader exists.
  void add(std::size_t topic, std::span<const std::uint8_t> encoded) {
    const std::lock_guard lock{mutex_};
    const std::uint64_t now = since_1970();
    if (has_topics_)
      write(topic, now, encoded);
    else
      early_.push_back({topic, now, {encoded.begin(), encoded.end()}});
  }

  void flush() {
    const std::lock_guard lock{mutex_};
    if (error_.empty()) guarded([&] { mcap_.flush(); });
  }
  void close() {
    const std::lock_guard lock{mutex_};
    if (error_.empty()) guarded([&] { mcap_.close(); });
  }

  [[nodiscard]] std::string error() const {
    const std::lock_guard lock{mutex_};
    return error_;
  }
  [[nodiscard]] std::uint64_t messages() const {
    const std::lock_guard lock{mutex_};
    return mcap_.messages();
  }
  [[nodiscard]] std::uint64_t bytes() const {
    const std::lock_guard lock{mutex_};
    return mcap_.bytes();
  }

 private:
  struct EarlySample {
    std::size_t topic;
    std::uint64_t time;
    std::vector<std::uint8_t> bytes;
  };

  void write(std::size_t topic, std::uint64_t time, std::span<const std::uint8_t> encoded) {
    if (!error_.empty()) return;
    guarded([&] { mcap_.write(channels_.at(topic), time, time, ++sequences_.at(topic), encoded); });
  }
  template <class Write>
  void guarded(Write&& write) {
    try {
      write();
    } catch (const trace::McapError& error) {
      error_ = error.what();
    }
  }

  mutable std::mutex mutex_;
  trace::McapWriter mcap_;
  std::vector<trace::McapWriter::Channel> channels_;
  std::vector<std::uint32_t> sequences_;
  bool has_topics_ = false;
  std::vector<EarlySample> early_;
  std::string error_;
};

int record(const wire::SessionAddress& address, const std::string& file, double seconds, bool bulk,
           const std::atomic<bool>& cancelled) {
  Recording recording{file};
  wire::Participants participants{address};
  {
    wire::Tap tap{
        participants,
        [&](const std::string&, wire::TrafficClass traffic) { return bulk || traffic != wire::TrafficClass::kBulk; },
        [&](std::size_t topic, std::span<const std::uint8_t> encoded) { recording.add(topic, encoded); }};
    recording.set_topics(tap.topics());
    std::cout << "recording session " << address.session << " into " << file << std::endl;
    const auto begin = Clock::now();
    auto flushed = begin;
    while (!cancelled && recording.error().empty() &&
           (seconds == 0 || Clock::now() - begin < std::chrono::duration<double>{seconds})) {
      // The callbacks of the tap write the messages. This thread flushes the file and ends the recording.
      std::this_thread::sleep_for(std::chrono::milliseconds{50});
      if (Clock::now() - flushed < kFlushPeriod) continue;
      recording.flush();
      flushed = Clock::now();
    }
  }
  recording.close();
  std::cout << recording.messages() << " messages, " << recording.bytes() << " bytes\n";
  if (const std::string error = recording.error(); !error.empty()) {
    std::cerr << "tactus-record: " << error << '\n';
    return 1;
  }
  return cancelled && recording.messages() == 0 ? 130 : 0;
}

/// Writes a table for each channel into DIRECTORY/TOPIC.csv: time of arrival in ns since 1970, sequence number, and a
/// column for each value of the IDL type. The second channel of a topic (full-rate probe states) is TOPIC-2.csv.
int to_csv(const std::string& file, const std::filesystem::path& directory) {
  trace::McapReader reader{file};
  std::filesystem::create_directories(directory);
  std::map<const std::string*, trace::IdlSchema> schemas;
  struct Table {
    std::ofstream out;
    std::filesystem::path path;
    std::uint64_t rows = 0;
  };
  std::map<std::uint16_t, Table> tables;
  std::map<std::string, int> used;
  const auto quoted = [](const std::string& cell) {
    if (cell.find_first_of(",\"\n\r") == std::string::npos) return cell;
    std::string text = "\"";
    for (const char c : cell) text += c == '"' ? "\"\"" : std::string{c};
    return text + '"';
  };
  trace::McapMessage message;
  while (reader.next(message)) {
    if (message.schema_encoding != "omgidl")
      throw std::runtime_error(file + ", topic " + message.topic + ": found schema encoding " +
                               message.schema_encoding + ", expected omgidl");
    const trace::IdlSchema& schema = schemas.try_emplace(message.schema_text, *message.schema_text).first->second;
    const auto [table, is_new] = tables.try_emplace(message.channel);
    if (is_new) {
      const int number = ++used[message.topic];
      table->second.path = directory / (message.topic + (number > 1 ? "-" + std::to_string(number) : "") + ".csv");
      table->second.out.open(table->second.path);
      table->second.out << "log_time_ns,sequence";
      for (const std::string& column : schema.columns(message.schema)) table->second.out << ',' << column;
      table->second.out << '\n';
    }
    std::ofstream& out = table->second.out;
    out << message.log_time << ',' << message.sequence;
    for (const std::string& cell : schema.values(message.schema, {message.bytes.data(), message.bytes.size()}))
      out << ',' << quoted(cell);
    out << '\n';
    ++table->second.rows;
  }
  for (auto& [channel, table] : tables) {
    table.out.close();
    if (!table.out) throw std::runtime_error("cannot write " + table.path.string());
    std::cout << table.path.string() << ": " << table.rows << " rows\n";
  }
  if (reader.is_truncated()) std::cout << file << " is truncated; everything before is included\n";
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  wire::SessionAddress address;
  address.participant = "record-" + std::to_string(getpid());
  std::string file;
  double seconds = 0;
  bool without_bulk = false;
  std::string csv;
  CLI::App app{"Records every topic of a session into an MCAP file.", "tactus-record"};
  app.footer(kExamples);
  app.add_option("FILE", file, "The recording, *.mcap; an existing file is replaced")->required();
  wire::add_address_options(app, address, "program");
  app.add_option("--seconds", seconds, "Duration in seconds; 0: until Ctrl-C")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e6));
  app.add_flag("--without-bulk", without_bulk, "Omit base meshes and records");
  app.add_option("--to-csv", csv, "Write each topic of FILE as a table into this directory, instead of recording");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& cancelled = wire::stop_signal();
  try {
    if (!csv.empty()) return to_csv(file, csv);
    return record(address, file, seconds, !without_bulk, cancelled);
  } catch (const std::exception& error) {
    std::cerr << "tactus-record: " << error.what() << '\n';
    return 2;
  }
}
