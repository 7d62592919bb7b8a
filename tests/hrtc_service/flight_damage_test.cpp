// A flight recording is untrusted input: a replay of any bytes must end with an error or a report.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>
#include <set>

#include "hrtc_service/servo/flight_store.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/hrtc_service/flight_files.hpp"
#include "tests/support/local_session.hpp"
#include "tests/support/temporary_folder.hpp"
#include "trace/cdr.hpp"

namespace tactus {
namespace {

using hrtc_service::flight_support::kSphereRadius;
using hrtc_service::flight_support::position_on_sphere;
using spm::Vec3d;
using test_support::LocalSession;
using Messages = std::vector<trace::FlightMessage>;

constexpr std::uint64_t kDamageSeed = 18;
constexpr std::uint32_t kStatePeriod = 100;    // cycles
constexpr std::uint64_t kReplayedCycles = 40;  // length of the replayed part, which contains every kind of event
constexpr std::uint64_t kMaxPoolBytes = 1u << 26;

/// Overwrites one number, or the size of one sequence, of a message.
class Overwrite {
 public:
  static constexpr int kVariants = 8;
  /// `target`: index of the number or sequence, in the order of the fields. `variant`: index of the new value or size.
  Overwrite(std::size_t target, int variant) : target_{target}, variant_{variant} {}

  template <class T>
  void operator()(T& value) {
    if constexpr (std::is_same_v<T, bool>) {
      if (is_target()) value = !value;
    } else if constexpr (std::is_enum_v<T>) {
      auto number = static_cast<std::uint32_t>(value);
      (*this)(number);
      value = static_cast<T>(number);
    } else if constexpr (std::is_integral_v<T>) {
      if (is_target()) value = integer(value);
    } else if constexpr (std::is_floating_point_v<T>) {
      if (is_target()) value = static_cast<T>(number(static_cast<double>(value)));
    } else if constexpr (std::is_same_v<T, std::string>) {
      if (is_target()) value.assign(static_cast<std::size_t>(variant_) * 100, 'x');
    } else if constexpr (trace::cdr::IsArray<T>::value) {
      for (auto& element : value) (*this)(element);
    } else if constexpr (trace::cdr::IsVector<T>::value) {
      if (is_target()) resize(value);
      if (std::is_same_v<T, std::vector<std::uint8_t>>) return;  // another test damages the carried state
      if (!value.empty()) (*this)(value.front());
      if (value.size() > 1) (*this)(value.back());
    } else {
      T::fields(value, *this);
    }
  }
  /// Returns whether the message has a number or sequence with the index `target`.
  [[nodiscard]] bool found() const { return next_index_ > target_; }

 private:
  [[nodiscard]] bool is_target() { return next_index_++ == target_; }
  template <class T>
  [[nodiscard]] T integer(T value) const {
    constexpr T kMax = std::numeric_limits<T>::max();
    const T values[kVariants] = {0,    1,        7,       static_cast<T>(value + 1), static_cast<T>(value - 1),
                                 kMax, kMax / 2, kMax - 1};
    return values[variant_];
  }
  [[nodiscard]] double number(double value) const {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const double values[kVariants] = {
        0, std::numeric_limits<double>::quiet_NaN(), kInfinity, -value, 1e300, -1e300, 1e-300, 1e9};
    return values[variant_];
  }
  template <class T>
  void resize(std::vector<T>& value) const {
    const std::vector<T> before = value;
    const bool empty = value.empty();
    if (variant_ == 0) {
      value.clear();
    } else if (variant_ == 1 && !empty) {
      value.pop_back();
    } else if (variant_ == 2 && !empty) {
      value.push_back(before.back());
    } else if (variant_ == 3) {
      value.insert(value.end(), before.begin(), before.end());
    } else {
      value.resize(value.size() + (variant_ == 4 ? 3 : 1000));
    }
  }

