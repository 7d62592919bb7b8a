#include <gmock/gmock.h>

#include <cstdlib>

#include "latency/carrier.hpp"
#include "tests/support/file_size_limit.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::latency {
namespace {

TEST(JoinSession, ReportsProfilesThatDoNotFitOnTheDiskAndLeavesNoFile) {
  const test_support::TemporaryFolder folder;
  ::setenv("TMPDIR", folder.path().c_str(), 1);
  TestCase test;
  test.profile = Profile::kPlain;
  std::string message;
  {
    const test_support::FileSizeLimit limit{100};
    try {
      (void)join_session(test, {});
    } catch (const std::exception& error) {
      message = error.what();
    }
  }
  ::unsetenv("TMPDIR");
  EXPECT_THAT(message, testing::HasSubstr("/session.xml: cannot be written"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace tactus::latency
