// tactus-record: records every topic of a session in one MCAP file, as encoded on the wire, with its IDL.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "realtime/process.hpp"
#include "realtime/standard_output.hpp"
#include "session/messages.hpp"
#include "session/printable.hpp"
#include "tools/scene/scene.hpp"
#include "trace/cdr.hpp"
#include "trace/foxglove.hpp"
#include "trace/idl_schema.hpp"
#include "trace/mcap.hpp"
#include "trace/private_file.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"
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
MCAP readers that support omgidl can show them. The topics /scene/objects, /scene/probes, /tf and /events show the
session in Foxglove and Lichtblick; the layout for both is share/tactus/foxglove-layout.json. To hosts the recorder is one more HRTC, unless --without-bulk omits the
meshes.
Exit status: 0 recorded, 1 the file or the output could not be written completely, 2 wrong input, 130 interrupted
before any message.)";

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
    for (const wire::TapTopic& topic : topics)
      channels_.push_back(mcap_.add_channel(schema(topic.type, wire::idl_text()), topic.name, "cdr",
                                            {{"partitions", topic.partitions}}));
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

  void add(const scene::Frame& frame, std::uint64_t time) {
    const std::lock_guard lock{mutex_};
    for (const trace::foxglove::Log& event : frame.events) write_drawn(events_, "/events", "Log", event, time);
    if (frame.objects) write_drawn(objects_, "/scene/objects", "SceneUpdate", *frame.objects, time);
    if (frame.transforms) write_drawn(transforms_, "/tf", "FrameTransforms", *frame.transforms, time);
    if (frame.probes) write_drawn(probes_, "/scene/probes", "SceneUpdate", *frame.probes, time);
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
    write(channels_.at(topic), sequences_.at(topic), time, encoded);
  }
  template <class Write>
  void guarded(Write&& write) {
    try {
      write();
    } catch (const trace::McapError& error) {
      error_ = error.what();
    }
  }

  /// A channel that exists once it has a message.
  struct DrawnChannel {
    std::optional<trace::McapWriter::Channel> channel;
    std::uint32_t sequence = 0;
  };

  [[nodiscard]] trace::McapWriter::Schema schema(const std::string& type, const char* idl) {
    const auto [found, is_new] = schemas_.try_emplace(type);
    if (is_new) found->second = mcap_.add_schema(type, "omgidl", idl);
    return found->second;
  }
  void write(trace::McapWriter::Channel channel, std::uint32_t& sequence, std::uint64_t time,
             std::span<const std::uint8_t> encoded) {
    if (error_.empty()) guarded([&] { mcap_.write(channel, time, time, ++sequence, encoded); });
  }
  template <class Message>
  void write_drawn(DrawnChannel& to, const char* topic, const std::string& type, const Message& message,
                   std::uint64_t time) {
    if (!to.channel) to.channel = mcap_.add_channel(schema("foxglove::" + type, trace::foxglove::idl()), topic, "cdr");
    encoded_.clear();
    encoded_(message);
    write(*to.channel, to.sequence, time, encoded_.bytes());
  }

  mutable std::mutex mutex_;
  trace::McapWriter mcap_;
  std::map<std::string, trace::McapWriter::Schema> schemas_;  // by type
  DrawnChannel objects_, probes_, transforms_, events_;
  trace::CdrWriter encoded_;
  std::vector<trace::McapWriter::Channel> channels_;
  std::vector<std::uint32_t> sequences_;
  bool has_topics_ = false;
  std::vector<EarlySample> early_;
  std::string error_;
};

/// The scene of a session, to which the callbacks of a tap add samples. Thread: any.
class SharedScene {
 public:
  explicit SharedScene(const session::Origin& self) : scene_{self} {}

  void add(const wire::AnySample& sample) {
    const std::lock_guard lock{mutex_};
    std::visit(
        [this](const auto& value) {
          if constexpr (requires { scene_.add(value, scene::Moment{}); }) scene_.add(value, now());
        },
        sample);
  }
  /// Adds the messages of a frame to `recording`.
  void write_frame(Recording& recording) {
    const scene::Moment time = now();
    scene::Frame frame;
    {
      const std::lock_guard lock{mutex_};
      frame = scene_.frame(time);
    }
    recording.add(frame, time.since_1970_ns);
  }

