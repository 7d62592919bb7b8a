/// Users whose devices stand at their own end of the network.
#include <condition_variable>
#include <mutex>

#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;

class RemoteDeviceTest : public SessionTest {};

constexpr char kTouch[] = R"(name: a device elsewhere
duration: 120
users:
  - name: ann
    remote: true
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 100, force: 1}}]
)";

bool is_at_rest(const session::ProbeState& state) {
  return state.force[0] == 0 && state.force[1] == 0 && state.force[2] == 0;
}

TEST_F(RemoteDeviceTest, FeelsTheExactSurfaceAndNoForceOnceItIsSilent) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kTouch)};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    const SeenStates ann = seen.user("ann");
    return ann.exact > 100 && !is_at_rest(ann.last) && ann.last.origin.participant == session::id_of("desk");
  })) << users.output()
      << desk.output();
  EXPECT_TRUE(desk.wait_for_line("user ann brings a device of its own"));
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.figure("desk", figures::kRemoteDevices) == 1 && seen.figure("desk", figures::kDeviceRoundTrip) < 0.25e6;
  })) << "its loop is measured";
  EXPECT_GT(observer.seen().figure("desk", figures::kDeviceRoundTrip), 0);

  users.signal(SIGSTOP);
  EXPECT_TRUE(observer.until([](const Seen& seen) {
    const session::ProbeState state = seen.user("ann").last;
    return (state.status & session::kStalePose) != 0 && is_at_rest(state) && state.data_age_us >= 60'000;
  })) << "before the roster gives it up";
  users.signal(SIGCONT);
  EXPECT_TRUE(observer.until([](const Seen& seen) {
    const session::ProbeState state = seen.user("ann").last;
    return (state.status & session::kStalePose) == 0 && !is_at_rest(state);
  })) << "the force comes back";
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kStaleCycles) > 0; }));
  users.signal(SIGINT);
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(ends_with(0, museum));
}

TEST_F(RemoteDeviceTest, GoesOnFeelingAfterOneCommandFromTheFarFuture) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kTouch)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 100; })) << users.output();
  const wire::EndpointOptions where{wire::user_partition("ann")};
  std::mutex mutex;
  std::condition_variable news;
  std::uint32_t felt = 0;
  const wire::Reader<session::DevicePose> poses{observer.participants(), wire::topics::kDevicePose,
                                                [&](session::DevicePose&& pose) {
                                                  const std::lock_guard lock{mutex};
                                                  felt = pose.command_felt;
                                                  news.notify_all();
                                                },
                                                where};
  wire::SessionAddress as_desk = address("desk");
  as_desk.incarnation = observer.seen().roster.at("desk").origin.incarnation;
  wire::Participants participants{as_desk};
  wire::Writer<session::DeviceCommand> commands{participants, wire::topics::kDeviceCommand, where};
  const auto feels = [&](const auto& condition) {
    std::unique_lock lock{mutex};
    return news.wait_for(lock, kWatchdog, [&] { return condition(felt); });
  };
  ASSERT_TRUE(feels([&](std::uint32_t command) { return command > 100 && commands.matched() > 0; }));
  session::DeviceCommand wrong;
  wrong.origin = participants.origin();
  wrong.user_id = session::id_of("ann");
  wrong.sequence = 0xffffffff;
  const std::uint32_t before = [&] {
    const std::lock_guard lock{mutex};
    return felt;
  }();
  ASSERT_EQ(commands.send(wrong), wire::SendStatus::kSent);
  EXPECT_TRUE(feels([&](std::uint32_t command) { return command > before + 1000 && command < 0x80000000; }));
  users.signal(SIGINT);
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(ends_with(0, museum));
}

}  // namespace
}  // namespace tactus::e2e
