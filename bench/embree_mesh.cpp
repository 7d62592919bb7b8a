#include "bench/embree_mesh.hpp"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace tactus::bench {

using spm::Vec3d;

namespace {

using Position = std::array<float, 3>;
using Face = std::array<std::uint32_t, 3>;
using Plane = std::array<double, 4>;  // unit normal; distance from the origin

/// Relative enlargement of queries and of the tool's boxes: their coordinates are rounded from double to float.
constexpr double kRounding = 4e-7;

class Device {
 public:
  Device() {
    if (device_ == nullptr) throw std::runtime_error("Embree: no device");
  }
  ~Device() { rtcReleaseDevice(device_); }
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  operator RTCDevice() const noexcept { return device_; }
  void check(const char* step) const {
    const RTCError error = rtcGetDeviceError(device_);
    if (error != RTC_ERROR_NONE)
      throw std::runtime_error(std::string{"Embree: "} + step + " failed with error " + std::to_string(error));
  }

 private:
  RTCDevice device_ = rtcNewDevice("threads=1");
};

/// A scene with one geometry.
class OneMesh {
 public:
  OneMesh(const Device& device, RTCGeometryType type, RTCSceneFlags flags, RTCBuildQuality quality)
      : scene{rtcNewScene(device)}, geometry{rtcNewGeometry(device, type)} {
    rtcSetSceneFlags(scene, flags | RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, quality);
  }
  ~OneMesh() {
    rtcReleaseGeometry(geometry);
    rtcReleaseScene(scene);
  }
  OneMesh(const OneMesh&) = delete;
  OneMesh& operator=(const OneMesh&) = delete;
  void build(const Device& device) {
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcCommitScene(scene);
    device.check("building a tree");
  }

  const RTCScene scene;
  const RTCGeometry geometry;
};

/// The closest point of triangle abc to p. Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.5;
/// Embree's own tutorial `closest_point` uses the same routine.
Vec3d closest_point(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) noexcept {
  const Vec3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const Vec3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const Vec3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  const double scale = 1 / (va + vb + vc);
  return a + ab * (vb * scale) + ac * (vc * scale);
}

Vec3d to_double(const Position& p) noexcept { return {p[0], p[1], p[2]}; }

}  // namespace

// ---- spheres

struct EmbreeMesh::Scene {
  Scene(EmbreePositions positions, EmbreeFaces triangles)
      : vertices{positions.begin(), positions.end()}, faces{triangles.begin(), triangles.end()} {
    // Embree reads 16 bytes for each vertex of 12. Therefore Embree allocates the buffer, with padding.
    std::copy(vertices.begin(), vertices.end(),
              static_cast<Position*>(rtcSetNewGeometryBuffer(mesh.geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                             RTC_FORMAT_FLOAT3, sizeof(Position), vertices.size())));
    std::copy(faces.begin(), faces.end(),
              static_cast<Face*>(rtcSetNewGeometryBuffer(mesh.geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                         sizeof(Face), faces.size())));
    mesh.build(device);
  }

  Device device;
  // High quality would split triangles, and a query would find the same triangle several times.
  OneMesh mesh{device, RTC_GEOMETRY_TYPE_TRIANGLE, RTC_SCENE_FLAG_NONE, RTC_BUILD_QUALITY_MEDIUM};
  std::vector<Position> vertices;
  std::vector<Face> faces;
};

EmbreeMesh::EmbreeMesh(EmbreePositions vertices, EmbreeFaces faces)
    : scene_{std::make_unique<Scene>(vertices, faces)} {}

EmbreeMesh::~EmbreeMesh() = default;

void EmbreeMesh::find_contacts(const Vec3d& centre, double radius, std::vector<spm::Contact>& out) const {
  struct Query {
    const Position* vertices;
    const Face* faces;
    Vec3d centre;
    double squared_radius;
    std::vector<spm::Contact>& out;
  } query{scene_->vertices.data(), scene_->faces.data(), centre, radius * radius, out};
  out.clear();
  const auto decide = [](RTCPointQueryFunctionArguments* args) {
    auto& q = *static_cast<Query*>(args->userPtr);
    const Face& face = q.faces[args->primID];
    const Vec3d point = closest_point(q.centre, to_double(q.vertices[face[0]]), to_double(q.vertices[face[1]]),
                                      to_double(q.vertices[face[2]]));
    if ((q.centre - point).squaredNorm() <= q.squared_radius)
      q.out.push_back({point, spm::FaceId{args->primID}, spm::Contact::kFinest});
    return false;  // the query radius is unchanged
  };
  RTCPointQuery at{};
  at.x = static_cast<float>(centre[0]);
  at.y = static_cast<float>(centre[1]);
  at.z = static_cast<float>(centre[2]);
  at.radius = static_cast<float>(radius * (1 + 1e-6) + kRounding * centre.cwiseAbs().maxCoeff());
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(scene_->mesh.scene, &at, &context, decide, &query);
}

