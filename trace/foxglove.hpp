/// The messages of a recording that Foxglove and Lichtblick draw, as structs for trace/cdr.hpp.
///
/// idl/foxglove.idl explains the fields. Three fields of SceneEntity are no members here, because Tactus does not use
/// them: `fields` writes a lifetime of zero, and no cylinders and triangles. Metres; unit quaternions.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace tactus::trace::foxglove {

/// The text of idl/foxglove.idl.
[[nodiscard]] const char* idl() noexcept;

struct Time {
  std::uint32_t sec = 0, nsec = 0;  ///< since 1970
  [[nodiscard]] static Time from_ns(std::uint64_t since_1970_ns) noexcept {
    constexpr std::uint64_t kSecond = 1'000'000'000;
    return {static_cast<std::uint32_t>(since_1970_ns / kSecond), static_cast<std::uint32_t>(since_1970_ns % kSecond)};
  }
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.sec), visit(self.nsec);
  }
};

struct Pose {
  std::array<double, 3> position{0, 0, 0};
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< x, y, z, w
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.position), visit(self.orientation);
  }
};

using Color = std::array<double, 4>;  ///< red, green, blue, opacity: 0 to 1

struct Arrow {
  Pose pose;  ///< of the tail; the arrow points along +x
  double shaft_length = 0, shaft_diameter = 0, head_length = 0, head_diameter = 0;
  Color color{1, 1, 1, 1};
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.pose), visit(self.shaft_length), visit(self.shaft_diameter), visit(self.head_length);
    visit(self.head_diameter), visit(self.color);
  }
};

/// A box or a sphere; both types have the same fields.
struct Solid {
  Pose pose;                            ///< of the centre
  std::array<double, 3> size{0, 0, 0};  ///< edges or diameters
  Color color{1, 1, 1, 1};
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.pose), visit(self.size), visit(self.color);
  }
};

enum class LineType : std::uint32_t { kStrip, kLoop, kList };

struct Line {
  LineType type = LineType::kStrip;
  Pose pose;
  double thickness = 1;
  bool scale_invariant = true;  ///< the thickness is in pixels
  std::vector<std::array<double, 3>> points;
  Color color{1, 1, 1, 1};
  std::vector<Color> colors;
  std::vector<std::uint32_t> indices;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.type), visit(self.pose), visit(self.thickness), visit(self.scale_invariant), visit(self.points);
    visit(self.color), visit(self.colors), visit(self.indices);
  }
};

struct Text {
  Pose pose;  ///< of the centre
  bool billboard = true;
  double font_size = 14;
  bool scale_invariant = true;  ///< the font size is in pixels
  Color color{1, 1, 1, 1};
  std::string text;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.pose), visit(self.billboard), visit(self.font_size), visit(self.scale_invariant), visit(self.color);
    visit(self.text);
  }
};

/// A 3D model as a file.
struct Model {
  Pose pose;
  std::array<double, 3> scale{1, 1, 1};
  Color color{1, 1, 1, 1};
  bool override_color = false;
  std::string url;
  std::string media_type = "model/gltf-binary";
  std::vector<std::uint8_t> data;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.pose), visit(self.scale), visit(self.color), visit(self.override_color), visit(self.url);
    visit(self.media_type), visit(self.data);
  }
};

struct SceneEntity {
  Time timestamp;
  std::string frame_id;
  std::string id;
  bool frame_locked = true;
  std::vector<std::array<std::string, 2>> metadata;  ///< key and value
  std::vector<Arrow> arrows;
  std::vector<Solid> cubes, spheres;
  std::vector<Line> lines;
  std::vector<Text> texts;
  std::vector<Model> models;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    std::array<std::uint32_t, 2> lifetime{0, 0};  // zero: until the entity is replaced or deleted
    std::vector<Solid> cylinders, triangles;      // empty, so the type of their elements has no meaning
    visit(self.timestamp), visit(self.frame_id), visit(self.id), visit(lifetime), visit(self.frame_locked);
    visit(self.metadata), visit(self.arrows), visit(self.cubes), visit(self.spheres), visit(cylinders);
    visit(self.lines), visit(triangles), visit(self.texts), visit(self.models);
  }
};

struct SceneEntityDeletion {
  enum class Type : std::uint32_t { kMatchingId, kAll };
  Time timestamp;
  Type type = Type::kMatchingId;
  std::string id;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.timestamp), visit(self.type), visit(self.id);
  }
};

struct SceneUpdate {
  std::vector<SceneEntityDeletion> deletions;
  std::vector<SceneEntity> entities;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.deletions), visit(self.entities);
  }
};

struct FrameTransform {
  Time timestamp;
  std::string parent_frame_id, child_frame_id;
  Pose pose;  ///< of the child frame in the parent frame
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.timestamp), visit(self.parent_frame_id), visit(self.child_frame_id), visit(self.pose);
  }
};

struct FrameTransforms {
  std::vector<FrameTransform> transforms;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.transforms);
  }
};

enum class LogLevel : std::uint32_t { kUnknown, kDebug, kInfo, kWarning, kError, kFatal };

struct Log {
  Time timestamp;
  LogLevel level = LogLevel::kInfo;
  std::string message;
  std::string name;  ///< of the program
  std::string file;
  std::uint32_t line = 0;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.timestamp), visit(self.level), visit(self.message), visit(self.name), visit(self.file);
    visit(self.line);
  }
};

}  // namespace tactus::trace::foxglove
