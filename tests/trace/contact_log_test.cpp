#include "trace/contact_log.hpp"

#include <gtest/gtest.h>

#include "tests/support/temporary_folder.hpp"

namespace tactus::trace {
namespace {

TEST(ContactLog, TheCloseReportsAFullDisk) {
  ContactLogWriter writer{"/dev/full"};
  writer.write(LoggedTotals{0, 500, 100, 5, 1});
  ASSERT_TRUE(writer.healthy()) << "expected that the entry is still in the buffer";
  EXPECT_FALSE(writer.close());
  EXPECT_FALSE(writer.healthy());
}

TEST(ContactLog, AClosedFileHasAllEntries) {
  const test_support::TemporaryFolder folder;
  ContactLogWriter writer{folder.path() / "a.hlog"};
  writer.write(LoggedTotals{3, 500, 100, 5, 1});
  EXPECT_TRUE(writer.close());
  ContactLogReader reader{folder.path() / "a.hlog"};
  ASSERT_EQ(reader.next(), ContactLogReader::Entry::kTotals);
  EXPECT_EQ(reader.totals.object, 3u);
  EXPECT_EQ(reader.next(), ContactLogReader::Entry::kEnd);
}

}  // namespace
}  // namespace tactus::trace
