/// Helpers of the tests of whole sessions: models, the commands that start programs in the session of a test, and an
/// observer that records the published samples. Most sessions have a host "museum", an HRTC "desk" and a user "ann".
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <condition_variable>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/test_domain.hpp"
#include "wire/endpoints.hpp"

namespace tactus::e2e {

/// Numbers of the probe states of one user that arrived after the last call of `Observer::forget_states`.
struct StateCounts {
  std::uint64_t count = 0;
  std::uint64_t in_contact = 0;
  std::uint64_t exact = 0;  ///< states in contact and exact
  std::uint64_t faults = 0;
  session::ProbeState last;
};

/// A participant of the session that records received samples. A test may use `participants` to send other samples.
class Observer {
 public:
  explicit Observer(const wire::SessionAddress& address);

  /// The content of all received samples.
  struct Seen {
    std::map<std::string, session::RosterEntry> roster;            ///< newest entry, by participant
    std::map<std::string, std::map<std::string, double>> figures;  ///< newest value, by participant and figure
    std::map<std::string, std::uint64_t> metrics;                  ///< number of metrics samples, by participant
    std::map<std::string, std::vector<session::MeshHash>> meshes;  ///< all mesh hashes in order, by participant
    std::map<std::uint64_t, StateCounts> states;                   ///< by user id

    [[nodiscard]] bool is_present(const std::string& name) const;
    [[nodiscard]] bool has_left(const std::string& name) const;
    [[nodiscard]] std::uint64_t metrics_count(const std::string& name) const;
    /// The newest value of a figure; -1 if the participant has not published the figure.
    [[nodiscard]] double figure(const std::string& participant, const std::string& name) const;
    [[nodiscard]] StateCounts user(const std::string& name) const;
  };

  /// Waits until `condition` holds. Returns false if `limit` passes first.
  [[nodiscard]] bool until(const std::function<bool(const Seen&)>& condition,
                           std::chrono::milliseconds limit = kWatchdog);
  [[nodiscard]] Seen seen() const;
  void forget_states();

  [[nodiscard]] wire::Participants& participants() { return participants_; }

 private:
  template <class Sample>
  auto callback(void (Observer::*record)(const Sample&)) {
    return [this, record](Sample&& sample) {
      const std::lock_guard lock{mutex_};
      (this->*record)(sample);
      changed_.notify_all();
    };
  }
  void on_roster(const session::RosterEntry& entry);
  void on_metrics(const session::Metrics& metrics);
  void on_state(const session::ProbeState& state);

  wire::Participants participants_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Seen seen_;
  std::map<std::uint64_t, std::string> names_;  // by participant id
  // The readers are the last members, so that they are destroyed first: their callbacks use the other members.
  wire::Reader<session::RosterEntry> roster_;
  wire::Reader<session::Metrics> metrics_;
  wire::Reader<session::ProbeState> states_;
};

/// The models `organ.spm` and `sphere.spm` of about 20,000 faces with small regions. tactus-mesh builds them once for
/// all tests of a test program.
struct Models {
  Models();
  test_support::TemporaryFolder folder;
  std::string organ = (folder.path() / "organ.spm").string();
  std::string sphere = (folder.path() / "sphere.spm").string();
};
const Models& models();

/// Each test has its own session and temporary folder. Two tests seldom have the same domains.
class SessionTest : public ::testing::Test {
 protected:
  SessionTest();

  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  std::string write(const std::string& name, const std::string& text) const;

  /// The command of the program `tactus-NAME` with these arguments and no others.
  [[nodiscard]] static std::vector<std::string> program(const std::string& name, std::vector<std::string> arguments);
  /// Like `program`, with the session and the domain of this test.
  [[nodiscard]] std::vector<std::string> in_session(const std::string& name, std::vector<std::string> arguments) const;
  [[nodiscard]] std::vector<std::string> host(const std::string& name, const std::string& model) const;
  /// An HRTC without deadband coding: it sends every probe state, so that tests can count them.
  [[nodiscard]] std::vector<std::string> hrtc(const std::string& name,
                                              const std::vector<std::string>& options = {}) const;
  /// An HRTC with deadband coding.
  [[nodiscard]] std::vector<std::string> coding_hrtc(const std::string& name) const;
  /// Simulated users that follow `scenario`, a text in YAML.
  [[nodiscard]] std::vector<std::string> sim(const std::string& scenario,
                                             const std::vector<std::string>& options = {}) const;
  [[nodiscard]] wire::SessionAddress address(const std::string& participant) const;

  test_support::TemporaryFolder folder_;
  test_support::TestDomain domain_;
  std::string session_;
};

/// A scenario in which user ann touches the first object for 2 s.
inline constexpr char kOneTouch[] = R"(name: one touch
duration: 30
users:
  - name: ann
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 2, force: 1}}]
)";

/// Succeeds if the process exits with `status` before the watchdog expires, and no other process of its group remains.
testing::AssertionResult exits_with(int status, Process& process);

}  // namespace tactus::e2e
