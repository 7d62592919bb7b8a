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

TEST(IdlSchema, RefusesInvalidTextWithTheNumberOfTheLine) {
  const auto refusal = [](const std::string& text) -> std::string {
    try {
      const IdlSchema schema{text};
    } catch (const SchemaError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal("module a {\nstruct B {\n  what x;\n};\n};\n"), "IDL, line 3: found 'what', expected a type");
  EXPECT_EQ(refusal("module a {"), "IDL, line 1: found the end, expected module, const, typedef, enum or struct");
  EXPECT_EQ(refusal("struct A { double x[k]; };"), "IDL, line 1: found 'k', expected a number");
  EXPECT_THROW((void)IdlSchema{kText}.columns("a::b::Nothing"), SchemaError);
}

}  // namespace
}  // namespace tactus::trace
