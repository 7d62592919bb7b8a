#include "session/status_names.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <regex>

#include "session/messages.hpp"

namespace tactus::session {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

TEST(StatusNames, NamesEachSetBit) {
  EXPECT_THAT(status_names(0), IsEmpty());
  EXPECT_THAT(status_names(kInContact | kExact | kTargetsDropped),
              ElementsAre("kInContact", "kExact", "kTargetsDropped"));
  EXPECT_THAT(status_names(1u << 14 | 1u << 31), ElementsAre("bit 14", "bit 31"));
}

TEST(StatusNames, OmitsTheReasonOfAFault) {
  EXPECT_THAT(status_names(kFault | 4u << kFaultReasonShift), ElementsAre("kFault"));
  EXPECT_THAT(status_names(4u << kFaultReasonShift), ElementsAre("bit 26")) << "no fault, so no reason";
}

TEST(StatusNames, AreThoseOfTheReferencePage) {
  std::ifstream page{TACTUS_SOURCES "/docs/reference/status-bits.md"};
  const std::regex row{R"(\| (\d+) \| `(k\w+)` \|.*)"};
  unsigned rows = 0;
  std::smatch found;
  for (std::string line; std::getline(page, line);) {
    if (!std::regex_match(line, found, row)) continue;
    EXPECT_THAT(status_names(1u << std::stoul(found[1])), ElementsAre(found[2].str()));
    ++rows;
  }
  EXPECT_EQ(rows, 14u);
}

}  // namespace
}  // namespace tactus::session
