/// Restricts a thread to one system call by a seccomp filter, and counts the other system calls that it attempts.
///
/// A call that is not allowed fails with ENOSYS. The filter stays until the thread ends. At its end, a thread calls
/// rt_sigprocmask, madvise, munmap and exit. The filter counts the first three as attempts too, because a `free` makes
/// them, and lets them seem to succeed: signals stay enabled and memory stays mapped. So read the attempts before the
/// thread ends. Allowed are exit and the call that ends a signal handler (rt_sigreturn). Only for Linux on x86-64.
/// Source: seccomp(2), SECCOMP_RET_TRAP.
#pragma once

#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <ucontext.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <map>
#include <system_error>

namespace tactus::test_support {

class SystemCalls {
 public:
  /// From now on the calling thread may only make the system call with number `allowed`. Call it once per thread.
  /// Throws std::system_error if the kernel refuses the filter.
  static void allow_only(std::uint32_t allowed) {
    struct sigaction action {};
    action.sa_sigaction = count_blocked_call;
    action.sa_flags = SA_SIGINFO;
    if (sigaction(SIGSYS, &action, nullptr) != 0) fail("sigaction");
    constexpr std::uint32_t kLoad = BPF_LD | BPF_W | BPF_ABS, kEqual = BPF_JMP | BPF_JEQ | BPF_K;
    const std::array<sock_filter, 6> filter{{
        BPF_STMT(kLoad, offsetof(seccomp_data, nr)),
        BPF_JUMP(kEqual, allowed, 3, 0),
        BPF_JUMP(kEqual, SYS_rt_sigreturn, 2, 0),
        BPF_JUMP(kEqual, SYS_exit, 1, 0),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRAP),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    }};
    const sock_fprog program{filter.size(), const_cast<sock_filter*>(filter.data())};
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) fail("prctl no_new_privs");
    if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0) fail("prctl seccomp");
  }

  /// Number of attempts of each blocked call, by call number, in all filtered threads since `clear`.
  [[nodiscard]] static std::map<long, std::uint64_t> attempts() {
    std::map<long, std::uint64_t> calls;
    for (std::size_t number = 0; number < counts_.size(); ++number)
      if (counts_[number] > 0) calls[static_cast<long>(number)] = counts_[number];
    return calls;
  }
  static void clear() {
    for (std::atomic<std::uint64_t>& count : counts_) count = 0;
  }

 private:
  [[noreturn]] static void fail(const char* function) {
    throw std::system_error{errno, std::generic_category(), function};
  }
  static void count_blocked_call(int, siginfo_t* info, void* context) {
    const long number = info->si_syscall;
    ++counts_[static_cast<std::size_t>(number) % counts_.size()];
    const bool ends_thread = number == SYS_rt_sigprocmask || number == SYS_madvise || number == SYS_munmap;
    static_cast<ucontext_t*>(context)->uc_mcontext.gregs[REG_RAX] = ends_thread ? 0 : -ENOSYS;
  }

  static inline std::array<std::atomic<std::uint64_t>, 1024> counts_{};
};

}  // namespace tactus::test_support