  std::size_t target_, next_index_ = 0;
  int variant_;
};

/// Two tips, or two tools, each on a sphere. At intervals, one sphere is held and moved, and the other one is withdrawn
/// and offered again. The pool holds less than half of the records, so that regions are loaded and retired. The
/// recording begins in the middle of a run. Parameter: whether the users have tools.
class FlightDamage : public ::testing::TestWithParam<bool> {
 protected:
  static void SetUpTestSuite() {
    built_ = new spm::offline::BuiltModel{
        spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 3000))};
    encoded_ = new spm::codec::EncodedModel{built_->model()};
    spm::offline::TriangleMesh sphere = spm::offline::generate(spm::offline::Shape::kSphere, 80);
    for (std::array<float, 3>& position : sphere.positions)
      for (float& x : position) x *= 0.004f;
    tool_ = new spm::MeshProbe{sphere.positions, sphere.faces};
  }
  static void TearDownTestSuite() {
    delete tool_;
    delete encoded_;
    delete built_;
  }

  void SetUp() override {
    record();
    recorded_ = hrtc_service::flight_support::read_messages(file_);
    recorded_ = beginning(kReplayedCycles);
  }

  void record() {
    const spm::MeshProbe* const tool = GetParam() ? tool_ : nullptr;
    const spm::Model model = built_->model();
    const double radius = (model.summary.bounds_max[0] - model.summary.bounds_min[0]) / 2;
    const spm::PoolSettings pool =
        spm::PoolSettings::for_slots(static_cast<std::uint32_t>(0.8 * model.summary.parts) + 500);
    session::Material material;
    material.static_friction = 0.5;
    material.dynamic_friction = 0.4;
    hrtc_service::LoaderSettings loader;
    loader.tool = tool;
    const double scale = kSphereRadius / radius;
    LocalSession session{{model, model}, scale, pool, 2, loader, material, 0.5};
    hrtc_service::FlightRecorder recorder{kStatePeriod};
    session.cycle().set_observer(&recorder);
    hrtc_service::FlightStore store{
        recorder, hrtc_service::flight_start("desk", LocalSession::cycle_settings(tool), pool, LocalSession::specs()),
        0.1, hrtc_service::FlightStore::bytes_for(0.1, 0.001, 2)};
    const auto position = [](double cycle, double phase) { return position_on_sphere(cycle * 1.2e-2 + phase); };
    for (int cycle = 0; cycle < 1250; ++cycle) {
      const Vec3d movable_centre = Vec3d::UnitX();  // LocalSession places the movable object there
      session.prepare(movable_centre + position(cycle, 0), (position(cycle + 1, 0) - position(cycle, 0)) * 1000);
      if (cycle % 100 == 3) session.set_withdrawn(0, true);
      if (cycle % 100 == 60) session.set_withdrawn(0, false);
      session.inputs()[0].device.buttons =
          cycle % 100 > 8 && cycle % 100 < 18 ? std::uint32_t{haptics::kGrabButton} : 0;
      hrtc_service::ProbeInput& other = session.inputs()[1];
      other.active = true;
      other.device.position = position(cycle, 2);
      if (cycle % 100 == 20) session.cycle().stop(haptics::Fault::kEmergencyStop);
      if (cycle % 100 == 25) session.cycle().reset_faults();
      if (cycle > 100 && cycle % 100 > 4 && cycle % 100 < 15)
        for (const hrtc_service::TouchObject* object : session.cycle().objects())
          if (object->body)
            session.cycle().move(*object,
                                 hrtc_service::Placement{{{1 + 1e-5 * (cycle % 100), 0, 0}, {0, 0, 0, 1}}, scale});
      (void)session.run_cycle(1u << 20);
      store.drain();
    }
    (void)store.write(file_, "a test");
  }

