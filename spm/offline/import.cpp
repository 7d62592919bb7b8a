#include "spm/offline/import.hpp"

#include <assimp/config.h>
#include <assimp/scene.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <assimp/Importer.hpp>
#include <cctype>
#include <fstream>
#include <sstream>
#include <string>
#include <system_error>

#include "spm/model.hpp"
#include "spm/offline/ply_header.hpp"
#include "spm/offline/polygon.hpp"

namespace tactus::spm::offline {
namespace {

/// What a scene holds that is no triangle, for the message when it holds nothing else.
struct Found {
  std::size_t points = 0, lines = 0;
};

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& what) {
  throw ModelError{path.string() + ": " + what};
}

void check_readable(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found) fail(path, "no such file, expected a model");
  if (error) fail(path, "cannot be read: " + error.message());
  if (status.type() != std::filesystem::file_type::regular) fail(path, "is no regular file, expected a model");
  if (std::filesystem::file_size(path, error) == 0) fail(path, "found 0 bytes, expected a model");
}

std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

/// The counts in an OFF file, before the reader reserves memory for them: a vertex takes at least "0 0 0\n".
void check_off_counts(const std::filesystem::path& path) {
  std::ifstream file{path};
  std::string magic;
  double vertices = 0, faces = 0;
  const bool counted = static_cast<bool>(file >> magic >> vertices >> faces);
  const auto size = static_cast<double>(std::filesystem::file_size(path));
  if (counted && 6 * vertices + 2 * faces > size) {
    std::ostringstream text;
    text << "found " << size << " bytes, too few for " << vertices << " vertices and " << faces << " faces";
    fail(path, text.str());
  }
}

/// Before anything follows the indices of a scene.
void check_indices(const aiScene& scene, const std::filesystem::path& path) {
  for (unsigned m = 0; m < scene.mNumMeshes; ++m) {
    const aiMesh& mesh = *scene.mMeshes[m];
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      for (unsigned k = 0; k < mesh.mFaces[f].mNumIndices; ++k) {
        if (mesh.mFaces[f].mIndices[k] < mesh.mNumVertices) continue;
        fail(path, "mesh " + std::to_string(m) + ", face " + std::to_string(f) + ": found vertex index " +
                       std::to_string(mesh.mFaces[f].mIndices[k]) + ", expected below " +
                       std::to_string(mesh.mNumVertices));
      }
    }
  }
}

using Matrix = Eigen::Matrix4d;

Matrix matrix_of(const aiMatrix4x4& m) {
  Matrix out;
  for (unsigned row = 0; row < 4; ++row) {
    for (unsigned column = 0; column < 4; ++column) out(row, column) = m[row][column];
  }
  return out;
}

void append_mesh(const aiMesh& from, const Matrix& placed, TriangleMesh& to, Found& found) {
  const std::size_t first = to.positions.size();
  if (first + from.mNumVertices >= kNone) throw ModelError{"more vertices than 32 bits can name"};
  const bool moved = placed != Matrix::Identity();
  for (unsigned v = 0; v < from.mNumVertices; ++v) {
    const aiVector3D& p = from.mVertices[v];
    if (moved) {
      const Eigen::Vector4d q = placed * Eigen::Vector4d{p.x, p.y, p.z, 1};
      to.positions.push_back({static_cast<float>(q[0]), static_cast<float>(q[1]), static_cast<float>(q[2])});
    } else {
      to.positions.push_back({p.x, p.y, p.z});
    }
  }
  const bool mirrored = placed.topLeftCorner<3, 3>().determinant() < 0;
  const auto add = [&](const aiFace& face, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (mirrored) std::swap(b, c);
    const auto id = [&](std::uint32_t k) { return static_cast<std::uint32_t>(first + face.mIndices[k]); };
    to.faces.push_back({id(a), id(b), id(c)});
  };
  std::vector<std::array<float, 3>> corners;
  for (unsigned f = 0; f < from.mNumFaces; ++f) {
    const aiFace& face = from.mFaces[f];
    if (face.mNumIndices < 3) {
      ++(face.mNumIndices == 2 ? found.lines : found.points);
    } else if (face.mNumIndices == 3) {
      add(face, 0, 1, 2);
    } else {
      corners.clear();
      for (unsigned k = 0; k < face.mNumIndices; ++k) corners.push_back(to.positions[first + face.mIndices[k]]);
      for (const Triangle& t : cut_polygon(corners)) add(face, t[0], t[1], t[2]);
    }
  }
  if (from.mNumFaces == 0) found.points += from.mNumVertices;
}

void append_node(const aiScene& scene, const aiNode& node, const Matrix& parent, TriangleMesh& mesh, Found& found) {
  const Matrix placed = parent * matrix_of(node.mTransformation);
  for (unsigned i = 0; i < node.mNumMeshes; ++i) append_mesh(*scene.mMeshes[node.mMeshes[i]], placed, mesh, found);
  for (unsigned i = 0; i < node.mNumChildren; ++i) append_node(scene, *node.mChildren[i], placed, mesh, found);
}

std::string list(const aiScene& scene, const Found& found) {
  std::string text;
  const auto add = [&text](std::size_t count, const char* what) {
    if (count > 0) text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + what;
  };
  add(found.points, "points");
  add(found.lines, "lines");
  add(scene.mNumAnimations, "animations");
  return text.empty() ? "nothing" : text;
}

TriangleMesh import_with(Assimp::Importer& importer, const std::filesystem::path& path) {
  importer.SetPropertyBool(AI_CONFIG_IMPORT_NO_SKELETON_MESHES, true);
  const aiScene* scene = importer.ReadFile(path.string(), 0);
  if (scene == nullptr) fail(path, std::string{"cannot be read as a model: "} + importer.GetErrorString());
  check_indices(*scene, path);
  TriangleMesh mesh;
  Found found;
  if (scene->mRootNode != nullptr) append_node(*scene, *scene->mRootNode, Matrix::Identity(), mesh, found);
  if (mesh.faces.empty()) fail(path, "found " + list(*scene, found) + ", expected a surface of triangles");
  return mesh;
}

}  // namespace

TriangleMesh import_mesh(const std::filesystem::path& path) {
  check_readable(path);
  const std::string extension = extension_of(path);
  if (extension == ".ply") check_ply_header(path);
  if (extension == ".off") check_off_counts(path);
  try {
    Assimp::Importer importer;
    return import_with(importer, path);
  } catch (const ModelError&) {
    throw;
  } catch (const std::exception& e) {
    fail(path, std::string{"cannot be read as a model: "} + e.what());
  }
}

}  // namespace tactus::spm::offline
