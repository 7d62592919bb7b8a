#include "realtime/process.hpp"

#include <csignal>

namespace tactus::realtime {
namespace {

std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set in a signal handler");

void request_stop(int) { stop_requested = true; }

std::atomic<std::uint32_t> saves_requested{0}, emergency_stops_requested{0};
static_assert(std::atomic<std::uint32_t>::is_always_lock_free, "changed in a signal handler");

void request_save(int) { ++saves_requested; }
void request_emergency_stop(int) { ++emergency_stops_requested; }

/// Installs a handler, which also gets a signal that was delayed.
void install(int signal, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;
  sigaction(signal, &action, nullptr);
  sigset_t delayed;
  sigemptyset(&delayed);
  sigaddset(&delayed, signal);
  sigprocmask(SIG_UNBLOCK, &delayed, nullptr);
}

}  // namespace

const std::atomic<bool>& stop_signal() {
  struct sigaction action {};
  action.sa_handler = request_stop;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  return stop_requested;
}

void delay_user_signals() {
  sigset_t delayed;
  sigemptyset(&delayed);
  for (const int signal : {SIGUSR1, SIGUSR2}) sigaddset(&delayed, signal);
  sigprocmask(SIG_BLOCK, &delayed, nullptr);
}

const std::atomic<std::uint32_t>& save_signals() {
  install(SIGUSR1, request_save);
  return saves_requested;
}

const std::atomic<std::uint32_t>& emergency_stop_signals() {
  install(SIGUSR2, request_emergency_stop);
  return emergency_stops_requested;
}

}  // namespace tactus::realtime
