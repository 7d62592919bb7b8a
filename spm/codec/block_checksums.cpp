#include "spm/codec/block_checksums.hpp"

#include <xxhash.h>

#include <algorithm>
#include <utility>

#include "spm/assert.hpp"

namespace tactus::spm::codec {
namespace {

std::span<const std::uint8_t> block_of(std::span<const std::uint8_t> bytes, std::size_t block) {
  const std::size_t first = block * BlockChecksums::kBlockBytes;
  return bytes.subspan(first, std::min(BlockChecksums::kBlockBytes, bytes.size() - first));
}

std::uint64_t checksum_of(std::span<const std::uint8_t> block) { return XXH3_64bits(block.data(), block.size()); }

}  // namespace

std::vector<std::uint64_t> BlockChecksums::of(std::span<const std::uint8_t> bytes) {
  std::vector<std::uint64_t> checksums(blocks_in(bytes.size()));
  for (std::size_t block = 0; block < checksums.size(); ++block) checksums[block] = checksum_of(block_of(bytes, block));
  return checksums;
}

BlockChecksums::BlockChecksums(std::string name, std::span<const std::uint8_t> bytes,
                               std::vector<std::uint64_t> checksums)
    : name_{std::move(name)}, bytes_{bytes}, checksums_{std::move(checksums)}, states_(checksums_.size()) {
  TACTUS_CHECK(checksums_.size() == blocks_in(bytes_.size()));
}

std::string BlockChecksums::damage(std::uint64_t first, std::uint64_t end) const {
  if (first >= end) return {};
  const std::uint64_t after = std::min<std::uint64_t>((end - 1) / 8 / kBlockBytes + 1, checksums_.size());
  for (std::uint64_t block = first / 8 / kBlockBytes; block < after; ++block) {
    std::atomic<State>& state = states_[block];
    // Two threads may check a block at the same time; both find the same.
    if (state.load(std::memory_order_relaxed) == State::kUnchecked)
      state.store(checksum_of(block_of(bytes_, block)) == checksums_[block] ? State::kSound : State::kDamaged,
                  std::memory_order_relaxed);
    if (state.load(std::memory_order_relaxed) == State::kSound) continue;
    const std::uint64_t from = block * kBlockBytes;
    return name_ + ": the checksum of bytes " + std::to_string(from) + " to " +
           std::to_string(std::min<std::uint64_t>(from + kBlockBytes, bytes_.size()) - 1) +
           " does not match, the file is damaged";
  }
  return {};
}

}  // namespace tactus::spm::codec
