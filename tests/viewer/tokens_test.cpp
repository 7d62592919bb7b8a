#include "viewer/tokens.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <stdexcept>

#include "tests/support/temporary_folder.hpp"

namespace tactus::viewer {
namespace {

using testing::HasSubstr;

class TokensTest : public testing::Test {
 protected:
  /// Writes the file, which only its owner can read. Returns the error, or an empty text.
  std::string error_of(const std::string& text, mode_t mode = 0600) {
    test_support::write_bytes(file_, text);
    EXPECT_EQ(chmod(file_.c_str(), mode), 0);
    try {
      (void)kept_tokens(file_);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return {};
  }

  const test_support::TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_.path() / "tokens";
  const std::string control_ = std::string(32, 'c'), observer_ = std::string(32, '0');
};

TEST_F(TokensTest, AreNeverTheSame) {
  const Tokens one = make_tokens(), other = make_tokens();
  EXPECT_EQ(one.control.size(), 32u);
  EXPECT_NE(one.control, one.observer);
  EXPECT_NE(one.control, other.control);
}

TEST_F(TokensTest, AreKeptInAFileThatOnlyItsOwnerCanRead) {
  const Tokens first = kept_tokens(file_), again = kept_tokens(file_);
  EXPECT_EQ(first.control, again.control);
  EXPECT_EQ(first.observer, again.observer);
  struct stat status {};
  ASSERT_EQ(stat(file_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
}

TEST_F(TokensTest, OfAFileAreThoseThatItNames) {
  ASSERT_EQ(error_of("control " + control_ + "\nobserver " + observer_ + "\n"), "");
  EXPECT_EQ(kept_tokens(file_).control, control_);
  EXPECT_EQ(kept_tokens(file_).observer, observer_);
}

TEST_F(TokensTest, OfAFileThatOthersCanReadAreRefused) {
  const std::string text = "control " + control_ + "\nobserver " + observer_ + "\n";
  EXPECT_THAT(error_of(text, 0640), HasSubstr("expected mode 0600"));
  EXPECT_THAT(error_of(text, 0604), HasSubstr("expected mode 0600"));
}

TEST_F(TokensTest, OfAWrongFileAreRefusedWithItsName) {
  for (const std::string& text :
       {std::string{}, "control " + control_ + "\n", "observer " + observer_ + "\ncontrol " + control_ + "\n",
        "control " + control_ + "\nobserver " + observer_, "control " + control_ + "\nobserver " + control_ + "\n",
        "control " + control_ + "\nobserver " + observer_ + "\nmore\n",
        "control " + std::string(32, 'x') + "\nobserver " + observer_ + "\n", std::string{"control c\nobserver 0\n"},
        std::string(1000, 'c')}) {
    EXPECT_THAT(error_of(text), HasSubstr(file_.string() + ": expected two lines")) << text;
  }
}

TEST_F(TokensTest, WithoutAFolderForTheFileAreAnError) {
  EXPECT_THROW((void)kept_tokens(folder_.path() / "absent" / "tokens"), std::runtime_error);
}

}  // namespace
}  // namespace tactus::viewer
