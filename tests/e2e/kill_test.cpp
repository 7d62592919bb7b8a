/// Kills programs that write files, at random moments. Each file must then be absent or whole. The seed is in the
/// message of a failure.
#include <fcntl.h>

#include <fstream>
#include <iterator>
#include <random>
#include <thread>

#include "keys/authority.hpp"
#include "tests/e2e/session_test.hpp"
#include "trace/mcap.hpp"

namespace tactus::e2e {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

std::string bytes_of(const fs::path& file) {
  std::ifstream in{file, std::ios::binary};
  return {std::istreambuf_iterator<char>{in}, {}};
}

/// Returns the number of messages in a recording, which may be one in progress.
std::uint64_t messages_in(const std::string& file) {
  trace::McapReader reader{file};
  trace::McapMessage message;
  std::uint64_t messages = 0;
  while (reader.next(message)) ++messages;
  return messages;
}

class KillTest : public SessionTest {
 protected:
  /// Waits a random time, because a program may be killed at any moment.
  void wait_at_most(Seconds limit) {
    std::this_thread::sleep_for(limit * std::uniform_real_distribution{0.0, 1.0}(random_));
  }

  /// Kills the making of keys, in turn with their replacement, revocation and export, and the making of authorities.
  void kill_keys(int kills) {
    const keys::Authority authority = keys::Authority::create(path("lab-keys"));
    const auto run = [&](std::vector<std::string> arguments) { return program("keys", std::move(arguments)); };
    const auto began = Clock::now();
    Process whole{run({"add-hrtc", path("lab-keys"), "desk"})};
    ASSERT_TRUE(exits_with(0, whole));
    const Seconds duration = Clock::now() - began;
    const std::time_t now = std::time(nullptr);
    int complete = 0;
    for (int i = 0; i < kills; ++i) {
      SCOPED_TRACE("keys " + std::to_string(i) + ", seed " + std::to_string(kSeed));
      const std::string name = "new" + std::to_string(i);
      std::vector<std::string> arguments{"add-host", path("lab-keys"), name};
      if (i % 5 == 1) arguments = {"add-hrtc", path("lab-keys"), "desk", "--replace"};
      if (i % 5 == 2) arguments = {"revoke", path("lab-keys"), "desk"};
      if (i % 5 == 3) arguments = {"export", path("lab-keys"), "desk", path(name)};
      if (i % 5 == 4) arguments = {"init", path(name)};
      Process killed{run(arguments)};
      wait_at_most(1.1 * duration);
      killed.signal(SIGKILL);
      (void)killed.wait();
      for (const std::string& member : authority.names()) {
        try {
          (void)keys::read_member(authority.folder_of(member), now + 60);
        } catch (const keys::KeyError& error) {
          EXPECT_THAT(error.what(), testing::HasSubstr("is revoked"));
        }
      }
      if (i % 5 == 3 && fs::exists(path(name))) (void)keys::read_member(path(name), now + 60);
      if (i % 5 == 4 && fs::exists(path(name))) {
        keys::NewMember first;
        first.name = "first";
        (void)keys::read_member(keys::Authority{path(name)}.add(first), now + 60);
      }
      if (fs::exists(authority.folder_of(name))) ++complete;
      Process again{run({"add-hrtc", path("lab-keys"), "desk", "--replace"})};
      ASSERT_TRUE(exits_with(0, again)) << again.output();
    }
    EXPECT_TRUE(complete > 0 || kills < 100) << "none was complete, so the kills came too early";
  }

