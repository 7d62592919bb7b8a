#include "yaml/reader.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temporary_folder.hpp"

namespace tactus::yaml {
namespace {

using ::testing::HasSubstr;

class ReaderTest : public ::testing::Test {
 protected:
  test_support::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "a.yaml";
};

template <class Read>
std::string error_of(Read read) {
  try {
    read();
  } catch (const YamlError& error) {
    return error.what();
  }
  return "none";
}

TEST_F(ReaderTest, AnEmptyFileIsAnEmptyMap) {
  test_support::write_bytes(file_, "");
  EXPECT_EQ(error_of([&] { static_cast<void>(Map(Value::load(file_), {"key"}).required("key")); }),
            file_.string() + ":1:1: key 'key' is missing");
}

TEST_F(ReaderTest, AnErrorDistinguishesAnEmptyListFromAList) {
  EXPECT_EQ(error_of([] { (void)Value::parse("[]", "s").items("objects"); }),
            "s:1:1: found an empty list, expected a list of objects");
  EXPECT_EQ(error_of([] { (void)Value::parse("[1]", "s").number(0, 1); }),
            "s:1:1: found a list, expected a number from 0 to 1");
}

TEST_F(ReaderTest, ReadsAllBytesOfAFile) {
  const std::string text = "key: " + std::string(100'000, 'x') + '\n';
  test_support::write_bytes(file_, text);
  EXPECT_EQ(file_text(file_), text);
}

TEST_F(ReaderTest, AnErrorStatesWhyAFileCannotBeRead) {
  EXPECT_THAT(error_of([&] { (void)Value::load(file_); }), HasSubstr("cannot be read: No such file or directory"));
  EXPECT_THAT(error_of([&] { (void)Value::load(folder_.path()); }), HasSubstr("cannot be read: Is a directory"));
}

}  // namespace
}  // namespace tactus::yaml
