#include "spm/codec/prefix_code.hpp"

#include <algorithm>
#include <functional>
#include <queue>
#include <utility>

namespace tactus::spm::codec {
namespace {

constexpr unsigned kMaxZeros = 16;

/// Returns the depth of each symbol in Huffman's tree: 0 if its count is 0, or if it is the only symbol.
std::vector<unsigned> depths(const std::vector<std::uint64_t>& counts) {
  using Node = std::pair<std::uint64_t, std::size_t>;  // count, number
  std::priority_queue<Node, std::vector<Node>, std::greater<>> open;
  for (std::size_t s = 0; s < counts.size(); ++s) {
    if (counts[s] > 0) open.emplace(counts[s], s);
  }
  if (open.size() < 2) return std::vector<unsigned>(counts.size(), 0);
  std::vector<std::size_t> parent(2 * counts.size(), 0);
  std::size_t next = counts.size();
  while (open.size() > 1) {
    const Node a = open.top();
    open.pop();
    const Node b = open.top();
    open.pop();
    parent[a.second] = parent[b.second] = next;
    open.emplace(a.first + b.first, next++);
  }
  std::vector<unsigned> depth(2 * counts.size(), 0);
  for (std::size_t n = next - 1; n-- > 0;) {
    if (n >= counts.size() || counts[n] > 0) depth[n] = depth[parent[n]] + 1;
  }
  depth.resize(counts.size());
  return depth;
}

}  // namespace

PrefixCode::PrefixCode(std::span<const std::uint64_t> frequencies) {
  std::vector<std::uint64_t> flattened(frequencies.begin(), frequencies.end());
  std::vector<unsigned> depth = depths(flattened);
  while (*std::max_element(depth.begin(), depth.end()) > kMaxLength) {
    for (std::uint64_t& count : flattened) count = (count + 1) / 2;
    depth = depths(flattened);
  }
  for (std::size_t s = 0; s < depth.size(); ++s) {
    const bool is_only_symbol = flattened[s] > 0 && depth[s] == 0;
    length_.push_back(static_cast<std::uint8_t>(is_only_symbol ? 1 : depth[s]));
  }
  static_cast<void>(assign_words());
}

/// Computes words and decoding table from the lengths. Returns false if there are not enough words of these lengths.
bool PrefixCode::assign_words() {
  word_.assign(length_.size(), 0);
  unsigned longest = 0;
  for (const std::uint8_t length : length_) longest = std::max<unsigned>(longest, length);
  table_.assign(std::size_t{1} << longest, 0);
  mask_ = (1u << longest) - 1;
  std::uint32_t next = 0;  // next word, highest bit first
  for (unsigned length = 1; length <= longest; ++length) {
    next <<= 1;
    for (std::size_t s = 0; s < length_.size(); ++s) {
      if (length_[s] != length) continue;
      if (next >> length != 0) return false;
      std::uint32_t word = 0;
      for (unsigned bit = 0; bit < length; ++bit) word |= (next >> bit & 1u) << (length - 1 - bit);
      word_[s] = static_cast<std::uint16_t>(word);
      for (std::size_t at = word; at < table_.size(); at += std::size_t{1} << length) {
        table_[at] = static_cast<std::uint16_t>(s << kLengthBits | length);
      }
      ++next;
    }
  }
  return true;
}

void PrefixCode::write(BitWriter& out) const {
  for (std::size_t s = 0; s < length_.size();) {
    out.put(length_[s], kLengthBits);
    if (length_[s++] != 0) continue;
    unsigned zeros = 1;
    for (; zeros < kMaxZeros && s < length_.size() && length_[s] == 0; ++s) ++zeros;
    out.put(zeros - 1, kLengthBits);
  }
}

bool PrefixCode::read(BitReader& in, std::uint32_t symbols) {
  length_.clear();
  while (length_.size() < symbols && in.ok()) {
    const auto length = static_cast<std::uint8_t>(in.get(kLengthBits));
    if (length > kMaxLength) return false;
    length_.push_back(length);
    if (length == 0) length_.resize(length_.size() + in.get(kLengthBits), 0);
  }
  return in.ok() && length_.size() == symbols && assign_words();
}

}  // namespace tactus::spm::codec
