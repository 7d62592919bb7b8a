/// Creates objects whose sockets are in a network namespace.
#pragma once

#include <exception>
#include <memory>
#include <thread>
#include <utility>

#include "netem/pair.hpp"

namespace tactus::bench {

/// Creates a T in a thread that has entered the namespace, so that all sockets of T are in this namespace.
template <class T, class... Arguments>
std::unique_ptr<T> make_in_namespace(const netem::LinkedPair& pair, netem::Side side, Arguments&&... arguments) {
  std::unique_ptr<T> made;
  std::exception_ptr error;
  std::thread{[&] {
    try {
      pair.enter_namespace(side);
      made = std::make_unique<T>(std::forward<Arguments>(arguments)...);
    } catch (...) {
      error = std::current_exception();
    }
  }}.join();
  if (error != nullptr) std::rethrow_exception(error);
  return made;
}

}  // namespace tactus::bench
