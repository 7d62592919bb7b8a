#include "client_sim/scenario.hpp"

namespace tactus::client_sim {

namespace {

constexpr char kTouch[] = R"(name: touch
duration: 8
users:
  - name: ann
    script:
      - approach: {object: "#1", speed: 0.1, until_force: 0.5}
      - hold: {seconds: 0.5, force: 1}
      - retreat: {}
      - tap: {count: 5, speed: 0.1, force: 1}
      - wait: {seconds: 0.2}
)";

constexpr char kFollow[] = R"(name: follow
duration: 12
users:
  - name: ann
    repeat: true
    script:
      - approach: {object: "#1", speed: 0.1, until_force: 0.5}
      - follow: {speed: 0.05, force: 1.5, seconds: 10, pattern: circle}
      - retreat: {}
)";

/// One user raises a crate, and another user takes it over in the air and puts it down.
constexpr char kGrab[] = R"(name: grab
duration: 20
users:
  - name: ann
    hrtc: "#1"
    script:
      - grab: {object: crate, direction: [0, 0, 1], point: [0.3, 0.5, 0.5]}
      - move: {by: [0, 0, 0.1], speed: 0.1, seconds: 3}
      - release: {}
  - name: bob
    hrtc: "#2"
    script:
      - wait: {seconds: 3.5}
      - grab: {object: crate, direction: [0, 0, 1], point: [0.7, 0.5, 0.5], speed: 0.05}
      - wait: {seconds: 2.5}
      - move: {by: [0.05, 0, -0.1], speed: 0.1, seconds: 0.5}
      - release: {}
)";

/// Entries of two users who lift a crate, for the end of a list of users.
constexpr char kLifters[] = R"(  - name: dan
    hrtc: "#1"
    script:
      - lift: {object: crate, direction: [1, 0, 0], height: 0.1, seconds: 2}
  - name: eve
    hrtc: "#2"
    script:
      - lift: {object: crate, direction: [-1, 0, 0], height: 0.1, seconds: 2}
)";

constexpr char kDemoUsers[] = R"(  - name: ann
    hrtc: "#1"
    repeat: true
    script:
      - approach: {object: "#1", direction: [0, 0, 1], speed: 0.1, until_force: 0.5}
      - follow: {speed: 0.05, force: 1.5, seconds: 8, pattern: circle}
      - retreat: {}
      - tap: {count: 4, direction: [0.2, 0.1, 1], point: [0.4, 0.5, 0.5], speed: 0.15, force: 1}
      - follow:
          {direction: [-0.2, 0.1, 1], point: [0.6, 0.4, 0.5], speed: 0.05, force: 1.5, seconds: 6, pattern: zigzag}
      - retreat: {}
  - name: bob
    hrtc: "#2"
    repeat: true
    script:
      - approach: {object: "#1", direction: [0.5, -0.3, 1], speed: 0.1, until_force: 0.5}
      - follow: {speed: 0.05, force: 1.5, seconds: 9, pattern: zigzag}
      - retreat: {}
      - tap: {count: 5, direction: [0, 0.1, 1], point: [0.6, 0.6, 0.5], speed: 0.2, force: 1.5}
      - wait: {seconds: 0.3}
  - name: cyn
    hrtc: "#2"
    repeat: true
    script:
      - tap: {object: "#2", direction: [0, 0, 1], point: [0.35, 0.4, 0.5], count: 4, speed: 0.15, force: 1}
      - follow: {direction: [0, 0, 1], speed: 0.05, force: 1.5, seconds: 8, pattern: circle}
      - retreat: {}
      - approach: {direction: [0.1, 0, 1], point: [0.65, 0.6, 0.5], speed: 0.2, until_force: 1}
      - hold: {seconds: 0.5, force: 1}
      - follow: {speed: 0.05, force: 2, seconds: 5, pattern: zigzag}
      - retreat: {}
)";

// Scenarios of studies. In tap-scan, each tap touches another point, so its regions are not loaded yet.

constexpr char kTapWall[] = R"(name: tap-wall
measures: forces
truth: analytic
spread: 0.2
duration: 20
users:
  - name: ann
    script:
      - tap: {object: wall, count: 3, speed: 0.05, force: 1.5}
      - tap: {count: 3, speed: 0.15, force: 1.5}
      - tap: {count: 3, speed: 0.5, force: 1.5}
)";

constexpr char kTapWallRemote[] = R"(name: tap-wall-remote
measures: forces
truth: analytic
spread: 0.2
duration: 30
users:
  - name: ann
    remote: true
    script:
      - tap: {object: wall, count: 3, speed: 0.05, force: 1.5}
      - tap: {count: 3, speed: 0.15, force: 1.5}
      - tap: {count: 3, speed: 0.5, force: 1.5}
)";

constexpr char kTapScan[] = R"(name: tap-scan
measures: forces
truth: full-mesh
spread: 0.15
duration: 25
users:
  - name: ann
    script:
      - tap: {object: scan, direction: [0, 0, 1], point: [0.35, 0.35, 0.5], count: 1, speed: 0.05, force: 1.5}
      - tap: {direction: [0.2, 0.1, 1], point: [0.65, 0.4, 0.5], count: 1, speed: 0.1, force: 1.5}
      - tap: {direction: [0, 0.3, 1], point: [0.5, 0.65, 0.5], count: 1, speed: 0.2, force: 1.5}
      - tap: {direction: [0.6, 0, 1], point: [0.5, 0.5, 0.5], count: 1, speed: 0.3, force: 1.5}
      - tap: {direction: [-0.6, 0.2, 1], point: [0.4, 0.5, 0.5], count: 1, speed: 0.4, force: 1.5}
      - tap: {direction: [-0.2, -0.6, 1], point: [0.55, 0.4, 0.5], count: 1, speed: 0.5, force: 1.5}
)";

