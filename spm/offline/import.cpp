#include "spm/offline/import.hpp"

#include <assimp/config.h>
#include <assimp/scene.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>
#include <system_error>

#include "spm/model.hpp"
#include "spm/offline/ply.hpp"
#include "spm/offline/polygon.hpp"

namespace tactus::spm::offline {
namespace {

/// Counts of what the reader found, for messages.
struct Found {
  std::size_t points = 0, lines = 0;
  std::size_t faces = 0;  // faces before polygons are cut
};

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

/// The numbers of vertices and faces that a file declares; 0 if its format does not declare them.
struct Declared {
  double vertices = 0, faces = 0;
};

/// Reads the declared counts. Throws if the file is too short for these counts, because assimp would reserve memory for
/// them. A vertex takes at least the 6 bytes of "0 0 0\n".
Declared declared_by_off(const std::filesystem::path& path) {
  std::ifstream file{path};
  std::string magic;
  Declared counts;
  if (!(file >> magic >> counts.vertices >> counts.faces)) return {};
  const auto size = static_cast<double>(std::filesystem::file_size(path));
  if (6 * counts.vertices + 2 * counts.faces > size) {
    std::ostringstream text;
    text << "found " << size << " bytes, too few for " << counts.vertices << " vertices and " << counts.faces
         << " faces";
    fail(path, text.str());
  }
  return counts;
}

Declared declared_by_obj(const std::filesystem::path& path) {
  std::ifstream file{path};
  Declared counts;
  for (std::string line; std::getline(file, line);) {
    const std::size_t word = line.find_first_not_of(" \t");
    if (word == std::string::npos || word + 1 >= line.size() || (line[word + 1] != ' ' && line[word + 1] != '\t'))
      continue;
    if (line[word] == 'v') ++counts.vertices;
    if (line[word] == 'f') ++counts.faces;
  }
  return counts;
}

Declared declared_by_stl(const std::filesystem::path& path) {
  constexpr std::uint64_t kHeader = 84, kFacet = 50;
  std::ifstream file{path, std::ios::binary};
  std::array<char, kHeader> header{};
  std::uint32_t facets = 0;
  if (file.read(header.data(), header.size())) std::memcpy(&facets, header.data() + 80, sizeof facets);
  if (file && std::filesystem::file_size(path) == kHeader + kFacet * facets) return {0, static_cast<double>(facets)};
  file.clear();
  file.seekg(0);
  Declared counts;
  for (std::string word; file >> word;)
    if (word == "facet") ++counts.faces;
  return counts;
}

/// Throws if a face of the scene has a vertex that does not exist.
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

/// Throws if the scene lacks a node. assimp loses the nodes of some files and reports success, so their meshes would be
/// missing without a message.
void check_nodes(const aiNode& node, const std::filesystem::path& path) {
  for (unsigned i = 0; i < node.mNumChildren; ++i) {
    if (node.mChildren[i] == nullptr)
      fail(path, "found an empty node, expected all " + std::to_string(node.mNumChildren) +
                     " nodes of the file; assimp cannot read this file, so convert it to another format");
    check_nodes(*node.mChildren[i], path);
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

/// Appends a mesh of the scene, transformed by `transform`.
void append_mesh(const aiMesh& from, const Matrix& transform, TriangleMesh& to, Found& found) {
  const std::size_t first = to.positions.size();
  if (first + from.mNumVertices >= kNone) throw ModelError{"found more vertices than 32 bits can number"};
  const bool moved = transform != Matrix::Identity();
  for (unsigned v = 0; v < from.mNumVertices; ++v) {
    const aiVector3D& p = from.mVertices[v];
    if (moved) {
      const Eigen::Vector4d q = transform * Eigen::Vector4d{p.x, p.y, p.z, 1};
      to.positions.push_back({static_cast<float>(q[0]), static_cast<float>(q[1]), static_cast<float>(q[2])});
    } else {
      to.positions.push_back({p.x, p.y, p.z});
    }
  }
  const bool mirrored = transform.topLeftCorner<3, 3>().determinant() < 0;
  const auto add = [&](const aiFace& face, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (mirrored) std::swap(b, c);
    const auto id = [&](std::uint32_t k) { return static_cast<std::uint32_t>(first + face.mIndices[k]); };
    to.faces.push_back({id(a), id(b), id(c)});
  };
  std::vector<std::array<float, 3>> corners;
  for (unsigned f = 0; f < from.mNumFaces; ++f) {
    const aiFace& face = from.mFaces[f];
    if (face.mNumIndices >= 3) ++found.faces;
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
  const Matrix transform = parent * matrix_of(node.mTransformation);
  for (unsigned i = 0; i < node.mNumMeshes; ++i) append_mesh(*scene.mMeshes[node.mMeshes[i]], transform, mesh, found);
  for (unsigned i = 0; i < node.mNumChildren; ++i) append_node(scene, *node.mChildren[i], transform, mesh, found);
}

/// Describes a scene without triangles.
std::string described(const aiScene& scene, const Found& found) {
  std::string text;
  const auto add = [&text](std::size_t count, const char* what) {
    if (count > 0) text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + what;
  };
  add(found.points, "points");
  add(found.lines, "lines");
  add(scene.mNumAnimations, "animations");
  return text.empty() ? "nothing" : text;
}

TriangleMesh import_with(Assimp::Importer& importer, const std::filesystem::path& path, Found& found) {
  importer.SetPropertyBool(AI_CONFIG_IMPORT_NO_SKELETON_MESHES, true);
  const aiScene* scene = importer.ReadFile(path.string(), 0);
  if (scene == nullptr) fail(path, std::string{"cannot be read as a model: "} + importer.GetErrorString());
  check_indices(*scene, path);
  if (scene->mRootNode != nullptr) check_nodes(*scene->mRootNode, path);
  TriangleMesh mesh;
  if (scene->mRootNode != nullptr) append_node(*scene, *scene->mRootNode, Matrix::Identity(), mesh, found);
  if (mesh.faces.empty()) fail(path, "found " + described(*scene, found) + ", expected a surface of triangles");
  return mesh;
}

/// Counts the distinct positions. assimp repeats the vertices of an OBJ file for each face, so their number says
/// nothing.
std::size_t count_distinct(std::vector<std::array<float, 3>> positions) {
  const auto before = [](const auto& a, const auto& b) {
    return std::memcmp(&a, &b, sizeof a) < 0;
  };  // by bytes, because NaN is not ordered
  std::sort(positions.begin(), positions.end(), before);
  return static_cast<std::size_t>(std::unique(positions.begin(), positions.end()) - positions.begin());
}

/// Throws if most declared vertices or faces are missing, because assimp drops unknown content silently.
void require_few_losses(const std::filesystem::path& path, const Declared& declared, const TriangleMesh& mesh,
                        const Found& found) {
  const auto require = [&](const char* what, double has, double read) {
    if (2 * read >= has) return;
    std::ostringstream text;
    text.precision(12);
    text << "most " << what << " would be dropped: the file declares " << has << ", found " << read
         << ", expected at least half (tactus-mesh build --allow-losses builds it as it is)";
    fail(path, text.str());
  };
  require("faces", declared.faces, static_cast<double>(found.faces));
  if (declared.vertices > 0)
    require("vertices", declared.vertices, static_cast<double>(count_distinct(mesh.positions)));
}

/// True if the name or the first bytes are those of a PLY file, which read_ply() must read (ply.hpp).
bool is_ply(const std::filesystem::path& path, const std::string& extension) {
  std::array<char, 4> magic{};
  std::ifstream{path, std::ios::binary}.read(magic.data(), magic.size());
  return extension == ".ply" || (std::memcmp(magic.data(), "ply", 3) == 0 && (magic[3] == '\n' || magic[3] == '\r'));
}

TriangleMesh import_ply(const std::filesystem::path& path, LossPolicy losses) {
  std::ifstream bytes{path, std::ios::binary};
  PlyMesh ply = read_ply({path.string(), std::filesystem::file_size(path)}, bytes);
  if (ply.mesh.faces.empty())
    fail(path, "found " + std::to_string(ply.mesh.positions.size()) + " points and " + std::to_string(ply.lines) +
                   " lines, expected a surface of triangles");
  const Found found{0, ply.lines, ply.polygons};
  if (losses == LossPolicy::kRefuse)
    require_few_losses(path, {0, static_cast<double>(ply.lines + ply.polygons)}, ply.mesh, found);
  return std::move(ply.mesh);
}

}  // namespace

TriangleMesh import_mesh(const std::filesystem::path& path, LossPolicy losses) {
  check_readable(path);
  const std::string extension = extension_of(path);
  if (is_ply(path, extension)) return import_ply(path, losses);
  const Declared declared = extension == ".off"   ? declared_by_off(path)
                            : extension == ".obj" ? declared_by_obj(path)
                            : extension == ".stl" ? declared_by_stl(path)
                                                  : Declared{};
  try {
    Assimp::Importer importer;
    Found found;
    TriangleMesh mesh = import_with(importer, path, found);
    if (losses == LossPolicy::kRefuse) require_few_losses(path, declared, mesh, found);
    return mesh;
  } catch (const ModelError&) {
    throw;
  } catch (const std::exception& e) {
    fail(path, std::string{"cannot be read as a model: "} + e.what());
  }
}

}  // namespace tactus::spm::offline
