/// What the tests of whole sessions share: models, programs that meet in a session of the test's own, and an observer
/// that sees what they publish.
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
#include "wire/endpoints.hpp"

namespace tactus::e2e {

/// The probe states of one user since `Observer::forget_states`.
struct SeenStates {
  std::uint64_t count = 0;
  std::uint64_t in_contact = 0;
  std::uint64_t exact = 0;  ///< in contact and exact
  std::uint64_t faults = 0;
  session::ProbeState last;
};

/// A participant of the session that only looks; samples of its own it sends when a test needs crafted ones.
class Observer {
 public:
  explicit Observer(const wire::SessionAddress& address);

  /// Everything seen, as `until` shows it.
  struct Seen {
    std::map<std::string, session::RosterEntry> roster;            ///< newest by name
    std::map<std::string, std::map<std::string, double>> figures;  ///< by participant, then figure
    std::map<std::string, std::uint64_t> metrics;                  ///< samples by participant
    std::map<std::string, std::vector<session::MeshHash>> meshes;  ///< all that a participant published, in order
    std::map<std::uint64_t, SeenStates> states;                    ///< by user id

    [[nodiscard]] bool is_here(const std::string& name) const;
    [[nodiscard]] bool has_left(const std::string& name) const;
    [[nodiscard]] std::uint64_t metrics_of(const std::string& name) const;
    [[nodiscard]] double figure(const std::string& participant, const std::string& name) const;
    [[nodiscard]] SeenStates user(const std::string& name) const;
  };

  /// Waits until `condition` holds; false when the watchdog bites first.
  [[nodiscard]] bool until(const std::function<bool(const Seen&)>& condition,
                           std::chrono::milliseconds limit = kWatchdog);
  [[nodiscard]] Seen seen() const;
  void forget_states();

  [[nodiscard]] wire::Participants& participants() { return participants_; }

 private:
  template <class Sample>
  auto keep(void (Observer::*take)(const Sample&)) {
    return [this, take](Sample&& sample) {
      const std::lock_guard lock{mutex_};
      (this->*take)(sample);
      news_.notify_all();
    };
  }
  void on_roster(const session::RosterEntry& entry);
  void on_metrics(const session::Metrics& metrics);
  void on_state(const session::ProbeState& state);

  wire::Participants participants_;
  mutable std::mutex mutex_;
  std::condition_variable news_;
  Seen seen_;
  std::map<std::uint64_t, std::string> names_;
  wire::Reader<session::RosterEntry> roster_;  // last, so that no callback outlives what it fills
  wire::Reader<session::Metrics> metrics_;
  wire::Reader<session::ProbeState> states_;
};

/// `organ.spm` and `sphere.spm` of some 20,000 faces in small regions, made once by tactus-mesh.
struct Models {
  Models();
  test_support::TemporaryFolder folder;
  std::string organ = (folder.path() / "organ.spm").string();
  std::string sphere = (folder.path() / "sphere.spm").string();
};
const Models& models();

/// Each test has a session and domains of its own.
class SessionTest : public ::testing::Test {
 protected:
  SessionTest();

  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  std::string write(const std::string& name, const std::string& text) const;

  /// A program of ours with these arguments and no others.
  [[nodiscard]] static std::vector<std::string> program(const std::string& name, std::vector<std::string> arguments);
  /// The same with the session and the domain of this test.
  [[nodiscard]] std::vector<std::string> in_session(const std::string& name, std::vector<std::string> arguments) const;
  [[nodiscard]] std::vector<std::string> host(const std::string& name, const std::string& model) const;
  /// One that sends every probe state: tests count them.
  [[nodiscard]] std::vector<std::string> hrtc(const std::string& name,
                                              const std::vector<std::string>& further = {}) const;
  /// One that follows the scenario `text`.
  [[nodiscard]] std::vector<std::string> sim(const std::string& text,
                                             const std::vector<std::string>& further = {}) const;
  [[nodiscard]] wire::SessionAddress address(const std::string& participant) const;

  test_support::TemporaryFolder folder_;
  int domain_;
  std::string session_;
};

/// Ends so within the watchdog's time, and leaves nothing running.
testing::AssertionResult ends_with(int status, Process& process);

}  // namespace tactus::e2e
