#include "trace/idl_schema.hpp"

#include <array>
#include <cctype>
#include <charconv>
#include <cstring>
#include <utility>

namespace tactus::trace {

struct IdlSchema::Type {
  enum class Kind { kNumber, kText, kEnum, kArray, kSequence, kStruct };
  enum class Number { kBoolean, kU8, kI16, kU16, kI32, kU32, kI64, kU64, kFloat, kDouble };
  struct Member {
    std::string name;
    std::shared_ptr<const Type> type;
  };
  Kind kind = Kind::kNumber;
  Number number = Number::kU8;
  std::size_t count = 0;           // of an array
  std::shared_ptr<const Type> of;  // elements
  std::vector<std::string> names;  // enumerators
  std::vector<Member> members;
};

/// Recursive-descent parser of the IDL text.
class IdlSchema::Parser {
 public:
  using TypePtr = std::shared_ptr<const Type>;

  explicit Parser(const std::string& text) {
    split(text);
    while (at_ < tokens_.size()) definition("");
  }
  [[nodiscard]] std::map<std::string, TypePtr> structs() && { return std::move(structs_); }

 private:
  struct Token {
    std::string text;
    int line;
  };

  void split(const std::string& text) {
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
        tokens_.push_back({text.substr(i, end - i), line});
        i = end;
      }
    }
  }

  [[noreturn]] void fail(const std::string& expected) const {
    const bool end = at_ >= tokens_.size();
    const int line = end ? (tokens_.empty() ? 1 : tokens_.back().line) : tokens_[at_].line;
    throw SchemaError("IDL, line " + std::to_string(line) + ": found " +
                      (end ? "the end" : "'" + tokens_[at_].text + "'") + ", expected " + expected);
  }
  [[nodiscard]] bool is(const char* text) const { return at_ < tokens_.size() && tokens_[at_].text == text; }
  bool accept(const char* text) {
    if (!is(text)) return false;
    ++at_;
    return true;
  }
  void expect(const char* text) {
    if (!accept(text)) fail(std::string{"'"} + text + "'");
  }
  std::string word() {
    if (at_ >= tokens_.size() ||
        (std::isalpha(static_cast<unsigned char>(tokens_[at_].text[0])) == 0 && tokens_[at_].text[0] != '_'))
      fail("a name");
    return tokens_[at_++].text;
  }
  std::size_t size() {
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
  void annotations() {
    while (accept("@")) {
      (void)word();
      if (!accept("(")) continue;
      while (!accept(")")) {
        if (at_++ >= tokens_.size()) fail("')'");
      }
    }
  }

  void definition(const std::string& scope) {
    annotations();
    if (accept("module")) {
      const std::string inner = scope + word() + "::";
      expect("{");
      while (!is("}")) definition(inner);
      expect("}");
    } else if (accept("const")) {
      (void)type();
      const std::string name = word();
      expect("=");
      constants_[name] = size();
    } else if (accept("typedef")) {
      const TypePtr of = type();
      const std::string name = word();
      named_[name] = array_of(of);
    } else if (accept("enum")) {
      Type made;
      made.kind = Type::Kind::kEnum;
      const std::string name = word();
      expect("{");
      do made.names.push_back(word());
      while (accept(","));
      expect("}");
      named_[name] = std::make_shared<const Type>(std::move(made));
    } else if (accept("struct")) {
      Type made;
      made.kind = Type::Kind::kStruct;
      const std::string name = word();
      expect("{");
      while (!is("}")) {
        annotations();
        const TypePtr of = type();
        const std::string member = word();
        made.members.push_back({member, array_of(of)});
        expect(";");
      }
      expect("}");
      named_[name] = structs_[scope + name] = std::make_shared<const Type>(std::move(made));
    } else {
      fail("module, const, typedef, enum or struct");
    }
    expect(";");
  }

  TypePtr array_of(TypePtr of) {
    std::vector<std::size_t> counts;
    while (accept("[")) {
      counts.push_back(size());
      expect("]");
    }
    for (auto count = counts.rbegin(); count != counts.rend(); ++count) {
      Type made;
      made.kind = Type::Kind::kArray;
      made.count = *count;
      made.of = std::move(of);
      of = std::make_shared<const Type>(std::move(made));
    }
    return of;
  }

  static TypePtr number(Type::Number which) {
    Type made;
    made.number = which;
    return std::make_shared<const Type>(std::move(made));
  }

  TypePtr type() {
    using Number = Type::Number;
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
    Type made;
    if (accept("string")) {
      made.kind = Type::Kind::kText;
      if (accept("<")) {
        (void)size();
        expect(">");
      }
      return std::make_shared<const Type>(std::move(made));
    }
    if (accept("sequence")) {
      made.kind = Type::Kind::kSequence;
      expect("<");
      made.of = type();
      if (accept(",")) (void)size();
      expect(">");
      return std::make_shared<const Type>(std::move(made));
    }
    const auto known = at_ < tokens_.size() ? named_.find(tokens_[at_].text) : named_.end();
    if (known == named_.end()) fail("a type");
    ++at_;
    return known->second;
  }

  std::vector<Token> tokens_;
  std::size_t at_ = 0;
  std::map<std::string, std::size_t> constants_;
  std::map<std::string, TypePtr> named_;
  std::map<std::string, TypePtr> structs_;
};

/// Decodes a sample by its type.
class IdlSchema::Decoder {
 public:
  explicit Decoder(std::span<const std::uint8_t> encoded) : bytes_{encoded} {
    if (bytes_.size() < kHead || bytes_[0] != 0 || bytes_[1] > 1)
      throw SchemaError("sample: expected the encapsulation of plain CDR");
    swap_ = bytes_[1] == 0;  // this machine is little-endian, as spm/ requires
  }

