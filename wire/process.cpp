#include "wire/process.hpp"

#include <csignal>

namespace tactus::wire {
namespace {

std::atomic<bool> stop_asked{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set in a signal handler");

void ask_to_stop(int) { stop_asked = true; }

}  // namespace

const std::atomic<bool>& stop_signal() {
  struct sigaction action {};
  action.sa_handler = ask_to_stop;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  return stop_asked;
}

}  // namespace tactus::wire
