#include "spm/fcl/fixed_mesh.hpp"

#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/detail/gjk_solver_libccd.h>
#include <fcl/narrowphase/detail/traversal/collision/mesh_collision_traversal_node.h>
#include <fcl/narrowphase/detail/traversal/collision/mesh_shape_collision_traversal_node.h>
#include <fcl/narrowphase/detail/traversal/collision_node.h>
#include <fcl/narrowphase/detail/traversal/distance/mesh_shape_distance_traversal_node.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>

namespace tactus::spm::fcl {

namespace {

using Box = ::fcl::AABBd;
using Sphere = ::fcl::Sphered;
using Solver = ::fcl::detail::GJKSolver_libccd<double>;

::fcl::Transform3d at(const Vec3d& position) {
  ::fcl::Transform3d pose = ::fcl::Transform3d::Identity();
  pose.translation() = position;
  return pose;
}

void check(int fcl_status, const char* step) {
  if (fcl_status != ::fcl::BVH_OK) {
    throw std::runtime_error(std::string{"FCL: "} + step + " failed with status " + std::to_string(fcl_status));
  }
}

}  // namespace

struct FixedMesh::Tree {
  // FCL's traversals take the model by non-const reference, but do not change it under the identity pose.
  mutable ::fcl::BVHModel<Box> model;
  std::vector<::fcl::Vector3d> vertices;

  void set_vertices(std::span<const Position> from) {
    vertices.resize(from.size());
    for (std::size_t i = 0; i < from.size(); ++i) vertices[i] = {from[i][0], from[i][1], from[i][2]};
  }

  void replace(bool refit) {
    check(model.beginReplaceModel(), "beginReplaceModel");
    check(model.replaceSubModel(vertices), "replaceSubModel");
    check(model.endReplaceModel(refit, true), "endReplaceModel");
  }
};

FixedMesh::FixedMesh(std::span<const Position> vertices, std::span<const Face> faces)
    : tree_{std::make_unique<Tree>()} {
  if (faces.empty()) throw std::invalid_argument("FixedMesh: no face");
  std::vector<::fcl::Triangle> triangles;
  triangles.reserve(faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::uint32_t corner : faces[f]) {
      if (corner >= vertices.size()) {
        throw std::invalid_argument("FixedMesh: face " + std::to_string(f) + " has corner " + std::to_string(corner) +
                                    ", expected below " + std::to_string(vertices.size()));
      }
    }
    triangles.emplace_back(faces[f][0], faces[f][1], faces[f][2]);
  }
  tree_->set_vertices(vertices);
  check(tree_->model.beginModel(static_cast<int>(faces.size()), static_cast<int>(vertices.size())), "beginModel");
  check(tree_->model.addSubModel(tree_->vertices, triangles), "addSubModel");
  check(tree_->model.endModel(), "endModel");
}

FixedMesh::~FixedMesh() = default;
FixedMesh::FixedMesh(FixedMesh&&) noexcept = default;
FixedMesh& FixedMesh::operator=(FixedMesh&&) noexcept = default;

void FixedMesh::find_touched_faces(const Vec3d& centre, double radius, std::vector<std::uint32_t>& faces) const {
  faces.clear();
  const Sphere sphere{radius};
  ::fcl::Transform3d mesh_pose = ::fcl::Transform3d::Identity();
  ::fcl::CollisionRequestd request{std::numeric_limits<std::size_t>::max(), true};
  ::fcl::CollisionResultd result;
  const Solver solver;
  ::fcl::detail::MeshShapeCollisionTraversalNode<Box, Sphere, Solver> node;
  ::fcl::detail::initialize(node, tree_->model, mesh_pose, sphere, at(centre), &solver, request, result);
  ::fcl::detail::collide<double>(&node);
  faces.reserve(result.numContacts());
  for (std::size_t i = 0; i < result.numContacts(); ++i) {
    faces.push_back(static_cast<std::uint32_t>(result.getContact(i).b1));
  }
}

void FixedMesh::intersecting(const FixedMesh& other, std::vector<std::array<std::uint32_t, 2>>& pairs) const {
  pairs.clear();
  ::fcl::Transform3d own_pose = ::fcl::Transform3d::Identity(), other_pose = own_pose;
  ::fcl::CollisionRequestd request{std::numeric_limits<std::size_t>::max(), true};
  ::fcl::CollisionResultd result;
  ::fcl::detail::MeshCollisionTraversalNode<Box> node;
  ::fcl::detail::initialize(node, tree_->model, own_pose, other.tree_->model, other_pose, request, result);
  ::fcl::detail::collide<double>(&node);
  pairs.reserve(result.numContacts());
  for (std::size_t i = 0; i < result.numContacts(); ++i) {
    const ::fcl::Contactd& contact = result.getContact(i);
    pairs.push_back({static_cast<std::uint32_t>(contact.b1), static_cast<std::uint32_t>(contact.b2)});
  }
}

double FixedMesh::distance(const Vec3d& point) const {
  const Sphere sphere{0};
  const Solver solver;
  ::fcl::DistanceResultd result;
  // FCL declares initialize() for this node but defines it with other parameters, so this code sets the fields itself.
  ::fcl::detail::MeshShapeDistanceTraversalNode<Box, Sphere, Solver> node;
  node.request = ::fcl::DistanceRequestd{};
  node.result = &result;
  node.model1 = &tree_->model;
  node.tf1 = ::fcl::Transform3d::Identity();
  node.vertices = tree_->model.vertices;
  node.tri_indices = tree_->model.tri_indices;
  node.model2 = &sphere;
  node.tf2 = at(point);
  node.nsolver = &solver;
  ::fcl::computeBV(sphere, node.tf2, node.model2_bv);
  ::fcl::detail::distance<double>(&node);
  return std::max(0.0, result.min_distance);
}

void FixedMesh::move(std::span<const Position> vertices) {
  if (vertices.size() != tree_->vertices.size()) {
    throw std::invalid_argument("FixedMesh::move: " + std::to_string(vertices.size()) + " vertices, expected " +
                                std::to_string(tree_->vertices.size()));
  }
  tree_->set_vertices(vertices);
}

void FixedMesh::refit() { tree_->replace(true); }

void FixedMesh::rebuild() { tree_->replace(false); }

}  // namespace tactus::spm::fcl
