#include "wire/transport/gate.hpp"

namespace tactus::wire {

void Gate::open() noexcept {
  const std::lock_guard<std::mutex> lock{mutex_};
  open_ = true;
  opened_.notify_all();
}

void Gate::pass() {
  if (open_) return;
  std::unique_lock<std::mutex> lock{mutex_};
  opened_.wait_for(lock, timeout_, [this] { return open_.load(); });
}

}  // namespace tactus::wire
