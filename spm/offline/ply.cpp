#include "spm/offline/ply.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <istream>
#include <iterator>
#include <optional>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

#include "spm/ids.hpp"
#include "spm/offline/polygon.hpp"

namespace tactus::spm::offline {
namespace {

constexpr std::size_t kMaxHeader = 1u << 16;

enum class Type : std::uint8_t { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

struct NamedType {
  const char* name;
  Type type;
};
constexpr NamedType kTypes[] = {
    {"char", Type::kInt8},   {"int8", Type::kInt8},     {"uchar", Type::kUint8},   {"uint8", Type::kUint8},
    {"short", Type::kInt16}, {"int16", Type::kInt16},   {"ushort", Type::kUint16}, {"uint16", Type::kUint16},
    {"int", Type::kInt32},   {"int32", Type::kInt32},   {"uint", Type::kUint32},   {"uint32", Type::kUint32},
    {"float", Type::kFloat}, {"float32", Type::kFloat}, {"double", Type::kDouble}, {"float64", Type::kDouble}};

std::optional<Type> type_of(const std::string& name) {
  for (const NamedType& known : kTypes)
    if (name == known.name) return known.type;
  return std::nullopt;
}

constexpr std::size_t bytes_of(Type type) {
  constexpr std::array<std::size_t, 8> kBytes{1, 1, 2, 2, 4, 4, 4, 8};
  return kBytes[static_cast<std::size_t>(type)];
}

enum class Encoding : std::uint8_t { kAscii, kLittleEndian, kBigEndian };

struct Property {
  std::string name;
  Type type;
  std::optional<Type> count;  // type of the number of entries, if the property is a list
};

struct Element {
  std::string name;
  std::uint64_t count;
  std::vector<Property> properties;

  /// Returns the index of the property with that name that is a list (or is none), or kNone.
  [[nodiscard]] std::size_t find(const char* property, bool list) const {
    for (std::size_t i = 0; i < properties.size(); ++i)
      if (properties[i].name == property && properties[i].count.has_value() == list) return i;
    return kNone;
  }
};

struct PlyHeader {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  std::uint64_t bytes = 0;  // length of the header
};

class HeaderReader {
 public:
  HeaderReader(const PlyFile& file, std::istream& bytes) : file_{file} {
    text_.resize(kMaxHeader);
    bytes.read(text_.data(), static_cast<std::streamsize>(text_.size()));
    text_.resize(static_cast<std::size_t>(bytes.gcount()));
    bytes.clear();
  }

  PlyHeader read() {
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
      }  // every other line is a comment; old versions of Blender do not mark it
    }
    if (!has_format_) fail("a line with the format before the end of the header");
    header_.bytes = at_;
    check_size();
    return std::move(header_);
  }

 private:
  /// Returns the words of the next line. Line endings are LF, CR or CR LF, the same for all lines of a header.
  std::vector<std::string> next_line() {
    const std::size_t end = text_.find_first_of("\r\n", at_);
    if (end == std::string::npos) {
      throw ModelError{file_.name + ": found no end_header in a PLY header of " + std::to_string(text_.size()) +
                       " bytes (truncated)"};
    }
    if (line_end_ == 0) line_end_ = text_.compare(end, 2, "\r\n") == 0 ? 2 : 1;
    line_ = text_.substr(at_, end - at_);
    at_ = end + (line_end_ == 2 && text_.compare(end, 2, "\r\n") == 0 ? 2 : 1);
    std::istringstream words{line_};
    return {std::istream_iterator<std::string>{words}, {}};
  }

  void read_format(const std::vector<std::string>& words) {
    static const std::vector<std::string> kFormats{"ascii", "binary_little_endian", "binary_big_endian"};
    const auto format = words.size() == 3 ? std::find(kFormats.begin(), kFormats.end(), words[1]) : kFormats.end();
    if (format == kFormats.end()) fail("format ascii, binary_little_endian or binary_big_endian, and 1.0");
    header_.encoding = static_cast<Encoding>(format - kFormats.begin());
    has_format_ = true;
  }

  void read_element(const std::vector<std::string>& words) {
    std::uint64_t count = 0;
    const char* const end = words.size() == 3 ? words[2].data() + words[2].size() : nullptr;
    const auto result = end != nullptr ? std::from_chars(words[2].data(), end, count) : std::from_chars_result{};
    if (end == nullptr || result.ec != std::errc{} || result.ptr != end || count > 0xffffffffu)
      fail("element NAME COUNT, below 2^32");
    header_.elements.push_back({words[1], count, {}});
  }

