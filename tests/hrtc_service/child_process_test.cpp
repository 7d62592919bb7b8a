#include "realtime/child_process.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>

namespace tactus::realtime {
namespace {

constexpr int kCannot = 10, kCan = 11, kNoLandlock = 12;

/// Forks a child that tries to open the memory of this process for writing. Returns kCan, kCannot or kNoLandlock.
int opens_parent(bool is_forbidden) {
  ::prctl(PR_SET_PTRACER, PR_SET_PTRACER_ANY);  // kernel.yama.ptrace_scope may forbid it otherwise
  const pid_t parent = ::getpid(), child = ::fork();
  if (child == 0) {  // without gtest, which would report twice
    if (is_forbidden && !forbid_debugging_others()) ::_exit(kNoLandlock);
    ::_exit(::open(("/proc/" + std::to_string(parent) + "/mem").c_str(), O_RDWR | O_CLOEXEC) >= 0 ? kCan : kCannot);
  }
  int status = 0;
  return ::waitpid(child, &status, 0) == child && WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(ChildProcess, CannotChangeTheMemoryOfItsParentIfThatIsForbidden) {
  ASSERT_EQ(opens_parent(false), kCan);
  const int result = opens_parent(true);
  if (result == kNoLandlock) GTEST_SKIP() << "the kernel has no Landlock";
  EXPECT_EQ(result, kCannot);
}

TEST(ChildProcess, TheTextOfItsEndNamesTheSignal) {
  EXPECT_EQ(text_of_end(SIGSEGV), "was killed by SIGSEGV");
  EXPECT_EQ(text_of_end(0x100), "has failed");
  EXPECT_EQ(text_of_end(0), "has ended");
}

}  // namespace
}  // namespace tactus::realtime
