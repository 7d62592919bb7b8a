/// Counts the cycles of an HRTC, and computes percentiles of their times over the newest 100,000 cycles.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "hrtc_service/servo/servo_link.hpp"
#include "session/figures.hpp"
#include "session/messages.hpp"
#include "session/percentile.hpp"

namespace tactus::hrtc_service {

/// Samples in ns.
using Samples = session::Samples<std::uint32_t>;
/// Number of newest cycles whose times are stored.
inline constexpr std::size_t kMaxSamples = 100'000;

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
    recent_.add(costs.total());
  }
  /// Adds the class of a late cycle.
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

  /// Appends the figures; percentiles take O(stored cycles). The next call reports the cycles after this one as recent.
  void add_figures(std::vector<session::Figure>& out, bool with_percentiles) {
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
    if (!recent_.empty()) out.push_back({names::kRecentCycleP99, recent_.percentile(0.99) * 1e-3});
    recent_.clear();
    if (!with_percentiles || wake_.empty()) return;
    out.push_back({names::kWakeP50, wake_.percentile(0.5) * 1e-3});
    out.push_back({names::kWakeP99, wake_.percentile(0.99) * 1e-3});
    out.push_back({names::kWakeMax, wake_.percentile(1) * 1e-3});
    const std::pair<const char*, const Samples*> times[] = {
        {names::kLoadTime, &load_},   {names::kRefineTime, &refine_}, {names::kRefitTime, &refit_},
        {names::kQueryTime, &query_}, {names::kForceTime, &force_},   {names::kCycleTime, &total_}};
    for (const auto& [name, samples] : times) {
      out.push_back({std::string(name) + ".p50", samples->percentile(0.5) * 1e-3});
      out.push_back({std::string(name) + ".p99", samples->percentile(0.99) * 1e-3});
      out.push_back({std::string(name) + ".p999", samples->percentile(0.999) * 1e-3});
      out.push_back({std::string(name) + ".max", samples->percentile(1) * 1e-3});
    }
  }

 private:
  std::uint64_t cycles_ = 0, overruns_ = 0, preempted_ = 0, late_unknown_ = 0, skipped_ = 0;
  std::uint64_t contact_ = 0, exact_ = 0, stale_ = 0, targets_dropped_ = 0;
  Samples wake_{kMaxSamples}, load_{kMaxSamples}, refine_{kMaxSamples}, refit_{kMaxSamples}, query_{kMaxSamples},
      force_{kMaxSamples}, total_{kMaxSamples};
  static constexpr std::size_t kMaxRecent = 10'000;
  Samples recent_{kMaxRecent};  // computing times of the cycles since add_figures
};

}  // namespace tactus::hrtc_service