  /// The step of a loop over messages or rounds. A replay with tools takes ten times as long as one with tips.
  [[nodiscard]] static std::size_t stride() { return GetParam() ? 10 : 1; }
  /// Replays these messages. Returns "same", "differs" or the error.
  std::string replay(const Messages& messages) {
    hrtc_service::flight_support::write_messages(file_, messages);
    return replay_file();
  }
  std::string replay_file() {
    hrtc_service::FlightReplayOptions options = hrtc_service::flight_support::replay_options(*encoded_);
    options.max_pool_bytes = kMaxPoolBytes;
    try {
      const hrtc_service::FlightReport report = hrtc_service::replay_flight(file_, options);
      return report.different_cycles > 0 ? "differs" : "same";
    } catch (const trace::FlightError& error) {
      return error.what();
    } catch (const trace::McapError& error) {
      return error.what();
    }
  }
  /// Returns the messages before the first cycle and those of the first `cycles` cycles.
  [[nodiscard]] Messages beginning(std::uint64_t cycles) const {
    Messages messages;
    for (const trace::FlightMessage& message : recorded_) {
      messages.push_back(message);
      if (std::holds_alternative<trace::FlightRefine>(message) && --cycles == 0) break;
    }
    return messages;
  }
  static trace::FlightState& state_of(Messages& messages) {
    for (trace::FlightMessage& message : messages)
      if (auto* const state = std::get_if<trace::FlightState>(&message)) return *state;
    throw std::logic_error("the recording has no state");
  }

  test_support::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "flight.mcap";
  Messages recorded_;
  static spm::offline::BuiltModel* built_;
  static spm::codec::EncodedModel* encoded_;
  static spm::MeshProbe* tool_;
};
spm::offline::BuiltModel* FlightDamage::built_ = nullptr;
spm::codec::EncodedModel* FlightDamage::encoded_ = nullptr;
spm::MeshProbe* FlightDamage::tool_ = nullptr;

TEST_P(FlightDamage, AnUndamagedRecordingIsReplayedToTheBit) {
  EXPECT_EQ(replay_file(), "same");
  EXPECT_EQ(replay(recorded_), "same");
  EXPECT_EQ(replay(beginning(5)), "same");
  std::array<int, std::variant_size_v<trace::FlightMessage>> found{};
  for (const trace::FlightMessage& message : recorded_) ++found[message.index()];
  EXPECT_THAT(found, testing::Each(testing::Gt(0))) << "the tests need each kind of message";
  using Kind = trace::FlightEvent::Kind;
  for (const Kind kind : {Kind::kObjectWithdrawn, Kind::kObjectDeparted})
    EXPECT_TRUE(std::any_of(recorded_.begin(), recorded_.end(), [&](const trace::FlightMessage& message) {
      const auto* const event = std::get_if<trace::FlightEvent>(&message);
      return event != nullptr && event->kind == kind;
    })) << static_cast<int>(kind);
}

TEST_P(FlightDamage, AReplayOfDamagedBytesEnds) {
  std::ifstream in{file_, std::ios::binary};
  const std::vector<char> whole{std::istreambuf_iterator<char>{in}, {}};
  std::mt19937_64 random{kDamageSeed};
  for (int round = 0; round < 150; ++round) {
    std::vector<char> bytes = whole;
    if (round % 3 == 0) bytes.resize(random() % bytes.size());
    for (int i = 0; i < 1 + round % 4 && !bytes.empty(); ++i) {
      // Damages the first bytes more often, because a checksum covers the later ones.
      const std::size_t position =
          random() % (round % 2 == 0 ? bytes.size() : std::min<std::size_t>(bytes.size(), 200));
      bytes[position] = static_cast<char>(random());
    }
    std::ofstream{file_, std::ios::binary}.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    (void)replay_file();
  }
}