  /// Kills builds of a model, of which every second one would replace an earlier model.
  void kill_builds(int kills) {
    const std::string mesh = models().sphere + ".ply";
    const auto build = [&](const std::string& model) {
      return program("mesh", {"build", mesh, path(model), "--cell-faces", "100"});
    };
    const auto began = Clock::now();
    Process whole{build("whole.spm")};
    ASSERT_TRUE(exits_with(0, whole));
    Seconds max_wait = 1.1 * (Clock::now() - began);
    const std::string expected = bytes_of(path("whole.spm")), earlier = bytes_of(models().organ);
    const int nameless = ::open(path("").c_str(), O_TMPFILE | O_WRONLY, 0600);
    const bool has_nameless_files = nameless >= 0;  // else a killed build leaves a file with a temporary name
    if (has_nameless_files) ::close(nameless);
    int finished = 0;
    for (int i = 0; i < kills; ++i) {
      SCOPED_TRACE("build " + std::to_string(i) + ", seed " + std::to_string(kSeed));
      const fs::path model = path("model.spm");
      const bool replaces = i % 2 == 1;
      fs::remove(model);
      if (replaces) fs::copy_file(models().organ, model);
      Process killed{build("model.spm")};
      wait_at_most(max_wait);
      killed.signal(SIGKILL);
      (void)killed.wait();
      for (const auto& entry : fs::directory_iterator{model.parent_path()}) {
        const bool is_temporary = entry.path().filename().string().rfind("model.spm.", 0) == 0;
        EXPECT_FALSE(is_temporary && has_nameless_files) << entry.path();
        if (is_temporary) fs::remove(entry.path());
      }
      const std::string found = bytes_of(model);
      if (found == expected) {
        ++finished;
        // If other programs delayed the first build, the others end much sooner.
        if (finished == i + 1) max_wait /= 2;
      } else if (replaces) {
        EXPECT_TRUE(found == earlier) << found.size() << " bytes";
      } else {
        EXPECT_FALSE(fs::exists(model)) << found.size() << " bytes";
      }
    }
    EXPECT_LT(finished, kills) << "no build was killed";
  }

  /// Kills recorders of a session. Of three, the second one has written messages, and the third one is writing the index
  /// at the end of its file.
  void kill_recorders(int kills) {
    Process museum{host("museum", models().sphere)};
    Process desk{hrtc("desk")};
    ASSERT_TRUE(desk.wait_for_line("object sphere found"));
    std::uint64_t messages = 0;
    for (int i = 0; i < kills; ++i) {
      SCOPED_TRACE("recorder " + std::to_string(i) + ", seed " + std::to_string(kSeed));
      const std::string file = path("recording" + std::to_string(i) + ".mcap");
      Process killed{in_session("record", {file})};
      if (i % 3 == 1) {
        // A recorder flushes its file every second, and how long it needs to join depends on the machine.
        ASSERT_TRUE(killed.wait_for_line("recording session"));
        const auto began = Clock::now();
        while (messages_in(file) == 0 && Clock::now() - began < kWatchdog) std::this_thread::sleep_for(Seconds{0.05});
      }
      wait_at_most(Seconds{1.5});
      if (i % 3 == 2) {
        killed.signal(SIGINT);
        wait_at_most(Seconds{0.1});
      }
      killed.signal(SIGKILL);
      (void)killed.wait();
      if (!fs::exists(file)) continue;
      try {
        messages += messages_in(file);
      } catch (const trace::McapError& error) {
        ADD_FAILURE() << error.what();
      }
      fs::remove(file);
    }
    EXPECT_GT(messages, 0u);
  }

 private:
  static constexpr std::uint64_t kSeed = 20261126;
  std::mt19937_64 random_{kSeed};
};

TEST_F(KillTest, AKilledBuildLeavesTheEarlierModelOrAWholeOne) { kill_builds(4); }
TEST_F(KillTest, KilledKeysAreAbsentOrWhole) { kill_keys(10); }
TEST_F(KillTest, AKilledRecorderLeavesNoFileOrAReadableOne) { kill_recorders(4); }

using TwoHundredKills = KillTest;
TEST_F(TwoHundredKills, OfBuildsLeaveTheEarlierModelOrAWholeOne) { kill_builds(200); }
TEST_F(TwoHundredKills, LeaveKeysAbsentOrWhole) { kill_keys(200); }
TEST_F(TwoHundredKills, OfRecordersLeaveNoFileOrAReadableOne) { kill_recorders(200); }

}  // namespace
}  // namespace tactus::e2e
