/// A secured session with a member that uses another implementation of DDS, and its own security plugins.
#include <condition_variable>
#include <mutex>
#include <set>
#include <thread>

#include "keys/authority.hpp"
#include "keys/identity.hpp"
#include "tests/e2e/session_test.hpp"
#include "wire/endpoints.hpp"

#ifndef TACTUS_CYCLONE_LIAR
#define TACTUS_CYCLONE_LIAR ""
#endif

namespace tactus::e2e {
namespace {

class CycloneSecuredTest : public SessionTest {
 protected:
  [[nodiscard]] keys::Member add(const std::string& name) const {
    keys::NewMember member;
    member.name = name;
    member.role = keys::Role::kOperator;
    member.replaces = true;
    return keys::read_member(authority_.add(member), std::time(nullptr));
  }
  [[nodiscard]] static keys::GuidBegin guid_of(const keys::Member& member) {
    return keys::guid_begin_of(member.group, keys::identity_of(member, member.name));
  }
  /// Polls `condition`, because neither the log nor DDS reports the change. Returns false if `limit` passes first.
  template <class Condition>
  [[nodiscard]] static bool holds_within(std::chrono::milliseconds limit, const Condition& condition) {
    const auto end = std::chrono::steady_clock::now() + limit;
    while (!condition()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds{10});
    }
    return true;
  }

  keys::Authority authority_ = keys::Authority::create(path("lab-keys"));
};

TEST_F(CycloneSecuredTest, AMemberOnCycloneDdsTakesPartButCannotSendInTheNameOfAnother) {
  if (*TACTUS_CYCLONE_LIAR == '\0') GTEST_SKIP() << "no Cyclone DDS (Debian: cyclonedds-dev, cyclonedds-tools)";
  const keys::Member desk = add("desk");
  keys::Member liar = add("liar");
  // The participant with the smaller GUID begins the handshake. Cyclone DDS does not understand how Fast DDS begins it.
  while (guid_of(desk) < guid_of(liar)) liar = add("liar");
  wire::SessionAddress at = address("desk");
  at.keys = authority_.folder_of("desk");
  at.audit = path("desk.jsonl");
  wire::Participants participants{at};
  std::mutex mutex;
  std::condition_variable changed;
  std::set<std::string> texts;
  const wire::Reader<session::EmergencyStop> reader{participants, wire::topics::kStop,
                                                    [&](session::EmergencyStop&& stop) {
                                                      const std::lock_guard lock{mutex};
                                                      EXPECT_EQ(stop.origin.participant, session::id_of("liar"));
                                                      if (texts.insert(stop.text).second) changed.notify_all();
                                                    }};
  const Process process{{TACTUS_CYCLONE_LIAR, session_, std::to_string(domain_ + 1), authority_.folder_of("liar"),
                         text_of(keys::identity_of(liar, "liar")), "liar", "museum"}};
  {
    std::unique_lock lock{mutex};
    ASSERT_TRUE(changed.wait_for(lock, kWatchdog, [&] { return !texts.empty(); })) << process.output();
  }
  const auto is_in_audit_log = [&](const std::string& event, std::chrono::milliseconds limit) {
    return holds_within(limit, [&] {
      return test_support::read_bytes(at.audit).find(R"("event":")" + event + R"(","subject":"operator liar")") !=
             std::string::npos;
    });
  };
  EXPECT_TRUE(is_in_audit_log("false sender", std::chrono::seconds{1}));
  EXPECT_TRUE(is_in_audit_log("cut off", kWatchdog));
  EXPECT_TRUE(holds_within(kWatchdog, [&] { return reader.matched() == 0; })) << "DDS still knows the member";
  const std::lock_guard lock{mutex};
  EXPECT_THAT(texts, testing::ElementsAre("the truth"));
}

}  // namespace
}  // namespace tactus::e2e
