#include "ros2/names.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <regex>
#include <set>

namespace tactus::ros2 {
namespace {

TEST(Ros2NamesTest, LettersDigitsAndSingleUnderscoresStay) { EXPECT_EQ(ros_name("ann_B2"), "ann_B2"); }

TEST(Ros2NamesTest, OtherBytesBecomeGroups) {
  EXPECT_EQ(ros_name("ann 2"), "annqx_202");
  EXPECT_EQ(ros_name("7up"), "qx_37up");
  EXPECT_EQ(ros_name("_a__b"), "qx_5fa_qx_5fb");
  EXPECT_EQ(ros_name("view.guest"), "viewqx_2eguest");
}

TEST(Ros2NamesTest, AQThatWouldBeginAGroupIsWrittenAsOne) { EXPECT_EQ(ros_name("tqx_ab"), "tqx_71x_ab"); }

TEST(Ros2NamesTest, UsualNamesWithNumbersStayAsTheyAre) {
  for (const char* name : {"max_01", "box_10", "x_20"}) EXPECT_EQ(ros_name(name), name);
}

TEST(Ros2NamesTest, APartThatNoNameGivesHasNoName) {
  for (const char* part : {"", "7", "_a", "a__b", "qx_61", "a-b"}) EXPECT_EQ(name_of(part), std::nullopt) << part;
}

TEST(Ros2NamesTest, EachNameHasAValidPartOfItsOwnWhichGivesTheNameBack) {
  std::mt19937 random{7};
  constexpr std::string_view kBytes = "qx_0a2A. \xc3";
  const std::regex valid{"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*_?"};
  std::set<std::string> names, parts;
  for (int i = 0; i < 20000; ++i) {
    std::string name;
    for (auto left = 1 + random() % 7; left > 0; --left) name += kBytes[random() % kBytes.size()];
    names.insert(name);
  }
  for (const std::string& name : names) {
    const std::string part = ros_name(name);
    ASSERT_TRUE(std::regex_match(part, valid)) << name << ": " << part;
    ASSERT_TRUE(parts.insert(part).second) << name << ": " << part;
    ASSERT_EQ(name_of(part), name) << part;
  }
}

}  // namespace
}  // namespace tactus::ros2
