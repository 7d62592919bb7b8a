/// A secured session of two members, `museum` and `desk`, with the audit logs of its programs.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "keys/authority.hpp"
#include "support.hpp"
#include "tests/support/sanitizer.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::wire::test {

using Clock = std::chrono::steady_clock;

/// Max time from a refused message to the line about it. The log writes twice a second.
inline constexpr std::chrono::milliseconds kMaxUntilLogged = 1s;

class SecuredSession : public testing::Test {
 protected:
  [[nodiscard]] std::filesystem::path audit_of(const std::string& name) const {
    return folder_.path() / (name + ".jsonl");
  }
  /// Returns whether the audit log of a program has a line with all of these texts.
  [[nodiscard]] bool has_event(const std::vector<std::string>& texts, const std::string& program = "desk") const {
    std::istringstream log{test_support::read_bytes(audit_of(program))};
    for (std::string line; std::getline(log, line);) {
      if (std::all_of(texts.begin(), texts.end(),
                      [&](const std::string& text) { return line.find(text) != std::string::npos; }))
        return true;
    }
    return false;
  }
  /// Waits for a line with this text in the audit log of `desk`.
  [[nodiscard]] bool is_in_audit_log(const std::string& text) const {
    return eventually([&] { return has_event({text}); });
  }
  /// Waits for a line with all of these texts in the audit log of a program, and expects it at most `limit` after
  /// `since`. Tests that call this are in a list of CMakeLists.txt, so that no other tests run meanwhile; a sanitizer
  /// still makes them too slow for the limit. The report of GoogleTest contains the time.
  void expect_in_audit_log(const std::vector<std::string>& texts, Clock::time_point since,
                           std::chrono::milliseconds limit = kMaxUntilLogged, const std::string& program = "desk") {
    const bool is_logged = eventually([&] { return has_event(texts, program); });
    const std::chrono::duration<double, std::milli> passed = Clock::now() - since;
    EXPECT_TRUE(is_logged) << texts.front() << " is not in the audit log:\n"
                           << test_support::read_bytes(audit_of(program));
    RecordProperty("ms_until_logged", std::to_string(passed.count()));
    if (test_support::kSanitized) return;
    EXPECT_LE(passed.count(), static_cast<double>(limit.count())) << texts.front();
  }
  [[nodiscard]] SessionAddress member(const std::string& name, keys::Role role = keys::Role::kOperator,
                                      keys::Permitted permitted = {}) const {
    keys::NewMember wanted;
    wanted.name = name;
    wanted.role = role;
    wanted.permitted = std::move(permitted);
    return with_keys(name, authority_.add(wanted));
  }
  /// The address of a program with the keys of this folder.
  [[nodiscard]] SessionAddress with_keys(const std::string& name, const std::filesystem::path& keys) const {
    SessionAddress made = address(session_, name);
    made.keys = keys;
    made.audit = audit_of(name);
    return made;
  }

  test_support::TemporaryFolder folder_;
  std::string session_ = unique_session("secured");
  keys::Authority authority_ = keys::Authority::create(folder_.path() / "lab-keys");
  Participants museum_{member("museum")}, desk_{member("desk")};
};

}  // namespace tactus::wire::test