 private:
  [[nodiscard]] static scene::Moment now() {
    const auto monotonic = Clock::now().time_since_epoch();
    return {std::chrono::duration_cast<std::chrono::nanoseconds>(monotonic).count(), since_1970()};
  }
  std::mutex mutex_;
  scene::Scene scene_;
};

struct RecordSettings {
  double seconds = 0;  ///< 0: until a signal
  bool bulk = true;    ///< record base meshes and records
  bool scene = true;   ///< record the messages for Foxglove and Lichtblick
};

int record(const wire::SessionAddress& address, const std::string& file, const RecordSettings& settings,
           const std::atomic<bool>& cancelled) {
  wire::Participants participants{address};
  Recording recording{file};  // after the step that may throw, so that a failed start replaces no earlier recording
  SharedScene drawn{{session::id_of(address.session), participants.origin().participant, 0, 0}};
  std::uint64_t excess = 0;
  {
    wire::Tap::OnDecoded on_decoded;
    if (settings.scene) on_decoded = [&](const wire::AnySample& sample) { drawn.add(sample); };
    wire::Tap tap{participants,
                  [&](const std::string&, wire::TrafficClass traffic) {
                    return settings.bulk || traffic != wire::TrafficClass::kBulk;
                  },
                  [&](std::size_t topic, std::span<const std::uint8_t> encoded) { recording.add(topic, encoded); },
                  std::move(on_decoded)};
    recording.set_topics(tap.topics());
    std::cout << "recording session " << address.session << " into " << file << std::endl;
    const auto begin = Clock::now();
    auto flushed = begin, frame = begin;
    while (!cancelled && recording.error().empty() &&
           (settings.seconds == 0 || Clock::now() - begin < std::chrono::duration<double>{settings.seconds})) {
      // The callbacks of the tap write the samples. This thread writes the scene, flushes the file and ends the
      // recording.
      frame = std::max(frame + std::chrono::nanoseconds{scene::Scene::kFramePeriodNs}, Clock::now());
      std::this_thread::sleep_until(frame);
      if (settings.scene) drawn.write_frame(recording);
      if (Clock::now() - flushed < kFlushPeriod) continue;
      recording.flush();
      flushed = Clock::now();
    }
    excess = tap.excess();
  }
  if (settings.scene) drawn.write_frame(recording);  // the events since the last frame
  recording.close();
  std::cout << recording.messages() << " messages, " << recording.bytes() << " bytes\n";
  if (excess > 0) std::cout << excess << " samples above the rate limit of their participant were not recorded\n";
  if (const std::string error = recording.error(); !error.empty()) {
    std::cerr << "tactus-record: " << error << '\n';
    return 1;
  }
  return cancelled && recording.messages() == 0 ? 130 : 0;
}

/// Returns the topic as the name of a file: /scene/objects becomes scene_objects.
std::string file_name(const std::string& topic) {
  std::string name = topic.substr(topic.starts_with('/') ? 1 : 0);
  if (name.empty()) return "unnamed";
  std::replace(name.begin(), name.end(), '/', '_');
  return name;
}

/// Returns the names of the tables of a recording, by channel.
std::map<std::uint16_t, std::string> table_names(const std::string& file) {
  trace::McapReader reader{file};
  std::map<std::uint16_t, std::string> names;
  try {
    for (trace::McapMessage message; reader.next(message);)
      names.try_emplace(message.channel, file_name(message.topic));
  } catch (const trace::McapError&) {
    // The tables have everything before the damage, and to_csv reports it.
  }
  return trace::channel_names(names);
}

