/// A session that is published in a ROS domain, and a node there that uses another implementation of DDS.
#include <chrono>
#include <cmath>
#include <mutex>
#include <sstream>
#include <thread>

#include "tests/e2e/session_test.hpp"

#ifndef TACTUS_CYCLONE_ROS2
#define TACTUS_CYCLONE_ROS2 ""
#endif

namespace tactus::e2e {
namespace {

using Seen = Observer::Seen;
using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr char kPress[] = R"(name: press
duration: 60
users:
  - name: ann
    script:
      - approach: {object: "#1", direction: [0, 0, 1], until_force: 1}
      - hold: {force: 1, seconds: 60}
)";
constexpr char kPlacedSphere[] = R"(objects:
  - name: sphere
    model: MODEL
    position: [0.1, 0.2, 0.3]
    rotation: [0, 0, 0.6, 0.8]
    size: 0.2
)";
constexpr double kPosition = 0.002;  // m; the hand trembles, and a line of the node is up to 0.1 s old
constexpr double kForce = 0.3;       // N

/// A sample that the node has printed.
struct Line {
  double stamp = 0;  // s since 1970
  std::string frame, child;
  std::vector<double> numbers;
};

class Ros2Test : public SessionTest {
 protected:
  void SetUp() override {
    if (*TACTUS_CYCLONE_ROS2 == '\0') GTEST_SKIP() << "no Cyclone DDS (Debian: cyclonedds-dev, cyclonedds-tools)";
  }

  [[nodiscard]] std::vector<std::string> bridge(std::vector<std::string> options = {}) const {
    options.insert(options.end(), {"--ros-domain", std::to_string(ros_domain_)});
    return in_session("ros2", std::move(options));
  }
  [[nodiscard]] std::vector<std::string> node(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), {TACTUS_CYCLONE_ROS2, std::to_string(ros_domain_)});
    return arguments;
  }
  /// A host with a sphere of 0.2 m that is moved and rotated.
  [[nodiscard]] std::vector<std::string> museum() const {
    std::string placed = kPlacedSphere;
    placed.replace(placed.find("MODEL"), 5, models().sphere);
    return in_session("host", {"--name", "museum", "--config", write("objects.yaml", placed)});
  }

  /// Returns the samples of a topic that the node has printed.
  static std::vector<Line> lines_of(const Process& node, const std::string& topic) {
    std::vector<Line> lines;
    std::istringstream output{node.output()};
    for (std::string text; std::getline(output, text) && !output.eof();) {  // the last line may not be complete
      std::istringstream words{text};
      std::string word;
      words >> word;
      if (word != topic + ":") continue;
      Line line;
      words >> line.stamp >> line.frame;
      if (topic == "tf") words >> line.child;
      for (double number = 0; words >> number;) line.numbers.push_back(number);
      lines.push_back(std::move(line));
    }
    return lines;
  }
  /// Waits until `holds` is true for the newest sample of a topic. Returns the sample, or an empty one after 20 s.
  template <class Condition>
  static Line line_when(const Process& node, const std::string& topic, Condition&& holds) {
    const auto end = std::chrono::steady_clock::now() + kWatchdog;
    while (std::chrono::steady_clock::now() < end) {
      const std::vector<Line> lines = lines_of(node, topic);
      if (!lines.empty() && holds(lines.back())) return lines.back();
      std::this_thread::sleep_for(10ms);  // the output of a process can only be polled
    }
    return {};
  }
  static Line any_line(const Process& node, const std::string& topic) {
    return line_when(node, topic, [](const Line&) { return true; });
  }

  int ros_domain_ = 97 + domain_.first() % 4;  // above the domains of all sessions of tests
};

auto near(const std::array<double, 3>& values, double tolerance) {
  return ElementsAre(DoubleNear(values[0], tolerance), DoubleNear(values[1], tolerance),
                     DoubleNear(values[2], tolerance));
}

std::array<double, 3> three(const Line& line, std::size_t from = 0) {
  if (line.numbers.size() < from + 3) return {NAN, NAN, NAN};
  return {line.numbers[from], line.numbers[from + 1], line.numbers[from + 2]};
}

