#include "host_service/host_config.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <set>

namespace tactus::host_service {
namespace {

constexpr double kRadiansPerDegree = 0.017453292519943295;
constexpr double kUnitTolerance = 1e-3;

/// Reads one file; messages name the file and the line.
class ConfigReader {
 public:
  explicit ConfigReader(const std::filesystem::path& file) : file_{file} {}

  std::vector<ObjectConfig> read() const {
    const YAML::Node root = load();
    expect_keys(root, {"objects", "ground"});
    double ground = 0;
    if (const YAML::Node node = root["ground"]) ground = number(node, "ground", -HUGE_VAL);
    const YAML::Node list = root["objects"];
    if (!list || !list.IsSequence() || list.size() == 0) fail(root, "'objects' must be a list of at least one object");
    std::vector<ObjectConfig> objects;
    std::set<std::string> names;
    for (const YAML::Node& node : list) {
      objects.push_back(read_object(node));
      if (objects.back().body) objects.back().body->ground = ground;
      if (!names.insert(objects.back().name).second) fail(node, "a second object '" + objects.back().name + "'");
    }
    return objects;
  }

 private:
  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& what) const {
    throw HostError{file_.string() + ":" + std::to_string(mark.line + 1) + ": " + what};
  }
  [[noreturn]] void fail(const YAML::Node& node, const std::string& what) const { fail(node.Mark(), what); }

  YAML::Node load() const {
    try {
      return YAML::LoadFile(file_.string());
    } catch (const YAML::BadFile&) {
      throw HostError{file_.string() + ": cannot be read"};
    } catch (const YAML::Exception& error) {
      fail(error.mark, error.msg);
    }
  }

  void expect_keys(const YAML::Node& node, std::initializer_list<const char*> keys) const {
    std::string expected;
    for (const char* key : keys) expected += (expected.empty() ? "" : ", ") + std::string{key};
    if (!node.IsMap()) fail(node, "found no map, expected one of " + expected);
    for (const auto& entry : node) {
      const auto key = entry.first.as<std::string>("");
      if (std::find(keys.begin(), keys.end(), key) == keys.end()) {
        fail(entry.first, "unknown key '" + key + "', expected one of " + expected);
      }
    }
  }

  double number(const YAML::Node& node, const char* key, double min) const {
    const auto value = node.as<double>(std::nan(""));
    if (!std::isfinite(value) || value < min) {
      fail(node, std::string{"'"} + key + "' is '" + (node.IsScalar() ? node.Scalar() : "no number") +
                     "', expected a number" + (std::isfinite(min) ? " of at least " + shown(min) : ""));
    }
    return value;
  }
  static std::string shown(double value) {
    std::string text = std::to_string(value);
    return text.substr(0, text.find('.') + 4);
  }

  template <std::size_t n>
  std::array<double, n> numbers(const YAML::Node& node, const char* key) const {
    if (!node.IsSequence() || node.size() != n) {
      fail(node, std::string{"'"} + key + "' must be a list of " + std::to_string(n) + " numbers");
    }
    std::array<double, n> values{};
    for (std::size_t i = 0; i < n; ++i) values[i] = number(node[i], key, -HUGE_VAL);
    return values;
  }

  ObjectConfig read_object(const YAML::Node& node) const {
    expect_keys(node, {"name", "model", "position", "rotation", "rpy_degrees", "scale", "size", "material", "body"});
    if (!node["model"] || !node["model"].IsScalar()) fail(node, "an object without 'model'");
    std::filesystem::path model = node["model"].Scalar();
    if (model.is_relative()) model = file_.parent_path() / model;
    ObjectConfig object = object_from_model(model);
    if (const YAML::Node name = node["name"]) object.name = name.as<std::string>("");
    if (object.name.empty() || object.name.size() > session::kMaxName) {
      fail(node, "the name '" + object.name + "' must have 1 to " + std::to_string(session::kMaxName) + " bytes");
    }
    if (node["position"] || node["rotation"] || node["rpy_degrees"]) object.pose = read_pose(node);
    if (node["scale"] && node["size"]) fail(node["size"], "'scale' and 'size' both set the scale; give one of them");
    if (const YAML::Node scale = node["scale"]) object.scale = number(scale, "scale", 1e-12);
    if (const YAML::Node size = node["size"]) object.size = number(size, "size", 1e-6);
    if (const YAML::Node material = node["material"]) object.material = read_material(material);
    if (const YAML::Node body = node["body"]) object.body = read_body(body);
    return object;
  }