  /// Appends the cells of a value; `path` names the field in errors.
  void cells(const Type& type, const std::string& path, std::vector<std::string>& out) {
    switch (type.kind) {
      case Type::Kind::kStruct:
        for (const Type::Member& member : type.members) cells(*member.type, path + "." + member.name, out);
        break;
      case Type::Kind::kArray:
        for (std::size_t i = 0; i < type.count; ++i) cells(*type.of, path, out);
        break;
      case Type::Kind::kSequence: {
        std::string text;
        json(type, path, text);
        out.push_back(std::move(text));
        break;
      }
      case Type::Kind::kText:
        out.push_back(text(path));
        break;
      case Type::Kind::kNumber:
      case Type::Kind::kEnum:
        out.push_back(plain(type, path));
        break;
    }
  }

 private:
  static constexpr std::size_t kHead = 4;

  void json(const Type& type, const std::string& path, std::string& out) {
    const auto list = [&](std::size_t count, char open, char close, const auto& each) {
      out += open;
      for (std::size_t i = 0; i < count; ++i) {
        if (i > 0) out += ',';
        each(i);
      }
      out += close;
    };
    switch (type.kind) {
      case Type::Kind::kStruct:
        list(type.members.size(), '{', '}', [&](std::size_t i) {
          out += '"' + type.members[i].name + "\":";
          json(*type.members[i].type, path + "." + type.members[i].name, out);
        });
        break;
      case Type::Kind::kArray:
        list(type.count, '[', ']', [&](std::size_t) { json(*type.of, path, out); });
        break;
      case Type::Kind::kSequence: {
        const auto count = take<std::uint32_t>(path);
        if (count > bytes_.size()) fail(path);  // every element takes at least a byte
        list(count, '[', ']', [&](std::size_t) { json(*type.of, path, out); });
        break;
      }
      case Type::Kind::kText:
        quote(text(path), out);
        break;
      case Type::Kind::kEnum:
        quote(plain(type, path), out);
        break;
      case Type::Kind::kNumber:
        out += plain(type, path);
        break;
    }
  }

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
    throw SchemaError("sample: ends in " + path.substr(path.empty() ? 0 : 1) + ", expected more bytes");
  }

  template <class Value>
  Value take(const std::string& path) {
    const std::size_t from = kHead + (at_ + sizeof(Value) - 1) / sizeof(Value) * sizeof(Value);
    if (from + sizeof(Value) > bytes_.size()) fail(path);
    std::array<std::uint8_t, sizeof(Value)> raw{};
    for (std::size_t i = 0; i < raw.size(); ++i) raw[i] = bytes_[from + (swap_ ? raw.size() - 1 - i : i)];
    at_ = from + sizeof(Value) - kHead;
    Value value;
    std::memcpy(&value, raw.data(), sizeof value);
    return value;
  }

  std::string text(const std::string& path) {
    const auto size = take<std::uint32_t>(path);  // with its terminating zero
    if (size == 0 || size > bytes_.size() - kHead - at_) fail(path);
    std::string value;
    for (std::uint32_t i = 0; i + 1 < size; ++i) value += static_cast<char>(bytes_[kHead + at_ + i]);
    at_ += size;
    return value;
  }

  template <class Value>
  static std::string shortest(Value value) {
    std::array<char, 32> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return {digits.data(), end};
  }

  std::string plain(const Type& type, const std::string& path) {
    if (type.kind == Type::Kind::kEnum) {
      const auto value = take<std::uint32_t>(path);
      return value < type.names.size() ? type.names[value] : std::to_string(value);
    }
    switch (type.number) {
      case Type::Number::kBoolean:
        return take<std::uint8_t>(path) != 0 ? "true" : "false";
      case Type::Number::kU8:
        return std::to_string(take<std::uint8_t>(path));
      case Type::Number::kI16:
        return std::to_string(take<std::int16_t>(path));
      case Type::Number::kU16:
        return std::to_string(take<std::uint16_t>(path));
      case Type::Number::kI32:
        return std::to_string(take<std::int32_t>(path));
      case Type::Number::kU32:
        return std::to_string(take<std::uint32_t>(path));
      case Type::Number::kI64:
        return std::to_string(take<std::int64_t>(path));
      case Type::Number::kU64:
        return std::to_string(take<std::uint64_t>(path));
      case Type::Number::kFloat:
        return shortest(take<float>(path));
      case Type::Number::kDouble:
        return shortest(take<double>(path));
    }
    return {};
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;  // from the end of the encapsulation, where alignment counts from
  bool swap_ = false;
};

IdlSchema::IdlSchema(const std::string& text) : types_{Parser{text}.structs()} {}
IdlSchema::~IdlSchema() = default;

std::vector<std::string> IdlSchema::columns(const std::string& type) const {
  const auto found = types_.find(type);
  if (found == types_.end()) throw SchemaError("IDL: found no struct " + type);
  std::vector<std::string> all;
  const auto add = [&](const auto& self, const Type& of, const std::string& path) -> void {
    if (of.kind == Type::Kind::kStruct)
      for (const Type::Member& member : of.members)
        self(self, *member.type, path.empty() ? member.name : path + "." + member.name);
    else if (of.kind == Type::Kind::kArray)
      for (std::size_t i = 0; i < of.count; ++i) self(self, *of.of, path + "." + std::to_string(i));
    else
      all.push_back(path);
  };
  add(add, *found->second, "");
  return all;
}

std::vector<std::string> IdlSchema::cells(const std::string& type, std::span<const std::uint8_t> encoded) const {
  const auto found = types_.find(type);
  if (found == types_.end()) throw SchemaError("IDL: found no struct " + type);
  std::vector<std::string> all;
  Decoder{encoded}.cells(*found->second, "", all);
  return all;
}

}  // namespace tactus::trace
