/// Runs tactus-link as a user would.
#include <gmock/gmock.h>
#include <unistd.h>

#include <filesystem>
#include <thread>

#include "netem/pair.hpp"
#include "tests/support/process.hpp"

namespace tactus::netem {
namespace {

using e2e::Process;
using namespace std::chrono_literals;
using testing::HasSubstr;
using Arguments = std::vector<std::string>;

Arguments link(Arguments arguments) {
  arguments.insert(arguments.begin(), TACTUS_LINK);
  return arguments;
}

/// Number of namespaces that process `pid` has made.
int namespaces_of(pid_t pid) {
  int count = 0;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator{"/run/netns", error})
    if (entry.path().filename().string().rfind("tactus-link-" + std::to_string(pid) + "-", 0) == 0) ++count;
  return count;
}

class LinkProgram : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string reason = missing_privilege(); !reason.empty()) GTEST_SKIP() << reason;
  }
};

TEST_F(LinkProgram, EndsWithTheStatusOfTheSecondCommandAndStopsTheFirst) {
  Process run{link({"run", "--", "sleep", "1000", "--", "sh", "-c", "exit 7"})};
  EXPECT_EQ(run.wait(), 7);
  EXPECT_TRUE(run.left_nothing_running());
  EXPECT_EQ(namespaces_of(run.pid()), 0);
}

TEST_F(LinkProgram, EndsWithTheStatusOfTheFirstCommandWhenThatFails) {
  Process run{link({"run", "--", "sh", "-c", "exit 3", "--", "sleep", "1000"})};
  EXPECT_EQ(run.wait(), 3);
}

TEST_F(LinkProgram, WaitsForTheSecondCommandWhenTheFirstHasEnded) {
  Process run{link({"run", "--", "true", "--", "sh", "-c", "sleep 0.3; echo over; exit 0"})};
  EXPECT_EQ(run.wait(), 0);
  EXPECT_THAT(run.output(), HasSubstr("over"));
}

TEST_F(LinkProgram, KillsACommandThatIgnoresSignals) {
  Process run{link({"run", "--", "sh", "-c", "trap '' INT TERM; while :; do sleep 1; done", "--", "sleep", "0.5"})};
  EXPECT_EQ(run.wait(), 0);
}

TEST_F(LinkProgram, NamesACommandThatCannotBeRun) {
  Process run{link({"run", "--", "sleep", "1000", "--", "no-such-command"})};
  EXPECT_EQ(run.wait(), 127);
  EXPECT_THAT(run.output(), HasSubstr("no-such-command: cannot be run here"));
}

TEST_F(LinkProgram, StopsBothCommandsAndRemovesItsNamespacesOnASignal) {
  for (const int signal : {SIGINT, SIGTERM}) {
    Process run{link({"run", "--", "sh", "-c", "echo started; exec sleep 1000", "--", "sleep", "1000"})};
    ASSERT_TRUE(run.wait_for_line("started"));
    EXPECT_EQ(namespaces_of(run.pid()), 2);
    run.signal(signal);
    EXPECT_EQ(run.wait(), 130);
    EXPECT_EQ(namespaces_of(run.pid()), 0);
  }
}

TEST_F(LinkProgram, EndsItsCommandsWhenKilledAndTheNextRunRemovesItsNamespaces) {
  std::optional<Process> run;
  run.emplace(link({"run", "--", "sh", "-c", "echo pid $$; exec sleep 1000", "--", "sleep", "1000"}));
  ASSERT_TRUE(run->wait_for_line("pid [0-9]"));
  const std::string output = run->output();
  const pid_t command = std::stoi(output.substr(output.find("pid ") + 4)), killed = run->pid();
  run->signal(SIGKILL);
  ASSERT_EQ(run->wait(), 128 + SIGKILL);
  run.reset();  // a zombie would count as a program that uses its namespaces
  while (::kill(command, 0) == 0 && std::filesystem::exists("/proc/" + std::to_string(command) + "/exe")) {
  }
  Process next{link({"run", "--", "true", "--", "true"})};
  EXPECT_EQ(next.wait(), 0);
  while (namespaces_of(killed) != 0) std::this_thread::yield();  // ctest's timeout fails the test otherwise
}

TEST_F(LinkProgram, UpPrintsTheCommandToEnterANamespaceAndEndsOnInterrupt) {
  Process up{link({"up", "--profile", "P6a"})};
  ASSERT_TRUE(up.wait_for_line("nsenter --net=/run/netns/tactus-link-[0-9]+-b"));
  up.signal(SIGINT);
  EXPECT_EQ(up.wait(), 0);
  EXPECT_EQ(namespaces_of(up.pid()), 0);
}

TEST(LinkProgramAnywhere, NamesTheWrongInput) {
  const auto refused = [](Arguments arguments, const char* part) {
    Process run{link(std::move(arguments))};
    EXPECT_EQ(run.wait(), 2);
    EXPECT_THAT(run.output(), HasSubstr(part));
  };
  refused({"run", "--profile", "P77", "--", "true", "--", "true"}, "no link 'P77'; expected veth, P0");
  refused({"run", "--", "true"}, "found 1 command, expected two");
  refused({"run", "--profile", "P0:jitter=5", "--", "true", "--", "true"}, "jitter, ms, is 5; expected 0 to 0");
  refused({"run", "--profil", "P5", "--", "true", "--", "true"}, "--profil");
  refused({}, "subcommand");
}

TEST(LinkProgramAnywhere, NamesMissingPrivilegesAndTheRemedy) {
  Arguments command = link({"run", "--", "true", "--", "true"});
  if (::geteuid() == 0) {
    for (const char* word : {"--clear-groups", "65534", "--reuid", "/usr/bin/setpriv"})
      command.insert(command.begin(), word);
  } else if (missing_privilege().empty()) {
    GTEST_SKIP() << "not root, but with the privileges that should be missing";
  }
  Process run{command};
  EXPECT_EQ(run.wait(), 2);
  EXPECT_THAT(run.output(), HasSubstr("need root (CAP_SYS_ADMIN and CAP_NET_ADMIN)"));
}

TEST(LinkProgramAnywhere, ListsEveryNamedLink) {
  Process list{link({"list"})};
  EXPECT_EQ(list.wait(), 0);
  for (const NamedLink& named : kNamedLinks) EXPECT_THAT(list.output(), HasSubstr(named.name));
}

}  // namespace
}  // namespace tactus::netem
