#include "host_service/model_store.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "spm/offline/generate.hpp"
#include "spm/offline/write_mesh.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::host_service {
namespace {

namespace offline = spm::offline;
using testing::HasSubstr;

class ModelStoreTest : public testing::Test {
 protected:
  ModelStoreTest() { offline::write_mesh(mesh_, offline::generate(offline::Shape::kSphere, 400)); }

  /// Opens a model and returns its digest. Writes the log to `log_text_`.
  std::uint64_t open(const std::filesystem::path& path) {
    log_text_.clear();
    const ModelStore store{cache_,
                           [this](const std::string& line) {
                             log_text_ += line + "\n";
                             if (line.find(stop_at_) != std::string::npos) stop_ = true;
                           },
                           stop_};
    return store.open(path).summary().digest;
  }
  std::filesystem::path cached() const {
    return std::filesystem::directory_iterator { cache_ } -> path();
  }

  test_support::TemporaryFolder folder_;
  std::filesystem::path mesh_ = folder_.path() / "sphere.ply";
  std::filesystem::path cache_ = folder_.path() / "cache" / "models";
  std::string log_text_;
  std::string stop_at_ = "nowhere";  // part of the line after which `stop_` is set
  std::atomic<bool> stop_{false};
};

TEST_F(ModelStoreTest, BuildsAModelOnceForTheSameBytes) {
  const std::uint64_t digest = open(mesh_);
  EXPECT_THAT(log_text_, HasSubstr("building"));

  std::filesystem::copy_file(mesh_, folder_.path() / "other name.ply");
  EXPECT_EQ(open(folder_.path() / "other name.ply"), digest);

  EXPECT_THAT(log_text_, HasSubstr("from the cache"));
  EXPECT_EQ(open(cached()), digest) << "a .spm file is opened directly";
  EXPECT_EQ(log_text_, "");
}

TEST_F(ModelStoreTest, BuildsAModelForOtherBytes) {
  const std::uint64_t digest = open(mesh_);
  offline::write_mesh(mesh_, offline::generate(offline::Shape::kSphere, 402));
  EXPECT_NE(open(mesh_), digest);
}

TEST_F(ModelStoreTest, RebuildsADamagedCacheEntry) {
  const std::uint64_t digest = open(mesh_);
  std::string bytes = test_support::read_bytes(cached());
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  test_support::write_bytes(cached(), bytes);

  EXPECT_EQ(open(mesh_), digest);
  EXPECT_THAT(log_text_, HasSubstr("is invalid and will be built again"));
}

TEST_F(ModelStoreTest, TheHashCoversTheBuffersOfAGltfFile) {
  const std::filesystem::path gltf = folder_.path() / "triangle.gltf";
  // One triangle: three positions of three floats.
  test_support::write_bytes(gltf, R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                   "min": [0, 0, 0], "max": [1, 1, 0]}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "triangle.bin", "byteLength": 36}]})");
  const auto write = [&](float corner) {
    const float positions[9] = {0, 0, 0, corner, 0, 0, 0, 1, 0};
    test_support::write_bytes(folder_.path() / "triangle.bin",
                              std::string(reinterpret_cast<const char*>(positions), sizeof positions));
  };
  write(1);
  const std::uint64_t digest = open(gltf);
  write(0.5F);

  EXPECT_NE(open(gltf), digest);
}

TEST_F(ModelStoreTest, StopsAtEveryStageWithoutAnIncompleteFile) {
  stop_ = true;
  EXPECT_THROW(open(mesh_), Stopped);
  EXPECT_FALSE(std::filesystem::exists(cache_));
  for (const std::string stage : {"building", "clean", "number", "divide"}) {
    stop_ = false;
    stop_at_ = stage;
    EXPECT_THROW(open(mesh_), Stopped) << stage;
    EXPECT_THAT(log_text_, HasSubstr(stage));
    EXPECT_TRUE(std::filesystem::is_empty(cache_)) << stage;
  }
  stop_ = false;
  stop_at_ = "stored in";
  EXPECT_THROW(open(mesh_), Stopped);
  stop_ = false;
  open(mesh_);
  EXPECT_THAT(log_text_, HasSubstr("from the cache")) << "the written file is complete";
}

TEST_F(ModelStoreTest, RefusesAFileThatIsNotAModelAndNamesIt) {
  const auto error_of = [&](const std::filesystem::path& path) -> std::string {
    try {
      open(path);
    } catch (const offline::ModelError& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_THAT(error_of(folder_.path() / "none.ply"), HasSubstr("none.ply"));
  EXPECT_THAT(error_of(folder_.path()), HasSubstr("is a folder, expected a model file"));
  test_support::write_bytes(folder_.path() / "empty.obj", "");
  EXPECT_THAT(error_of(folder_.path() / "empty.obj"), HasSubstr("empty.obj"));
  test_support::write_bytes(folder_.path() / "odd.spm", "no model");
  EXPECT_THAT(error_of(folder_.path() / "odd.spm"), HasSubstr("odd.spm"));
}

TEST_F(ModelStoreTest, NamesACacheFolderThatCannotBeCreated) {
  test_support::write_bytes(folder_.path() / "cache", "a file, not a folder");
  try {
    open(mesh_);
    FAIL() << "no error";
  } catch (const offline::ModelError& error) {
    EXPECT_THAT(error.what(), HasSubstr(cache_.string()));
  }
}

}  // namespace
}  // namespace tactus::host_service
