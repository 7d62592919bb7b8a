/// Runs a fuzz target without libFuzzer: over the files of the folders in the arguments, and over random changes of them.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "tests/fuzz/target.hpp"

namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kChanges = 300;  // of each file

/// Changes up to four bytes, and cuts every fourth file. Of a copy whose memory has no byte more, so that sanitizers see
/// reads beyond its end.
Bytes changed(const Bytes& file, std::mt19937& random) {
  Bytes bytes = file;
  if (bytes.empty()) return bytes;
  if (random() % 4 == 0) bytes.resize(random() % bytes.size());
  for (std::uint32_t i = random() % 4; !bytes.empty() && i > 0; --i)
    bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
  return Bytes(bytes);
}

}  // namespace

int main(int argc, char** argv) {
  std::mt19937 random{7};
  int files = 0;
  for (int i = 1; i < argc; ++i) {
    if (!std::filesystem::is_directory(argv[i])) continue;
    for (const auto& entry : std::filesystem::directory_iterator{argv[i]}) {
      std::ifstream in{entry.path(), std::ios::binary};
      const Bytes file{std::istreambuf_iterator<char>{in}, {}};
      (void)LLVMFuzzerTestOneInput(file.data(), file.size());
      for (int k = 0; k < kChanges; ++k) {
        const Bytes bytes = changed(file, random);
        (void)LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
      }
      ++files;
    }
  }
  std::printf("%d files\n", files);
  return files > 0 ? 0 : 1;
}
