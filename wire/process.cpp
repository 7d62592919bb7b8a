#include "wire/process.hpp"

#include <csignal>

namespace tactus::wire {
namespace {

std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set in a signal handler");

void request_stop(int) { stop_requested = true; }

std::atomic<std::uint32_t> saves_requested{0};
static_assert(std::atomic<std::uint32_t>::is_always_lock_free, "changed in a signal handler");

void request_save(int) { ++saves_requested; }

}  // namespace

const std::atomic<bool>& stop_signal() {
  struct sigaction action {};
  action.sa_handler = request_stop;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  return stop_requested;
}

const std::atomic<std::uint32_t>& save_signals() {
  struct sigaction action {};
  action.sa_handler = request_save;
  action.sa_flags = SA_RESTART;
  sigaction(SIGUSR1, &action, nullptr);
  return saves_requested;
}

}  // namespace tactus::wire