  void read_property(const std::vector<std::string>& words) {
    const bool list = words.size() == 5 && words[1] == "list";
    const std::optional<Type> type = list ? type_of(words[3]) : words.size() == 3 ? type_of(words[1]) : std::nullopt;
    const std::optional<Type> count = list ? type_of(words[2]) : std::nullopt;
    if (header_.elements.empty() || !type || list != count.has_value())
      fail("property TYPE NAME or property list TYPE TYPE NAME");
    header_.elements.back().properties.push_back({words.back(), *type, count});
  }

  /// Throws if the file is too short for the counts of the header.
  void check_size() const {
    std::uint64_t min = 0;
    for (const Element& element : header_.elements) {
      std::uint64_t bytes = 0;
      for (const Property& property : element.properties)
        bytes += header_.encoding == Encoding::kAscii ? 1 : bytes_of(property.count.value_or(property.type));
      min += element.count * bytes;
    }
    const std::uint64_t rest = file_.bytes - at_;
    if (min > rest) {
      throw ModelError{file_.name + ": found " + std::to_string(rest) + " bytes after its header, expected at least " +
                       std::to_string(min) + " (truncated)"};
    }
  }

  [[noreturn]] void fail(const std::string& expected) const {
    throw ModelError{file_.name + ": PLY header: found \"" + line_.substr(0, 80) + "\", expected " + expected};
  }

  const PlyFile& file_;
  std::string text_, line_;
  std::size_t at_ = 0, line_end_ = 0;
  bool has_format_ = false;
  PlyHeader header_;
};

/// Reads a decimal number as std::from_chars does.
template <class Number>
std::from_chars_result read_number(const char* first, const char* last, Number& number) {
#ifdef __cpp_lib_to_chars
  return std::from_chars(first, last, number);
#else  // the library of emscripten has std::from_chars for integers only
  const std::string text{first, last};
  if (text.empty() || text.find_first_of(" +xX") == 0 || text.find_first_of("xX") != std::string::npos)
    return {first, std::errc::invalid_argument};
  char* end = nullptr;
  errno = 0;
  number = std::is_same_v<Number, float> ? std::strtof(text.c_str(), &end) : std::strtod(text.c_str(), &end);
  if (end == text.c_str()) return {first, std::errc::invalid_argument};
  return {first + (end - text.c_str()), errno == ERANGE ? std::errc::result_out_of_range : std::errc{}};
#endif
}

/// Reads the numbers after the header.
class Numbers {
 public:
  Numbers(const PlyFile& file, std::istream& bytes, const PlyHeader& header)
      : file_{file}, bytes_{bytes}, encoding_{header.encoding} {
    bytes_.seekg(static_cast<std::streamoff>(header.bytes));
  }

  /// Sets the element and row of the next numbers, for messages.
  void set_position(const Element& element, std::uint64_t row) noexcept {
    element_ = &element;
    row_ = row;
  }

  /// Reads the next number. A double can represent the numbers of all types.
  double next(Type type) { return encoding_ == Encoding::kAscii ? next_word(type) : next_binary(type); }

  void skip(const Property& property) {
    std::uint64_t count = property.count ? next_count(*property.count) : 1;
    for (; count > 0; --count) next(property.type);
  }

  std::uint64_t next_count(Type type) {
    const double count = next(type);
    if (!(count >= 0 && count <= 0xffffffffu) || count != static_cast<double>(static_cast<std::uint64_t>(count)))
      fail("a list of " + text_of(count) + " entries", "a count");
    return static_cast<std::uint64_t>(count);
  }

  /// Reads a vertex index, or -1, which ends a strip.
  std::int64_t next_index(Type type) {
    const double index = next(type);
    if (!(index >= -1 && index < kNone) || index != static_cast<double>(static_cast<std::int64_t>(index)))
      fail("vertex index " + text_of(index), "a whole number of at least -1");
    return static_cast<std::int64_t>(index);
  }

  [[noreturn]] void fail(const std::string& found, const std::string& expected) const {
    throw ModelError{file_.name + ": " + element_->name + " " + std::to_string(row_) + " of " +
                     std::to_string(element_->count) + ": found " + found + ", expected " + expected};
  }

 private:
  static std::string text_of(double number) {
    std::ostringstream text;
    text << number;
    return text.str();
  }

