#include "trace/private_file.hpp"

#include <gtest/gtest.h>

#include <cerrno>

#include "tests/support/file_size_limit.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::trace {
namespace {

using test_support::read_bytes;

class PrivateFileTest : public testing::Test {
 protected:
  test_support::TemporaryFolder folder_;
  const std::filesystem::path path_ = folder_.path() / "file";
  const std::filesystem::path unfinished_ = folder_.path() / "file.part";
};

TEST_F(PrivateFileTest, ReplacesTheOldFileOnlyAtCommitAndThenOnlyItsOwnerCanReadIt) {
  test_support::write_bytes(path_, "old");
  std::filesystem::permissions(path_, std::filesystem::perms{0644});
  PrivateFile file{path_};
  ASSERT_NE(file.get(), nullptr);
  std::fputs("new", file.get());
  EXPECT_EQ(read_bytes(path_), "old");
  EXPECT_TRUE(file.commit());
  EXPECT_EQ(read_bytes(path_), "new");
  EXPECT_EQ(std::filesystem::status(path_).permissions(), std::filesystem::perms{0600});
  EXPECT_FALSE(std::filesystem::exists(unfinished_));
}

TEST_F(PrivateFileTest, LeavesNoFileWithoutACommit) {
  {
    const PrivateFile file{path_};
    std::fputs("new", file.get());
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(PrivateFileTest, LeavesNoFileOnAFullDisk) {
  {
    PrivateFile file{path_};
    const test_support::FileSizeLimit limit{100};
    const std::string text(200, 'x');
    std::fputs(text.c_str(), file.get());
    EXPECT_FALSE(file.commit());
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(PrivateFileTest, StatesWhyAFileCannotBeOpened) {
  const PrivateFile file{folder_.path() / "none" / "file"};
  EXPECT_EQ(errno, ENOENT);
  EXPECT_EQ(file.get(), nullptr);
}

TEST_F(PrivateFileTest, WritesThroughALink) {
  std::filesystem::create_symlink("other", path_);
  PrivateFile file{path_};
  std::fputs("new", file.get());
  EXPECT_TRUE(file.commit());
  EXPECT_TRUE(std::filesystem::is_symlink(path_));
  EXPECT_EQ(read_bytes(folder_.path() / "other"), "new");
}

}  // namespace
}  // namespace tactus::trace
