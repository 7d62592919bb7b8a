/// Stores the records of a FlightRecorder for the last seconds, and writes them to a file.
///
///   oldest segment                       next segment                         ...
///   state | records of a second    --->  state | records of a second    --->
///
/// The oldest segment is dropped when the others contain enough seconds, or when the memory is used up. The store also
/// tracks the objects and regions of the haptic thread at the start of the oldest segment, so that a file can begin
/// there.
///
/// One thread at a time, which must be neither the haptic nor the service thread, because writing has no time limit.
/// Allocates: the records take up to `max_bytes`, more while a file is written.
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "haptics/device.hpp"
#include "hrtc_service/servo/cycle.hpp"
#include "hrtc_service/servo/flight_recorder.hpp"
#include "spm/pool.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

/// Returns the first message of a file: build, settings and devices of the HRTC.
[[nodiscard]] trace::FlightStart flight_start(const std::string& participant, const CycleSettings& settings,
                                              const spm::PoolSettings& pool,
                                              const std::array<haptics::DeviceSpec, kMaxProbes>& specs);

class FlightStore {
 public:
  /// `recorder` must outlive the store.
  FlightStore(FlightRecorder& recorder, trace::FlightStart start, double seconds, std::uint64_t max_bytes);

  /// Returns the max memory for `seconds` of cycles with that many probes.
  [[nodiscard]] static std::uint64_t bytes_for(double seconds, double period, std::uint32_t probes) noexcept;

  /// Adds the new records of the recorder, and drops old segments. Call it at least every quarter of a second.
  void drain();
  /// Writes the stored segments. Records that arrive meanwhile go to the store, not to the file. Returns the number of
  /// cycles written. Throws trace::McapError.
  std::uint64_t write(const std::filesystem::path& file, const std::string& reason);

  [[nodiscard]] std::uint64_t bytes() const noexcept { return words_ * sizeof(std::uint64_t); }
  /// Returns the number of all lost cycles, including those before the oldest segment.
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }

 private:
  using Words = std::vector<std::uint64_t>;
  struct Segment {
    std::uint64_t lost = 0;  // cycles lost before its state
    Words lost_events;       // events of these cycles
    Words state;             // state at its begin; empty: the start of the HRTC
    Words records;
    std::uint64_t first_cycle = 0, cycles = 0;
    std::int64_t first_ns = 0, last_ns = 0;
    [[nodiscard]] std::uint64_t words() const noexcept { return lost_events.size() + state.size() + records.size(); }
  };
  /// The objects and regions in the haptic thread at one time.
  struct Contents {
    std::vector<std::optional<trace::FlightObject>> objects;  // by index
    std::vector<std::vector<std::uint32_t>> pages;            // by object index, in the order of their arrival
    std::vector<std::set<std::uint32_t>> regions;             // by object index
    void apply(const std::uint64_t* entry);                   // of an event; ignores other entries
    void apply_entries(const Words& entries);
    void apply_records(const Words& records);
  };

  void add(const FlightRecord& record);
  void add_new_records();
  void drop_old_segments();
  [[nodiscard]] trace::FlightState state_of(const Segment& segment, const Contents& contents) const;

  FlightRecorder& recorder_;
  trace::FlightStart start_;
  std::int64_t duration_ns_;
  std::uint64_t max_words_;
  std::deque<Segment> segments_;
  Contents contents_;  // at the start of the oldest segment
  std::uint64_t words_ = 0, lost_ = 0;
  FlightRecord record_;
};

}  // namespace tactus::hrtc_service
