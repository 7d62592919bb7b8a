/// What an HRTC tells of its cycles: percentiles from stored samples, the newest million.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "hrtc_service/haptic_thread.hpp"
#include "session/figures.hpp"
#include "session/messages.hpp"

namespace tactus::hrtc_service {

/// Samples in ns, a ring of fixed size.
class Samples {
 public:
  explicit Samples(std::size_t capacity) : capacity_{capacity} {}

  void add(std::uint32_t ns) {
    if (values_.size() < capacity_)
      values_.push_back(ns);
    else
      values_[next_++ % capacity_] = ns;
  }
  /// `share` in [0, 1]; microseconds; 0 without samples. O(n).
  [[nodiscard]] double percentile_us(double share) const {
    if (values_.empty()) return 0;
    std::vector<std::uint32_t> sorted = values_;
    const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), at, sorted.end());
    return *at / 1000.0;
  }
  [[nodiscard]] bool empty() const noexcept { return values_.empty(); }

 private:
  std::size_t capacity_;
  std::size_t next_ = 0;
  std::vector<std::uint32_t> values_;
};

/// One thread at a time.
class CycleStatistics {
 public:
  void add(const CycleTrace& trace) {
    ++cycles_;
    skipped_ += trace.skipped;
    contact_ += trace.in_contact;
    exact_ += trace.exact;
    stale_ += trace.stale;
    targets_dropped_ += trace.targets_dropped ? 1 : 0;
    wake_.add(trace.wake_late);
    const CycleCosts& costs = trace.costs;
    load_.add(costs.load);
    refine_.add(costs.refine);
    refit_.add(costs.refit);
    query_.add(costs.query);
    force_.add(costs.force);
    total_.add(costs.total());
  }
  /// A late cycle has been classified.
  void add(LateClass late) {
    switch (late) {
      case LateClass::kOverrun:
        ++overruns_;
        break;
      case LateClass::kPreempted:
        ++preempted_;
        break;
      case LateClass::kUnknown:
        ++late_unknown_;
        break;
    }
  }
  [[nodiscard]] std::uint64_t cycles() const noexcept { return cycles_; }

  /// `all`: percentiles as well, which cost some 50 ms for a million samples.
  void write(std::vector<session::Figure>& out, bool all) const {
    namespace names = session::figures;
    out.push_back({names::kCycles, static_cast<double>(cycles_)});
    out.push_back({names::kOverruns, static_cast<double>(overruns_)});
    out.push_back({names::kPreempted, static_cast<double>(preempted_)});
    out.push_back({names::kLateUnknown, static_cast<double>(late_unknown_)});
    out.push_back({names::kSkipped, static_cast<double>(skipped_)});
    out.push_back({names::kContactCycles, static_cast<double>(contact_)});
    out.push_back({names::kExactCycles, static_cast<double>(exact_)});
    out.push_back({names::kStaleCycles, static_cast<double>(stale_)});
    out.push_back({names::kTargetsDropped, static_cast<double>(targets_dropped_)});
    if (!all) return;
    out.push_back({names::kWakeP50, wake_.percentile_us(0.5)});
    out.push_back({names::kWakeP99, wake_.percentile_us(0.99)});
    out.push_back({names::kWakeMax, wake_.percentile_us(1)});
    const std::pair<const char*, const Samples*> times[] = {
        {names::kLoadTime, &load_},   {names::kRefineTime, &refine_}, {names::kRefitTime, &refit_},
        {names::kQueryTime, &query_}, {names::kForceTime, &force_},   {names::kCycleTime, &total_}};
    for (const auto& [name, samples] : times) {
      out.push_back({std::string(name) + ".p50", samples->percentile_us(0.5)});
      out.push_back({std::string(name) + ".p99", samples->percentile_us(0.99)});
      out.push_back({std::string(name) + ".p999", samples->percentile_us(0.999)});
      out.push_back({std::string(name) + ".max", samples->percentile_us(1)});
    }
  }

 private:
  static constexpr std::size_t kKept = 1'000'000;
  std::uint64_t cycles_ = 0, overruns_ = 0, preempted_ = 0, late_unknown_ = 0, skipped_ = 0;
  std::uint64_t contact_ = 0, exact_ = 0, stale_ = 0, targets_dropped_ = 0;
  Samples wake_{kKept}, load_{kKept}, refine_{kKept}, refit_{kKept}, query_{kKept}, force_{kKept}, total_{kKept};
};

}  // namespace tactus::hrtc_service