  /// Reads until the buffer has `bytes` bytes from begin_. Returns false if the file ends before.
  bool fill(std::size_t bytes) {
    if (end_ - begin_ >= bytes) return true;
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
    bytes_.read(buffer_.data() + end_, static_cast<std::streamsize>(buffer_.size() - end_));
    end_ += static_cast<std::size_t>(bytes_.gcount());
    return end_ >= bytes;
  }

  template <class T>
  double binary() {
    std::array<char, sizeof(T)> bytes;
    if (!fill(sizeof(T))) fail("the end of the file", "more (truncated)");
    std::memcpy(bytes.data(), buffer_.data() + begin_, sizeof(T));
    begin_ += sizeof(T);
    if (encoding_ == Encoding::kBigEndian) std::reverse(bytes.begin(), bytes.end());  // this machine is little-endian
    T value;
    std::memcpy(&value, bytes.data(), sizeof(T));
    return static_cast<double>(value);
  }

  double next_binary(Type type) {
    switch (type) {
      case Type::kInt8:
        return binary<std::int8_t>();
      case Type::kUint8:
        return binary<std::uint8_t>();
      case Type::kInt16:
        return binary<std::int16_t>();
      case Type::kUint16:
        return binary<std::uint16_t>();
      case Type::kInt32:
        return binary<std::int32_t>();
      case Type::kUint32:
        return binary<std::uint32_t>();
      case Type::kFloat:
        return binary<float>();
      case Type::kDouble:
        break;
    }
    return binary<double>();
  }

  double next_word(Type type) {
    constexpr std::size_t kMaxLength = 1024;
    const auto is_space = [](char c) { return c == ' ' || (c >= '\t' && c <= '\r'); };
    while (fill(1) && is_space(buffer_[begin_])) ++begin_;
    if (!fill(1)) fail("the end of the file", "more (truncated)");
    static_cast<void>(fill(kMaxLength + 1));
    const char* const first = buffer_.data() + begin_;
    const char* const last = std::find_if(first, first + std::min(end_ - begin_, kMaxLength + 1), is_space);
    if (static_cast<std::size_t>(last - first) > kMaxLength)  // its end may be beyond the buffer
      fail("a longer word", "a number of at most " + std::to_string(kMaxLength) + " characters");
    begin_ += static_cast<std::size_t>(last - first);
    const char* const digits = first + (*first == '+' && last - first > 1 ? 1 : 0);
    std::from_chars_result result{};
    double number = 0;
    if (type == Type::kFloat) {  // not read as a double, so that it is rounded only once
      float single = 0;
      result = read_number(digits, last, single);
      number = single;
    } else {
      result = read_number(digits, last, number);
    }
    if (result.ec == std::errc::result_out_of_range) number = std::strtod(std::string{digits, last}.c_str(), nullptr);
    if (result.ec == std::errc::invalid_argument || result.ptr != last)
      fail("\"" + std::string{first, std::min(last, first + 40)} + "\"", "a number");
    return number;
  }

  const PlyFile& file_;
  std::istream& bytes_;
  Encoding encoding_;
  std::vector<char> buffer_ = std::vector<char>(1 << 16);
  std::size_t begin_ = 0, end_ = 0;
  const Element* element_ = nullptr;
  std::uint64_t row_ = 0;
};

class Reader {
 public:
  Reader(const PlyFile& file, std::istream& bytes)
      : file_{file}, header_{HeaderReader{file, bytes}.read()}, numbers_{file, bytes, header_} {}

  PlyMesh read() {
    bool has_vertices = false;
    for (const Element& element : header_.elements) {
      if (element.name == "vertex" && !has_vertices) {
        has_vertices = true;
        read_vertices(element);
      } else if (element.name == "face") {
        read_faces(element);
      } else if (element.name == "tristrips") {
        read_strips(element);
      } else {
        for (std::uint64_t row = 0; row < element.count; ++row) {
          numbers_.set_position(element, row);
          for (const Property& property : element.properties) numbers_.skip(property);
        }
      }
    }
    if (!has_vertices) throw ModelError{file_.name + ": PLY header: found no element vertex, expected one"};
    return cut_polygons();
  }

