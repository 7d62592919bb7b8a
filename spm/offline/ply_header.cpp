#include "spm/offline/ply_header.hpp"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {
namespace {

constexpr std::size_t kMaxHeader = 1u << 16;

struct TypeSize {
  const char* name;
  std::uint64_t bytes;
};
constexpr TypeSize kTypes[] = {{"char", 1},  {"uchar", 1},   {"int8", 1},   {"uint8", 1},  {"short", 2}, {"ushort", 2},
                               {"int16", 2}, {"uint16", 2},  {"int", 4},    {"uint", 4},   {"int32", 4}, {"uint32", 4},
                               {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};

std::uint64_t bytes_of(const std::string& type) {
  for (const TypeSize& known : kTypes) {
    if (type == known.name) return known.bytes;
  }
  return 0;
}

std::optional<std::uint64_t> count_of(const std::string& text) {
  std::uint64_t count = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), count);
  if (result.ec != std::errc{} || result.ptr != text.data() + text.size() || count > 0xffffffffu) return std::nullopt;
  return count;
}

class Header {
 public:
  explicit Header(const std::filesystem::path& path) : path_{path} {
    std::ifstream file{path, std::ios::binary};
    text_.resize(kMaxHeader);
    file.read(text_.data(), static_cast<std::streamsize>(text_.size()));
    text_.resize(static_cast<std::size_t>(file.gcount()));
  }

  void check() {
    if (next_line() != std::vector<std::string>{"ply"}) fail("ply");
    while (true) {
      const std::vector<std::string> words = next_line();
      if (words.empty()) continue;
      if (words[0] == "end_header") break;
      if (words[0] == "format") {
        read_format(words);
      } else if (words[0] == "element") {
        read_element(words);
      } else if (words[0] == "property") {
        read_property(words);
      }  // anything else is a comment, marked or (old Blender) not
    }
    if (!has_format_) fail("a line with the format before it");
    const std::uint64_t rest = std::filesystem::file_size(path_) - at_;
    const std::uint64_t least = least_bytes_ + count_ * element_bytes_;
    if (least > rest) {
      throw ModelError{path_.string() + ": found " + std::to_string(rest) +
                       " bytes after its header, expected at least " + std::to_string(least) + " (truncated)"};
    }
  }

 private:
  /// The words of the next line, which may end in any of the three ways.
  std::vector<std::string> next_line() {
    const std::size_t end = text_.find_first_of("\r\n", at_);
    if (end == std::string::npos) {
      throw ModelError{path_.string() + ": found no end_header in a PLY header of " + std::to_string(text_.size()) +
                       " bytes (truncated)"};
    }
    line_ = text_.substr(at_, end - at_);
    at_ = end + (text_.compare(end, 2, "\r\n") == 0 ? 2 : 1);
    std::istringstream words{line_};
    return {std::istream_iterator<std::string>{words}, {}};
  }

  void read_format(const std::vector<std::string>& words) {
    static const std::vector<std::string> kFormats{"ascii", "binary_little_endian", "binary_big_endian"};
    if (words.size() != 3 || std::find(kFormats.begin(), kFormats.end(), words[1]) == kFormats.end()) {
      fail("format ascii, binary_little_endian or binary_big_endian, and 1.0");
    }
    ascii_ = words[1] == "ascii";
    has_format_ = true;
  }

  void read_element(const std::vector<std::string>& words) {
    const std::optional<std::uint64_t> count = words.size() == 3 ? count_of(words[2]) : std::nullopt;
    if (!count) fail("element NAME COUNT, below 2^32");
    least_bytes_ += count_ * element_bytes_;
    count_ = *count;
    element_bytes_ = 0;
    in_element_ = true;
  }

  void read_property(const std::vector<std::string>& words) {
    const bool list = words.size() == 5 && words[1] == "list" && bytes_of(words[2]) > 0 && bytes_of(words[3]) > 0;
    const bool scalar = words.size() == 3 && bytes_of(words[1]) > 0;
    if (!in_element_ || !(list || scalar)) fail("property TYPE NAME or property list TYPE TYPE NAME");
    element_bytes_ += ascii_ ? 1 : bytes_of(list ? words[2] : words[1]);
  }

  [[noreturn]] void fail(const std::string& expected) const {
    throw ModelError{path_.string() + ": PLY header: found \"" + line_.substr(0, 80) + "\", expected " + expected};
  }

  std::filesystem::path path_;
  std::string text_, line_;
  std::size_t at_ = 0;
  bool has_format_ = false, ascii_ = false, in_element_ = false;
  std::uint64_t count_ = 0, element_bytes_ = 0, least_bytes_ = 0;
};

}  // namespace

void check_ply_header(const std::filesystem::path& path) { Header{path}.check(); }

}  // namespace tactus::spm::offline
