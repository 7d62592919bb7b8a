#include "bench/embree_mesh.hpp"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "spm/triangle.hpp"

namespace tactus::bench {

using spm::Vec3d;

namespace {

void check(RTCDevice device, const char* step) {
  const RTCError error = rtcGetDeviceError(device);
  if (error != RTC_ERROR_NONE)
    throw std::runtime_error(std::string{"Embree: "} + step + " failed with error " + std::to_string(error));
}

/// What both scenes are made of.
struct Triangles {
  std::vector<EmbreeMesh::Position> vertices;
  std::vector<EmbreeMesh::Face> faces;
  float slack = 0;  // by which boxes are larger: vertices may have been rounded
};

void bounds_of(const RTCBoundsFunctionArguments* args) {
  const auto& mesh = *static_cast<const Triangles*>(args->geometryUserPtr);
  const EmbreeMesh::Face& face = mesh.faces[args->primID];
  float low[3], high[3];
  for (int axis = 0; axis < 3; ++axis) {
    const auto [min, max] =
        std::minmax({mesh.vertices[face[0]][axis], mesh.vertices[face[1]][axis], mesh.vertices[face[2]][axis]});
    low[axis] = min;
    high[axis] = max;
  }
  const float more = mesh.slack;
  *args->bounds_o = {low[0] - more, low[1] - more, low[2] - more, 0, high[0] + more, high[1] + more, high[2] + more, 0};
}

RTCGeometry attach(RTCDevice device, RTCScene scene, Triangles& mesh, RTCBuildQuality quality) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(mesh.faces.size()));
  rtcSetGeometryUserData(geometry, &mesh);
  rtcSetGeometryBoundsFunction(geometry, bounds_of, nullptr);
  rtcSetGeometryBuildQuality(geometry, quality);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  return geometry;
}

}  // namespace

struct EmbreeMesh::Scene {
  Triangles mesh;
  RTCDevice device = rtcNewDevice("threads=1");
  RTCScene scene = nullptr;
  RTCGeometry geometry = nullptr;

  Scene() {
    if (device == nullptr) throw std::runtime_error("Embree: no device");
    scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
  }
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;
  ~Scene() {
    rtcReleaseGeometry(geometry);
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }

  [[nodiscard]] Vec3d corner(std::uint32_t face, int i) const noexcept {
    const Position& p = mesh.vertices[mesh.faces[face][i]];
    return {p[0], p[1], p[2]};
  }
};

EmbreeMesh::EmbreeMesh(spm::Span<const Position> vertices, spm::Span<const Face> faces)
    : scene_{std::make_unique<Scene>()} {
  scene_->mesh.vertices.assign(vertices.begin(), vertices.end());
  scene_->mesh.faces.assign(faces.begin(), faces.end());
  scene_->geometry = attach(scene_->device, scene_->scene, scene_->mesh, RTC_BUILD_QUALITY_HIGH);
  rtcCommitScene(scene_->scene);
  check(scene_->device, "building the tree");
}

EmbreeMesh::~EmbreeMesh() = default;

void EmbreeMesh::touching(const Vec3d& centre, double radius, std::vector<spm::Contact>& out) const {
  struct Query {
    const Scene& scene;
    Vec3d centre;
    double radius;
    std::vector<spm::Contact>& out;
  } query{*scene_, centre, radius, out};
  out.clear();
  const auto decide = [](RTCPointQueryFunctionArguments* args) {
    auto& q = *static_cast<Query*>(args->userPtr);
    const Vec3d a = q.scene.corner(args->primID, 0), b = q.scene.corner(args->primID, 1),
                c = q.scene.corner(args->primID, 2);
    const spm::ClosestPoint closest = spm::closest_point(q.centre, a, b, c);
    if (!(closest.squared_distance <= q.radius * q.radius)) return false;
    q.out.push_back({closest.point, spm::FaceId{args->primID}, spm::Contact::kFinest});
    return false;  // the radius stays
  };
  RTCPointQuery at{};
  at.x = static_cast<float>(centre[0]);
  at.y = static_cast<float>(centre[1]);
  at.z = static_cast<float>(centre[2]);
  at.radius = static_cast<float>(radius * (1 + 1e-6) + 4e-7 * centre.cwiseAbs().maxCoeff());
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(scene_->scene, &at, &context, decide, &query);
}

