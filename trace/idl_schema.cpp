#include "trace/idl_schema.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cstring>
#include <utility>

namespace tactus::trace {
namespace {

struct Token {
  std::string text;
  int line;
};

/// Splits IDL text into tokens. Skips comments and blanks.
std::vector<Token> tokenize(const std::string& text) {
  std::vector<Token> tokens;
  int line = 1;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '\n') ++line;
    if (std::isspace(static_cast<unsigned char>(c)) != 0) {
      ++i;
    } else if (text.compare(i, 2, "//") == 0) {
      while (i < text.size() && text[i] != '\n') ++i;
    } else {
      std::size_t end = i;
      while (end < text.size() && (std::isalnum(static_cast<unsigned char>(text[end])) != 0 || text[end] == '_' ||
                                   text.compare(end, 2, "::") == 0 || (end > i && text[end] == ':')))
        ++end;
      if (end == i) ++end;
      tokens.push_back({text.substr(i, end - i), line});
      i = end;
    }
  }
  return tokens;
}

}  // namespace

bool has_same_types(const std::string& idl, const std::string& other) {
  const std::vector<Token> tokens = tokenize(idl), others = tokenize(other);
  return std::equal(tokens.begin(), tokens.end(), others.begin(), others.end(),
                    [](const Token& a, const Token& b) { return a.text == b.text; });
}

/// Recursive-descent parser of the IDL text.
class IdlSchema::Parser {
 public:
  using TypePtr = std::shared_ptr<const IdlType>;

  explicit Parser(const std::string& text) : tokens_{tokenize(text)} {
    while (at_ < tokens_.size()) parse_definition("", 1);
  }
  [[nodiscard]] std::map<std::string, TypePtr> structs() && { return std::move(structs_); }

