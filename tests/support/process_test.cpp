#include "tests/support/process.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace tactus::e2e {
namespace {

constexpr const char* kShell = "/bin/sh";

int open_descriptors() {
  int open = 0;
  for (int descriptor = 0; descriptor < 256; ++descriptor) open += ::fcntl(descriptor, F_GETFD) >= 0 ? 1 : 0;
  return open;
}

TEST(Process, NoOtherProcessGetsTheIdOfAnEndedProgramBeforeTheDestructor) {
  pid_t id = 0;
  {
    Process program{{kShell, "-c", "exit 3"}};
    id = program.pid();
    ASSERT_EQ(program.wait(), 3);
    EXPECT_EQ(::kill(id, 0), 0);
    EXPECT_TRUE(program.left_nothing_running());
  }
  EXPECT_EQ(::kill(id, 0), -1);
  EXPECT_EQ(errno, ESRCH);
}

TEST(Process, ReportsAndKillsAProcessThatTheProgramLeavesRunning) {
  std::string output;
  {
    Process program{{kShell, "-c", "sleep 1000 >/dev/null 2>&1 & echo $!"}};
    ASSERT_EQ(program.wait(), 0);
    EXPECT_FALSE(program.left_nothing_running());
    output = program.output();
  }
  const pid_t left = std::stoi(output);
  while (::kill(left, 0) == 0 && ::access(("/proc/" + std::to_string(left) + "/exe").c_str(), F_OK) == 0) {
  }  // ctest's timeout fails the test if the process stays
}

TEST(Process, ASignalAfterTheEndOfTheProgramChangesNothing) {
  Process program{{kShell, "-c", "exit 3"}};
  ASSERT_EQ(program.wait(), 3);
  program.signal(SIGKILL);
  EXPECT_EQ(program.wait(), 3);
}

/// Exits with the number of descriptors that a refused process leaves open, or with 10 or more if none was refused.
[[noreturn]] void start_where_the_system_refuses_a_process() {
  constexpr uid_t kNobody = 65534;  // root has no limit
  const rlimit none{0, 0};
  if (::getuid() == 0 && ::setresuid(kNobody, kNobody, kNobody) != 0) ::_exit(10);
  if (::setrlimit(RLIMIT_NPROC, &none) != 0) ::_exit(11);
  const int before = open_descriptors();
  try {
    const Process program{{kShell, "-c", "exit 3"}};
  } catch (const std::system_error& error) {
    ::_exit(error.code().value() == EAGAIN ? open_descriptors() - before : 12);
  }
  ::_exit(13);
}

TEST(Process, LeavesNoDescriptorOpenWhenTheSystemRefusesAProcess) {
  // In a process of its own, because the limit would also affect other tests.
  EXPECT_EXIT(start_where_the_system_refuses_a_process(), testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace tactus::e2e