TEST_P(FlightDamage, AReplayOfAMessageWithADamagedFieldEnds) {
  // Damages the first message of each type, and the first event of each kind.
  std::set<std::pair<std::size_t, std::uint32_t>> seen;
  int damaged = 0, refused = 0;
  for (std::size_t i = 0; i < recorded_.size(); ++i) {
    // With tools, a replay takes ten times as long. So only the start message, which contains the tool, is damaged.
    if (GetParam() && !std::holds_alternative<trace::FlightStart>(recorded_[i])) continue;
    const auto* const event = std::get_if<trace::FlightEvent>(&recorded_[i]);
    const auto kind = event != nullptr ? static_cast<std::uint32_t>(event->kind) : 0;
    if (!seen.insert({recorded_[i].index(), kind}).second) continue;
    bool found = true;
    for (std::size_t target = 0; found; target += GetParam() ? 3 : 1) {
      for (int variant = 0; variant < Overwrite::kVariants && found; ++variant) {
        Messages messages = recorded_;
        Overwrite overwrite{target, variant};
        std::visit([&](auto& message) { overwrite(message); }, messages[i]);
        found = overwrite.found();
        if (!found) continue;
        const std::string outcome = replay(messages);
        ++damaged;
        refused += outcome != "same" && outcome != "differs" ? 1 : 0;
      }
    }
  }
  EXPECT_GE(seen.size(), GetParam() ? 1u : 9u) << "all message types, and two kinds of events";
  EXPECT_GT(damaged, GetParam() ? 100 : 1000);
  EXPECT_GT(refused, damaged / 4);
}

TEST_P(FlightDamage, AReplayRefusesTargetsAndSlotsAboveTheirLimits) {
  const auto replay_with = [&](auto trace::FlightStart::*field, std::uint32_t value) {
    Messages messages = recorded_;
    for (trace::FlightMessage& message : messages)
      if (auto* const start = std::get_if<trace::FlightStart>(&message)) start->*field = value;
    return replay(messages);
  };
  constexpr std::uint32_t kMaxTargets = 65'536, kMaxSlots = 16'777'216;
  for (const std::uint32_t targets : {0u, kMaxTargets + 1})
    EXPECT_THAT(replay_with(&trace::FlightStart::targets, targets), testing::HasSubstr("targets, expected 1 to 65536"));
  EXPECT_THAT(replay_with(&trace::FlightStart::targets, kMaxTargets), testing::AnyOf("same", "differs"));
  EXPECT_THAT(replay_with(&trace::FlightStart::slots, kMaxSlots + 1), testing::HasSubstr("1 to 16777216"));
  EXPECT_THAT(replay_with(&trace::FlightStart::slots, kMaxSlots), testing::HasSubstr("a pool of bytes"))
      << "the memory is limited, too";
}

TEST_P(FlightDamage, AReplayDetectsImpossibleEvents) {
  using Kind = trace::FlightEvent::Kind;
  Messages messages = recorded_;
  const auto after_state = std::find_if(messages.begin(), messages.end(), [](const trace::FlightMessage& message) {
    return std::holds_alternative<trace::FlightRefine>(message);
  });
  const auto first_refine = static_cast<std::size_t>(after_state - messages.begin());
  const std::uint32_t regions = encoded_->compressed().summary().regions;
  // Which regions have come before this cycle depends on the speed of the machine. Any other one may arrive now.
  std::set<std::pair<std::uint32_t, std::uint32_t>> arrived;  // objects and regions
  for (const trace::FlightObjectState& object : state_of(recorded_).objects)
    for (const std::uint32_t region : object.loaded_regions) arrived.insert({object.object, region});
  for (std::size_t i = 0; i < first_refine; ++i)
    if (const auto* const event = std::get_if<trace::FlightEvent>(&recorded_[i]);
        event != nullptr && event->kind == Kind::kRegionArrived)
      arrived.insert({event->object, event->region});
  for (const Kind first : {Kind::kObjectArrived, Kind::kRegionArrived, Kind::kRegionRetired, Kind::kRegionDeparted,
                           Kind::kObjectWithdrawn, Kind::kObjectDeparted})
    for (const Kind second :
         {Kind::kRegionArrived, Kind::kRegionRetired, Kind::kReset, Kind::kObjectWithdrawn, static_cast<Kind>(11)})
      for (const std::uint32_t object : {0u, 1u, 63u, ~0u}) {
        if (GetParam() && object != 0) continue;
        for (const std::uint32_t region : {0u, 1u, regions / 2, regions - 1, regions, ~0u}) {
          const bool may_arrive = region < regions && arrived.count({object, region}) == 0;
          if (first == Kind::kRegionArrived && second == Kind::kReset && may_arrive) continue;
          messages = recorded_;
          for (const Kind kind : {second, second, first})  // each event is inserted before the previous one
            messages.insert(messages.begin() + static_cast<std::ptrdiff_t>(first_refine) + 1,
                            trace::FlightEvent{0, kind, object, region, 0});
          EXPECT_NE(replay(messages), "same");
        }
      }
}

