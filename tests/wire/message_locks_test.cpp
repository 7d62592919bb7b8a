/// Exclusive locks of OpenSSL that secured messages take.
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <pthread.h>

#include <atomic>
#include <cstring>

#include "support.hpp"
#include "tests/wire/secured_session.hpp"
#include "wire/session_keys.hpp"

// A sanitizer has functions of its own for locks.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define TACTUS_COUNTS_LOCKS
#endif

#ifdef TACTUS_COUNTS_LOCKS
namespace {
std::atomic<int> exclusive_locks{0};
}

/// Counts the calls of OpenSSL, and calls the function of libc.
extern "C" int pthread_rwlock_wrlock(pthread_rwlock_t* lock) {
  using Function = int (*)(pthread_rwlock_t*);
  static const auto of_libc = reinterpret_cast<Function>(::dlsym(RTLD_NEXT, "pthread_rwlock_wrlock"));
  Dl_info caller{};
  if (::dladdr(__builtin_return_address(0), &caller) != 0 && std::strstr(caller.dli_fname, "libcrypto") != nullptr)
    ++exclusive_locks;
  return of_libc(lock);
}
#endif

namespace tactus::wire::test {
namespace {

TEST(MessageCrypto, TheProgramReplacesTheFunctionsOfSharedLibraries) { EXPECT_TRUE(replaces_message_crypto()); }

#ifdef TACTUS_COUNTS_LOCKS
class MessageLocksTest : public SecuredSession {
 protected:
  Inbox<ses::ProbeState> inbox_;
  Reader<ses::ProbeState> reader_{desk_, topics::kProbeState, inbox_.callback()};
  Participants hrtc_{member("hrtc", keys::Role::kHrtc)};
  Writer<ses::ProbeState> writer_{hrtc_, topics::kProbeState};
};

// A thread under SCHED_FIFO that waits for such a lock can wait in a loop, for a thread that then gets no processor.
TEST_F(MessageLocksTest, SecuredStatesTakeFewExclusiveLocksOfOpenSsl) {
  constexpr int kStates = 500;
  auto state = full_sample<ses::ProbeState>(hrtc_);
  ASSERT_TRUE(send_until_received(writer_, inbox_, state)) << writer_.invalid_reason() << reader_.invalid_reason();
  EXPECT_GT(exclusive_locks, 0) << "the locks are not counted";
  int locks = 0;
  // At first the programs still exchange keys. Without the replaced functions, each state takes some five of the locks.
  EXPECT_TRUE(eventually([&] {
    const int before = exclusive_locks;
    for (int i = 0; i < kStates; ++i)
      if (!send_until_received(writer_, inbox_, state)) return false;
    locks = exclusive_locks - before;
    return locks < kStates / 5;
  })) << locks;
}
#endif

}  // namespace
}  // namespace tactus::wire::test
