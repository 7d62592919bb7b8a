/// Scripts of simulated users, read from YAML.
///
///     name: touch
///     measures: forces        # of a study (docs/how-to/studies.md)
///     truth: full-mesh        # reference of the study
///     tool: stylus            # probe of the users in a study; default: a sphere
///     duration: 10            # s
///     users:
///       - name: ann
///         hrtc: "#1"          # a name, or the n-th one in the session, sorted by name
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

/// A scenario that does not exist, or that its user cannot run.
class ScenarioError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class ActionKind : std::uint8_t {
  kApproach,  ///< moves from outside towards `point` of the object until the force is reached
  kTap,       ///< in until force or depth, out again, `count` times
  kFollow,    ///< moves along the surface at `speed` with `force`, for `seconds`
  kHold,      ///< presses with `force` (0: no motion) for `seconds`
  kWait,      ///< does not move for `seconds`
  kLift,      ///< with others: presses with `force`, raises the object by `height`, holds it `seconds`, puts it down
  kGrab,      ///< approaches, and holds the object at the contact point
  kMove,      ///< moves a held object by `by`, and stays there for `seconds`
  kRelease,   ///< releases the object and moves away
  kRetreat    ///< leaves the object's bounds in the direction of the approach
};

/// Paths along a surface; each needs only the bounds of the object.
enum class Pattern : std::uint8_t {
  kCircle,  ///< circles around the first contact at `extent` from it, seen along the approach
  kZigzag,  ///< back and forth in rows over a square of half edge `extent`
  kAround   ///< all around the object's centre, in the plane of the approach
};

struct Action {
  ActionKind kind = ActionKind::kWait;
  std::string object;                  ///< name or "#n"; empty: as in the previous action
  Vec3d direction = Vec3d::UnitZ();    ///< object's frame, unit, towards the hand
  Vec3d point = Vec3d::Constant(0.5);  ///< target point, as a share of the object's bounds along each axis
  double speed = 0.1;                  ///< m/s
  double force = 1;                    ///< N; of an approach: until_force
  double depth = 0;                    ///< tap: m beyond the first contact at which it turns back; 0: at `force`
  double seconds = 1;
  std::uint32_t count = 1;
  double height = 0.1;       ///< lift: m
  Vec3d by = Vec3d::Zero();  ///< move: m, world
  std::uint32_t others = 1;  ///< lift: number of other users who have to press before it begins
  Pattern pattern = Pattern::kCircle;
  double extent = 0;  ///< m; 0: a third of what the bounds allow
  double lean = 0;    ///< follow: rad, amplitude of the tilt from the surface's normal; twice that about the normal
};

struct User {
  std::string name;
  std::string hrtc;       ///< name or "#n"
  double radius = 0.003;  ///< m, of the probe
  bool repeat = false;    ///< repeat the script until the session ends
  bool remote = false;    ///< holds a device at the client, not in the HRTC
  std::vector<Action> script;
};

/// The quantity that a study measures in a run of the scenario.
enum class Measure : std::uint8_t {
  kNone,        ///< nothing: it only runs
  kForces,      ///< forces on each hand, at each of its positions
  kFirstTouch,  ///< forces, and the time until the touched regions are loaded by an HRTC that has just started
  kTarget,      ///< error of the force that users keep while they press one body from several sides
  kLift,        ///< motion of a body that users lift together
  kHandOver     ///< times at which users take over a body from each other
};
/// The reference of that measurement.
enum class Truth : std::uint8_t {
  kNone,
  kFullMesh,     ///< all faces of the touched object, in the same process: a second proxy follows the same hand
  kAnalytic,     ///< forces: a box with the object's bounds; target and lift: the values in the script
  kStateMachine  ///< at most one simulating program per fencing number (session/ownership.hpp)
};

/// The probe of each user in a study; in a live session the HRTC's --tool decides.
enum class Tool : std::uint8_t {
  kSphere,  ///< User::radius
  kStylus   ///< spm::offline::stylus
};

struct Scenario {
  std::string name;
  std::uint64_t digest = 0;  ///< of its text
  Measure measures = Measure::kNone;
  Truth truth = Truth::kNone;  ///< kNone only when nothing is measured
  Tool tool = Tool::kSphere;
  double within = 0.2;   ///< N; a force counts as on target within this distance
  double spread = 0;     ///< amplitude by which `varied` moves each target point, as a share of the bounds
  double duration = 10;  ///< s from the moment when all users are served
  std::uint64_t seed = 1;
  std::vector<User> users;
};

/// Parses `text`; `source` names it in messages. Unknown keys, wrong types and values out of range throw YamlError.
[[nodiscard]] Scenario parse_scenario(const std::string& text, const std::string& source);

/// The scenario with target points varied by `seed` within its spread; the same for the same seed.
[[nodiscard]] Scenario varied(Scenario scenario, std::uint64_t seed);

/// Loads a built-in scenario by name, or else a file by path. Throws YamlError, or ScenarioError that lists the
/// built-in names.
[[nodiscard]] Scenario load_scenario(const std::string& name_or_path);

/// `touch`, `follow`, `lift`, `grab`, `demo`, `demo-lift`, and those of studies (docs/how-to/studies.md): name and YAML
/// text.
struct BuiltInScenario {
  const char* name;
  const char* text;
};
[[nodiscard]] const std::vector<BuiltInScenario>& built_in_scenarios();

/// The number of a reference: 3 for "#3"; 0 for a name.
[[nodiscard]] std::uint32_t ordinal_of(const std::string& reference);

}  // namespace tactus::client_sim
