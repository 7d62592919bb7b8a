#include "spm/importer/read_mesh.hpp"

#include <assimp/config.h>
#include <assimp/scene.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <assimp/IOStream.hpp>
#include <assimp/IOSystem.hpp>
#include <assimp/Importer.hpp>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <exception>
#include <new>
#include <sstream>
#include <stdexcept>
#include <string>

#include "spm/model.hpp"
#include "spm/offline/ply.hpp"
#include "spm/offline/polygon.hpp"

namespace tactus::spm::importer {
namespace {

using offline::cut_polygon;
using offline::fail;
using offline::LossPolicy;
using offline::ModelError;
using offline::PlyMesh;
using offline::Triangle;
using offline::TriangleMesh;

/// A file of `files` for assimp.
class ReadStream : public Assimp::IOStream {
 public:
  explicit ReadStream(std::unique_ptr<std::istream> file) : file_{std::move(file)}, size_{size_of(*file_)} {}

  std::size_t Read(void* to, std::size_t size, std::size_t count) override {
    if (size == 0) return 0;
    file_->read(static_cast<char*>(to), static_cast<std::streamsize>(size * std::min(count, size_ / size)));
    const auto read = static_cast<std::size_t>(file_->gcount());
    file_->clear();
    return read / size;
  }
  std::size_t Write(const void*, std::size_t, std::size_t) override { return 0; }
  aiReturn Seek(std::size_t offset, aiOrigin origin) override {
    const std::size_t from = origin == aiOrigin_SET ? 0 : origin == aiOrigin_CUR ? Tell() : size_;
    if (offset > size_ - std::min(from, size_)) return aiReturn_FAILURE;
    file_->seekg(static_cast<std::streamoff>(from + offset));
    return aiReturn_SUCCESS;
  }
  [[nodiscard]] std::size_t Tell() const override { return static_cast<std::size_t>(file_->tellg()); }
  [[nodiscard]] std::size_t FileSize() const override { return size_; }
  void Flush() override {}

  [[nodiscard]] static std::size_t size_of(std::istream& file) {
    file.seekg(0, std::ios::end);
    const auto size = static_cast<std::size_t>(file.tellg());
    file.seekg(0);
    return size;
  }

 private:
  std::unique_ptr<std::istream> file_;
  std::size_t size_;
};

/// The files of a model for assimp, which opens no other files.
class ReadOnlyFiles : public Assimp::IOSystem {
 public:
  explicit ReadOnlyFiles(ModelFiles& files) : files_{files} {}
  bool Exists(const char* name) const override { return files_.open(name) != nullptr; }
  char getOsSeparator() const override { return '/'; }
  Assimp::IOStream* Open(const char* name, const char* mode) override {
    if (*mode != 'r') return nullptr;
    std::unique_ptr<std::istream> file = files_.open(name);
    return file ? new ReadStream{std::move(file)} : nullptr;  // assimp gives it back to Close()
  }
  void Close(Assimp::IOStream* file) override { delete file; }

 private:
  ModelFiles& files_;
};

/// Counts of what the reader found, for messages.
struct Found {
  std::size_t points = 0, lines = 0;
  std::size_t faces = 0;  // faces before polygons are cut
};

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
Declared declared_by_off(const std::filesystem::path& path, std::istream& file) {
  std::string magic;
  Declared counts;
  const auto size = static_cast<double>(ReadStream::size_of(file));
  if (!(file >> magic >> counts.vertices >> counts.faces)) return {};
  if (6 * counts.vertices + 2 * counts.faces > size) {
    std::ostringstream text;
    text << "found " << size << " bytes, too few for " << counts.vertices << " vertices and " << counts.faces
         << " faces";
    fail(path, text.str());
  }
  return counts;
}

Declared declared_by_obj(std::istream& file) {
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

Declared declared_by_stl(std::istream& file) {
  constexpr std::uint64_t kHeader = 84, kFacet = 50;
  const std::uint64_t size = ReadStream::size_of(file);
  std::array<char, kHeader> header{};
  std::uint32_t facets = 0;
  if (file.read(header.data(), header.size())) std::memcpy(&facets, header.data() + 80, sizeof facets);
  if (file && size == kHeader + kFacet * facets) return {0, static_cast<double>(facets)};
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

/// Throws ModelError with a reason, which may be empty if assimp states none.
[[noreturn]] void fail_to_read(const std::filesystem::path& path, const std::string& reason) {
  fail(path, "cannot be read as a model: " +
                 (reason.empty() ? "the file is damaged, or its format differs from its extension" : reason));
}

TriangleMesh read_scene(const std::filesystem::path& path, ModelFiles& files, Found& found) {
  Assimp::Importer importer;
  importer.SetIOHandler(new ReadOnlyFiles{files});  // the importer deletes it
  importer.SetPropertyBool(AI_CONFIG_IMPORT_NO_SKELETON_MESHES, true);
  const aiScene* scene = importer.ReadFile(path.filename().string(), 0);
  if (const std::exception_ptr error = importer.GetException()) std::rethrow_exception(error);  // std::bad_alloc, too
  if (scene == nullptr) fail_to_read(path, importer.GetErrorString());
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
bool is_ply(std::istream& file, const std::string& extension) {
  std::array<char, 4> magic{};
  file.read(magic.data(), magic.size());
  file.clear();
  file.seekg(0);
  return extension == ".ply" || (std::memcmp(magic.data(), "ply", 3) == 0 && (magic[3] == '\n' || magic[3] == '\r'));
}

TriangleMesh read_ply_file(const std::filesystem::path& path, std::istream& file, LossPolicy losses) {
  const std::size_t size = ReadStream::size_of(file);
  PlyMesh ply = offline::read_ply({path.string(), size}, file);
  if (ply.mesh.faces.empty())
    fail(path, "found " + std::to_string(ply.mesh.positions.size()) + " points and " + std::to_string(ply.lines) +
                   " lines, expected a surface of triangles");
  const Found found{0, ply.lines, ply.polygons};
  if (losses == LossPolicy::kRefuse)
    require_few_losses(path, {0, static_cast<double>(ply.lines + ply.polygons)}, ply.mesh, found);
  return std::move(ply.mesh);
}

}  // namespace

TriangleMesh read_mesh(const std::filesystem::path& model, ModelFiles& files, LossPolicy losses) {
  std::unique_ptr<std::istream> file = files.open(model.filename().string());
  if (!file) fail(model, "cannot be opened");
  const std::string extension = extension_of(model);
  if (is_ply(*file, extension)) return read_ply_file(model, *file, losses);
  const Declared declared = extension == ".off"   ? declared_by_off(model, *file)
                            : extension == ".obj" ? declared_by_obj(*file)
                            : extension == ".stl" ? declared_by_stl(*file)
                                                  : Declared{};
  file.reset();
  try {
    Found found;
    TriangleMesh mesh = read_scene(model, files, found);
    if (losses == LossPolicy::kRefuse) require_few_losses(model, declared, mesh, found);
    return mesh;
  } catch (const ModelError&) {
    throw;
  } catch (const std::bad_alloc&) {
    // The caller knows the limit.
    throw;
  } catch (const std::runtime_error& e) {
    // An error of assimp, whose text is for users.
    fail_to_read(model, e.what());
  } catch (const std::exception&) {
    // Such as std::out_of_range, whose text is the name of a C++ function ("stoi").
    fail_to_read(model, "");
  }
}

}  // namespace tactus::spm::importer
