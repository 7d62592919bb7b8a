#include "spm/offline/write_mesh.hpp"

#include <Eigen/Geometry>
#include <charconv>
#include <string>

#include "spm/model.hpp"
#include "spm/offline/pending_file.hpp"

namespace tactus::spm::offline {
namespace {

template <class T>
void append_raw(std::string& out, const T& value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

template <class T>
void append_number(std::string& out, T value) {
  std::array<char, 32> digits;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
  out += ' ';
  out.append(digits.data(), end);
}

std::string as_ply(const TriangleMesh& mesh) {
  std::string out = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(mesh.positions.size()) +
                    "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
                    std::to_string(mesh.faces.size()) + "\nproperty list uchar int vertex_indices\nend_header\n";
  out.reserve(out.size() + 12 * mesh.positions.size() + 13 * mesh.faces.size());
  for (const auto& p : mesh.positions) append_raw(out, p);
  for (const Triangle& f : mesh.faces) {
    out += '\3';
    append_raw(out, f);
  }
  return out;
}

std::string as_obj(const TriangleMesh& mesh) {
  std::string out;
  for (const auto& p : mesh.positions) {
    out += 'v';
    for (const float x : p) append_number(out, x);
    out += '\n';
  }
  for (const Triangle& f : mesh.faces) {
    out += 'f';
    for (const std::uint32_t v : f) append_number(out, v + 1);
    out += '\n';
  }
  return out;
}

std::string as_stl(const TriangleMesh& mesh) {
  std::string out(80, ' ');
  append_raw(out, static_cast<std::uint32_t>(mesh.faces.size()));
  const auto corner = [&mesh](std::uint32_t v) -> Vec3f {
    return {mesh.positions[v][0], mesh.positions[v][1], mesh.positions[v][2]};
  };
  for (const Triangle& f : mesh.faces) {
    const Vec3f normal = (corner(f[1]) - corner(f[0])).cross(corner(f[2]) - corner(f[0])).normalized();
    append_raw(out, std::array<float, 3>{normal[0], normal[1], normal[2]});
    for (const std::uint32_t v : f) append_raw(out, mesh.positions[v]);
    append_raw(out, std::uint16_t{0});
  }
  return out;
}

}  // namespace

void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh) {
  const std::string extension = path.extension().string();
  std::string bytes;
  if (extension == ".ply") {
    bytes = as_ply(mesh);
  } else if (extension == ".obj") {
    bytes = as_obj(mesh);
  } else if (extension == ".stl") {
    bytes = as_stl(mesh);
  } else {
    throw ModelError{path.string() + ": extension \"" + extension + "\", expected .ply, .obj or .stl"};
  }
  PendingFile file{path};
  file.write(bytes.data(), bytes.size());
  file.commit();
}

}  // namespace tactus::spm::offline
