#include "trace/idl_schema.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>

namespace tactus::trace {
namespace {

using testing::ElementsAre;

constexpr char kText[] = R"(// A comment with struct { in it.
module a {
module b {
const unsigned long kMaxCount = 3;
typedef double Pair[2];
typedef string<kMaxCount> Short;
enum Colour { kRed, kGreen };
@final
struct Inner {
  Pair where;   // two numbers
  Colour colour;
};
struct Outer {
  @key unsigned long long id;
  boolean on;
  Inner inner;
  Short name;
  sequence<Inner, kMaxCount> more;
  float grid[2][2];
  short last;
};
};
};
)";

/// Builds plain CDR, little-endian, independently of CdrWriter.
class CdrBytes {
 public:
  template <class Value>
  CdrBytes& add(Value value) {
    while ((bytes_.size() - 4) % sizeof(Value) != 0) bytes_.push_back(0xee);  // padding may contain any byte
    const auto* const raw = reinterpret_cast<const std::uint8_t*>(&value);
    bytes_.insert(bytes_.end(), raw, raw + sizeof value);
    return *this;
  }
  CdrBytes& text(const std::string& value) {
    add(static_cast<std::uint32_t>(value.size() + 1));
    bytes_.insert(bytes_.end(), value.c_str(), value.c_str() + value.size() + 1);
    return *this;
  }
  [[nodiscard]] std::span<const std::uint8_t> bytes(std::size_t removed = 0) const {
    return {bytes_.data(), bytes_.size() - removed};
  }

 private:
  std::vector<std::uint8_t> bytes_{0, 1, 0, 0};
};

CdrBytes sample() {
  CdrBytes cdr;
  cdr.add(std::uint64_t{1} << 63).add(std::uint8_t{1});
  cdr.add(0.1).add(-2.5e-300).add(std::uint32_t{1});
  cdr.text("n\"1");
  cdr.add(std::uint32_t{1}).add(3.0).add(4.0).add(std::uint32_t{7});
  for (const float value : {1.5f, 0.1f, -0.0f, 4.0f}) cdr.add(value);
  cdr.add(std::int16_t{-2});
  return cdr;
}

TEST(IdlSchema, NamesAColumnForEachNumber) {
  EXPECT_THAT(IdlSchema{kText}.columns("a::b::Outer"),
              ElementsAre("id", "on", "inner.where.0", "inner.where.1", "inner.colour", "name", "more", "grid.0.0",
                          "grid.0.1", "grid.1.0", "grid.1.1", "last"));
}

TEST(IdlSchema, ReadsASampleIntoItsColumns) {
  EXPECT_THAT(IdlSchema{kText}.values("a::b::Outer", sample().bytes()),
              ElementsAre("9223372036854775808", "true", "0.1", "-2.5e-300", "kGreen", "n\"1",
                          R"([{"where":[3,4],"colour":"7"}])", "1.5", "0.1", "-0", "4", "-2"));
}

TEST(IdlSchema, WritesASampleAsJson) {
  EXPECT_EQ(IdlSchema{kText}.json("a::b::Outer", sample().bytes()),
            R"({"id":9223372036854775808,"on":true,"inner":{"where":[0.1,-2.5e-300],"colour":"kGreen"},"name":"n\"1",)"
            R"("more":[{"where":[3,4],"colour":"7"}],"grid":[[1.5,0.1],[-0,4]],"last":-2})");
}

TEST(IdlSchema, WritesNumbersThatAreNotFiniteAsStringsOfJson) {
  CdrBytes cdr;
  cdr.add(std::numeric_limits<double>::quiet_NaN()).add(-std::numeric_limits<double>::infinity()).add(0u);
  EXPECT_EQ(IdlSchema{kText}.json("a::b::Inner", cdr.bytes()), R"({"where":["nan","-inf"],"colour":"kRed"})");
}

TEST(IdlSchema, RefusesASampleThatIsTruncatedAnywhere) {
  const IdlSchema schema{kText};
  const CdrBytes complete = sample();
  for (std::size_t removed = 1; removed <= complete.bytes().size(); ++removed)
    EXPECT_THAT([&] { (void)schema.values("a::b::Outer", complete.bytes(removed)); },
                testing::ThrowsMessage<SchemaError>(testing::StartsWith(
                    removed + 4 <= complete.bytes().size() ? "sample ends inside field" : "sample: found another")))
        << removed;
}

