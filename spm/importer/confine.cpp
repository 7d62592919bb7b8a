#include "spm/importer/confine.hpp"

#include <fcntl.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <initializer_list>
#include <memory>
#include <system_error>

namespace tactus::spm::importer {
namespace {

/// Throws if `error`, a number of errno, is not 0.
void require_no_error(int error, const char* what) {
  if (error != 0) throw std::system_error{error, std::generic_category(), what};
}

/// The system calls of a confined process.
class Filter {
 public:
  Filter() : context_{seccomp_init(SCMP_ACT_ERRNO(EPERM)), seccomp_release} {
    require_no_error(context_ == nullptr ? ENOMEM : 0, "seccomp_init");
  }
  void allow(std::initializer_list<int> calls) {
    for (const int call : calls) add(call, {});
  }
  void allow_if(int call, scmp_arg_cmp condition) { add(call, {condition}); }
  void load() { require_no_error(-seccomp_load(context_.get()), "seccomp_load"); }

 private:
  void add(int call, std::initializer_list<scmp_arg_cmp> conditions) {
    require_no_error(-seccomp_rule_add_array(context_.get(), SCMP_ACT_ALLOW, call,
                                             static_cast<unsigned>(conditions.size()), conditions.begin()),
                     "seccomp_rule_add");
  }

  std::unique_ptr<void, void (*)(scmp_filter_ctx)> context_;
};

}  // namespace

void confine() {
  require_no_error(prctl(PR_SET_PDEATHSIG, SIGKILL) == 0 ? 0 : errno, "prctl(PR_SET_PDEATHSIG)");
  // No core dumps, and no debugger of the same user.
  require_no_error(prctl(PR_SET_DUMPABLE, 0) == 0 ? 0 : errno, "prctl(PR_SET_DUMPABLE)");

  Filter filter;
  filter.allow({SCMP_SYS(read), SCMP_SYS(pread64), SCMP_SYS(readv), SCMP_SYS(lseek), SCMP_SYS(write), SCMP_SYS(writev),
                SCMP_SYS(close), SCMP_SYS(fstat), SCMP_SYS(sendto), SCMP_SYS(sendmsg), SCMP_SYS(recvfrom),
                SCMP_SYS(recvmsg)});
  filter.allow_if(SCMP_SYS(fcntl), SCMP_A1(SCMP_CMP_EQ, F_GETFL));  // fdopen()
  filter.allow({SCMP_SYS(brk), SCMP_SYS(munmap), SCMP_SYS(mremap), SCMP_SYS(madvise)});
  for (const int call : {SCMP_SYS(mmap), SCMP_SYS(mprotect)})
    filter.allow_if(call, SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0));
  filter.allow({SCMP_SYS(futex), SCMP_SYS(sched_yield), SCMP_SYS(getrandom), SCMP_SYS(clock_gettime), SCMP_SYS(getpid),
                SCMP_SYS(gettid), SCMP_SYS(rt_sigaction), SCMP_SYS(rt_sigprocmask), SCMP_SYS(rt_sigreturn),
                SCMP_SYS(sigaltstack), SCMP_SYS(exit), SCMP_SYS(exit_group)});
  // abort() signals its own process.
  filter.allow_if(SCMP_SYS(tgkill), SCMP_A0(SCMP_CMP_EQ, static_cast<scmp_datum_t>(getpid())));
#ifdef TACTUS_SANITIZED  // a sanitizer tests by a pipe whether memory can be read
  filter.allow({SCMP_SYS(pipe), SCMP_SYS(pipe2), SCMP_SYS(readlink)});
#endif
  filter.load();
}

}  // namespace tactus::spm::importer
