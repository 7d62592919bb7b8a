#include "keys/message_crypto.hpp"

#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <sys/random.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string_view>

#include "keys/member.hpp"

namespace tactus::keys {

MessageKey session_key(KeyUse use, const MessageKey& master, const MessageKey& salt, std::uint32_t session_id,
                       std::size_t key_bytes) {
  constexpr std::string_view kLabels[] = {"SessionKey", "SessionReceiverKey"};
  const std::string_view label = kLabels[static_cast<std::size_t>(use)];
  std::array<std::uint8_t, 64> text{};
  auto* end = std::copy(label.begin(), label.end(), text.data());
  end = std::copy_n(salt.data(), std::min(key_bytes, salt.size()), end);
  std::memcpy(end, &session_id, sizeof session_id);
  end += sizeof session_id;
  MessageKey key{};
  if (key_bytes > master.size() || HMAC(EVP_sha256(), master.data(), static_cast<int>(key_bytes), text.data(),
                                        static_cast<std::size_t>(end - text.data()), key.data(), nullptr) == nullptr)
    throw KeyError("OpenSSL cannot derive a session key");
  return key;
}

}  // namespace tactus::keys

/// OpenSSL 3.0 takes two exclusive locks of the process for its own random bytes. Fast DDS ignores the result, and
/// would encrypt with numbers that repeat.
extern "C" __attribute__((visibility("default"))) int RAND_bytes(unsigned char* bytes, int count) {
  if (count < 0) return 0;
  for (std::size_t done = 0, all = static_cast<std::size_t>(count); done < all;) {
    const ssize_t got = ::getrandom(bytes + done, all - done, 0);
    if (got > 0) done += static_cast<std::size_t>(got);
    if (got >= 0 || errno == EINTR) continue;
    std::fprintf(stderr, "the kernel gives no random bytes (%s); without them nothing can be encrypted\n",
                 std::strerror(errno));
    std::abort();
  }
  return 1;
}
