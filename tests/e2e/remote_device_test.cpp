/// Users with a remote device: the device is at the client, so its force loop runs over the network.
#include <condition_variable>
#include <mutex>

#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;

class RemoteDeviceTest : public SessionTest {};

constexpr char kLongTouchOfADevice[] = R"(name: remote device
duration: 120
users:
  - name: ann
    remote: true
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 100, force: 1}}]
)";

bool has_no_force(const session::ProbeState& state) {
  return state.force[0] == 0 && state.force[1] == 0 && state.force[2] == 0;
}

TEST_F(RemoteDeviceTest, ARemoteDeviceReceivesForcesOfTheExactSurfaceAndNoForceWhileItSendsNoPoses) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kLongTouchOfADevice)};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    const StateCounts ann = seen.user("ann");
    return ann.exact > 100 && !has_no_force(ann.last) && ann.last.origin.participant == session::id_of("desk");
  })) << users.output()
      << desk.output();
  EXPECT_TRUE(desk.wait_for_line("user ann has a remote device"));
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.figure("desk", figures::kRemoteDevices) == 1 && seen.figure("desk", figures::kDeviceRoundTrip) < 0.25e6;
  })) << "the metrics contain the round trip";
  EXPECT_GT(observer.seen().figure("desk", figures::kDeviceRoundTrip), 0);

  users.signal(SIGSTOP);
  EXPECT_TRUE(observer.until([](const Seen& seen) {
    const session::ProbeState state = seen.user("ann").last;
    return (state.status & session::kStalePose) != 0 && has_no_force(state) && state.data_age_us >= 60'000;
  })) << "before the HRTC removes the silent client";
  users.signal(SIGCONT);
  EXPECT_TRUE(observer.until([](const Seen& seen) {
    const session::ProbeState state = seen.user("ann").last;
    return (state.status & session::kStalePose) == 0 && !has_no_force(state);
  })) << "the force returns with new poses";
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kStaleCycles) > 0; }));
  users.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, museum));
}

TEST_F(RemoteDeviceTest, ARemoteDeviceIgnoresACommandWhoseSequenceNumberIsTooLarge) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kLongTouchOfADevice)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 100; })) << users.output();
  const wire::EndpointOptions partition{wire::user_partition("ann")};
  std::mutex mutex;
  std::condition_variable changed;
  std::uint32_t newest_felt = 0;  // the newest command whose force the device has exerted
  const wire::Reader<session::DevicePose> poses{observer.participants(), wire::topics::kDevicePose,
                                                [&](session::DevicePose&& pose) {
                                                  const std::lock_guard lock{mutex};
                                                  newest_felt = pose.command_applied;
                                                  changed.notify_all();
                                                },
                                                partition};
  wire::SessionAddress as_desk = address("desk");
  as_desk.incarnation = observer.seen().roster.at("desk").origin.incarnation;
  wire::Participants participants{as_desk};
  wire::Writer<session::DeviceCommand> commands{participants, wire::topics::kDeviceCommand, partition};
  const auto wait_for_felt = [&](const auto& condition) {
    std::unique_lock lock{mutex};
    return changed.wait_for(lock, kWatchdog, [&] { return condition(newest_felt); });
  };
  ASSERT_TRUE(wait_for_felt([&](std::uint32_t command) { return command > 100 && commands.matched() > 0; }));
  session::DeviceCommand future_command;
  future_command.origin = participants.origin();
  future_command.user_id = session::id_of("ann");
  future_command.sequence = 0xffffffff;
  const std::uint32_t felt_before = [&] {
    const std::lock_guard lock{mutex};
    return newest_felt;
  }();
  ASSERT_EQ(commands.send(future_command), wire::SendStatus::kSent);
  EXPECT_TRUE(
      wait_for_felt([&](std::uint32_t command) { return command > felt_before + 1000 && command < 0x80000000; }));
  users.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, museum));
}

}  // namespace
}  // namespace tactus::e2e