  BodyConfig read_body(const YAML::Node& node) const {
    constexpr double kMinMass = 1e-3, kMinInertia = 1e-9, kRelativeTolerance = 1e-9;
    expect_keys(node, {"mass", "inertia", "friction"});
    BodyConfig body;
    if (!node["mass"]) fail(node, "a body without 'mass'");
    body.mass = number(node["mass"], "mass", kMinMass);
    if (const YAML::Node child = node["friction"]) body.friction = number(child, "friction", 0);
    const YAML::Node inertia = node["inertia"];
    if (!inertia) return body;
    body.inertia = numbers<3>(inertia, "inertia");
    const auto& i = *body.inertia;
    if (*std::min_element(i.begin(), i.end()) < kMinInertia) {
      fail(inertia, "'inertia' has a moment below 1e-9 kg m^2, expected three above that");
    }
    if (i[0] + i[1] + i[2] < (2 - kRelativeTolerance) * *std::max_element(i.begin(), i.end())) {
      fail(inertia, "'inertia' has a moment larger than the other two together, which no body has");
    }
    return body;
  }

  session::Pose read_pose(const YAML::Node& node) const {
    session::Pose pose;
    if (const YAML::Node position = node["position"]) pose.position = numbers<3>(position, "position");
    if (node["rotation"] && node["rpy_degrees"]) {
      fail(node["rpy_degrees"], "'rotation' and 'rpy_degrees' both turn the object; give one of them");
    }
    if (const YAML::Node rotation = node["rotation"]) {
      pose.orientation = numbers<4>(rotation, "rotation");
      double square = 0;
      for (const double c : pose.orientation) square += c * c;
      const double length = std::sqrt(square);
      if (!(std::abs(length - 1) <= kUnitTolerance)) {
        fail(rotation, "'rotation' has length " + shown(length) + ", expected a unit quaternion x, y, z, w");
      }
      for (double& c : pose.orientation) c /= length;
    }
    if (const YAML::Node rpy = node["rpy_degrees"]) pose.orientation = from_rpy(numbers<3>(rpy, "rpy_degrees"));
    return pose;
  }

  /// Roll about x, then pitch about y, then yaw about z, all axes fixed.
  static std::array<double, 4> from_rpy(const std::array<double, 3>& degrees) {
    std::array<double, 3> c{};
    std::array<double, 3> s{};
    for (std::size_t i = 0; i < 3; ++i) {
      c[i] = std::cos(degrees[i] * kRadiansPerDegree / 2);
      s[i] = std::sin(degrees[i] * kRadiansPerDegree / 2);
    }
    return {s[0] * c[1] * c[2] - c[0] * s[1] * s[2], c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
            c[0] * c[1] * s[2] - s[0] * s[1] * c[2], c[0] * c[1] * c[2] + s[0] * s[1] * s[2]};
  }

  session::Material read_material(const YAML::Node& node) const {
    expect_keys(node, {"stiffness", "damping", "static_friction", "dynamic_friction"});
    session::Material material;
    const auto read = [&](const char* key, double& value) {
      if (const YAML::Node child = node[key]) value = number(child, key, 0);
    };
    read("stiffness", material.stiffness);
    read("damping", material.damping);
    read("static_friction", material.static_friction);
    read("dynamic_friction", material.dynamic_friction);
    if (material.dynamic_friction > material.static_friction) {
      fail(node, "'dynamic_friction' is over 'static_friction'");
    }
    return material;
  }

  std::filesystem::path file_;
};

}  // namespace

std::vector<ObjectConfig> read_config(const std::filesystem::path& file) { return ConfigReader{file}.read(); }

ObjectConfig object_from_model(const std::filesystem::path& model) {
  ObjectConfig object;
  object.name = model.stem().string();
  object.model = model;
  return object;
}

}  // namespace tactus::host_service
