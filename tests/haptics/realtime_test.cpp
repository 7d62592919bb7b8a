#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <memory>
#include <new>

#include "haptics/body_touch.hpp"
#include "haptics/force.hpp"
#include "haptics/passivity.hpp"
#include "haptics/shared_object.hpp"
#include "haptics/simulated_device.hpp"
#include "tests/haptics/triangle_surface.hpp"

namespace {
std::atomic<long> g_allocations{0};
}  // namespace

// Not inlined, because the compiler would report malloc and free in these operators as a mismatch.
[[gnu::noinline]] void* operator new(std::size_t size) {
  ++g_allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc{};
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace tactus::haptics {
namespace {

TEST(Realtime, CountsAllocations) {
  const long before = g_allocations;
  int* volatile memory = new int;  // volatile, so that the compiler does not remove the allocation
  delete memory;
  EXPECT_GT(g_allocations, before);
}

TEST(Realtime, DeviceProxyAndForceDoNotAllocate) {
  testing::TriangleSurface surfaces[2]{testing::TriangleSurface{testing::bumpy(0.05, 1, 0.1)},
                                       testing::TriangleSurface{testing::bumpy(0.05, 2, 0.1)}};
  HandSettings hand;
  hand.start = {0, 0, 0.08};
  hand.tremor = 1e-3;
  hand.noise = 1e-5;
  SimulatedDevice device{hand};
  ForceRenderer renderer{{}, device.spec()};
  Proxy proxy;
  proxy.set_grip({0.5, 0.3});
  HandPath path;
  path.count = 2;
  path.waypoints[0] = {0, {0, 0, 0.08}};
  path.waypoints[1] = {500'000'000, {0.01, 0.02, 0.03}};
  device.paths().post(path);
  int contact_cycles = 0;

  const long before = g_allocations;
  for (int ms = 0; ms < 2000; ++ms) {
    const DeviceState state = device.read(ms * 1'000'000LL);
    const ProxyResult& touch = proxy.step(state.position, 1e-3, surfaces[ms / 100 % 2], ms % 100 == 0);
    device.write(renderer.step(touch, state, {1000, 1}, 0, 1e-3).force);
    if (touch.in_contact) ++contact_cycles;
  }
  EXPECT_EQ(g_allocations, before);
  EXPECT_GT(contact_cycles, 500);
}

TEST(Realtime, TouchingASharedObjectDoesNotAllocate) {
  const Vec3d half_size{0.05, 0.05, 0.05};
  BodyState start;
  start.position.z() = 0.05;
  const auto object = std::make_unique<SharedObject>(box_body(0.5, half_size), start);
  const auto coupling = std::make_unique<CopyCoupling>(CouplingSettings{}, 0, object->body().settings());
  object->couple(*coupling);
  BoxSurface shape{half_size};
  BodyTouch touch;
  PassivityController port;
  int touched_cycles = 0;

  const long before = g_allocations;
  for (int ms = 1; ms <= 1000; ++ms) {
    DeviceState device;
    device.position = {-0.06 + 2e-5 * ms, 0, 0.05};
    touch.step(device, ms > 500, object->state(), shape, {1000, 2}, 1e-3);
    (void)port.step(1000 * (touch.touch().anchor - device.position), device.position, 0, 1e-3);
    CopySample sample;
    sample.time_ns = ms * 1'000'000LL;
    sample.body = start;
    object->coupling()->on_sample(1, sample);
    object->step(ms * 1'000'000LL, {&touch.spring(), touch.is_touching() ? 1u : 0u}, {}, 1e-3);
    if (touch.is_touching()) ++touched_cycles;
  }
  EXPECT_EQ(g_allocations, before);
  EXPECT_GT(touched_cycles, 300);
}

}  // namespace
}  // namespace tactus::haptics
