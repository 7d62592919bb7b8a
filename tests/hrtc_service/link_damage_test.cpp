/// Writes random bytes everywhere in the memory that a gateway can write, while the servo runs. The servo may then lose
/// objects and users, but never exceeds its limits or reads other memory, which AddressSanitizer checks.
#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <limits>
#include <random>
#include <thread>

#include "hrtc_service/servo/probe_devices.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/local_session.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr int kWritesPerCycle = 100;
constexpr int kCyclesPerRestore = 500;  // after which the servo finds valid values again

class LinkDamageTest : public testing::Test {
 protected:
  LinkDamageTest() {
    ProbeInput& second = session_.inputs()[1];
    second.active = true;
    second.device.position = tip_ + Vec3d{1, 0, 0};  // at the movable object
    for (int cycle = 0; cycle < 1000; ++cycle) session_.step(tip_, Vec3d::Zero());
    session_.has_gateway = false;
    ProbeOrders orders{};
    for (std::uint32_t i = 1; i < kMaxProbes; ++i)
      orders[i] = {
          .source = i % 2 == 0 ? PoseSource::kRemote : PoseSource::kHand, .user = i, .start = {1 + tip_.x(), 0, 0}};
    MailboxWriter{link().devices.orders}.post(orders);
    valid_.resize(sizeof(ServoLink));
    std::memcpy(valid_.data(), static_cast<const void*>(&link()), valid_.size());
  }

  [[nodiscard]] ServoLink& link() { return session_.core().link(); }

  /// Writes at a random place of the next page: a random byte, or a value at the edge of its type.
  void damage() {
    constexpr std::size_t kPage = 4096;
    const std::size_t pages = (valid_.size() + kPage - 1) / kPage;
    page_ = (page_ + 1) % pages;
    const std::size_t offset = page_ * kPage + random_() % kPage;
    static const double kDoubles[] = {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                                      -1e300, 1e-300, 0.0};
    static const std::uint64_t kIntegers[] = {0, 1, 0x7fffffff, 0xffffffff, 1ull << 63, ~0ull};
    std::uint64_t value = random_();
    std::size_t size = 1;
    if (value % 4 == 0) {
      std::memcpy(&value, &kDoubles[random_() % std::size(kDoubles)], size = sizeof value);
    } else if (value % 4 == 1) {
      value = kIntegers[random_() % std::size(kIntegers)];
      size = random_() % 2 == 0 ? 4 : 8;
    }
    if (offset + size <= valid_.size()) std::memcpy(reinterpret_cast<std::byte*>(&link()) + offset, &value, size);
  }
  /// Makes all values valid again, as a new gateway that attaches: the intake then reads messages again.
  void restore() {
    std::memcpy(static_cast<void*>(&link()), valid_.data(), valid_.size());
    link().intake.attach_requests = ++attach_requests_;
  }

  /// Runs a cycle as the servo's threads do. Counts forces above the limits.
  void run_cycle() {
    now_ns_ += 1'000'000;
    session_.core().tick_servo();
    devices_.read(now_ns_, inputs_);
    Servo& servo = session_.core().servo();
    const Servo::Outputs outputs = servo.touch(inputs_, now_ns_);
    devices_.write(outputs);
    servo.publish(now_ns_, now_ns_ + 1'000'000);
    (void)servo.refine(spm::Budget{4000});
    for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
      const double force = Eigen::Map<const Vec3d>{outputs[i].force.data()}.norm();
      const double torque = Eigen::Map<const Vec3d>{outputs[i].torque.data()}.norm();
      if (force > 0) ++forces_[i];
      if (!(force <= limits_.max_force * 1.000001) || !(torque <= limits_.max_torque * 1.000001)) ++wrong_;
    }
  }

  void damage_link(int writes) {
    const int cycles = writes / kWritesPerCycle;
    for (int cycle = 0; cycle < cycles; ++cycle) {
      for (int i = 0; i < kWritesPerCycle; ++i) damage();
      run_cycle();
      if (cycle % kCyclesPerRestore == kCyclesPerRestore - 1) restore();
    }
    expect_no_force_above_limits(cycles);
  }
  /// The same by a second thread, so that a value also changes between a check and its use.
  void damage_link_during_cycles(int writes) {
    const int cycles = writes / kWritesPerCycle;
    std::atomic<int> cycle{0};
    std::jthread writer{[&] {
      for (int done = 0; done < writes;) {
        if (done < kWritesPerCycle * (cycle + 1)) damage(), ++done;
      }
    }};
    for (; cycle < cycles; ++cycle) {
      run_cycle();
      if (cycle % kCyclesPerRestore == kCyclesPerRestore - 1) restore();
    }
    writer.join();
    expect_no_force_above_limits(cycles);
  }
  void expect_no_force_above_limits(int cycles) const {
    EXPECT_EQ(wrong_, 0);
    EXPECT_GT(forces_[0], cycles / 20) << "of a fixed object; too few, so the limits were hardly tested";
    EXPECT_GT(forces_[1], 0) << "of a movable object";
  }

  const spm::offline::BuiltModel built_ =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 4000));
  const spm::Model model_ = built_.model();
  const Vec3d tip_{model_.summary.bounds_max[0] + 0.0025, 0, 0};
  test_support::LocalSession session_{
      {model_, model_}, 1, spm::PoolSettings::for_slots(3 * model_.summary.parts), 2, {}, {}, 0.8};
  const haptics::ForceSettings limits_ = test_support::LocalSession::cycle_settings().force;
  haptics::SimulatedDevice hand_{{.start = tip_}};
  ProbeDevices devices_{session_.core().link().devices, {&hand_}, haptics::DeviceFrame{}};
  Servo::Inputs inputs_;
  std::vector<std::byte> valid_;
  std::mt19937_64 random_{20261126};
  std::size_t page_ = 0;
  std::uint32_t attach_requests_ = 1000;  // larger than those of the gateway
  std::int64_t now_ns_ = 10'000'000'000;
  int wrong_ = 0;
  std::array<int, kMaxProbes> forces_{};  // cycles with a force, by probe
};

TEST_F(LinkDamageTest, OfAMillionWritesExceedsNoLimit) { damage_link(1'000'000); }

// ThreadSanitizer would report each of these writes.
#ifndef __SANITIZE_THREAD__
TEST_F(LinkDamageTest, OfAMillionWritesDuringCyclesExceedsNoLimit) { damage_link_during_cycles(1'000'000); }
#endif

using LinkDamageNightly = LinkDamageTest;
TEST_F(LinkDamageNightly, OfTenMillionWritesExceedsNoLimit) { damage_link(10'000'000); }
#ifndef __SANITIZE_THREAD__
TEST_F(LinkDamageNightly, OfTenMillionWritesDuringCyclesExceedsNoLimit) { damage_link_during_cycles(10'000'000); }
#endif

}  // namespace
}  // namespace tactus::hrtc_service
