// Prints the contacts of a session with a fixed path of the hand. Each line is a millisecond: in contact, in exact
// contact, and the number of shown faces, which is updated every 100 ms. page_test.js compares them with those of the
// WebAssembly module.
#include <cstdio>
#include <exception>

#include "spm/offline/generate.hpp"
#include "web/touch_session.hpp"

namespace tactus::web {
namespace {

constexpr std::uint32_t kFaces = 60'000, kSeed = 1;
constexpr int kMilliseconds = 6000;
constexpr double kSize = 0.16;

/// Rises and falls between 0 and 1. page_test.js has the same function.
double triangle_wave(int ms, int period) {
  const int at = ms % period, half = period / 2;
  return static_cast<double>(at < half ? at : period - at) / half;
}

void trace() {
  using namespace spm::offline;
  TouchSession session{"organ", generate(Shape::kOrgan, kFaces, kSeed), kSize, kSeed};
  const double top = session.bounds()[5];
  std::uint32_t faces = 0;
  for (int ms = 0; ms < kMilliseconds; ++ms) {
    if (ms % 16 == 0)
      session.move_hand({0.03 * triangle_wave(ms, 1900) - 0.015, 0.03 * triangle_wave(ms, 2300) - 0.015,
                         top + 0.02 - 0.05 * triangle_wave(ms, 3000)});
    session.step();
    if (ms % 100 == 99 && session.update_mesh()) faces = static_cast<std::uint32_t>(session.figures().faces);
    const UserView& user = session.users()[0];
    std::printf("%.0f %.0f %u\n", user.in_contact, user.in_contact * user.exact, faces);
  }
}

}  // namespace
}  // namespace tactus::web

int main() {
  try {
    tactus::web::trace();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "touch_trace: %s\n", error.what());
    return 2;
  }
}