 private:
  void read_vertices(const Element& element) {
    std::array<std::size_t, 3> axes{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const char name[2] = {"xyz"[axis], 0};
      axes[axis] = element.find(name, false);
      if (axes[axis] == kNone)
        throw ModelError{file_.name + ": PLY header: element vertex: found no property " + name +
                         ", expected x, y and z"};
    }
    for (std::uint64_t row = 0; row < element.count; ++row) {
      numbers_.set_position(element, row);
      std::array<float, 3> position{};
      for (std::size_t i = 0; i < element.properties.size(); ++i) {
        const auto axis = std::find(axes.begin(), axes.end(), i);
        if (axis == axes.end())
          numbers_.skip(element.properties[i]);
        else
          position[static_cast<std::size_t>(axis - axes.begin())] =
              static_cast<float>(numbers_.next(element.properties[i].type));
      }
      out_.mesh.positions.push_back(position);
    }
  }

  /// Calls `add(index)` for each entry of the vertex lists of an element, and `end()` after each list.
  template <class Add, class End>
  void read_lists(const Element& element, Add add, End end) {
    std::size_t corners = element.find("vertex_indices", true);
    if (corners == kNone) corners = element.find("vertex_index", true);
    if (corners == kNone && element.count > 0)
      throw ModelError{file_.name + ": PLY header: element " + element.name +
                       ": found no list, expected property list TYPE TYPE vertex_indices"};
    for (std::uint64_t row = 0; row < element.count; ++row) {
      numbers_.set_position(element, row);
      for (std::size_t i = 0; i < element.properties.size(); ++i) {
        const Property& property = element.properties[i];
        if (i != corners) {
          numbers_.skip(property);
          continue;
        }
        for (std::uint64_t left = numbers_.next_count(*property.count); left > 0; --left)
          add(numbers_.next_index(property.type));
        end();
      }
    }
  }

  void read_faces(const Element& element) {
    std::uint32_t size = 0;
    read_lists(
        element,
        [&](std::int64_t index) {
          if (index < 0) numbers_.fail("vertex index -1", "0 or more");
          corners_.push_back(static_cast<std::uint32_t>(index));
          ++size;
        },
        [&] {
          sizes_.push_back(size);
          size = 0;
        });
  }

  void read_strips(const Element& element) {
    std::array<std::uint32_t, 2> last{};
    std::uint64_t length = 0;  // corners of this strip so far
    read_lists(
        element,
        [&](std::int64_t index) {
          if (index < 0) {
            length = 0;
            return;
          }
          const auto corner = static_cast<std::uint32_t>(index);
          const auto [a, b] = last;
          if (length >= 2 && a != b && b != corner && corner != a) {
            const bool is_reversed = length % 2 == 1;
            corners_.insert(corners_.end(), {is_reversed ? b : a, is_reversed ? a : b, corner});
            sizes_.push_back(3);
          }
          last = {b, corner};
          ++length;
        },
        [&] { length = 0; });
  }

  /// Cuts the polygons and returns the mesh. The vertices may be the last element, so all elements must have been read.
  PlyMesh cut_polygons() {
    std::vector<Triangle>& faces = out_.mesh.faces;
    std::vector<std::array<float, 3>> polygon;
    std::size_t first = 0;
    for (std::size_t face = 0; face < sizes_.size(); first += sizes_[face++]) {
      const std::uint32_t* const corners = corners_.data() + first;
      for (std::uint32_t k = 0; k < sizes_[face]; ++k) {
        if (corners[k] < out_.mesh.positions.size()) continue;
        throw ModelError{file_.name + ": face " + std::to_string(face) + ": found vertex index " +
                         std::to_string(corners[k]) + ", expected below " + std::to_string(out_.mesh.positions.size())};
      }
      ++(sizes_[face] < 3 ? out_.lines : out_.polygons);
      if (sizes_[face] < 3) continue;
      if (sizes_[face] == 3) {
        faces.push_back({corners[0], corners[1], corners[2]});
      } else {
        polygon.clear();
        for (std::uint32_t k = 0; k < sizes_[face]; ++k) polygon.push_back(out_.mesh.positions[corners[k]]);
        for (const Triangle& t : cut_polygon(polygon)) faces.push_back({corners[t[0]], corners[t[1]], corners[t[2]]});
      }
    }
    return std::move(out_);
  }

  const PlyFile& file_;
  PlyHeader header_;
  Numbers numbers_;
  std::vector<std::uint32_t> corners_;  // corners of all polygons
  std::vector<std::uint32_t> sizes_;    // number of corners, by polygon
  PlyMesh out_;
};

}  // namespace

PlyMesh read_ply(const PlyFile& file, std::istream& bytes) { return Reader{file, bytes}.read(); }

}  // namespace tactus::spm::offline
