/// An `.spm` file. The checksums are corrected first, because damage would not get past them otherwise.
#include "spm/offline/model_file.hpp"

#include <xxhash.h>

#include <algorithm>
#include <cstring>
#include <span>
#include <vector>

#include "spm/codec/block_checksums.hpp"
#include "tests/fuzz/target.hpp"

namespace {

// Layout of header and table (spm/offline/model_file.hpp).
constexpr std::size_t kSectionsWithBlocks[] = {2, 3}, kBlockChecksums = 6;
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

/// The bytes of a section; none if it is not within the file.
std::span<std::uint8_t> section_of(std::vector<std::uint8_t>& file, std::size_t i) {
  const std::size_t entry = kHeader + i * kEntry;
  const std::uint64_t offset = number_at(file, entry + kOffsetAt, 8), size = number_at(file, entry + kSizeAt, 8);
  if (offset > file.size() || size > file.size() - offset) return {};
  return std::span{file}.subspan(offset, size);
}

void correct_checksums(std::vector<std::uint8_t>& file) {
  if (file.size() < kHeader) return;
  const std::size_t sections = std::min<std::size_t>(number_at(file, kSectionsAt, 4), (file.size() - kHeader) / kEntry);
  if (sections > kBlockChecksums) {
    std::span<std::uint8_t> left = section_of(file, kBlockChecksums);
    for (const std::size_t section : kSectionsWithBlocks)
      for (const std::uint64_t checksum : tactus::spm::codec::BlockChecksums::of(section_of(file, section))) {
        if (left.size() < sizeof checksum) break;
        std::memcpy(left.data(), &checksum, sizeof checksum);
        left = left.subspan(sizeof checksum);
      }
  }
  for (std::size_t i = 0; i < sections; ++i)
    if (const std::span<const std::uint8_t> section = section_of(file, i); section.data() != nullptr)
      set_number(file, kHeader + i * kEntry + kEntryChecksumAt, XXH3_64bits(section.data(), section.size()));
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
    static_cast<void>(tactus::spm::offline::MappedModel{file.path()}.decode());
  } catch (const tactus::spm::offline::ModelError&) {
  }
  return 0;
}
