/// The last seconds of the cycles of an HRTC, as its FlightRecorder reports them, and the file to which they are
/// written.
///
///   segment:  state before | records of a second  ---> next segment ...      the oldest is dropped when the rest
///   suffices
///
/// The store always knows the regions that the haptic thread had at the start of the oldest segment, so a file can
/// begin there. One thread at a time, and neither the haptic nor the service thread, because writing has no time limit.
/// Allocates, up to `max_bytes`.
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
#include "hrtc_service/cycle.hpp"
#include "hrtc_service/flight_recorder.hpp"
#include "spm/pool.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

/// The HRTC that wrote a file.
[[nodiscard]] trace::FlightStart flight_start(const std::string& participant, const CycleSettings& settings,
                                              const spm::PoolSettings& pool,
                                              const std::array<haptics::DeviceSpec, kMaxProbes>& specs);

class FlightStore {
 public:
  /// `recorder` must outlive the store.
  FlightStore(FlightRecorder& recorder, trace::FlightStart start, double seconds, std::uint64_t max_bytes);

  /// The maximum memory for `seconds` with that many probes.
  [[nodiscard]] static std::uint64_t bytes_for(double seconds, double period, std::uint32_t probes) noexcept;

  /// Takes the new records of the recorder. Call it at least every quarter of a second.
  void drain();
  /// Writes the stored segments and takes new records meanwhile; returns the count of cycles. Throws trace::McapError.
  std::uint64_t write(const std::filesystem::path& file, const std::string& reason);

  [[nodiscard]] std::uint64_t bytes() const noexcept { return words_ * sizeof(std::uint64_t); }
  /// All lost cycles, also those before the oldest segment.
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }

 private:
  using Words = std::vector<std::uint64_t>;
  struct Segment {
    std::uint64_t lost = 0;  // cycles, before its state
    Words before;            // events of these
    Words state;             // where the replay starts; empty: at the start of the HRTC
    std::uint64_t state_cycle = 0;
    Words records;
    std::uint64_t first_cycle = 0, cycles = 0;
    std::int64_t first_ns = 0, last_ns = 0;
    [[nodiscard]] std::uint64_t words() const noexcept { return before.size() + state.size() + records.size(); }
  };
  /// The objects and regions of the haptic thread at one time.
  struct Known {
    std::vector<std::optional<trace::FlightObject>> objects;  // by index
    std::vector<std::set<std::uint32_t>> here;                // their regions
    void take(const std::uint64_t* entry);                    // an event's
    void take_all(const Words& entries);
    void take_records(const Words& records);
  };

  void take(const FlightRecord& record);
  void take_new();
  void evict();
  [[nodiscard]] trace::FlightState state_of(const Segment& segment, const Known& known) const;

  FlightRecorder& recorder_;
  trace::FlightStart start_;
  std::int64_t keep_ns_;
  std::uint64_t max_words_;
  std::deque<Segment> segments_;
  Known known_;  // at the start of the first segment
  std::uint64_t words_ = 0, lost_ = 0;
  FlightRecord record_;
};

}  // namespace tactus::hrtc_service
