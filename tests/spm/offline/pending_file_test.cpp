#include "spm/offline/pending_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/model_file.hpp"
#include "spm/offline/write_mesh.hpp"
#include "tests/support/file_size_limit.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::read_bytes;
using test_support::write_bytes;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class PendingFileTest : public ::testing::Test {
 protected:
  std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& entry : std::filesystem::directory_iterator{folder_.path()})
      all.push_back(entry.path().filename().string());
    return all;
  }
  /// Calls `write` with a file size limit of 1000 bytes. Returns its error message, or an empty string if it succeeds.
  template <class Write>
  static std::string error_of(Write write) {
    const test_support::FileSizeLimit limit{1000};
    try {
      write();
    } catch (const ModelError& error) {
      return error.what();
    }
    return {};
  }

  test_support::TemporaryFolder folder_;
};

TEST_F(PendingFileTest, ReplacesTheOldFileOnlyAtCommit) {
  const std::filesystem::path path = folder_.path() / "file";
  write_bytes(path, "old");
  {
    PendingFile file{path};
    file.write("new", 3);
    EXPECT_EQ(read_bytes(path), "old");
    file.commit();
    EXPECT_EQ(read_bytes(path), "new");
  }
  EXPECT_THAT(names(), ElementsAre("file"));
}

TEST_F(PendingFileTest, LeavesNoFileWithoutACommit) {
  {
    PendingFile file{folder_.path() / "file"};
    file.write("new", 3);
    EXPECT_EQ(file.written(), 3u);
  }
  EXPECT_THAT(names(), IsEmpty());
}

TEST_F(PendingFileTest, RefusesWhatIsNoRegularFileAndLeavesIt) {
  const std::filesystem::path pipe = folder_.path() / "pipe", link = folder_.path() / "link";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  std::filesystem::create_symlink("pipe", link);
  for (const std::filesystem::path& path : {pipe, link, folder_.path()})
    EXPECT_THAT([&] { const PendingFile file{path}; },
                testing::ThrowsMessage<ModelError>(HasSubstr(path.string() + ": cannot be written: found no regular")));
  EXPECT_TRUE(std::filesystem::is_fifo(pipe));
}

TEST_F(PendingFileTest, WritesTheFileToWhichALinkLeads) {
  const std::filesystem::path link = folder_.path() / "current";
  std::filesystem::create_directory(folder_.path() / "versions");
  std::filesystem::create_symlink("versions/v3", link);
  for (const std::string text : {"new", "next"}) {  // without the file of the link, and with it
    PendingFile file{link};
    file.write(text.data(), text.size());
    file.commit();
    EXPECT_TRUE(std::filesystem::is_symlink(link));
    EXPECT_EQ(read_bytes(folder_.path() / "versions/v3"), text);
  }
  std::filesystem::create_symlink("loop", folder_.path() / "loop");
  EXPECT_THROW(PendingFile{folder_.path() / "loop"}, ModelError);
}

TEST_F(PendingFileTest, KeepsThePermissionsOfAReplacedFileAndOtherwiseFollowsTheMask) {
  using std::filesystem::perms;
  const std::filesystem::path path = folder_.path() / "file";
  const auto written_perms = [&] {
    PendingFile file{path};
    file.write("new", 3);
    file.commit();
    return std::filesystem::status(path).permissions();
  };
  const mode_t before = ::umask(0027);
  EXPECT_EQ(written_perms(), perms{0640});
  for (const perms kept : {perms{0600}, perms{0666}}) {
    std::filesystem::permissions(path, kept);
    EXPECT_EQ(written_perms(), kept);
  }
  EXPECT_EQ(::umask(before), 0027u);
}

TEST_F(PendingFileTest, AMeshThatDoesNotFitOnTheDiskDoesNotChangeTheOldFile) {
  const TriangleMesh mesh = generate(Shape::kSphere, 1000);
  for (const std::string name : {"mesh.ply", "mesh.obj", "mesh.stl"}) {
    const std::filesystem::path path = folder_.path() / name;
    write_bytes(path, "old");
    EXPECT_THAT(error_of([&] { write_mesh(path, mesh); }), HasSubstr(name + ": cannot be written: File too large"));
    EXPECT_EQ(read_bytes(path), "old");
    EXPECT_THAT(names(), ElementsAre(name));
    std::filesystem::remove(path);
  }
}

TEST_F(PendingFileTest, AModelThatDoesNotFitOnTheDiskDoesNotChangeTheOldFile) {
  const BuiltModel built = build_model(generate(Shape::kSphere, 1000));
  const std::filesystem::path path = folder_.path() / "model.spm";
  write_bytes(path, "old");
  EXPECT_THAT(error_of([&] { write_model(path, built.model(), {}); }), HasSubstr("model.spm: cannot be written: File"));
  EXPECT_EQ(read_bytes(path), "old");
  EXPECT_THAT(names(), ElementsAre("model.spm"));
}

}  // namespace
}  // namespace tactus::spm::offline
