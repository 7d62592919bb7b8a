/// An `.spm` file. The checksums are corrected first, because damage would not get past them otherwise.
#include "spm/offline/model_file.hpp"

#include <xxhash.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "tests/fuzz/target.hpp"

namespace {

// Layout of header and table (spm/offline/model_file.hpp).
constexpr std::size_t kHeader = 64, kEntry = 32, kSectionsAt = 12, kFileSizeAt = 16, kChecksumAt = 24, kOffsetAt = 8,
                      kSizeAt = 16, kEntryChecksumAt = 24;

std::uint64_t number_at(const std::vector<std::uint8_t>& bytes, std::size_t at, std::size_t size) {
  std::uint64_t number = 0;
  std::memcpy(&number, bytes.data() + at, size);
  return number;
}
void set_number(std::vector<std::uint8_t>& bytes, std::size_t at, std::uint64_t number) {
  std::memcpy(bytes.data() + at, &number, sizeof number);
}

void correct_checksums(std::vector<std::uint8_t>& file) {
  if (file.size() < kHeader) return;
  const std::size_t sections = std::min<std::size_t>(number_at(file, kSectionsAt, 4), (file.size() - kHeader) / kEntry);
  for (std::size_t i = 0; i < sections; ++i) {
    const std::size_t entry = kHeader + i * kEntry;
    const std::uint64_t offset = number_at(file, entry + kOffsetAt, 8), size = number_at(file, entry + kSizeAt, 8);
    if (offset <= file.size() && size <= file.size() - offset)
      set_number(file, entry + kEntryChecksumAt, XXH3_64bits(file.data() + offset, size));
  }
  set_number(file, kFileSizeAt, file.size());
  set_number(file, kChecksumAt, 0);
  set_number(file, kChecksumAt, XXH3_64bits(file.data(), kHeader + sections * kEntry));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::vector<std::uint8_t> bytes(data, data + size);
  correct_checksums(bytes);
  const tactus::fuzz::MemoryFile file{bytes};
  try {
    const tactus::spm::offline::MappedModel model{file.path()};
  } catch (const tactus::spm::offline::ModelError&) {
  }
  return 0;
}