/// Writes a table for each channel into DIRECTORY/TOPIC.csv: time of arrival in ns since 1970, sequence number, and a
/// column for each value of the IDL type. The second channel of a topic (full-rate probe states) is TOPIC-2.csv.
int to_csv(const std::string& file, const std::filesystem::path& directory) {
  const std::map<std::uint16_t, std::string> names = table_names(file);
  trace::McapReader reader{file};
  std::filesystem::create_directories(directory);
  std::map<const std::string*, trace::IdlSchema> schemas;
  struct Table {
    std::unique_ptr<trace::PrivateFile> out;
    std::filesystem::path path;
    std::uint64_t rows = 0;
  };
  std::map<std::uint16_t, Table> tables;
  const auto quoted = [](const std::string& cell) {
    if (cell.find_first_of(",\"\n\r") == std::string::npos) return cell;
    std::string text = "\"";
    for (const char c : cell) text += c == '"' ? "\"\"" : std::string{c};
    return text + '"';
  };
  const auto fail = [](const std::filesystem::path& path) {
    throw std::runtime_error("cannot write " + path.string() + ": " + std::strerror(errno));
  };
  const auto write = [&fail](const Table& table, const std::string& line) {
    if (std::fputs((line + '\n').c_str(), table.out->get()) == EOF) fail(table.path);
  };
  const auto commit = [&] {
    for (auto& [channel, table] : tables) {
      if (table.out == nullptr || table.out->get() == nullptr) continue;  // it could not be opened
      if (!table.out->commit()) fail(table.path);
      std::cout << session::printable(table.path.string()) << ": " << table.rows << " rows\n";
    }
  };
  const auto add = [&](const trace::McapMessage& message) {
    const auto name = names.find(message.channel);
    if (name == names.end()) return;  // a recorder has added the channel since the names were read
    if (message.schema_encoding != "omgidl")
      throw std::runtime_error(file + ", topic " + message.topic + ": found schema encoding " +
                               message.schema_encoding + ", expected omgidl");
    const trace::IdlSchema& schema = schemas.try_emplace(message.schema_text, *message.schema_text).first->second;
    const auto [table, is_new] = tables.try_emplace(message.channel);
    if (is_new) {
      table->second.path = directory / (name->second + ".csv");
      table->second.out = std::make_unique<trace::PrivateFile>(table->second.path);
      if (table->second.out->get() == nullptr) fail(table->second.path);
      std::string heading = "log_time_ns,sequence";
      for (const std::string& column : schema.columns(message.schema)) heading += ',' + column;
      write(table->second, heading);
    }
    std::string row = std::to_string(message.log_time) + ',' + std::to_string(message.sequence);
    for (const std::string& cell : schema.values(message.schema, {message.bytes.data(), message.bytes.size()}))
      row += ',' + quoted(cell);
    write(table->second, row);
    ++table->second.rows;
  };
  try {
    for (trace::McapMessage message; reader.next(message);) add(message);
  } catch (const std::exception&) {
    commit();  // everything before the error
    throw;
  }
  commit();
  if (reader.is_truncated()) std::cout << file << " is truncated; everything before is included\n";
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  wire::SessionAddress address;
  address.participant = "record-" + std::to_string(getpid());
  address.naming = wire::Naming::kInstance;
  std::string file;
  RecordSettings settings;
  std::string csv;
  CLI::App app{"Records every topic of a session into an MCAP file.", "tactus-record"};
  app.footer(kExamples);
  app.add_option("FILE", file, "The recording, *.mcap; an existing file is replaced")->required();
  wire::add_address_options(app, address, "program");
  app.add_option("--seconds", settings.seconds, "Duration in seconds; 0: until Ctrl-C")
      ->capture_default_str()
      ->check(wire::finite_range(0.0, 1e6));
  app.add_flag("!--without-bulk", settings.bulk, "Omit base meshes and records");
  app.add_flag("!--no-scene", settings.scene, "Omit the topics that Foxglove and Lichtblick draw");
  app.add_option("--to-csv", csv, "Write each topic of FILE as a table into this directory, instead of recording");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& cancelled = realtime::stop_signal();
  try {
    const int status = csv.empty() ? record(address, file, settings, cancelled) : to_csv(file, csv);
    return realtime::status_after_output("tactus-record", status);
  } catch (const std::exception& error) {
    std::cerr << "tactus-record: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
