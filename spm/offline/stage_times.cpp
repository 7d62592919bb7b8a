#include "spm/offline/stage_times.hpp"

#include <sys/resource.h>

#include <algorithm>
#include <chrono>

namespace tactus::spm::offline {
namespace {

double wall() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

double cpu() {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

}  // namespace

void StageTimes::begin(std::string_view stage) {
  if (running_ && stages_[at_].name == stage) return;
  end();
  const auto same = [stage](const Stage& s) { return s.name == stage; };
  at_ = static_cast<std::size_t>(std::find_if(stages_.begin(), stages_.end(), same) - stages_.begin());
  if (at_ == stages_.size()) stages_.push_back({std::string{stage}, 0, 0});
  running_ = true;
  since_ = wall();
  cpu_since_ = cpu();
}

void StageTimes::end() {
  if (!running_) return;
  stages_[at_].seconds += wall() - since_;
  stages_[at_].cpu_seconds += cpu() - cpu_since_;
  running_ = false;
}

StageTimes::Stage StageTimes::sum() const {
  Stage all{"all", 0, 0};
  for (const Stage& stage : stages_) {
    all.seconds += stage.seconds;
    all.cpu_seconds += stage.cpu_seconds;
  }
  return all;
}

double peak_resident_bytes() {
  rusage used{};
  return getrusage(RUSAGE_SELF, &used) == 0 ? 1024.0 * static_cast<double>(used.ru_maxrss) : 0;
}

}  // namespace tactus::spm::offline