 private:
  [[noreturn]] void fail(const std::string& expected) const {
    fail(at_ >= tokens_.size() ? "the end" : "'" + tokens_[at_].text.substr(0, kMaxNameBytes) + "'", expected);
  }
  [[noreturn]] void fail(const std::string& found, const std::string& expected) const {
    const int line = tokens_.empty() ? 1 : tokens_[std::min(at_, tokens_.size() - 1)].line;
    throw SchemaError("IDL, line " + std::to_string(line) + ": found " + found + ", expected " + expected);
  }
  [[nodiscard]] bool is_next(const char* text) const { return at_ < tokens_.size() && tokens_[at_].text == text; }
  bool accept(const char* text) {
    if (!is_next(text)) return false;
    ++at_;
    return true;
  }
  void expect(const char* text) {
    if (!accept(text)) fail(std::string{"'"} + text + "'");
  }
  /// Reads a name.
  std::string parse_name() {
    if (at_ >= tokens_.size() ||
        (std::isalpha(static_cast<unsigned char>(tokens_[at_].text[0])) == 0 && tokens_[at_].text[0] != '_'))
      fail("a name");
    if (tokens_[at_].text.size() > kMaxNameBytes)
      fail("a name of " + std::to_string(tokens_[at_].text.size()) + " bytes",
           "at most " + std::to_string(kMaxNameBytes));
    return tokens_[at_++].text;
  }
  /// Reads a number or the name of a constant.
  std::size_t parse_number() {
    if (at_ >= tokens_.size()) fail("a number");
    const std::string& text = tokens_[at_].text;
    if (const auto known = constants_.find(text); known != constants_.end()) {
      ++at_;
      return known->second;
    }
    std::size_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size()) fail("a number");
    ++at_;
    return value;
  }
  void skip_annotations() {
    while (accept("@")) {
      (void)parse_name();
      if (!accept("(")) continue;
      while (!accept(")")) {
        if (at_++ >= tokens_.size()) fail("')'");
      }
    }
  }

  /// `depth`: number of nested modules, with the definition itself.
  void parse_definition(const std::string& scope, std::size_t depth) {
    skip_annotations();
    if (depth > kMaxDepth) fail("at most " + std::to_string(kMaxDepth - 1) + " nested modules");
    if (accept("module")) {
      const std::string inner = scope + parse_name() + "::";
      expect("{");
      while (!is_next("}")) parse_definition(inner, depth + 1);
      expect("}");
    } else if (accept("const")) {
      (void)parse_type(1);
      const std::string name = parse_name();
      expect("=");
      constants_[name] = parse_number();
    } else if (accept("typedef")) {
      const TypePtr of = parse_type(1);
      const std::string name = parse_name();
      named_[name] = parse_array_of(of);
    } else if (accept("enum")) {
      IdlType made;
      made.kind = IdlType::Kind::kEnum;
      const std::string name = parse_name();
      expect("{");
      do made.names.push_back(parse_name());
      while (accept(","));
      expect("}");
      made.values = made.names.size();
      named_[name] = checked(std::move(made));
    } else if (accept("struct")) {
      IdlType made;
      made.kind = IdlType::Kind::kStruct;
      const std::string name = parse_name();
      expect("{");
      made.values = 0;
      do {
        skip_annotations();
        const TypePtr of = parse_type(1);
        const std::string member = parse_name();
        made.members.push_back({member, parse_array_of(of)});
        made.depth = std::max(made.depth, 1 + made.members.back().type->depth);
        made.values += made.members.back().type->values;
        expect(";");
      } while (!is_next("}"));
      expect("}");
      named_[name] = structs_[scope + name] = checked(std::move(made));
    } else {
      fail("module, const, typedef, enum or struct");
    }
    expect(";");
  }

  /// Reads the array bounds after a name, if any, and returns the type of the array of `of`.
  TypePtr parse_array_of(TypePtr of) {
    std::vector<std::size_t> counts;
    while (accept("[")) {
      counts.push_back(parse_number());
      if (counts.back() == 0) fail("an array of 0 elements", "at least 1");
      expect("]");
    }
    for (auto count = counts.rbegin(); count != counts.rend(); ++count) {
      IdlType made;
      made.kind = IdlType::Kind::kArray;
      made.count = *count;
      made.depth = 1 + of->depth;
      // `kMaxValues` + 1 stands for all larger numbers, which could overflow.
      made.values = made.count > kMaxValues ? kMaxValues + 1 : made.count * of->values;
      made.of = std::move(of);
      of = checked(std::move(made));
    }
    return of;
  }

  /// Throws if a type exceeds a limit.
  [[nodiscard]] TypePtr checked(IdlType made) const {
    if (made.depth > kMaxDepth)
      fail(std::to_string(made.depth) + " nested types", "at most " + std::to_string(kMaxDepth));
    if (made.values > kMaxValues)
      fail("a type of too many values", "at most " + std::to_string(kMaxValues) + " with their enumerators");
    return std::make_shared<const IdlType>(std::move(made));
  }

  static TypePtr number(IdlType::Number which) {
    IdlType made;
    made.number = which;
    return std::make_shared<const IdlType>(std::move(made));
  }

  /// Reads a type without array bounds. `depth`: number of the sequences around it in the text, and itself.
  TypePtr parse_type(std::size_t depth) {
    using Number = IdlType::Number;
    if (depth > kMaxDepth) fail("at most " + std::to_string(kMaxDepth) + " nested types");
    if (accept("boolean")) return number(Number::kBoolean);
    if (accept("octet")) return number(Number::kU8);
    if (accept("float")) return number(Number::kFloat);
    if (accept("double")) return number(Number::kDouble);
    const bool has_sign = !accept("unsigned");
    if (accept("short")) return number(has_sign ? Number::kI16 : Number::kU16);
    if (accept("long")) {
      if (accept("long")) return number(has_sign ? Number::kI64 : Number::kU64);
      return number(has_sign ? Number::kI32 : Number::kU32);
    }
    IdlType made;
    if (accept("string")) {
      made.kind = IdlType::Kind::kText;
      if (accept("<")) {
        (void)parse_number();
        expect(">");
      }
      return std::make_shared<const IdlType>(std::move(made));
    }
    if (accept("sequence")) {
      made.kind = IdlType::Kind::kSequence;
      expect("<");
      made.of = parse_type(depth + 1);
      if (accept(",")) (void)parse_number();
      expect(">");
      made.depth = 1 + made.of->depth;
      made.values = 1 + made.of->values;
      return checked(std::move(made));
    }
    const auto known = at_ < tokens_.size() ? named_.find(tokens_[at_].text) : named_.end();
    if (known == named_.end()) fail("a type");
    ++at_;
    return known->second;
  }

  std::vector<Token> tokens_;
  std::size_t at_ = 0;
  std::map<std::string, std::size_t> constants_;
  std::map<std::string, TypePtr> named_;    // all types, by name without scope
  std::map<std::string, TypePtr> structs_;  // by full name
};