struct EmbreeMesh::Probe::Scene {
  const EmbreeMesh::Scene& object;
  std::vector<Position> rest;
  Triangles mesh;                               // as placed, rounded: for boxes
  std::vector<std::array<double, 3>> vertices;  // as placed
  RTCScene scene = nullptr;
  RTCGeometry geometry = nullptr;
  std::vector<spm::MeshContact>* out = nullptr;
  spm::TrianglePairs pairs{};
  spm::PairContacts found{};
  std::uint32_t count = 0;
  std::array<RTCCollision, spm::TrianglePairs::kWidth> waiting{};
  double reach = 0;  // greatest coordinate of the probe

  void add(const RTCCollision& pair) noexcept {
    for (int i = 0; i < 3; ++i) {
      const Position& f = object.mesh.vertices[object.mesh.faces[pair.primID0][i]];
      const std::array<double, 3>& g = vertices[mesh.faces[pair.primID1][i]];
      for (int axis = 0; axis < 3; ++axis) {
        pairs.object[i][axis][count] = f[axis];
        pairs.probe[i][axis][count] = g[axis];
      }
    }
    waiting[count] = pair;
    if (++count == spm::TrianglePairs::kWidth) flush();
  }

  void flush() {
    for (unsigned hit = spm::meet(pairs, count, found, spm::best_simd()); hit != 0; hit &= hit - 1) {
      const auto lane = static_cast<unsigned>(__builtin_ctz(hit));
      out->push_back({spm::FaceId{waiting[lane].primID0},
                      waiting[lane].primID1,
                      true,
                      {found.point[0][lane], found.point[1][lane], found.point[2][lane]},
                      {found.normal[0][lane], found.normal[1][lane], found.normal[2][lane]},
                      found.depth[lane],
                      waiting[lane].primID0});
    }
    count = 0;
  }
};

EmbreeMesh::Probe::Probe(const EmbreeMesh& object, spm::Span<const Position> vertices, spm::Span<const Face> triangles)
    : scene_{new Scene{*object.scene_, {vertices.begin(), vertices.end()}, {}, {}}} {
  Scene& s = *scene_;
  s.mesh.vertices = s.rest;
  s.mesh.faces.assign(triangles.begin(), triangles.end());
  s.vertices.resize(s.rest.size());
  for (const Position& p : s.rest)
    for (const float x : p) s.reach = std::max(s.reach, 2 * std::abs(double{x}));
  s.scene = rtcNewScene(s.object.device);
  // The one combination that refits, in 11 us instead of 75 to 200 for a new tree.
  rtcSetSceneFlags(s.scene, RTC_SCENE_FLAG_DYNAMIC | RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(s.scene, RTC_BUILD_QUALITY_LOW);
  s.geometry = attach(s.object.device, s.scene, s.mesh, RTC_BUILD_QUALITY_REFIT);
  rtcCommitScene(s.scene);
  check(s.object.device, "building the probe's tree");
}

EmbreeMesh::Probe::~Probe() {
  rtcReleaseGeometry(scene_->geometry);
  rtcReleaseScene(scene_->scene);
}

void EmbreeMesh::Probe::touching(const Eigen::Isometry3d& pose, std::vector<spm::MeshContact>& out) {
  Scene& s = *scene_;
  out.clear();
  s.out = &out;
  const Eigen::Matrix3d r = pose.linear();
  const Vec3d t = pose.translation();
  s.mesh.slack = static_cast<float>((t.cwiseAbs().maxCoeff() + s.reach) * 4e-7);
  for (std::size_t v = 0; v < s.rest.size(); ++v)
    for (int i = 0; i < 3; ++i) {
      const double at = r(i, 0) * s.rest[v][0] + r(i, 1) * s.rest[v][1] + r(i, 2) * s.rest[v][2] + t[i];
      s.vertices[v][i] = at;
      s.mesh.vertices[v][i] = static_cast<float>(at);
    }
  rtcCommitGeometry(s.geometry);
  rtcCommitScene(s.scene);
  rtcCollide(
      s.object.scene, s.scene,
      [](void* user, RTCCollision* collisions, unsigned count) {
        for (unsigned i = 0; i < count; ++i) static_cast<Scene*>(user)->add(collisions[i]);
      },
      &s);
  if (s.count > 0) s.flush();
}

}  // namespace tactus::bench
