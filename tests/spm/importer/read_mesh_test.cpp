#include "spm/importer/read_mesh.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/write_mesh.hpp"
#include "tests/spm/importer/names_file_and_reason.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::spm::importer {
namespace {

using offline::generate;
using offline::ModelError;
using offline::Shape;
using offline::Triangle;
using offline::TriangleMesh;
using test_support::NamesFileAndReason;
using ::testing::HasSubstr;

/// One file, in memory.
class MemoryFile : public ModelFiles {
 public:
  MemoryFile(std::string name, const std::string& bytes) : name_{std::move(name)}, bytes_{bytes} {}
  std::unique_ptr<std::istream> open(const std::string& name) override {
    return name == name_ ? std::make_unique<std::istringstream>(bytes_) : nullptr;
  }

 private:
  std::string name_;
  const std::string& bytes_;
};

TriangleMesh read(const std::string& name, const std::string& bytes) {
  MemoryFile file{name, bytes};
  return read_mesh(name, file, offline::LossPolicy::kRefuse);
}

/// Returns the error message of the reader, or an empty string if it succeeds.
std::string read_error(const std::string& name, const std::string& bytes) {
  try {
    static_cast<void>(read(name, bytes));
  } catch (const ModelError& e) {
    return e.what();
  }
  return {};
}

void expect_refused_or_valid_indices(const std::string& name, const std::string& bytes) {
  try {
    const TriangleMesh mesh = read(name, bytes);
    for (const Triangle& face : mesh.faces)
      for (const std::uint32_t vertex : face) ASSERT_LT(vertex, mesh.positions.size());
  } catch (const ModelError& e) {
    ASSERT_THAT(e.what(), NamesFileAndReason(name));
  }
}

/// Files whose second open() throws. The reader opens the first one, and assimp the second.
template <class Exception>
class BrokenFiles : public ModelFiles {
 public:
  explicit BrokenFiles(const char* text) : text_{text} {}
  std::unique_ptr<std::istream> open(const std::string&) override {
    if (std::exchange(opened_, true)) throw Exception{text_};
    return std::make_unique<std::istringstream>("v 0 0 0\n");
  }

