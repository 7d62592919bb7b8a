#include "hrtc_service/servo/shared_block.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <stdexcept>

namespace tactus::hrtc_service {
namespace {

TEST(SharedBlock, IsTheSameMemoryForAnotherProcess) {
  const SharedBlock block = SharedBlock::create(true);
  ASSERT_NE(block.log(), nullptr);
  RingReader<trace::LoggedQuery, ContactQuery::kLogEntries> queries{*block.log()};
  const int descriptor = ::dup(block.memory().descriptor());
  const pid_t child = ::fork();
  if (child == 0) {  // without gtest, which would report twice
    const SharedBlock opened = SharedBlock::open(descriptor);
    opened.link().set_stop({true, 5});
    trace::LoggedQuery query{};
    query.time_ns = 7;
    const bool is_logged = opened.log() != nullptr && RingWriter{*opened.log()}.push(query);
    ::_exit(is_logged && opened.servo() == ::getppid() ? 0 : 1);
  }
  ::close(descriptor);
  int status = -1;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  EXPECT_TRUE(block.link().stop().stopped);
  EXPECT_EQ(block.link().stop().resets, 5u);
  trace::LoggedQuery query;
  ASSERT_TRUE(queries.pop(query));
  EXPECT_EQ(query.time_ns, 7);
}

TEST(SharedBlock, HasNoRingOfQueriesWithoutAContactLog) {
  const SharedBlock block = SharedBlock::create(false);
  EXPECT_EQ(block.log(), nullptr);
  const SharedBlock opened = SharedBlock::open(::dup(block.memory().descriptor()));
  EXPECT_EQ(opened.log(), nullptr);
  EXPECT_EQ(opened.memory().bytes(), block.memory().bytes());
  EXPECT_LT(opened.memory().bytes(), sizeof(ServoLink) + 4096);
}

TEST(SharedBlock, CannotBecomeShorterUnderTheServo) {
  const SharedBlock block = SharedBlock::create(false);
  EXPECT_EQ(::ftruncate(block.memory().descriptor(), 1), -1);
  EXPECT_EQ(errno, EPERM);
}

TEST(SharedBlock, IsRefusedIfItIsNoneOrOfAnotherBuild) {
  EXPECT_THROW((void)SharedBlock::open(-1), std::runtime_error);
  EXPECT_THROW((void)SharedBlock::open(::open("/dev/null", O_RDWR | O_CLOEXEC)), std::runtime_error);
  EXPECT_THROW((void)SharedBlock::open(::memfd_create("empty", MFD_CLOEXEC | MFD_ALLOW_SEALING)), std::runtime_error);
  const SharedBlock block = SharedBlock::create(false);
  ASSERT_EQ(::pwrite(block.memory().descriptor(), "another", 7, 0), 7);
  try {
    (void)SharedBlock::open(::dup(block.memory().descriptor()));
    FAIL() << "a block of another build";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("another build"));
  }
}

}  // namespace
}  // namespace tactus::hrtc_service
