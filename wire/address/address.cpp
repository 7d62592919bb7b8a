#include "wire/address/address.hpp"

#include <system_error>

namespace tactus::wire {

std::filesystem::path default_qos_directory() {
  std::error_code error;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (!error) {
    const auto inside = program.lexically_relative(TACTUS_BUILD_DIR);
    if (!inside.empty() && *inside.begin() != "..") return TACTUS_SOURCE_QOS_DIR;
    const auto prefix = program.parent_path().parent_path();   // of a program in bin
    for (const auto& folder : {prefix, prefix.parent_path()})  // or in libexec/tactus
      if (std::filesystem::is_directory(folder / "share/tactus/qos", error)) return folder / "share/tactus/qos";
  }
  return TACTUS_INSTALL_QOS_DIR;
}

}  // namespace tactus::wire
