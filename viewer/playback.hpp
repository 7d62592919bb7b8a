/// Plays a recording of a session (`tactus record`) into a ViewerCore, in place of the network.
///
///     file --> samples in the order of their arrival --> on_roster, on_probe_state, ...
///          --> messages of base meshes and regions ----> on_chunk, in one stream for each demand of the viewer
///
/// The time of the core is the recorded time, ns since 1970. At the begin of a pause it advances by
/// 100 ms, so that the mesh follows the last samples, and then stands still. A step skips the probe states and shown
/// regions that are more than 2 s older than its end. A step back begins at the start of the recording again.
///
/// Hosts sent each record once to each HRTC, so a region can need records of earlier messages. The compressed cache of
/// the core is therefore so large that it evicts no region.
///
/// No DDS, socket or thread. One thread at a time. Not realtime.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "viewer/page_feed.hpp"
#include "viewer/viewer_core.hpp"
#include "wire/tap.hpp"

namespace tactus::viewer {

class Playback {
 public:
  /// Reads the file and shows its begin. `pool` and `faces`: as in ViewerSettings. Throws trace::McapError if the file
  /// cannot be read or has no samples of a session.
  Playback(const std::filesystem::path& file, const spm::PoolSettings& pool, std::uint32_t faces);

  void play(bool plays);
  /// Shows the session `seconds` after the begin. O(length of the recording).
  void seek(double seconds);
  /// Plays `ns` of the recording, unless it is paused. It pauses at the end.
  void advance(std::int64_t ns);

  /// The same object at all times; `seek` begins it anew.
  [[nodiscard]] ViewerCore& core() noexcept { return *core_; }
  [[nodiscard]] const PlaybackStatus& status() const noexcept { return status_; }

 private:
  /// An encoded sample of the file.
  struct Recorded {
    std::int64_t at_ns = 0;
    const std::string* topic = nullptr;
    std::size_t begin = 0, size = 0;  // in bytes_
  };
  /// A complete message of a host about an object.
  struct Message {
    std::uint32_t region = 0;  // kNone: base mesh
    std::vector<std::uint8_t> bytes;
  };
  /// The messages of an object in the order of their arrival, and how many the core has received.
  struct Delivery {
    std::vector<Message> bases, regions;
    std::size_t sent = 0;  // of `regions`
  };
  /// A stream from a host to the core.
  struct Stream {
    std::uint32_t sequence = 0;
  };

  void read(const std::filesystem::path& file);
  void read_bulk(const std::vector<std::pair<std::int64_t, session::BulkChunk>>& chunks,
                 const std::map<std::uint32_t, std::uint64_t>& objects);
  [[nodiscard]] std::optional<wire::AnySample> decode(const Recorded& recorded) const;
  void restart();
  void play_until(std::int64_t to_ns, std::int64_t tick_ns, std::int64_t states_from_ns);
  void settle();
  void tick();
  void answer(const session::ClockSample& request);
  void deliver(const session::Demand& demand);
  void send(const session::Demand& demand, const Message& message);

  std::vector<std::uint8_t> bytes_;
  std::map<std::string, std::uint16_t> channels_;  // by topic: the channel that is played
  std::vector<Recorded> samples_;                  // without base meshes and records
  std::map<std::uint64_t, Delivery> deliveries_;   // by object id
  /// By participant and incarnation: recorded time minus session time, min over its roster entries.
  std::map<std::pair<std::uint64_t, std::uint64_t>, std::int64_t> clock_offsets_;
  std::uint64_t session_ = 0;
  std::string session_name_;
  spm::PoolSettings pool_;
  std::uint32_t faces_;
  std::map<std::uint64_t, Camera> cameras_;  // by page, of the core before
  std::optional<ViewerCore> core_;
  std::map<std::uint32_t, Stream> streams_;  // by stream_id
  std::size_t next_ = 0;                     // index in samples_
  std::int64_t begin_ns_ = 0, end_ns_ = 0;
  std::int64_t now_ns_ = 0;    // time of the core; during a pause, up to 100 ms after the shown time
  std::int64_t shown_ns_ = 0;  // recorded time that is shown
  std::string shown_hrtc_;
  PlaybackStatus status_;
};

}  // namespace tactus::viewer
