// import_mesh() with a reader that a hostile file has taken over, and with models that consist of several files.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

#include "spm/model.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/import_channel.hpp"
#include "tests/spm/importer/names_file_and_reason.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::NamesFileAndReason;
using test_support::write_bytes;
using testing::HasSubstr;
using testing::StartsWith;

class ConfinedImport : public testing::Test {
 protected:
  void TearDown() override { unsetenv("TACTUS_IMPORT"); }

  [[nodiscard]] std::filesystem::path path(const std::string& name) const { return folder_.path() / name; }

  [[nodiscard]] static std::string import_error(const std::filesystem::path& model) {
    try {
      (void)import_mesh(model);
    } catch (const ModelError& error) {
      return error.what();
    }
    return "no error";
  }

  /// Returns the error for a model, if a hostile file has taken over its reader, which then does `behavior`.
  [[nodiscard]] std::string error_of_reader(const std::string& behavior) const {
    setenv("TACTUS_IMPORT", TACTUS_SPM_HOSTILE_READER, 1);
    write_bytes(path(behavior + ".obj"), "v 0 0 0\n");
    const std::string error = import_error(path(behavior + ".obj"));
    EXPECT_THAT(error, StartsWith(path(behavior + ".obj").string() + ": "));
    return error;
  }

  test_support::TemporaryFolder folder_;
};

TEST_F(ConfinedImport, NamesTheFileIfTheReaderCrashes) {
  EXPECT_THAT(error_of_reader("crash"), HasSubstr("the reader crashed (Segmentation fault), so the file is damaged"));
  EXPECT_THAT(error_of_reader("abort"), HasSubstr("the reader crashed (Aborted)"));
  EXPECT_THAT(error_of_reader("status"), HasSubstr("ended with status 7"));
  EXPECT_THAT(error_of_reader("killed"), HasSubstr("too little memory")) << "as the system does";
}

TEST_F(ConfinedImport, AcceptsOnlyAValidMesh) {
  for (const char* behavior : {"short", "huge", "overflow", "index", "long_message", "nothing"})
    EXPECT_THAT(error_of_reader(behavior), HasSubstr("returned no valid mesh")) << behavior;
}

TEST_F(ConfinedImport, PrintsAMessageOfTheReaderAsOneLineOfText) {
  EXPECT_EQ(error_of_reader("message"), path("message.obj").string() + ":  [2Jall  is   well ");
}

TEST_F(ConfinedImport, AddsAReasonToAMessageOfTheReaderThatHasNone) {
  for (const char* behavior : {"only_name", "only_spaces"})
    EXPECT_THAT(error_of_reader(behavior), HasSubstr("returned neither a mesh nor a reason")) << behavior;
}

