#include "wire/address/address.hpp"

#include <system_error>

namespace tactus::wire {

std::filesystem::path default_qos_directory() {
  std::error_code error;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (!error) {
    const auto inside = program.lexically_relative(TACTUS_BUILD_DIR);
    if (!inside.empty() && *inside.begin() != "..") return TACTUS_SOURCE_QOS_DIR;
    const auto beside = program.parent_path().parent_path() / "share/tactus/qos";
    if (std::filesystem::is_directory(beside, error)) return beside;
  }
  return TACTUS_INSTALL_QOS_DIR;
}

}  // namespace tactus::wire
