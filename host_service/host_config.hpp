/// Reads, from a YAML file or from the names of model files, which objects a host serves.
///
///     objects:
///       - name: organ                  # unique in the session; default: the model's file name
///         model: models/organ.ply      # .spm or any importable format; relative to this file
///         position: [0, 0, 0.1]        # m
///         rotation: [0, 0, 0, 1]       # quaternion x, y, z, w; or rpy_degrees: [roll, pitch, yaw]
///         size: 0.2                    # m, longest side of the bounds; or scale: metres per file unit
///         material: {stiffness: 800, damping: 2, static_friction: 0.3, dynamic_friction: 0.2}
///       - model: crate.spm
///         body: {mass: 0.8, friction: 0.6}   # the object is movable; inertia: [x, y, z], default: box of bounds
///     ground: 0                        # m, height of the ground plane for movable objects
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "session/messages.hpp"

namespace tactus::host_service {

/// Thrown for input with which a host cannot start. The message names the item, the value found and the value expected.
class HostError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The settings that make an object movable (docs/explanation/shared-objects.md).
struct BodyConfig {
  double mass = 1;                               ///< kg
  std::optional<std::array<double, 3>> inertia;  ///< kg m^2, about the model's axes; default: box of the bounds
  double friction = session::Body{}.friction;    ///< coefficient, against the ground and static objects
  double ground = 0;                             ///< m, height of the ground plane
};

struct ObjectConfig {
  std::string name;
  std::filesystem::path model;
  std::optional<session::Pose> pose;  ///< default: next to the previous object
  std::optional<double> scale;        ///< metres per file unit; default: from `size`, else from the model
  std::optional<double> size;         ///< metres of the longest side of the bounds
  session::Material material;
  std::optional<BodyConfig> body;  ///< none: the object is static
};

/// Reads a file as above. Throws yaml::YamlError for an entry that is missing, unknown or out of bounds.
[[nodiscard]] std::vector<ObjectConfig> read_config(const std::filesystem::path& file);

/// Returns an object with default settings whose name is the file name without folder and extension.
[[nodiscard]] ObjectConfig object_from_model(const std::filesystem::path& model);

}  // namespace tactus::host_service
