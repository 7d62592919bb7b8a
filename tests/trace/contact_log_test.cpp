#include "trace/contact_log.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

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

TEST(ContactLog, AFlushedEntryRemainsIfTheProgramIsKilled) {
  const test_support::TemporaryFolder folder;
  ContactLogWriter writer{folder.path() / "a.hlog"};
  writer.write(LoggedTotals{3, 500, 100, 5, 1});
  writer.flush();
  ContactLogReader reader{folder.path() / "a.hlog"};  // reads what a kill would leave
  EXPECT_EQ(reader.next(), ContactLogReader::Entry::kTotals);
}

TEST(ContactLog, AFlushReportsAFullDisk) {
  ContactLogWriter writer{"/dev/full"};
  writer.write(LoggedTotals{0, 500, 100, 5, 1});
  writer.flush();
  EXPECT_FALSE(writer.healthy());
}

TEST(ContactLog, OnlyItsOwnerCanReadItAlsoIfItReplacesAnother) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path log = folder.path() / "a.hlog";
  std::ofstream{log} << "an earlier log that everybody can read";
  std::filesystem::permissions(log, std::filesystem::perms{0644});
  ContactLogWriter writer{log};
  EXPECT_TRUE(writer.close());
  EXPECT_EQ(status(log).permissions(), std::filesystem::perms{0600});
}

}  // namespace
}  // namespace tactus::trace
