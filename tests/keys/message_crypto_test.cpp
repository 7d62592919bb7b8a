/// The cryptography of messages that the keys module computes in place of Fast DDS and OpenSSL.
#include "keys/message_crypto.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "keys/member.hpp"

extern "C" int RAND_bytes(unsigned char* bytes, int count);  // of OpenSSL, as only the keys module includes its headers

namespace tactus::keys {
namespace {

std::string digits_of(const MessageKey& key) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string digits;
  for (const std::uint8_t byte : key) digits += {kDigits[byte >> 4], kDigits[byte & 15]};
  return digits;
}

/// The bytes first, first + 1, ...
MessageKey counting_from(std::uint8_t first) {
  MessageKey key{};
  for (std::size_t i = 0; i < key.size(); ++i) key[i] = static_cast<std::uint8_t>(first + i);
  return key;
}

// The expected values are those of Python:
//   hmac.digest(bytes(range(0, 32)), b"SessionKey" + bytes(range(100, 132)) + (7).to_bytes(4, "little"), "sha256")
TEST(MessageCrypto, SessionKeysAreThoseOfDdsSecurity) {
  const MessageKey master = counting_from(0), salt = counting_from(100);
  EXPECT_EQ(digits_of(session_key(KeyUse::kContent, master, salt, 7, 32)),
            "0fbeff11df316930b0819455bc49288238541ff36bbae0443b7cdc9cdd1e6623");
  EXPECT_EQ(digits_of(session_key(KeyUse::kOrigin, master, salt, 7, 32)),
            "5d0603d321f6adf338bf0f0dceb81cf29bdf42598093c0891d8519ac1e6f5d90");
  EXPECT_EQ(digits_of(session_key(KeyUse::kContent, master, salt, 0x01020304, 32)),
            "eed8c7a7085fee2a7d5ec03005aa0d189e014da00a0f523e191b36a24c0079f8");
  EXPECT_EQ(digits_of(session_key(KeyUse::kContent, master, salt, 7, 16)),
            "01669f1b8fafcef35694550220bac162c2272a0786883bd39a7170a421da2131");
  EXPECT_EQ(digits_of(session_key(KeyUse::kOrigin, master, salt, 7, 16)),
            "88bdaf9af4e76ec3d93cb8207ba395f7990af6fb5c362ef66ca70d45c726bcfc");
}

TEST(MessageCrypto, ALongerMasterKeyIsRefused) {
  EXPECT_THROW((void)session_key(KeyUse::kContent, {}, {}, 7, 33), KeyError);
}

TEST(MessageCrypto, RandomBytesFillTheWholeBuffer) {
  constexpr std::size_t kBytes = 1 << 20;
  std::vector<unsigned char> bytes(kBytes), others(kBytes);
  ASSERT_EQ(RAND_bytes(bytes.data(), static_cast<int>(kBytes)), 1);
  ASSERT_EQ(RAND_bytes(others.data(), static_cast<int>(kBytes)), 1);
  std::size_t equal = 0, zero = 0, zero_at_the_end = 0;
  for (std::size_t i = 0; i < kBytes; ++i) {
    equal += bytes[i] == others[i] ? 1 : 0;
    zero += bytes[i] == 0 ? 1 : 0;
    zero_at_the_end += i >= kBytes - 256 && bytes[i] == 0 ? 1 : 0;
  }
  // Each mean is a 256th of the bytes; the limits are more than ten standard deviations away.
  EXPECT_LT(equal, kBytes / 200);
  EXPECT_LT(zero, kBytes / 200);
  EXPECT_LT(zero_at_the_end, 20u);
}

TEST(MessageCrypto, ANegativeNumberOfRandomBytesIsRefused) {
  unsigned char byte = 0;
  EXPECT_EQ(RAND_bytes(&byte, -1), 0);
}

}  // namespace
}  // namespace tactus::keys
