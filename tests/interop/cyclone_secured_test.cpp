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

/// Only with Fast DDS 2.9: with keys, a program with version 3.1 receives nothing from Cyclone DDS; not analysed.
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
  /// Polls `condition`, because neither the log nor DDS reports the change. Returns false if the watchdog expires
  /// first.
  template <class Condition>
  [[nodiscard]] static bool holds(const Condition& condition) {
    const auto end = std::chrono::steady_clock::now() + kWatchdog;
    while (!condition()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds{10});
    }
    return true;
  }

  keys::Authority authority_ = keys::Authority::create(path("lab-keys"));
};

TEST_F(CycloneSecuredTest, AMemberOnCycloneDdsTakesPartButCannotSendInTheNameOfAnother) {
  if (*TACTUS_CYCLONE_LIAR == '\0')
    GTEST_SKIP() << "no Cyclone DDS with security plugins (Debian: cyclonedds-dev, cyclonedds-tools)";
  keys::Member desk = add("desk"), liar = add("liar");
  // The participant with the smaller GUID begins the handshake. Cyclone DDS does not understand how Fast DDS begins it.
  while (guid_of(desk) < guid_of(liar)) desk = add("desk"), liar = add("liar");
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
  const Process process{{TACTUS_CYCLONE_LIAR, session_, std::to_string(domain_.first() + 1),
                         authority_.folder_of("liar"), text_of(keys::identity_of(liar, "liar")), "liar", "museum"}};
  {
    std::unique_lock lock{mutex};
    ASSERT_TRUE(changed.wait_for(lock, kWatchdog, [&] { return !texts.empty(); })) << process.output();
  }
  const auto is_in_audit_log = [&](const std::string& event) {
    return holds([&] {
      return test_support::read_bytes(at.audit).find(R"("event":")" + event + R"(","subject":"operator liar")") !=
             std::string::npos;
    });
  };
  EXPECT_TRUE(is_in_audit_log("false sender"));
  EXPECT_TRUE(is_in_audit_log("cut off"));
  EXPECT_TRUE(holds([&] { return reader.matched() == 0; })) << "DDS still knows the member";
  const std::lock_guard lock{mutex};
  EXPECT_THAT(texts, testing::ElementsAre("the truth"));
}

}  // namespace
}  // namespace tactus::e2e
