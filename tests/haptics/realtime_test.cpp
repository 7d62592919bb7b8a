#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <new>

#include "haptics/force.hpp"
#include "haptics/simulated_device.hpp"
#include "tests/haptics/triangle_surface.hpp"

namespace {
std::atomic<long> g_allocations{0};
}  // namespace

// Not inlined: the compiler would take the pairing of malloc and free in them for a mismatch.
[[gnu::noinline]] void* operator new(std::size_t size) {
  ++g_allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc{};
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace tactus::haptics {
namespace {

TEST(Realtime, TheCountOfAllocationsCounts) {
  const long before = g_allocations;
  int* volatile memory = new int;  // volatile: not optimised away
  delete memory;
  EXPECT_GT(g_allocations, before);
}

TEST(Realtime, DeviceProxyAndForceDoNotAllocate) {
  const testing::TriangleSurface surfaces[2]{testing::TriangleSurface{testing::bumpy(0.05, 1, 0.1)},
                                             testing::TriangleSurface{testing::bumpy(0.05, 2, 0.1)}};
  HandSettings hand;
  hand.start = {0, 0, 0.08};
  hand.tremor = 1e-3;
  hand.noise = 1e-5;
  SimulatedDevice device{hand};
  ForceRenderer renderer{{}, device.spec()};
  Proxy proxy;
  proxy.set_grip({0.5, 0.3, 1000});
  HandPath path;
  path.count = 2;
  path.waypoints[0] = {0, {0, 0, 0.08}};
  path.waypoints[1] = {500'000'000, {0.01, 0.02, 0.03}};
  device.wishes().post(path);
  int contacts = 0;

  const long before = g_allocations;
  for (int ms = 0; ms < 2000; ++ms) {
    const DeviceState state = device.read(ms * 1'000'000LL);
    const ProxyResult& touch = proxy.step(state.position, 1e-3, surfaces[ms / 100 % 2], ms % 100 == 0);
    device.write(renderer.step(touch, state, {1000, 1}, 0, 1e-3).force);
    if (touch.in_contact) ++contacts;
  }
  EXPECT_EQ(g_allocations, before);
  EXPECT_GT(contacts, 500);
}

}  // namespace
}  // namespace tactus::haptics