/// Decodes a sample by its type.
class IdlSchema::Decoder {
 public:
  explicit Decoder(std::span<const std::uint8_t> encoded) : bytes_{encoded} {
    if (bytes_.size() < kHeadBytes || bytes_[0] != 0 || bytes_[1] > 1)
      throw SchemaError("sample: found another encoding, expected plain CDR");
    swap_ = bytes_[1] == 0;  // this machine is little-endian, as spm/ requires
  }

  /// Appends the values of all columns of a field to `out`. `path` names the field in errors.
  void values(const IdlType& type, const std::string& path, std::vector<std::string>& out) {
    switch (type.kind) {
      case IdlType::Kind::kStruct:
        for (const IdlType::Member& member : type.members) values(*member.type, path + "." + member.name, out);
        break;
      case IdlType::Kind::kArray:
        for (std::size_t i = 0; i < type.count; ++i) values(*type.of, path, out);
        break;
      case IdlType::Kind::kSequence: {
        std::string text;
        json(type, path, text);
        out.push_back(std::move(text));
        break;
      }
      case IdlType::Kind::kText:
        out.push_back(text(path));
        break;
      case IdlType::Kind::kNumber:
      case IdlType::Kind::kEnum:
        out.push_back(scalar(type, path));
        break;
    }
  }

  /// Appends a field as JSON.
  void json(const IdlType& type, const std::string& path, std::string& out) {
    if (out.size() > kMaxJsonBytes)
      throw SchemaError("sample, field " + path.substr(path.empty() ? 0 : 1) + ": found more than " +
                        std::to_string(kMaxJsonBytes) + " bytes of JSON, expected fewer");
    const auto list = [&](std::size_t count, char open, char close, const auto& each) {
      out += open;
      for (std::size_t i = 0; i < count; ++i) {
        if (i > 0) out += ',';
        each(i);
      }
      out += close;
    };
    switch (type.kind) {
      case IdlType::Kind::kStruct:
        list(type.members.size(), '{', '}', [&](std::size_t i) {
          out += '"' + type.members[i].name + "\":";
          json(*type.members[i].type, path + "." + type.members[i].name, out);
        });
        break;
      case IdlType::Kind::kArray:
        list(type.count, '[', ']', [&](std::size_t) { json(*type.of, path, out); });
        break;
      case IdlType::Kind::kSequence: {
        const auto count = take<std::uint32_t>(path);
        if (count > bytes_.size()) fail(path);  // every element has at least one byte
        list(count, '[', ']', [&](std::size_t) { json(*type.of, path, out); });
        break;
      }
      case IdlType::Kind::kText:
        quote(text(path), out);
        break;
      case IdlType::Kind::kEnum:
        quote(scalar(type, path), out);
        break;
      case IdlType::Kind::kNumber: {
        const std::string number = scalar(type, path);
        if (number.find('n') == std::string::npos)
          out += number;
        else  // "nan", "inf" or "-inf", which JSON does not have
          quote(number, out);
        break;
      }
    }
  }

 private:
  static constexpr std::size_t kHeadBytes = 4;  // the encapsulation

  static void quote(const std::string& text, std::string& out) {
    out += '"';
    for (const char c : text) {
      const auto code = static_cast<unsigned char>(c);
      if (c == '"' || c == '\\') out += '\\';
      if (code >= 0x20) {
        out += c;
        continue;
      }
      std::array<char, 8> escaped{};
      std::snprintf(escaped.data(), escaped.size(), "\\u%04x", code);
      out += escaped.data();
    }
    out += '"';
  }

