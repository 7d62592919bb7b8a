/// tactus-host as a process: exit codes, messages, signals.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "spm/offline/generate.hpp"
#include "spm/offline/write_mesh.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/test_domain.hpp"

namespace tactus::host_service {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using Clock = std::chrono::steady_clock;

class HostProgramTest : public testing::Test {
 protected:
  HostProgramTest() { spm::offline::write_mesh(model_, spm::offline::generate(spm::offline::Shape::kSphere, 400)); }
  ~HostProgramTest() override {
    if (pid_ <= 0) return;
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }

  /// Starts the program in a Tactus session that no other process uses. Its output goes to a file.
  void start(std::vector<std::string> arguments) {
    std::filesystem::remove(output_);
    std::vector<std::string> all{TACTUS_HOST, "--cache", (folder_.path() / "cache").string(), "--session",
                                 "test.program." + std::to_string(getpid())};
    if (std::find(arguments.begin(), arguments.end(), "--domain") == arguments.end()) {
      all.insert(all.end(), {"--domain", std::to_string(test_support::test_domain())});
    }
    all.insert(all.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& argument : all) argv.push_back(argument.data());
    argv.push_back(nullptr);
    pid_ = fork();
    if (pid_ != 0) return;
    const int out = open(output_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(out, STDOUT_FILENO);
    dup2(out, STDERR_FILENO);
    execv(argv[0], argv.data());
    _exit(127);
  }
  /// Waits for the end of the program. Returns its exit code, or 128 plus the signal.
  int wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  int run(std::vector<std::string> arguments) {
    start(std::move(arguments));
    return wait();
  }
  std::string output() const { return test_support::read_bytes(output_); }
  /// Waits until the output contains `text`. Returns false after 20 s.
  bool prints(const std::string& text) const {
    for (const auto end = Clock::now() + 20s; Clock::now() < end; std::this_thread::yield()) {
      if (output().find(text) != std::string::npos) return true;
    }
    return false;
  }

  test_support::TemporaryFolder folder_;
  std::string model_ = (folder_.path() / "sphere.ply").string();
  std::string output_ = (folder_.path() / "output").string();
  pid_t pid_ = 0;
};

TEST_F(HostProgramTest, ASignalEndsTheHostWithExitCodeZero) {
  for (const int signal : {SIGINT, SIGTERM}) {
    start({"--name", "h", model_});
    ASSERT_TRUE(prints("is in session")) << output();
    kill(pid_, signal);

    EXPECT_EQ(wait(), 0) << output();

    EXPECT_THAT(output(), HasSubstr("left the session"));
  }
}

TEST_F(HostProgramTest, OptionsWithSeveralValuesDoNotConsumeTheModelAfterThem) {
  for (const std::vector<std::string>& option :
       {std::vector<std::string>{"--at", "0.5", "0", "0"}, std::vector<std::string>{"--peer", "127.0.0.1"},
        std::vector<std::string>{"--discovery-server", "127.0.0.1"}}) {
    std::vector<std::string> arguments{"--name", "h"};
    arguments.insert(arguments.end(), option.begin(), option.end());
    arguments.push_back(model_);
    start(arguments);
    EXPECT_TRUE(prints("is in session")) << option.front() << ": " << output();
    kill(pid_, SIGINT);
    EXPECT_EQ(wait(), 0) << output();
  }
}

TEST_F(HostProgramTest, WrongInputGivesExitCodeTwoAndNamesTheInput) {
  EXPECT_EQ(run({"--colour", "red", model_}), 2);
  EXPECT_THAT(output(), HasSubstr("--colour"));
  EXPECT_EQ(run({"missing.spm"}), 2);
  EXPECT_THAT(output(), HasSubstr("missing.spm"));
  EXPECT_EQ(run({}), 2);
  EXPECT_THAT(output(), HasSubstr("no model"));
  EXPECT_EQ(run({"--domain", "900", model_}), 2);
  EXPECT_THAT(output(), HasSubstr("domain 900"));
  EXPECT_EQ(run({"--name", std::string(70, 'x'), model_}), 2);
  EXPECT_EQ(run({"--qos", "/nowhere", model_}), 2);
  EXPECT_THAT(output(), HasSubstr("/nowhere"));
  const std::string config = (folder_.path() / "bad.yaml").string();
  test_support::write_bytes(config, "objects:\n  - modell: x\n");
  EXPECT_EQ(run({"--config", config}), 2);
  EXPECT_THAT(output(), HasSubstr("bad.yaml:2:5: objects[0]: unknown key 'modell'"));
  test_support::write_bytes(config, "objects:\n  - {model: sphere.ply, name: \"a\\tb\"}\n");
  EXPECT_EQ(run({"--config", config}), 2);
  EXPECT_THAT(output(), HasSubstr("has a control character"));
}

TEST_F(HostProgramTest, HelpHasExamples) {
  EXPECT_EQ(run({"--help"}), 0);
  EXPECT_THAT(output(), HasSubstr("Examples:"));
}

}  // namespace
}  // namespace tactus::host_service
