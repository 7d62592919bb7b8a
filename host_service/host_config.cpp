#include "host_service/host_config.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "yaml/reader.hpp"

namespace tactus::host_service {
namespace {

using yaml::Map;
using yaml::Value;

constexpr double kRadiansPerDegree = 0.017453292519943295;
constexpr double kUnitTolerance = 1e-3;
constexpr double kUnbounded = std::numeric_limits<double>::infinity();

/// Returns the quaternion of a rotation by roll about x, then pitch about y, then yaw about z, all about fixed axes.
std::array<double, 4> from_rpy(const std::array<double, 3>& degrees) {
  std::array<double, 3> c{};
  std::array<double, 3> s{};
  for (std::size_t i = 0; i < 3; ++i) {
    c[i] = std::cos(degrees[i] * kRadiansPerDegree / 2);
    s[i] = std::sin(degrees[i] * kRadiansPerDegree / 2);
  }
  return {s[0] * c[1] * c[2] - c[0] * s[1] * s[2], c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
          c[0] * c[1] * s[2] - s[0] * s[1] * c[2], c[0] * c[1] * c[2] + s[0] * s[1] * s[2]};
}

session::Pose read_pose(const Map& map) {
  session::Pose pose;
  map.numbers("position", -kUnbounded, kUnbounded, pose.position);
  if (map.has("rotation") && map.has("rpy_degrees"))
    map.child("rpy_degrees").fail("found 'rotation' too, which also sets the rotation; expected one of them");
  if (map.has("rotation")) {
    map.numbers("rotation", -kUnbounded, kUnbounded, pose.orientation);
    double square = 0;
    for (const double c : pose.orientation) square += c * c;
    const double length = std::sqrt(square);
    if (!(std::abs(length - 1) <= kUnitTolerance)) {
      map.child("rotation")
          .fail("found the length " + std::to_string(length) + ", expected a unit quaternion x, y, z, w");
    }
    for (double& c : pose.orientation) c /= length;
  }
  if (map.has("rpy_degrees")) {
    std::array<double, 3> degrees{};
    map.numbers("rpy_degrees", -kUnbounded, kUnbounded, degrees);
    pose.orientation = from_rpy(degrees);
  }
  return pose;
}

session::Material read_material(const Value& value) {
  const Map map{value, {"stiffness", "damping", "static_friction", "dynamic_friction"}};
  session::Material material;
  map.number("stiffness", 0, kUnbounded, material.stiffness);
  map.number("damping", 0, kUnbounded, material.damping);
  map.number("static_friction", 0, kUnbounded, material.static_friction);
  map.number("dynamic_friction", 0, kUnbounded, material.dynamic_friction);
  if (material.dynamic_friction > material.static_friction)
    value.fail("found a 'dynamic_friction' above 'static_friction', expected at most 'static_friction'");
  return material;
}

BodyConfig read_body(const Value& value) {
  constexpr double kMinMass = 1e-3, kMinInertia = 1e-9, kRelativeTolerance = 1e-9;
  const Map map{value, {"mass", "inertia", "friction"}};
  BodyConfig body;
  (void)map.required("mass");
  map.number("mass", kMinMass, kUnbounded, body.mass);
  map.number("friction", 0, kUnbounded, body.friction);
  if (!map.has("inertia")) return body;
  std::array<double, 3> inertia{};
  map.numbers("inertia", kMinInertia, kUnbounded, inertia);
  if (inertia[0] + inertia[1] + inertia[2] <
      (2 - kRelativeTolerance) * *std::max_element(inertia.begin(), inertia.end())) {
    map.child("inertia").fail("found a moment larger than the other two together, which no body has");
  }
  body.inertia = inertia;
  return body;
}

ObjectConfig read_object(const Value& value, const std::filesystem::path& folder) {
  const Map map{value, {"name", "model", "position", "rotation", "rpy_degrees", "scale", "size", "material", "body"}};
  std::filesystem::path model = map.required("model").text(4096);
  if (model.is_relative()) model = folder / model;
  ObjectConfig object = object_from_model(model);
  map.text("name", object.name, session::kMaxName);
  if (object.name.size() > session::kMaxName)
    map.child("model").fail("found no 'name', and a file name of more than " + std::to_string(session::kMaxName) +
                            " bytes; expected a name");
  if (map.has("position") || map.has("rotation") || map.has("rpy_degrees")) object.pose = read_pose(map);
  if (map.has("scale") && map.has("size"))
    map.child("size").fail("found 'scale' too, which also sets the scale; expected one of them");
  const auto read = [&](const char* key, double min, std::optional<double>& target) {
    if (map.has(key)) target = map.child(key).number(min, kUnbounded);
  };
  read("scale", 1e-12, object.scale);
  read("size", 1e-6, object.size);
  if (map.has("material")) object.material = read_material(map.child("material"));
  if (map.has("body")) object.body = read_body(map.child("body"));
  return object;
}

}  // namespace

std::vector<ObjectConfig> read_config(const std::filesystem::path& file) {
  const Map map{Value::load(file), {"objects", "ground"}};
  double ground = 0;
  map.number("ground", -kUnbounded, kUnbounded, ground);
  std::vector<ObjectConfig> objects;
  std::set<std::string> names;
  for (const Value& item : map.required("objects").items("objects")) {
    objects.push_back(read_object(item, file.parent_path()));
    ObjectConfig& object = objects.back();
    if (object.body) object.body->ground = ground;
    if (!names.insert(object.name).second) item.fail("a second object '" + object.name + "'");
  }
  return objects;
}

ObjectConfig object_from_model(const std::filesystem::path& model) {
  ObjectConfig object;
  object.name = model.stem().string();
  object.model = model;
  return object;
}

}  // namespace tactus::host_service