TEST(ImportLimits, GrowWithTheSizeOfTheFiles) {
  using import_channel::limits_for;
  EXPECT_EQ(limits_for(0).memory_bytes, std::uint64_t{1} << 30);
  EXPECT_EQ(limits_for(1000).memory_bytes, (std::uint64_t{1} << 30) + 64'000);
  EXPECT_EQ(limits_for(0).computing_s, 10u);
  EXPECT_EQ(limits_for(1'999'999).computing_s, 10u);
  EXPECT_EQ(limits_for(2'000'000).computing_s, 11u);
  EXPECT_EQ(limits_for(2'000'000'000).computing_s, 1010u);
  EXPECT_EQ(limits_for(0).elapsed_s, 100u);
  EXPECT_EQ(limits_for(2'000'000'000).elapsed_s, 10'100u);
}

TEST_F(ConfinedImport, EndsAReaderThatRequestsTooManyFiles) {
  EXPECT_THAT(error_of_reader("ask"), HasSubstr("requests more than 1000 files"));
}

TEST_F(ConfinedImport, LimitsTheComputingTimeOfAReaderThatNoLongerCommunicates) {
  for (const char* behavior : {"close", "empty_request", "no_answers"})
    EXPECT_THAT(error_of_reader(behavior), HasSubstr("takes more than 10 s of computing time")) << behavior;
}

TEST_F(ConfinedImport, LimitsTheMemoryOfTheResult) {
  EXPECT_THAT(error_of_reader("flood"), HasSubstr("needs more than 1024 MiB of memory"));
}

TEST_F(ConfinedImport, LimitsTheComputingTime) {
  EXPECT_THAT(error_of_reader("compute"), HasSubstr("takes more than 10 s of computing time"));
}

// The sanitizers reserve terabytes of addresses, so their reader has no limit.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_F(ConfinedImport, LimitsTheMemoryOfTheReader) {
  EXPECT_THAT(error_of_reader("allocate"), HasSubstr("needs more than 1024 MiB of memory"));
}

TEST_F(ConfinedImport, TheReaderHasMoreMemoryForALargerFile) {
  constexpr std::uint64_t kBytes = 4u << 20;  // of a file with a hole
  const auto reserved_mib = [&] {
    const std::string error = import_error(path("reserve.obj"));
    return std::atoi(error.substr(error.rfind(' ') + 1).c_str());
  };
  setenv("TACTUS_IMPORT", TACTUS_SPM_HOSTILE_READER, 1);
  write_bytes(path("reserve.obj"), "v 0 0 0\n");
  const int small = reserved_mib();
  EXPECT_THAT(small, testing::AllOf(testing::Gt(900), testing::Le(1024)));
  std::filesystem::resize_file(path("reserve.obj"), kBytes);
  EXPECT_THAT(reserved_mib() - small, testing::AllOf(testing::Ge(64 * 4 - 1), testing::Le(64 * 4 + 1)));
}
#endif

TEST_F(ConfinedImport, AKilledProgramLeavesNoReader) {
  setenv("TACTUS_IMPORT", TACTUS_SPM_HOSTILE_READER, 1);
  const std::filesystem::path model = path("compute.obj");
  write_bytes(model, "v 0 0 0\n");
  const auto readers = [&] {
    int count = 0;
    for (const auto& process : std::filesystem::directory_iterator{"/proc"}) {
      const std::string command = test_support::read_bytes(process.path() / "cmdline");
      count += command.find("tactus-import") == 0 && command.find(model.string()) != std::string::npos;
    }
    return count;
  };
  const auto becomes = [&](int expected) {
    // Nothing notifies of a process that starts or ends without being a child of this one.
    for (int i = 0; i < 500; ++i, std::this_thread::sleep_for(std::chrono::milliseconds{10}))
      if (readers() == expected) return true;
    return false;
  };
  const pid_t program = fork();
  if (program == 0) {
    (void)import_error(model);
    _exit(0);
  }
  EXPECT_TRUE(becomes(1));
  kill(program, SIGKILL);
  waitpid(program, nullptr, 0);
  EXPECT_TRUE(becomes(0));
}

/// A glTF file whose buffer, one triangle, is the file `uri`.
std::string gltf_with_buffer(const std::string& uri) {
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
    "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
    "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":")" +
         uri + "\"}]}";
}

std::string triangle_bytes() {
  const float corners[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  return {reinterpret_cast<const char*>(corners), sizeof corners};
}

TEST_F(ConfinedImport, ReadsOtherFilesInTheFolderOfTheModel) {
  std::filesystem::create_directory(path("parts"));
  write_bytes(path("triangle.bin"), triangle_bytes());
  write_bytes(path("parts/triangle.bin"), triangle_bytes());
  for (const char* uri : {"triangle.bin", "parts/triangle.bin"}) {
    write_bytes(path("model.gltf"), gltf_with_buffer(uri));
    EXPECT_EQ(import_mesh(path("model.gltf")).faces.size(), 1u) << uri;
  }
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(folder_.path());
  EXPECT_EQ(import_mesh("model.gltf").faces.size(), 1u);
  std::filesystem::current_path(before);
}

TEST_F(ConfinedImport, ReadsAModelInAProcessThatIgnoresItsChildren) {
  write_bytes(path("triangle.bin"), triangle_bytes());
  write_bytes(path("model.gltf"), gltf_with_buffer("triangle.bin"));
  const auto before = ::signal(SIGCHLD, SIG_IGN);
  EXPECT_EQ(import_mesh(path("model.gltf")).faces.size(), 1u);
  EXPECT_EQ(::signal(SIGCHLD, before), SIG_IGN) << "as before the import";
}

TEST_F(ConfinedImport, ReadsNoFileOutsideTheFolderOfTheModel) {
  write_bytes(path("secret.bin"), triangle_bytes());
  std::filesystem::create_directory(path("models"));
  std::filesystem::create_symlink(path("secret.bin"), path("models/link.bin"));
  for (const std::string& uri : {std::string{"../secret.bin"}, path("secret.bin").string(), std::string{"link.bin"}}) {
    write_bytes(path("models/model.gltf"), gltf_with_buffer(uri));
    EXPECT_THAT(import_error(path("models/model.gltf")), HasSubstr("cannot be read as a model")) << uri;
  }
}

TEST_F(ConfinedImport, DoesNotWaitForAFileThatIsNoRegularFile) {
  ASSERT_EQ(mkfifo(path("pipe.bin").c_str(), 0600), 0);
  write_bytes(path("model.gltf"), gltf_with_buffer("pipe.bin"));
  EXPECT_THAT(import_error(path("model.gltf")), HasSubstr("cannot be read as a model"));
}

TEST_F(ConfinedImport, EndsWithAMeshOrAMessageForEachInvalidModelOfAssimp) {
  const std::filesystem::path models = "/usr/share/assimp/models/invalid";
  // scripts/test installs the models; a build by hand may lack them.
  if (!std::filesystem::exists(models)) GTEST_SKIP() << "no " << models << "; it is in the package assimp-testmodels";
  int count = 0;
  for (const auto& file : std::filesystem::directory_iterator{models}) {
    const std::string error = import_error(file.path());
    EXPECT_THAT(error, testing::AnyOf("no error", NamesFileAndReason(file.path().string())));
    ++count;
  }
  EXPECT_GT(count, 5);
}

}  // namespace
}  // namespace tactus::spm::offline