TEST_F(Ros2Test, ANodeWithTheDefaultQosReceivesWhatTheSessionPublishes) {
  Process host{museum()};
  Process desk{hrtc("desk")};
  Process users{sim(kPress)};
  Process ros{bridge()};
  Process rviz{node({"ann"})};
  Observer observer{address("observer")};

  for (const char* writer :
       {"rt/tactus/ann/wrench geometry_msgs::msg::dds_::WrenchStamped_ "
        "typehash=RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77; reliable volatile",
        "rt/tactus/ann/pose geometry_msgs::msg::dds_::PoseStamped_ "
        "typehash=RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8; reliable volatile",
        "rt/tactus/ann/proxy geometry_msgs::msg::dds_::PoseStamped_ "
        "typehash=RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8; reliable volatile",
        "rt/tactus/ann/twist geometry_msgs::msg::dds_::TwistStamped_ "
        "typehash=RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64; reliable volatile",
        "rt/tf tf2_msgs::msg::dds_::TFMessage_ "
        "typehash=RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087; reliable volatile",
        "rt/tactus/markers visualization_msgs::msg::dds_::MarkerArray_ "
        "typehash=RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf; reliable volatile"})
    EXPECT_TRUE(rviz.wait_for_line("^writer: " + std::string{writer} + "$")) << writer << '\n' << rviz.output();

  // The hand now holds the probe at the top of the sphere.
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 500; })) << users.output();
  const Line wrench = line_when(rviz, "wrench", [](const Line& line) { return line.numbers.at(2) > 0.5; });
  // Each 25th message is printed, and 250 are sent in a second.
  (void)line_when(rviz, "wrench", [&](const Line& line) { return line.stamp > wrench.stamp + 0.25; });
  const Line pose = any_line(rviz, "pose"), proxy = any_line(rviz, "proxy"), twist = any_line(rviz, "twist");
  const session::ProbeState state = observer.seen().user("ann").last;
  EXPECT_THAT(three(wrench), near(state.force, kForce));
  EXPECT_THAT(three(wrench, 3), ElementsAre(0, 0, 0));
  EXPECT_THAT(three(pose), near(state.device.position, kPosition));
  EXPECT_THAT(three(proxy), near(state.proxy, kPosition));
  EXPECT_THAT(three(twist), near(state.velocity, 0.05));
  const double now = static_cast<double>(std::chrono::system_clock::now().time_since_epoch().count()) / 1e9;
  for (const Line& line : {wrench, pose, proxy, twist}) {
    EXPECT_EQ(line.frame, "world");
    EXPECT_NEAR(line.stamp, now, 20);  // Unix time
  }
  const std::vector<Line> wrenches = lines_of(rviz, "wrench");
  ASSERT_GT(wrenches.size(), 2u);
  EXPECT_GT((wrenches.back().stamp - wrenches.front().stamp) / (static_cast<double>(wrenches.size() - 1) * 25), 0.0039);

  const Line transform = any_line(rviz, "tf");
  EXPECT_EQ(transform.frame, "world");
  EXPECT_EQ(transform.child, "tactus/sphere");
  EXPECT_THAT(transform.numbers, ElementsAre(0.1, 0.2, 0.3, 0, 0, 0.6, 0.8));
}

TEST_F(Ros2Test, MarkersShowTheMeshInTheFrameOfItsObject) {
  Process host{museum()};
  Process ros{bridge()};
  Process rviz{node({"ann"})};
  ASSERT_TRUE(rviz.wait_for_line("^marker: ")) << ros.output();
  const std::string output = rviz.output();
  std::istringstream marker{output.substr(output.find("marker: "))};
  std::string word, frame, ns;
  int id = -1, type = 0, action = -1, frame_locked = 0, has_embedded_materials = -1;
  std::uint32_t points = 0, colors = 0;
  std::array<double, 3> low{}, high{};
  marker >> word >> frame >> ns >> id >> type >> action >> points >> colors;
  for (double& bound : low) marker >> bound;
  for (double& bound : high) marker >> bound;
  marker >> frame_locked >> has_embedded_materials;
  ASSERT_TRUE(marker);
  EXPECT_EQ(frame, "tactus/sphere");
  EXPECT_EQ(ns, "tactus/sphere");
  EXPECT_EQ(std::vector({id, type, action, frame_locked, has_embedded_materials}), std::vector({0, 11, 0, 1, 0}));
  EXPECT_GT(points, 0u);
  EXPECT_EQ(points % 3, 0u);
  EXPECT_EQ(points, colors);
  EXPECT_THAT(low, near({-0.1, -0.1, -0.1}, 0.002));  // the base mesh is coarse
  EXPECT_THAT(high, near({0.1, 0.1, 0.1}, 0.002));

  host.signal(SIGTERM);
  EXPECT_TRUE(rviz.wait_for_line("^marker: tactus/sphere tactus/sphere 0 11 2 0 0 "))
      << rviz.output() << ros.output() << host.output();
}

