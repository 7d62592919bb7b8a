/// Reads scenarios from YAML: the scripts of simulated users.
///
///     name: touch
///     measures: forces        # what a study measures (docs/how-to/studies.md)
///     truth: full-mesh        # ground truth with which the study compares
///     tool: stylus            # probe of the users in a study; default: a sphere
///     duration: 10            # s
///     users:
///       - name: ann
///         hrtc: "#1"          # name, or "#n": the n-th HRTC of the session in the order of names
///         script:
///           - approach: {object: organ, direction: [0, 0, 1], speed: 0.1, until_force: 0.5}
///           - tap: {count: 5, speed: 0.2, force: 1}
///           - retreat: {}
///
/// SI units. Not realtime.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "spm/model.hpp"

namespace tactus::client_sim {

using spm::Vec3d;

/// Thrown for a scenario that does not exist.
class ScenarioError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class ActionKind : std::uint8_t {
  kApproach,  ///< moves from outside towards `point` of the object until the contact has `force`
  kTap,       ///< approaches until `force` or `depth` and moves back, `count` times
  kFollow,    ///< moves along the surface at `speed` with `force`, for `seconds`
  kHold,      ///< presses with `force` for `seconds`; if `force` is 0, does not move
  kWait,      ///< does not move for `seconds`
  kLift,      ///< with other users, presses with `force`, raises the object by `height`, waits `seconds`, puts it down
  kGrab,      ///< approaches, and holds the object at the contact point
  kMove,      ///< moves a held object by `displacement`, and waits `seconds`
  kRelease,   ///< releases the object and moves away
  kRetreat    ///< leaves the object's bounds in the direction of the approach
};

/// Paths along a surface.
enum class Pattern : std::uint8_t {
  kCircle,  ///< a circle of radius `extent` around the first contact, seen along the approach
  kZigzag,  ///< parallel rows over a square of half edge `extent`
  kAround   ///< around the object's centre, in a plane parallel to the approach
};

struct Action {
  ActionKind kind = ActionKind::kWait;
  std::string object;                  ///< name or "#n"; empty: the object of the previous action
  Vec3d direction = Vec3d::UnitZ();    ///< object's frame, unit, towards the hand
  Vec3d point = Vec3d::Constant(0.5);  ///< target point, as a share of the object's bounds along each axis
  double speed = 0.1;                  ///< m/s
  double force = 1;                    ///< N; the key of approach and grab is until_force
  double depth = 0;                    ///< tap: m below the first contact at which the hand turns back; 0: at `force`
  double seconds = 1;                  ///< s
  std::uint32_t count = 1;
  double height = 0.1;                 ///< lift: m
  Vec3d displacement = Vec3d::Zero();  ///< move: m, world
  std::uint32_t min_other_users = 1;   ///< lift: number of other users who have to press before the user lifts
  Pattern pattern = Pattern::kCircle;
  double extent = 0;  ///< follow: m, size of the pattern; 0: a third of the smaller half extent of the bounds
  double tilt =
      0;  ///< follow: rad, amplitude of the tilt from the normal; the rotation about the normal has twice this value
};

struct User {
  std::string name;
  std::string hrtc;                ///< name or "#n"
  double radius = 0.003;           ///< m, of the probe
  bool repeats_script = false;     ///< true: the script repeats until the session ends
  bool has_remote_device = false;  ///< true: the client simulates the device; false: the HRTC does
  std::vector<Action> script;
};

/// The quantity that a study measures in a run of the scenario.
enum class Measure : std::uint8_t {
  kNone,        ///< no measurement
  kForces,      ///< forces on each hand, at each of its positions
  kFirstTouch,  ///< forces, and the time until an HRTC that has just started has loaded the touched regions
  kTarget,      ///< error of the force with which users press one body from several sides
  kLift,        ///< motion of a body that users lift together
  kHandOver     ///< times at which a user takes over a body from another user
};
/// The ground truth with which a study compares the measurement.
enum class Truth : std::uint8_t {
  kNone,
  kFullMesh,     ///< forces of a second proxy that follows the same hand on all faces of the touched object
  kAnalytic,     ///< kForces: forces of a box with the object's bounds; kTarget and kLift: the values in the script
  kStateMachine  ///< the rule that at most one program simulates a body per fencing number (session/ownership.hpp)
};

/// The probe of each user in a study. In a live session, option --tool of the HRTC selects the probe.
enum class Tool : std::uint8_t {
  kSphere,  ///< User::radius
  kStylus   ///< spm::offline::stylus
};

struct Scenario {
  std::string name;
  std::uint64_t digest = 0;  ///< hash of the YAML text
  Measure measures = Measure::kNone;
  Truth truth = Truth::kNone;  ///< kNone only when nothing is measured
  Tool tool = Tool::kSphere;
  double force_tolerance = 0.2;  ///< N; max error of a force that counts as on target
  double target_spread = 0;      ///< max displacement of each target point by `varied`, as a share of the bounds
  double duration = 10;          ///< s from the time at which all users have probes
  std::uint64_t seed = 1;
  std::vector<User> users;
};

/// Parses `text`. Throws YamlError for unknown keys, wrong types and values out of range; its message contains
/// `source`, the name of the text.
[[nodiscard]] Scenario parse_scenario(const std::string& text, const std::string& source);

/// Returns the scenario with target points that are displaced at random within Scenario::target_spread. Equal seeds
/// give equal scenarios.
[[nodiscard]] Scenario varied(Scenario scenario, std::uint64_t seed);

/// Loads the built-in scenario with this name; if there is none, the file with this path. Throws YamlError for an
/// invalid file, and ScenarioError, which lists the built-in names, for a missing one.
[[nodiscard]] Scenario load_scenario(const std::string& name_or_path);

struct BuiltInScenario {
  const char* name;
  const char* text;  ///< YAML
};
/// `touch`, `follow`, `lift`, `grab`, `demo`, `demo-lift`, and the scenarios of studies (docs/how-to/studies.md).
[[nodiscard]] const std::vector<BuiltInScenario>& built_in_scenarios();
/// Returns the built-in scenario with this name. Throws ScenarioError, which lists the built-in names, if there is none.
[[nodiscard]] const BuiltInScenario& built_in_scenario(const std::string& name);

/// Returns n for the reference "#n", and 0 for a name.
[[nodiscard]] std::uint32_t ordinal_of(const std::string& reference);

}  // namespace tactus::client_sim