TEST_P(FlightDamage, AReplayWithAMissingOrRepeatedMessageEnds) {
  for (std::size_t i = 0; i < recorded_.size(); i += stride()) {
    Messages messages = recorded_;
    messages.insert(messages.begin() + static_cast<std::ptrdiff_t>(i), recorded_[i]);
    (void)replay(messages);
    messages = recorded_;
    messages.erase(messages.begin() + static_cast<std::ptrdiff_t>(i));
    (void)replay(messages);
  }
}

TEST_P(FlightDamage, AReplayOfMessagesInAnotherOrderEnds) {
  std::mt19937_64 random{kDamageSeed};
  for (std::size_t round = 0; round < 100; round += stride()) {
    Messages messages = recorded_;
    for (std::size_t i = 0; i < 1 + round % 5; ++i)
      std::swap(messages[random() % messages.size()], messages[random() % messages.size()]);
    (void)replay(messages);
  }
}

TEST_P(FlightDamage, AReplayOfADamagedStateEndsAndAWrongSizeIsRefused) {
  Messages messages = beginning(4);
  trace::FlightState& state = state_of(messages);
  const std::vector<std::uint8_t> carried = state.carried;
  int refused = 0, damaged = 0;
  const auto damage = [&](std::size_t offset, std::uint64_t value, std::size_t size) {
    state.carried = carried;
    std::memcpy(state.carried.data() + offset, &value, std::min(size, carried.size() - offset));
    const std::string outcome = replay(messages);
    ++damaged;
    refused += outcome != "same" && outcome != "differs" ? 1 : 0;
  };
  // Damages every second word with tips. With tools, a replay takes ten times as long, so only every sixteenth word.
  std::mt19937_64 random{kDamageSeed};
  const std::size_t step = GetParam() ? 16 : 2;  // words
  for (std::size_t offset = 8 * (random() % step); offset < carried.size(); offset += 8 * step) {
    damage(offset, ~std::uint64_t{0}, 8);
    if (GetParam()) continue;
    damage(offset, 0x0000000200000003u, 8);
    damage(offset, 0x7f7f7f7f7f7f7f7fu, 8);
  }
  for (int round = 0; round < (GetParam() ? 60 : 500); ++round)
    damage(random() % carried.size(), random(), 1 + random() % 8);
  EXPECT_GT(refused, damaged / 10) << "for most words, each value is valid";
  for (const std::size_t size : {std::size_t{0}, carried.size() - 1, carried.size() / 2}) {
    state.carried.assign(carried.begin(), carried.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_THAT(replay(messages), testing::HasSubstr("found a state of " + std::to_string(size) + " bytes, expected "));
  }
}

INSTANTIATE_TEST_SUITE_P(Probes, FlightDamage, testing::Bool(),
                         [](const auto& probe) { return probe.param ? "Tool" : "Tip"; });

}  // namespace
}  // namespace tactus
