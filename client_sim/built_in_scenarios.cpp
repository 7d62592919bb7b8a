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

constexpr char kDemo[] = R"(name: demo
duration: 20
users:
  - name: ann
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

}  // namespace

const std::vector<BuiltInScenario>& built_in_scenarios() {
  static const std::vector<BuiltInScenario> kScenarios{{"touch", kTouch}, {"follow", kFollow}, {"demo", kDemo}};
  return kScenarios;
}

}  // namespace tactus::client_sim