constexpr char kFollowScan[] = R"(name: follow-scan
measures: forces
truth: full-mesh
spread: 0.15
duration: 25
users:
  - name: ann
    script:
      - approach: {object: scan, direction: [0, 0, 1], speed: 0.1, until_force: 0.5}
      - follow: {speed: 0.05, force: 1.5, seconds: 4, pattern: circle, extent: 0.02}
      - retreat: {}
      - follow: {direction: [0.5, 0.2, 1], point: [0.6, 0.5, 0.5], speed: 0.1, force: 1.5, seconds: 4,
                 pattern: zigzag, extent: 0.03}
      - retreat: {}
      - follow: {direction: [-0.3, 0.2, 1], point: [0.4, 0.5, 0.5], speed: 0.15, force: 1.5, seconds: 4,
                 pattern: around}
)";

constexpr char kToolScan[] = R"(name: tool-scan
measures: forces
truth: full-mesh
tool: stylus
spread: 0.15
duration: 20
users:
  - name: ann
    script:
      - approach: {object: scan, direction: [0, 0, 1], speed: 0.1, until_force: 0.5}
      - follow: {speed: 0.05, force: 1.5, seconds: 4, pattern: circle, extent: 0.02, lean: 1.6}
      - retreat: {}
      - follow: {direction: [0.5, 0.2, 1], point: [0.6, 0.5, 0.5], speed: 0.1, force: 1.5, seconds: 4,
                 pattern: zigzag, extent: 0.03, lean: 1.6}
      - retreat: {}
)";

constexpr char kColdStart[] = R"(name: cold-start
measures: first-touch
truth: full-mesh
spread: 0.15
duration: 6
users:
  - name: ann
    script:
      - approach: {object: scan, direction: [0, 0, 1], speed: 0.2, until_force: 0.5}
      - follow: {speed: 0.05, force: 1.5, seconds: 2, pattern: zigzag, extent: 0.02}
)";

/// The users press on the crate above its centre of mass, at 70 % of its height. Only the weight resists a rotation
/// about the line between the two contact points. With the centre of mass below this line the crate hangs stably; with
/// the centre above it, the crate would tip over.
constexpr char kLift[] = R"(name: lift
measures: lift
truth: analytic
spread: 0.03
duration: 20
users:
  - name: dan
    hrtc: "#1"
    script:
      - lift: {object: crate, direction: [1, 0, 0], point: [0.5, 0.5, 0.7], height: 0.1, seconds: 2}
  - name: eve
    hrtc: "#2"
    script:
      - lift: {object: crate, direction: [-1, 0, 0], point: [0.5, 0.5, 0.7], height: 0.1, seconds: 2}
)";

constexpr char kTargetForce[] = R"(name: target-force
measures: target
truth: analytic
spread: 0.03
within: 0.2
duration: 12
users:
  - name: ann
    script:
      - approach: {object: crate, direction: [1, 0, 0], speed: 0.1, until_force: 0.2}
      - hold: {force: 2, seconds: 8}
  - name: bob
    hrtc: "#2"
    script:
      - approach: {object: crate, direction: [-1, 0, 0], speed: 0.1, until_force: 0.2}
      - hold: {force: 2, seconds: 8}
)";

constexpr char kHandOver[] = R"(name: hand-over
measures: hand-over
truth: state-machine
duration: 30
users:
  - name: ann
    hrtc: "#1"
    repeat: true
    script:
      - approach: {object: crate, direction: [1, 0, 0], speed: 0.2, until_force: 0.3}
      - hold: {force: 1, seconds: 1}
      - retreat: {speed: 0.2}
      - wait: {seconds: 1}
  - name: bob
    hrtc: "#2"
    repeat: true
    script:
      - approach: {object: crate, direction: [-1, 0, 0], speed: 0.2, until_force: 0.3}
      - hold: {force: 1, seconds: 1}
      - retreat: {speed: 0.2}
      - wait: {seconds: 1}
  - name: cyn
    hrtc: "#3"
    repeat: true
    script:
      - approach: {object: crate, direction: [0, 1, 0], speed: 0.2, until_force: 0.3}
      - hold: {force: 1, seconds: 1}
      - retreat: {speed: 0.2}
      - wait: {seconds: 1}
  - name: dan
    hrtc: "#4"
    repeat: true
    script:
      - approach: {object: crate, direction: [0, -1, 0], speed: 0.2, until_force: 0.3}
      - hold: {force: 1, seconds: 1}
      - retreat: {speed: 0.2}
      - wait: {seconds: 1}
)";

}  // namespace

const std::vector<BuiltInScenario>& built_in_scenarios() {
  const auto with = [](const char* name, const std::string& users) {
    return std::string{"name: "}.append(name).append("\nduration: 20\nusers:\n").append(users);
  };
  static const std::string kDemo = with("demo", kDemoUsers);
  static const std::string kDemoLift = with("demo-lift", std::string{kDemoUsers} + kLifters);
  static const std::vector<BuiltInScenario> kScenarios{{"touch", kTouch},
                                                       {"follow", kFollow},
                                                       {"lift", kLift},
                                                       {"grab", kGrab},
                                                       {"demo", kDemo.c_str()},
                                                       {"demo-lift", kDemoLift.c_str()},
                                                       {"tap-wall", kTapWall},
                                                       {"tap-wall-remote", kTapWallRemote},
                                                       {"tap-scan", kTapScan},
                                                       {"follow-scan", kFollowScan},
                                                       {"tool-scan", kToolScan},
                                                       {"cold-start", kColdStart},
                                                       {"target-force", kTargetForce},
                                                       {"hand-over", kHandOver}};
  return kScenarios;
}

}  // namespace tactus::client_sim
