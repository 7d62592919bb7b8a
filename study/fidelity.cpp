#include "study/fidelity.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "study/constants.hpp"

namespace tactus::study {
namespace {

constexpr std::size_t kMinPause = 20;  // ms without force between two touches; after less, the touch continues

/// Returns the mean of `count` values with the given sum; NaN if there are none.
double mean(double sum, std::size_t count) {
  return count > 0 ? sum / static_cast<double>(count) : std::numeric_limits<double>::quiet_NaN();
}

/// Returns a maximum of `count` values; NaN if there are none.
double max_of(double max, std::size_t count) { return count > 0 ? max : std::numeric_limits<double>::quiet_NaN(); }

}  // namespace

double jnd_of(double force) noexcept { return std::max(0.1 * force, kMinForce); }

double torque_jnd_of(double torque) noexcept { return std::max(0.13 * torque, kMinTorque); }

void Fidelity::Touches::add(std::size_t ms, const Vec3d& position, double force) {
  if (force < kMinForce) return;
  if (all.empty() || ms >= all.back().end + kMinPause) all.push_back({ms, ms, position, 0});
  all.back().end = ms + 1;
  all.back().peak = std::max(all.back().peak, force);
}

const Fidelity::Touch* Fidelity::Touches::overlapping(const Touch& other) const {
  const auto found = std::find_if(
      all.begin(), all.end(), [&](const Touch& touch) { return touch.begin < other.end && other.begin < touch.end; });
  return found == all.end() ? nullptr : &*found;
}

void Fidelity::add(const Vec3d& position, const haptics::Wrench& felt, const haptics::Wrench& truth, bool exact) {
  const double size = truth.force.norm();
  felt_.add(ms_, position, felt.force.norm());
  truth_.add(ms_, position, size);
  ++ms_;
  if (felt.force.norm() >= kMinForce) {
    ++felt_ms_;
    exact_ms_ += exact ? 1 : 0;
  } else if (size < kMinForce) {
    return;
  }
  ++contact_ms_;
  const double error = (felt.force - truth.force).norm();
  squares_ += error * error;
  max_ = std::max(max_, error);
  above_jnd_ms_ += error > jnd_of(size) ? 1 : 0;
  const double torque = truth.torque.norm(), torque_error = (felt.torque - truth.torque).norm();
  true_torque_squares_ += torque * torque;
  torque_squares_ += torque_error * torque_error;
  torque_max_ = std::max(torque_max_, torque_error);
  torque_above_jnd_ms_ += torque_error > torque_jnd_of(torque) ? 1 : 0;
}

Figures Fidelity::figures() const {
  double onset_ms = 0, onset_mm = 0, ratio = 0;  // sums of differences and of ratios
  std::size_t paired = 0, missed = 0;
  const Touch* last = nullptr;
  for (const Touch& truth : truth_.all) {
    const Touch* const felt = felt_.overlapping(truth);
    if (felt == nullptr) ++missed;
    if (felt == nullptr || felt == last)
      continue;  // a touch already paired with an earlier true touch has no new onset
    last = felt;
    ++paired;
    onset_ms += std::abs(static_cast<double>(felt->begin) - static_cast<double>(truth.begin));
    onset_mm += (felt->position - truth.position).norm() * 1e3;
    ratio += felt->peak / truth.peak;
  }
  const auto without_truth = std::count_if(felt_.all.begin(), felt_.all.end(),
                                           [&](const Touch& felt) { return truth_.overlapping(felt) == nullptr; });
  const auto number = [](std::size_t value) { return static_cast<double>(value); };
  return {{"contact", "s", number(felt_ms_) * kCycle},
          {"exact", "%", 100 * mean(number(exact_ms_), felt_ms_)},
          {"force error rms", "N", std::sqrt(mean(squares_, contact_ms_))},
          {"force error max", "N", max_of(max_, contact_ms_)},
          {"above 1 JND", "%", 100 * mean(number(above_jnd_ms_), contact_ms_)},
          {"touches", "", number(truth_.all.size())},
          {"onset time error", "ms", mean(onset_ms, paired)},
          {"onset position error", "mm", mean(onset_mm, paired)},
          {"peak force ratio", "", mean(ratio, paired)},
          {"missed", "", number(missed)},
          {"false", "", static_cast<double>(without_truth)}};
}

Figures Fidelity::torque_figures() const {
  return {{"torque error rms", "mN m", 1e3 * std::sqrt(mean(torque_squares_, contact_ms_))},
          {"torque error max", "mN m", 1e3 * max_of(torque_max_, contact_ms_)},
          {"torque above 1 JND", "%", 100 * mean(static_cast<double>(torque_above_jnd_ms_), contact_ms_)},
          {"true torque rms", "mN m", 1e3 * std::sqrt(mean(true_torque_squares_, contact_ms_))}};
}

}  // namespace tactus::study
