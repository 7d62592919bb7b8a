/// The last seconds of a controller's cycles, as its FlightRecorder tells them, and the file that they go to.
///
///   segment:  state before | records of a second  ---> next segment ...      the oldest goes when the rest is enough
///
/// Which regions the haptic thread had at the start of the oldest segment is kept up to date as segments go, so a file
/// can begin there. One thread at a time, which is neither the haptic nor the service thread: writing takes as long as
/// it takes. Allocates, up to `max_bytes`.
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "haptics/device.hpp"
#include "hrtc_service/cycle.hpp"
#include "hrtc_service/flight_recorder.hpp"
#include "spm/pool.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

/// What a file says of the controller that made it.
[[nodiscard]] trace::FlightStart flight_start(const std::string& participant, const CycleSettings& settings,
                                              const spm::PoolSettings& pool,
                                              const std::array<haptics::DeviceSpec, kMaxProbes>& specs);

class FlightStore {
 public:
  /// `recorder` must outlive the store; the objects that it tells of must be there until the last `write`.
  FlightStore(FlightRecorder& recorder, trace::FlightStart start, double seconds, std::uint64_t max_bytes);

  /// What `seconds` of that many probes take, at most.
  [[nodiscard]] static std::uint64_t bytes_for(double seconds, double period, std::uint32_t probes) noexcept;

  /// Takes what the recorder has; at least every quarter of a second.
  void drain();
  /// Writes what is kept, and drains meanwhile; returns the count of cycles. Throws trace::McapError.
  std::uint64_t write(const std::filesystem::path& file, const std::string& reason);

  [[nodiscard]] std::uint64_t bytes() const noexcept { return words_ * sizeof(std::uint64_t); }
  /// Cycles that are missing in all, those before the oldest kept included.
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }

 private:
  using Words = std::vector<std::uint64_t>;
  struct Segment {
    std::uint64_t lost = 0;  // cycles, before its state
    Words before;            // events of these
    Words state;             // what it goes on from; empty: a controller that has done nothing yet
    std::uint64_t state_cycle = 0;
    Words records;
    std::uint64_t first_cycle = 0, cycles = 0;
    std::int64_t first_ns = 0, last_ns = 0;
    [[nodiscard]] std::uint64_t words() const noexcept { return before.size() + state.size() + records.size(); }
  };
  /// What the haptic thread knows at some point.
  struct Known {
    std::vector<const TouchObject*> objects;    // by index
    std::vector<std::set<std::uint32_t>> here;  // their regions
    void take(const std::uint64_t* entry);      // an event's
    void take_all(const Words& entries);
    void take_records(const Words& records);
  };

  void take(const FlightRecord& record);
  void take_new();
  void evict();
  [[nodiscard]] trace::FlightState state_of(const Segment& segment, const Known& known) const;
  [[nodiscard]] static trace::FlightObject describe(const TouchObject& object);

  FlightRecorder& recorder_;
  trace::FlightStart start_;
  std::int64_t keep_ns_;
  std::uint64_t max_words_;
  std::deque<Segment> segments_;
  Known known_;  // when the first segment begins
  std::uint64_t words_ = 0, lost_ = 0;
  FlightRecord record_;
};

}  // namespace tactus::hrtc_service
