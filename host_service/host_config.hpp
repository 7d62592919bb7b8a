/// What a host serves: from a YAML file, or a list of model files.
///
///     objects:
///       - name: organ                  # unique in the session; the model's file name when left out
///         model: models/organ.ply      # .spm or anything that can be imported; relative to this file
///         position: [0, 0, 0.1]        # m
///         rotation: [0, 0, 0, 1]       # quaternion x, y, z, w; or rpy_degrees: [roll, pitch, yaw]
///         size: 0.2                    # m, longest side of its bounds; or scale: metres per file unit
///         material: {stiffness: 800, damping: 2, static_friction: 0.3, dynamic_friction: 0.2}
///       - model: crate.spm
///         body: {mass: 0.8, friction: 0.6}   # it can be moved; inertia: [x, y, z] that of a box of its bounds else
///     ground: 0                        # m, height of the plane on which such objects come to rest
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "session/messages.hpp"

namespace tactus::host_service {

/// What a host cannot start with. The message names the thing, what was found and what was expected.
class HostError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What makes an object move; docs/explanation/shared-objects.md.
struct BodyConfig {
  double mass = 1;                               ///< kg
  std::optional<std::array<double, 3>> inertia;  ///< kg m^2, about the model's axes; else of a box of its bounds
  double friction = session::Body{}.friction;    ///< coefficient, against the ground
  double ground = 0;                             ///< m, height of the ground plane
};

struct ObjectConfig {
  std::string name;
  std::filesystem::path model;
  std::optional<session::Pose> pose;  ///< without one it stands beside the object before it
  std::optional<double> scale;        ///< metres per file unit; without it and `size` the model's own suggestion
  std::optional<double> size;         ///< metres of the longest side of the bounds
  session::Material material;
  std::optional<BodyConfig> body;  ///< it can be moved
};

/// Throws HostError as `file:line: ...` for what is missing, unknown or out of bounds.
[[nodiscard]] std::vector<ObjectConfig> read_config(const std::filesystem::path& file);

/// Served under the file's name without folder and extension, as it is.
[[nodiscard]] ObjectConfig object_from_model(const std::filesystem::path& model);

}  // namespace tactus::host_service
