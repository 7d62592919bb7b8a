#include "spm/importer/confine.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace tactus::spm::importer {
namespace {

struct Attempt {
  std::string what;
  std::function<long()> call;  // negative: refused
};

/// Makes all attempts in a process, after `prepare`. Returns which of them were refused with EPERM.
std::vector<std::string> refused_after(const std::function<void()>& prepare, const std::vector<Attempt>& attempts) {
  const std::size_t size = attempts.size();
  auto* const refused =
      static_cast<bool*>(mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0));
  const pid_t child = fork();
  if (child == 0) {
    prepare();
    for (std::size_t i = 0; i < size; ++i) {
      errno = 0;
      refused[i] = attempts[i].call() < 0 && errno == EPERM;
    }
    _exit(0);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << "status " << status;
  std::vector<std::string> result;
  for (std::size_t i = 0; i < size; ++i)
    if (refused[i]) result.push_back(attempts[i].what);
  munmap(refused, size);
  return result;
}

std::vector<Attempt> attempts() {
  return {
      {"open a file", [] { return long{open("/etc/hostname", O_RDONLY)}; }},
      {"write a file", [] { return long{open("/tmp/tactus-confined", O_WRONLY | O_CREAT, 0600)}; }},
      {"look for a file",
       [] {
         struct stat status {};
         return long{stat("/etc/hostname", &status)};
       }},
      {"look for a file in another way",
       [] {
         struct stat status {};
         return long{fstatat(AT_FDCWD, "/etc/hostname", &status, AT_EMPTY_PATH)};
       }},
      {"make a socket", [] { return long{socket(AF_INET, SOCK_DGRAM, 0)}; }},
      {"start a process", [] { return syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0); }},
      {"start a program",
       [] {
         char* const none[] = {nullptr};
         return long{execve("/nonexistent", none, none)};
       }},
      {"signal its parent", [] { return long{kill(getppid(), 0)}; }},
      {"trace its parent", [] { return ptrace(PTRACE_ATTACH, getppid(), nullptr, nullptr); }},
      {"get code into memory",
       [] {
         void* const at = mmap(nullptr, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
         return at == MAP_FAILED ? -1L : 0L;
       }},
      {"raise its limits",
       [] {
         const rlimit limits{RLIM_INFINITY, RLIM_INFINITY};
         return long{setrlimit(RLIMIT_AS, &limits)};
       }},
  };
}

TEST(Confine, RefusesEverythingButMemoryAndOpenFiles) {
  std::vector<std::string> all;
  for (const Attempt& attempt : attempts()) all.push_back(attempt.what);
  EXPECT_EQ(refused_after(confine, attempts()), all);
}

TEST(Confine, LeavesMemoryAndOpenFiles) {
  const int file = open("/etc/passwd", O_RDONLY);
  const std::vector<Attempt> allowed{
      {"read",
       [file] {
         char c = 0;
         return read(file, &c, 1);
       }},
      {"seek", [file] { return lseek(file, 0, SEEK_SET); }},
      {"use much memory",
       [] {
         const std::vector<char> bytes(100'000'000, 'x');
         return long{bytes.back()};
       }},
      {"throw",
       [] {
         try {
           throw std::string{"caught"};
         } catch (const std::string&) {
           return 0L;
         }
       }},
  };
  EXPECT_TRUE(refused_after(confine, allowed).empty());
  close(file);
}

}  // namespace
}  // namespace tactus::spm::importer