// ---- tools

namespace {

/// Triangles of a user geometry.
struct Triangles {
  std::vector<Position> vertices;
  std::vector<Face> faces;
  float slack = 0;  // enlarges the boxes by the rounding error of the vertices
};

void bounds_of(const RTCBoundsFunctionArguments* args) {
  const auto& mesh = *static_cast<const Triangles*>(args->geometryUserPtr);
  const Face& face = mesh.faces[args->primID];
  float low[3], high[3];
  for (int axis = 0; axis < 3; ++axis) {
    const auto [min, max] =
        std::minmax({mesh.vertices[face[0]][axis], mesh.vertices[face[1]][axis], mesh.vertices[face[2]][axis]});
    low[axis] = min;
    high[axis] = max;
  }
  const float slack = mesh.slack;
  *args->bounds_o = {low[0] - slack,  low[1] - slack,  low[2] - slack,  0,
                     high[0] + slack, high[1] + slack, high[2] + slack, 0};
}

void build(const Device& device, OneMesh& scene, Triangles& mesh, RTCBuildQuality quality) {
  rtcSetGeometryUserPrimitiveCount(scene.geometry, static_cast<unsigned>(mesh.faces.size()));
  rtcSetGeometryUserData(scene.geometry, &mesh);
  rtcSetGeometryBoundsFunction(scene.geometry, bounds_of, nullptr);
  rtcSetGeometryBuildQuality(scene.geometry, quality);
  scene.build(device);
}

}  // namespace

struct EmbreeTool::Scenes {
  Scenes(EmbreePositions object_vertices, EmbreeFaces object_faces, EmbreePositions tool_vertices,
         EmbreeFaces tool_faces)
      : object{{object_vertices.begin(), object_vertices.end()}, {object_faces.begin(), object_faces.end()}},
        tool{{tool_vertices.begin(), tool_vertices.end()}, {tool_faces.begin(), tool_faces.end()}},
        rest_vertices{tool.vertices},
        placed_vertices(rest_vertices.size()) {
    for (const Position& p : rest_vertices)
      for (const float x : p) reach = std::max(reach, 2 * std::abs(double{x}));
    double extent = reach;
    for (const Position& p : object.vertices)
      for (const float x : p) extent = std::max(extent, std::abs(double{x}));
    clearance = 1e-6 * extent;
    set_planes(object.vertices, object.faces, object_planes);
    build(device, object_scene, object, RTC_BUILD_QUALITY_HIGH);
    build(device, tool_scene, tool, RTC_BUILD_QUALITY_REFIT);
  }

  void add(const RTCCollision& pair) noexcept {
    const Face &face = object.faces[pair.primID0], &triangle = tool.faces[pair.primID1];
    if (is_separated(object_planes[pair.primID0], placed_vertices, triangle) ||
        is_separated(tool_planes[pair.primID1], object.vertices, face))
      return;
    for (int i = 0; i < 3; ++i) {
      const Position& f = object.vertices[face[i]];
      const std::array<double, 3>& g = placed_vertices[triangle[i]];
      for (int axis = 0; axis < 3; ++axis) {
        pairs.object[i][axis][count] = f[axis];
        pairs.probe[i][axis][count] = g[axis];
      }
    }
    pending[count] = pair;
    if (++count == spm::TrianglePairs::kWidth) flush();
  }

  /// Returns whether all three corners of a face are on one side of the plane. Rejects seven of eight pairs whose boxes
  /// overlap.
  template <class Vertices>
  [[nodiscard]] bool is_separated(const Plane& plane, const Vertices& vertices, const Face& face) const noexcept {
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (const std::uint32_t v : face) {
      const double offset =
          plane[0] * vertices[v][0] + plane[1] * vertices[v][1] + plane[2] * vertices[v][2] - plane[3];
      low = std::min(low, offset);
      high = std::max(high, offset);
    }
    return low > clearance || high < -clearance;
  }