TEST_F(Ros2Test, AProbeFollowsTargetPosesUntilTheyEnd) {
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process ros{bridge({"--rate", "100"})};
  Observer observer{address("observer")};
  std::mutex mutex;
  session::Intent intent;  // newest, guarded by `mutex`
  const wire::Reader<session::Intent> intents{observer.participants(),
                                              wire::topics::kIntent,
                                              [&](session::Intent&& sample) {
                                                const std::lock_guard lock{mutex};
                                                intent = std::move(sample);
                                              },
                                              {wire::user_partition("guest")}};
  Process arm{node({"guest", "world", "0.002", "0.003", "0.09"})};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return std::abs(seen.user("guest").last.device.position[2] - 0.09) < kPosition;
  })) << ros.output()
      << arm.output();
  {
    const std::lock_guard lock{mutex};
    ASSERT_FALSE(intent.path.empty());
    EXPECT_THAT(intent.path.back().pose.orientation, ElementsAre(0, 0, 0.6, 0.8));
  }
  const Line pose =
      line_when(arm, "pose", [](const Line& line) { return std::abs(line.numbers.at(2) - 0.09) < kPosition; });
  EXPECT_THAT(three(pose), near({0.002, 0.003, 0.09}, kPosition)) << arm.output();

  arm.signal(SIGTERM);
  EXPECT_EQ(arm.wait(), 0);
  EXPECT_TRUE(ros.wait_for_line("target poses of guest: .* the topic sent no hand position for 2 s")) << ros.output();
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.has_left("ros2.guest"); }));
  ros.signal(SIGTERM);
  EXPECT_TRUE(exits_with(0, ros));
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.has_left("ros2"); }));
}

TEST_F(Ros2Test, ATargetPoseInAnotherFrameIsReportedAndBringsNoUser) {
  Process desk{hrtc("desk")};
  Process ros{bridge({"--frame", "lab"})};
  Observer observer{address("observer")};
  Process arm{node({"guest", "world", "0", "0", "0.2"})};
  EXPECT_TRUE(ros.wait_for_line("target poses of guest: found frame 'world', expected 'lab'")) << ros.output();
  EXPECT_FALSE(observer.seen().is_present("ros2.guest"));
}

TEST_F(Ros2Test, AReadOnlyProgramBringsNoUser) {
  Process host{museum()};
  Process desk{hrtc("desk")};
  Process ros{bridge({"--read-only"})};
  Observer observer{address("observer")};
  Process arm{node({"guest", "world", "0", "0", "0.2"})};
  // With the first transforms, both have discovered each other; the next ones give a user the time to come.
  (void)line_when(arm, "tf", [&](const Line&) { return lines_of(arm, "tf").size() > 10; });
  ASSERT_GT(lines_of(arm, "tf").size(), 10u) << ros.output();
  EXPECT_FALSE(observer.seen().is_present("ros2.guest"));
}

TEST_F(Ros2Test, NamesAMissingProfile) {
  for (const char* file : {"session.xml", "probe.xml", "bulk.xml", "flow.yaml"})
    std::filesystem::copy(wire::default_qos_directory() / file, path(file));
  Process missing{bridge({"--qos", folder_.path().string()})};
  EXPECT_TRUE(exits_with(2, missing));
  EXPECT_THAT(missing.output(), HasSubstr("ros2.xml: no such file"));
}

}  // namespace
}  // namespace tactus::e2e
