/// Reads the figures of a study.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <string>

#include "study/fidelity.hpp"

namespace tactus::study {

inline const std::atomic<bool> kNoStop{false};

/// The figure with this name. Without such a figure, fails and returns -1.
inline double value_of(const Figures& figures, const std::string& name) {
  for (const Figure& figure : figures)
    if (figure.name == name) return figure.value;
  ADD_FAILURE() << name;
  return -1;
}

}  // namespace tactus::study
