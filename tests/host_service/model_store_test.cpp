#include "host_service/model_store.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

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

  /// Writes a glTF file with one triangle. `buffer`: the uri of its buffer, and the blanks before it.
  void write_gltf(const std::string& name, const std::string& buffer, const std::string& images = "") const {
    test_support::write_bytes(folder_.path() / name,
                              R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                   "min": [0, 0, 0], "max": [1, 1, 0]}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}], "images": [)" +
                                  images + R"(], "buffers": [{"byteLength": 36, "uri")" + buffer + "}]}");
  }
  /// Writes three positions of three floats.
  void write_buffer(const std::string& name, float corner) const {
    const float positions[9] = {0, 0, 0, corner, 0, 0, 0, 1, 0};
    test_support::write_bytes(folder_.path() / name,
                              std::string(reinterpret_cast<const char*>(positions), sizeof positions));
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

TEST_F(ModelStoreTest, TheHashCoversTheFilesThatTheReaderRequests) {
  std::filesystem::create_directory(folder_.path() / "parts");
  struct Case {
    const char *model, *uri;
  };
  for (const auto& [model, uri] :
       {Case{"triangle.gltf", "triangle.bin"}, Case{"triangle.GLTF", "triangle.bin"},
        Case{"blank.gltf", "a%20triangle.bin"}, Case{"slash.gltf", "parts\\/triangle.bin"}}) {
    write_gltf(model, R"(: ")" + std::string{uri} + "\"");
    const auto write_buffers = [&](float corner) {
      for (const char* name : {"triangle.bin", "a triangle.bin", "a%20triangle.bin", "parts/triangle.bin"})
        write_buffer(name, corner);
    };
    write_buffers(1);
    const std::uint64_t digest = open(folder_.path() / model);
    EXPECT_EQ(open(folder_.path() / model), digest);
    EXPECT_THAT(log_text_, HasSubstr("from the cache")) << uri;
    write_buffers(0.5F);
    EXPECT_NE(open(folder_.path() / model), digest) << model << ", " << uri;
    write_buffers(1);
    EXPECT_EQ(open(folder_.path() / model), digest);
    EXPECT_THAT(log_text_, HasSubstr("from the cache")) << uri;
  }
}

TEST_F(ModelStoreTest, RefusesAFileThatChangesWhileItIsRead) {
  const std::filesystem::path importer =
      std::filesystem::canonical("/proc/self/exe").parent_path() / "../bin/tactus-import";
  const std::filesystem::path slow = folder_.path() / "slow-import";
  test_support::write_bytes(slow, "#!/bin/sh\n/bin/touch \"$1\"\nexec '" + importer.string() + "' \"$@\"\n");
  std::filesystem::permissions(slow, std::filesystem::perms::owner_all);
  ::setenv("TACTUS_IMPORT", slow.c_str(), 1);
  std::string refusal;
  try {
    (void)open(mesh_);
  } catch (const offline::ModelError& error) {
    refusal = error.what();
  }
  ::unsetenv("TACTUS_IMPORT");
  EXPECT_THAT(refusal, HasSubstr("the file sphere.ply changed while it was read"));
  EXPECT_TRUE(std::filesystem::is_empty(cache_));
  (void)open(mesh_);
  EXPECT_THAT(log_text_, HasSubstr("built and stored in"));
}

TEST_F(ModelStoreTest, OpensAModelWithMegabytesOfBlanks) {
  write_buffer("triangle.bin", 1);
  write_gltf("triangle.gltf", std::string(4u << 20, ' ') + R"(: "triangle.bin")");
  EXPECT_NO_THROW(open(folder_.path() / "triangle.gltf"));
}

TEST_F(ModelStoreTest, TheHashDoesNotReadFilesThatTheReaderDoesNotGet) {
  const std::filesystem::path model = folder_.path() / "models" / "triangle.gltf";
  std::filesystem::create_directory(model.parent_path());
  write_buffer("models/triangle.bin", 1);
  write_gltf("models/triangle.gltf", R"(: "triangle.bin")", R"({"uri": "../secret"}, {"uri": "/proc/self/pagemap"})");
  test_support::write_bytes(folder_.path() / "secret", "one");
  open(model);
  test_support::write_bytes(folder_.path() / "secret", "two");

  open(model);

  EXPECT_THAT(log_text_, HasSubstr("from the cache"));
}

TEST_F(ModelStoreTest, AModelThatNamesItselfManyTimesIsReadOnce) {
  std::string images = R"({"uri": "triangle.gltf"})";
  for (int i = 1; i < 100'000; ++i) images += R"(, {"uri": "triangle.gltf"})";
  write_buffer("triangle.bin", 1);
  write_gltf("triangle.gltf", R"(: "triangle.bin")", images);
  EXPECT_NO_THROW(open(folder_.path() / "triangle.gltf"));
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