 private:
  const char* text_;
  bool opened_ = false;
};

template <class Exception>
std::string error_of_exception(const char* text) {
  BrokenFiles<Exception> files{text};
  try {
    static_cast<void>(read_mesh("broken.obj", files, offline::LossPolicy::kRefuse));
  } catch (const ModelError& e) {
    return e.what();
  }
  return {};
}

TEST(ReadMesh, StatesAReasonWhateverIsThrownWhileAssimpReads) {
  EXPECT_EQ(error_of_exception<std::runtime_error>("line 3 has no vertex"),
            "broken.obj: cannot be read as a model: line 3 has no vertex");
  for (const std::string& error :
       {error_of_exception<std::runtime_error>(""), error_of_exception<std::out_of_range>("stoi"),
        error_of_exception<std::length_error>("vector::_M_default_append")})
    EXPECT_EQ(error,
              "broken.obj: cannot be read as a model: the file is damaged, or its format differs from its extension");
}

/// The bytes that write_mesh() writes for a format.
std::string bytes_of(const std::string& name, const TriangleMesh& mesh) {
  const test_support::TemporaryFolder folder;
  offline::write_mesh(folder.path() / name, mesh);
  return test_support::read_bytes(folder.path() / name);
}

struct MeshFile {
  std::string name, bytes;
  std::size_t faces;
};

template <class Value>
void append(std::string& bytes, Value value, bool big_endian = false) {
  std::array<char, sizeof value> raw;
  std::memcpy(raw.data(), &value, sizeof value);
  if (big_endian) std::reverse(raw.begin(), raw.end());
  bytes.append(raw.begin(), raw.end());
}

/// PLY files with the same three triangle strips: a band of four triangles, a single triangle, and a strip that begins
/// with a repeated corner, which reverses its orientation.
std::vector<MeshFile> strip_files() {
  const std::vector<std::array<float, 3>> positions{{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {1, 1, 0}, {2, 0, 0}, {2, 1, 0}};
  const std::vector<std::int32_t> strips{1, 0, 3, 2, 5, 4, -1, 0, 2, 1, -1, 3, 3, 2, 5};
  const auto header = [](const char* format) {
    std::string text = "ply\nformat ";
    text += format;
    text +=
        " 1.0\ncomment a scan\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
        "property uchar confidence\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    return text;
  };
  std::string text = header("ascii");
  for (const auto& p : positions)
    text += std::to_string(p[0]) + " " + std::to_string(p[1]) + " " + std::to_string(p[2]) + " 7\n";
  text += std::to_string(strips.size());
  for (const std::int32_t index : strips) text += " " + std::to_string(index);
  std::vector<MeshFile> files{{"ascii.ply", text + "\n", 6}};
  for (const bool big_endian : {false, true}) {
    std::string bytes = header(big_endian ? "binary_big_endian" : "binary_little_endian");
    for (const auto& p : positions) {
      for (const float x : p) append(bytes, x, big_endian);
      bytes += '\7';
    }
    append(bytes, static_cast<std::int32_t>(strips.size()), big_endian);
    for (const std::int32_t index : strips) append(bytes, index, big_endian);
    files.push_back({big_endian ? "big.ply" : "little.ply", bytes, 6});
  }
  return files;
}

TEST(ReadMesh, ReadsTriangleStripsWithTheirWinding) {
  const std::vector<Triangle> expected{{1, 0, 3}, {3, 0, 2}, {3, 2, 5}, {5, 2, 4}, {0, 2, 1}, {2, 3, 5}};
  for (const MeshFile& strips : strip_files()) {
    const TriangleMesh mesh = read(strips.name, strips.bytes);
    EXPECT_EQ(mesh.positions.size(), 6u) << strips.name;
    EXPECT_EQ(mesh.faces, expected) << strips.name;
  }
}

TEST(ReadMesh, RefusesTruncatedStripsAndStripsWithAVertexThatDoesNotExist) {
  for (const MeshFile& strips : strip_files()) {
    const std::size_t cut = strips.bytes.find_last_not_of('\n') - 1;  // inside the last index or just before it
    EXPECT_THAT(read_error(strips.name, strips.bytes.substr(0, cut)), HasSubstr("truncated")) << strips.name;
    std::string wrong = strips.bytes;
    const std::size_t last = wrong.size() - (strips.name == "little.ply" ? 4 : strips.name == "big.ply" ? 1 : 2);
    wrong[last] = static_cast<char>(wrong[last] + 1);
    EXPECT_THAT(read_error(strips.name, wrong), HasSubstr("found vertex index 6, expected below 6")) << strips.name;
  }
}

TEST(ReadMesh, RefusesEveryTruncationOfABinaryFile) {
  const TriangleMesh mesh = generate(Shape::kSphere, 200);
  for (const char* name : {"cut.ply", "cut.stl"}) {
    const std::string bytes = bytes_of(name, mesh);
    for (std::size_t size = 0; size < bytes.size(); size += 61) {
      EXPECT_THAT(read_error(name, bytes.substr(0, size)), NamesFileAndReason(name)) << "cut to " << size;
    }
  }
}

TEST(ReadMesh, AFileWithADamagedByteIsRefusedOrHasValidIndices) {
  const TriangleMesh mesh = generate(Shape::kSphere, 60);
  for (const char* name : {"damaged.ply", "damaged.stl", "damaged.obj"}) {
    const std::string bytes = bytes_of(name, mesh);
    for (std::size_t i = 0; i < bytes.size(); i += 7) {
      std::string damaged = bytes;
      damaged[i] = static_cast<char>(damaged[i] ^ 0x55);
      ASSERT_NO_FATAL_FAILURE(expect_refused_or_valid_indices(name, damaged));
    }
  }
}

TEST(ReadMesh, AFileOfStripsWithADamagedBitIsRefusedOrHasValidIndices) {
  for (const MeshFile& strips : strip_files()) {
    for (std::size_t bit = 0; bit < 8 * strips.bytes.size(); bit += 3) {
      std::string damaged = strips.bytes;
      damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ 1 << bit % 8);
      ASSERT_NO_FATAL_FAILURE(expect_refused_or_valid_indices(strips.name, damaged));
    }
  }
}

}  // namespace
}  // namespace tactus::spm::importer
