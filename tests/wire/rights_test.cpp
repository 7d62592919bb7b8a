#include <gtest/gtest.h>

#include <set>
#include <string>

#include "keys/documents.hpp"
#include "wire/topics.hpp"

namespace tactus::wire::test {
namespace {

TEST(Rights, EveryTopicHasAWriterAndEveryRightATopic) {
  std::set<std::string> declared, permitted;
  topics::for_each([&](const auto& topic) { declared.insert(topic.name); });
  for (const keys::Role role : keys::kRoles)
    for (const keys::WriteRight& right : keys::rights_of(role)) permitted.insert(right.topic);
  EXPECT_EQ(permitted, declared);
}

}  // namespace
}  // namespace tactus::wire::test