  template <class Vertices>
  static void set_planes(const Vertices& vertices, const std::vector<Face>& faces, std::vector<Plane>& planes) {
    planes.resize(faces.size());
    for (std::size_t f = 0; f < faces.size(); ++f) {
      const auto corner = [&](std::size_t k) {
        const auto& p = vertices[faces[f][k]];
        return Vec3d{p[0], p[1], p[2]};
      };
      const Vec3d a = corner(0), normal = (corner(1) - a).cross(corner(2) - a);
      const double length = normal.norm();
      const Vec3d unit = length > 0 ? Vec3d{normal / length} : Vec3d::Zero();
      planes[f] = {unit[0], unit[1], unit[2], unit.dot(a)};
    }
  }

  void flush() {
    for (unsigned hit = spm::intersect(pairs, count, found, spm::best_simd()); hit != 0; hit &= hit - 1) {
      const auto lane = static_cast<unsigned>(__builtin_ctz(hit));
      out->push_back({spm::FaceId{pending[lane].primID0},
                      pending[lane].primID1,
                      true,
                      {found.point[0][lane], found.point[1][lane], found.point[2][lane]},
                      {found.normal[0][lane], found.normal[1][lane], found.normal[2][lane]},
                      found.depth[lane]});
    }
    count = 0;
  }

  Device device;
  OneMesh object_scene{device, RTC_GEOMETRY_TYPE_USER, RTC_SCENE_FLAG_NONE, RTC_BUILD_QUALITY_HIGH};
  // Embree refits a scene that is dynamic and of low quality, if its geometry has quality REFIT (see the constructor).
  // A refit takes 11 us, a new tree 75 to 200 us.
  OneMesh tool_scene{device, RTC_GEOMETRY_TYPE_USER, RTC_SCENE_FLAG_DYNAMIC, RTC_BUILD_QUALITY_LOW};
  Triangles object;                                    // in its own frame
  Triangles tool;                                      // at its pose, rounded to float, for the boxes
  std::vector<Position> rest_vertices;                 // of the tool, in its own frame
  std::vector<std::array<double, 3>> placed_vertices;  // of the tool at its pose
  std::vector<Plane> object_planes, tool_planes;
  double reach = 0;      // bound of the coordinates of the tool after any rotation
  double clearance = 0;  // distance beyond which a corner is certainly off a plane
  std::vector<spm::MeshContact>* out = nullptr;
  spm::TrianglePairs pairs{};
  spm::PairContacts found{};
  std::uint32_t count = 0;
  std::array<RTCCollision, spm::TrianglePairs::kWidth> pending{};
};

EmbreeTool::EmbreeTool(EmbreePositions object_vertices, EmbreeFaces object_faces, EmbreePositions tool_vertices,
                       EmbreeFaces tool_faces)
    : scenes_{std::make_unique<Scenes>(object_vertices, object_faces, tool_vertices, tool_faces)} {}

EmbreeTool::~EmbreeTool() = default;

void EmbreeTool::find_contacts(const Eigen::Isometry3d& pose, std::vector<spm::MeshContact>& out) {
  Scenes& s = *scenes_;
  out.clear();
  s.out = &out;
  const Eigen::Matrix3d rotation = pose.linear();
  const Vec3d translation = pose.translation();
  s.tool.slack = static_cast<float>((translation.cwiseAbs().maxCoeff() + s.reach) * kRounding);
  for (std::size_t v = 0; v < s.rest_vertices.size(); ++v)
    for (int i = 0; i < 3; ++i) {
      const double coordinate = rotation(i, 0) * s.rest_vertices[v][0] + rotation(i, 1) * s.rest_vertices[v][1] +
                                rotation(i, 2) * s.rest_vertices[v][2] + translation[i];
      s.placed_vertices[v][i] = coordinate;
      s.tool.vertices[v][i] = static_cast<float>(coordinate);
    }
  Scenes::set_planes(s.placed_vertices, s.tool.faces, s.tool_planes);
  rtcCommitGeometry(s.tool_scene.geometry);
  rtcCommitScene(s.tool_scene.scene);
  rtcCollide(
      s.object_scene.scene, s.tool_scene.scene,
      [](void* user, RTCCollision* collisions, unsigned count) {
        for (unsigned i = 0; i < count; ++i) static_cast<Scenes*>(user)->add(collisions[i]);
      },
      &s);
  if (s.count > 0) s.flush();
}

}  // namespace tactus::bench