  [[noreturn]] static void fail(const std::string& path) {
    throw SchemaError("sample ends inside field " + path.substr(path.empty() ? 0 : 1));
  }

  template <class Value>
  Value take(const std::string& path) {
    const std::size_t from = kHeadBytes + (at_ + sizeof(Value) - 1) / sizeof(Value) * sizeof(Value);
    if (from + sizeof(Value) > bytes_.size()) fail(path);
    std::array<std::uint8_t, sizeof(Value)> raw{};
    for (std::size_t i = 0; i < raw.size(); ++i) raw[i] = bytes_[from + (swap_ ? raw.size() - 1 - i : i)];
    at_ = from + sizeof(Value) - kHeadBytes;
    Value value;
    std::memcpy(&value, raw.data(), sizeof value);
    return value;
  }

  std::string text(const std::string& path) {
    const auto size = take<std::uint32_t>(path);  // with its terminating zero
    if (size == 0 || size > bytes_.size() - kHeadBytes - at_) fail(path);
    std::string value;
    for (std::uint32_t i = 0; i + 1 < size; ++i) value += static_cast<char>(bytes_[kHeadBytes + at_ + i]);
    at_ += size;
    return value;
  }

  /// Returns the number with the fewest digits that restore it.
  template <class Value>
  static std::string shortest(Value value) {
    std::array<char, 32> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return {digits.data(), end};
  }

  /// Reads a number or enumerator.
  std::string scalar(const IdlType& type, const std::string& path) {
    if (type.kind == IdlType::Kind::kEnum) {
      const auto value = take<std::uint32_t>(path);
      return value < type.names.size() ? type.names[value] : std::to_string(value);
    }
    switch (type.number) {
      case IdlType::Number::kBoolean:
        return take<std::uint8_t>(path) != 0 ? "true" : "false";
      case IdlType::Number::kU8:
        return std::to_string(take<std::uint8_t>(path));
      case IdlType::Number::kI16:
        return std::to_string(take<std::int16_t>(path));
      case IdlType::Number::kU16:
        return std::to_string(take<std::uint16_t>(path));
      case IdlType::Number::kI32:
        return std::to_string(take<std::int32_t>(path));
      case IdlType::Number::kU32:
        return std::to_string(take<std::uint32_t>(path));
      case IdlType::Number::kI64:
        return std::to_string(take<std::int64_t>(path));
      case IdlType::Number::kU64:
        return std::to_string(take<std::uint64_t>(path));
      case IdlType::Number::kFloat:
        return shortest(take<float>(path));
      case IdlType::Number::kDouble:
        return shortest(take<double>(path));
    }
    return {};
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;  // position after the encapsulation, bytes; fields are aligned relative to it
  bool swap_ = false;   // the sample is big-endian
};

IdlSchema::IdlSchema(const std::string& text) : structs_{Parser{text}.structs()} {}

const IdlType& IdlSchema::type(const std::string& name) const {
  const auto found = structs_.find(name);
  if (found == structs_.end()) throw SchemaError("IDL: found no struct " + name);
  return *found->second;
}

std::vector<std::string> IdlSchema::columns(const std::string& type) const {
  std::vector<std::string> all;
  const auto add_columns = [&](const auto& self, const IdlType& of, const std::string& path) -> void {
    if (of.kind == IdlType::Kind::kStruct)
      for (const IdlType::Member& member : of.members)
        self(self, *member.type, path.empty() ? member.name : path + "." + member.name);
    else if (of.kind == IdlType::Kind::kArray)
      for (std::size_t i = 0; i < of.count; ++i) self(self, *of.of, path + "." + std::to_string(i));
    else
      all.push_back(path);
  };
  add_columns(add_columns, this->type(type), "");
  return all;
}

std::vector<std::string> IdlSchema::values(const std::string& type, std::span<const std::uint8_t> encoded) const {
  std::vector<std::string> all;
  Decoder{encoded}.values(this->type(type), "", all);
  return all;
}

std::string IdlSchema::json(const std::string& type, std::span<const std::uint8_t> encoded) const {
  std::string text;
  Decoder{encoded}.json(this->type(type), "", text);
  return text;
}

}  // namespace tactus::trace
