#include "wire/session_keys.hpp"

#include <dlfcn.h>

#include <array>
#include <cstdint>

#include "keys/message_crypto.hpp"
#include "wire/library.hpp"

#ifdef TACTUS_FAST_DDS_3
#define TACTUS_RTPS_NAMESPACE eprosima::fastdds::rtps
#define TACTUS_RTPS_MANGLED "N8eprosima7fastdds4rtps"
#else
#define TACTUS_RTPS_NAMESPACE eprosima::fastrtps::rtps
#define TACTUS_RTPS_MANGLED "N8eprosima8fastrtps4rtps"
#endif

namespace TACTUS_RTPS_NAMESPACE::security {

/// A class of the library that its headers do not declare. The library exports this function, and calls it.
class __attribute__((visibility("default"))) AESGCMGMAC_Transform {
 public:
  void compute_sessionkey(std::array<std::uint8_t, 32>& session_key, bool receiver_specific,
                          const std::array<std::uint8_t, 32>& master_key,
                          const std::array<std::uint8_t, 32>& master_salt, std::uint32_t session_id, int key_bytes);
};

void AESGCMGMAC_Transform::compute_sessionkey(std::array<std::uint8_t, 32>& session_key, bool receiver_specific,
                                              const std::array<std::uint8_t, 32>& master_key,
                                              const std::array<std::uint8_t, 32>& master_salt, std::uint32_t session_id,
                                              int key_bytes) {
  using tactus::keys::KeyUse;
  session_key = tactus::keys::session_key(receiver_specific ? KeyUse::kOrigin : KeyUse::kContent, master_key,
                                          master_salt, session_id, static_cast<std::size_t>(key_bytes));
}

}  // namespace TACTUS_RTPS_NAMESPACE::security

namespace tactus::wire {
namespace {

constexpr char kComputeSessionKey[] =
    "_Z" TACTUS_RTPS_MANGLED "8security20AESGCMGMAC_Transform18compute_sessionkeyERSt5arrayIhLm32EEbRKS5_S8_ji";

/// Returns whether `name` is a function of the program, which contains this code, and also one of a shared library.
/// Does not search the libraries that the program has opened by dlopen.
bool is_replaced(const char* name) noexcept {
  Dl_info here{}, first{};
  void* const program = ::dlopen(nullptr, RTLD_LAZY);
  void* const function = program == nullptr ? nullptr : ::dlsym(program, name);
  return function != nullptr && ::dlsym(RTLD_NEXT, name) != nullptr && ::dladdr(function, &first) != 0 &&
         ::dladdr(reinterpret_cast<void*>(&is_replaced), &here) != 0 && first.dli_fbase == here.dli_fbase;
}

}  // namespace

bool replaces_message_crypto() noexcept { return is_replaced(kComputeSessionKey) && is_replaced("RAND_bytes"); }

}  // namespace tactus::wire
