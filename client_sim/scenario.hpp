/// What simulated users shall do, read from YAML.
///
///     name: touch
///     measures: forces        # of a study (docs/how-to/studies.md); with it goes what they are held against
///     truth: full-mesh
///     tool: stylus            # what users hold there; a ball unless told
///     duration: 10            # s
///     users:
///       - name: ann
///         hrtc: "#1"          # a name, or the n-th of those there, sorted by name
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

/// The message is `file:line:column: key: found ..., expected ...`.
class ScenarioError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class ActionKind : std::uint8_t {
  kApproach,  ///< from outside towards `point` of the object until the force is felt
  kTap,       ///< in until force or depth, out again, `count` times
  kFollow,    ///< along the surface at `speed`, pressed on with `force`, for `seconds`
  kHold,      ///< pressed on with `force` (0: just still) for `seconds`
  kWait,      ///< hand still for `seconds`
  kLift,      ///< with others: presses with `force`, raises the object by `height`, holds it `seconds`, puts it down
  kGrab,      ///< approaches, and closes the hand on the object where it touches
  kMove,      ///< with what it holds, by `by`, and stays there for `seconds`
  kRelease,   ///< opens the hand and takes it away
  kRetreat    ///< out of the object's bounds the way it came
};

/// Ways along a surface; each stays on an object whose bounds are all that is known of it.
enum class Pattern : std::uint8_t {
  kCircle,  ///< round and round the point of first touch, at `extent` from it, as seen along the approach
  kZigzag,  ///< to and fro in rows over a square of half edge `extent`
  kAround   ///< all around the object's centre, in the plane of the approach
};

struct Action {
  ActionKind kind = ActionKind::kWait;
  std::string object;                  ///< name or "#n"; empty: the one of the action before
  Vec3d direction = Vec3d::UnitZ();    ///< object's frame, from the object to where the hand comes from; unit
  Vec3d point = Vec3d::Constant(0.5);  ///< aimed at, as a share of the object's bounds along each axis
  double speed = 0.1;                  ///< m/s
  double force = 1;                    ///< N; of an approach: until_force
  double depth = 0;                    ///< tap: m beyond the first touch at which it turns; 0: at `force`
  double seconds = 1;
  std::uint32_t count = 1;
  double height = 0.1;       ///< lift: m
  Vec3d by = Vec3d::Zero();  ///< move: m, world
  std::uint32_t others = 1;  ///< lift: who have to press, too, before it begins
  Pattern pattern = Pattern::kCircle;
  double extent = 0;  ///< m; 0: a third of what the bounds give
  double lean = 0;    ///< follow: rad off the surface's normal by which the hand leans to and fro, and twice about it
};

struct User {
  std::string name;
  std::string hrtc;       ///< name or "#n"
  double radius = 0.003;  ///< m, of the probe
  bool repeat = false;    ///< begin the script anew until the session ends
  bool remote = false;    ///< holds a device at this end of the network, not one in the HRTC
  std::vector<Action> script;
};

/// What a study takes from a run of the scenario.
enum class Measure : std::uint8_t {
  kNone,        ///< nothing: it only runs
  kForces,      ///< what hands feel, at each of their places
  kFirstTouch,  ///< the same, and when what is touched is here, of a controller that has just come
  kTarget,      ///< how well users who press one body from several sides keep the force that they want
  kLift,        ///< what becomes of a body that users lift together
  kHandOver     ///< how users who take a body from each other get it
};
/// What that is held against.
enum class Truth : std::uint8_t {
  kNone,
  kFullMesh,     ///< all faces of the object touched, in the same process: a second proxy follows the same hand there
  kAnalytic,     ///< the same, against a box with the object's bounds; of a target and a lift, what the script asks for
  kStateMachine  ///< under one fencing number one program simulates (session/ownership.hpp)
};

/// What each user holds in a study; in a live session the controller's --tool says so.
enum class Tool : std::uint8_t {
  kSphere,  ///< User::radius
  kStylus   ///< spm::offline::stylus
};

struct Scenario {
  std::string name;
  std::uint64_t digest = 0;  ///< of its text
  Measure measures = Measure::kNone;
  Truth truth = Truth::kNone;  ///< none only when nothing is measured
  Tool tool = Tool::kSphere;
  double within = 0.2;   ///< N; a force so near to its target is on it
  double spread = 0;     ///< `varied` moves each point aimed at by up to so much, as a share of the bounds
  double duration = 10;  ///< s from the moment all users are served
  std::uint64_t seed = 1;
  std::vector<User> users;
};

/// Reads `text`; `source` names it in messages. Unknown keys, wrong types and values out of range throw ScenarioError.
[[nodiscard]] Scenario parse_scenario(const std::string& text, const std::string& source);

/// The scenario as `seed` has it: other places within its spread, the same for the same seed.
[[nodiscard]] Scenario varied(Scenario scenario, std::uint64_t seed);

/// A built-in scenario's name, or else a file's path. Throws ScenarioError, naming the built-in ones when there is
/// neither.
[[nodiscard]] Scenario load_scenario(const std::string& name_or_path);

/// `touch`, `follow`, `lift`, `grab`, `demo`, `demo-lift`, and those of studies (docs/how-to/studies.md): name and YAML
/// text.
struct BuiltInScenario {
  const char* name;
  const char* text;
};
[[nodiscard]] const std::vector<BuiltInScenario>& built_in_scenarios();

/// "#3" is 3; 0 for a name.
[[nodiscard]] std::uint32_t place_of(const std::string& reference);

}  // namespace tactus::client_sim