TEST(IdlSchema, RefusesImpossibleCountsBeforeAllocating) {
  CdrBytes cdr;
  cdr.add(std::uint64_t{1}).add(std::uint8_t{1}).add(0.1).add(0.1).add(std::uint32_t{1}).text("x").add(0xffffffffu);
  EXPECT_THROW((void)IdlSchema{kText}.values("a::b::Outer", cdr.bytes()), SchemaError);
}

/// Returns the error of a text; empty if the text is valid.
std::string refusal(const std::string& text) {
  try {
    const IdlSchema schema{text};
  } catch (const SchemaError& error) {
    return error.what();
  }
  return "";
}

std::string repeated(const std::string& text, int count) {
  std::string all;
  for (int i = 0; i < count; ++i) all += text;
  return all;
}

/// Structs S0 to S39, each with `members` of the one before.
std::string nested_structs(int members) {
  std::string text = "struct S0 { octet m0; };\n";
  for (int i = 1; i < 40; ++i) {
    text += "struct S" + std::to_string(i) + " {";
    for (int m = 0; m < members; ++m) text += " S" + std::to_string(i - 1) + " m" + std::to_string(m) + ";";
    text += " };\n";
  }
  return text;
}

TEST(IdlSchema, LimitsTheDepthOfModulesAndTypes) {
  EXPECT_EQ(refusal(repeated("module a { ", 31) + "struct S { octet x; };" + repeated(" };", 31)), "");
  EXPECT_EQ(refusal(repeated("module a{", 100'000)), "IDL, line 1: found 'module', expected at most 31 nested modules");
  EXPECT_EQ(refusal("struct S { " + repeated("sequence<", 100'000)),
            "IDL, line 1: found 'sequence', expected at most 32 nested types");
  EXPECT_EQ(refusal(nested_structs(1)), "IDL, line 32: found 33 nested types, expected at most 32");
  EXPECT_EQ(refusal("struct S { octet x" + repeated("[1]", 40) + "; };"),
            "IDL, line 1: found 33 nested types, expected at most 32");
}

TEST(IdlSchema, LimitsTheValuesOfAType) {
  const std::string error =
      "IDL, line 1: found a type of too many values, expected at most 65536 with their enumerators";
  EXPECT_EQ(IdlSchema{"struct S { octet x[256][256]; };"}.columns("S").size(), 65'536u);
  EXPECT_EQ(refusal("struct S { octet x[256][257]; };"), error);
  EXPECT_EQ(refusal("struct S { octet x[4000000000]; };"), error);
  EXPECT_EQ(refusal("struct S { octet x[65536]; octet y; };"), error);
  EXPECT_EQ(refusal("typedef octet A[40000]; struct S { sequence<A> x; sequence<A> y; };"), error);
  EXPECT_THAT(refusal(nested_structs(2)), testing::EndsWith("expected at most 65536 with their enumerators"));
  EXPECT_EQ(refusal("struct S { octet " + repeated("x", 300) + "; };"),
            "IDL, line 1: found a name of 300 bytes, expected at most 255");
}

TEST(IdlSchema, RefusesTypesWithoutValues) {
  EXPECT_EQ(refusal("struct S { };"), "IDL, line 1: found '}', expected a type");
  EXPECT_EQ(refusal("struct S { octet x[2][0]; };"), "IDL, line 1: found an array of 0 elements, expected at least 1");
  EXPECT_EQ(refusal("typedef octet Z[0]; struct S { sequence<Z> z; };"),
            "IDL, line 1: found an array of 0 elements, expected at least 1");
}

TEST(IdlSchema, RefusesInvalidTextWithTheNumberOfTheLine) {
  EXPECT_EQ(refusal("module a {\nstruct B {\n  what x;\n};\n};\n"), "IDL, line 3: found 'what', expected a type");
  EXPECT_EQ(refusal("module a {"), "IDL, line 1: found the end, expected module, const, typedef, enum or struct");
  EXPECT_EQ(refusal("struct A { double x[k]; };"), "IDL, line 1: found 'k', expected a number");
  EXPECT_THROW((void)IdlSchema{kText}.columns("a::b::Nothing"), SchemaError);
}

}  // namespace
}  // namespace tactus::trace
