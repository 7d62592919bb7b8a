/// Starts tactus-latency as a user does: with both sides on this machine, with an emulated link between them, and with
/// a second process, `tactus-latency serve`, as the other side.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "latency/test_case.hpp"
#include "netem/pair.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/test_domain.hpp"
#include "wire/footprint.hpp"

namespace tactus::latency {
namespace {

using e2e::Process;
using namespace std::chrono_literals;
using testing::HasSubstr;
using Words = std::vector<std::string>;

class LatencyRun : public testing::Test {
 protected:
  static Words command_line(const std::string& command, Words options) {
    Words words{TACTUS_LATENCY, command};
    // Plain Fast DDS ends at some of the datagrams that other tests send to all ports of their own domains.
    if (command == "run") words.insert(words.end(), {"--domain", std::to_string(test_support::test_domain())});
    words.insert(words.end(), options.begin(), options.end());
    return words;
  }
  /// Runs short tests at 200 Hz and returns the content of their JSON file: a cell for each test.
  nlohmann::json run(Words options) {
    const std::string json = path("figures.json"), html = path("page.html");
    Words words = command_line("run", {"--seconds", "1.5", "--rate", "200", "--json", json, "--html", html});
    words.insert(words.end(), options.begin(), options.end());
    Process process{words};
    EXPECT_EQ(process.wait(60s), 0) << process.output();
    EXPECT_THAT(test_support::read_bytes(html), HasSubstr("<svg"));
    const std::string text = test_support::read_bytes(json);
    return text.empty() ? nlohmann::json{} : nlohmann::json::parse(text);
  }
  static void expect_plausible(const nlohmann::json& cell) {
    const auto expected = cell.at("expected").get<std::uint64_t>();
    EXPECT_EQ(expected, 240u * cell.at("readers").get<std::uint64_t>()) << "300 pings, of which 60 are warm-up";
    EXPECT_EQ(cell.at("age").at("n").get<std::uint64_t>() + cell.at("lost").get<std::uint64_t>(), expected);
    EXPECT_GT(cell.at("age").at("n").get<std::uint64_t>(), expected / 2);
    EXPECT_GT(cell.at("half_round_trip").at("p50").get<double>(), 1);
    EXPECT_GE(cell.at("half_round_trip").at("p50").get<double>(),
              cell.at("half_round_trip_from_send").at("p50").get<double>());
    EXPECT_EQ(cell.at("clock_bound").get<double>(), 0) << "one machine, one clock";
    EXPECT_EQ(cell.at("duplicates").get<std::uint64_t>(), 0u);
  }
  /// Returns the port on which a `serve` process listens.
  static std::string port_of(const Process& server) {
    if (!server.wait_for_line("listening on port [0-9]")) return "none: " + server.output();
    const std::string output = server.output(), prefix = "listening on port ";
    const std::size_t begin = output.find(prefix) + prefix.size();
    return output.substr(begin, output.find(';', begin) - begin);
  }
  [[nodiscard]] std::string path(const char* name) const { return (folder_.path() / name).string(); }

  test_support::TemporaryFolder folder_;
};

TEST_F(LatencyRun, MeasuresEveryTransportAndProfile) {
  const auto figures = run({"--transport", "raw-udp,udp,shm,builtin", "--profile", "tactus,plain"});
  ASSERT_EQ(figures.at("tests").size(), 7u);
  for (const auto& cell : figures.at("tests")) expect_plausible(cell);
}

TEST_F(LatencyRun, SendsFewerPingsWithDeadbandCoding) {
  const auto figures = run({"--coding", "coded"});
  ASSERT_EQ(figures.at("tests").size(), 1u);
  const auto& coded = figures.at("tests")[0];
  const auto expected = coded.at("expected").get<std::uint64_t>();
  EXPECT_EQ(coded.at("coding").get<std::string>(), "coded");
  EXPECT_LT(expected, 240u * 3 / 4);
  EXPECT_GT(expected, 240u / 8) << "the keep-alive sends at least one ping every 40 ms";
  EXPECT_EQ(coded.at("age").at("n").get<std::uint64_t>() + coded.at("lost").get<std::uint64_t>(), expected);
}

TEST_F(LatencyRun, MeasuresSeveralReadersWhileMeshRecordsAreSent) {
  const auto figures = run({"--readers", "3", "--load", "20"});
  ASSERT_EQ(figures.at("tests").size(), 1u);
  expect_plausible(figures.at("tests")[0]);
  EXPECT_GT(figures.at("tests")[0].at("mesh_mbyte_per_s").get<double>(), 0);
}

TEST_F(LatencyRun, TunedFastDdsSendsRecordsNoFasterThanItsLimit) {
  if (!wire::library_version().starts_with("2.")) {
    Process process{command_line("run", {"--profile", "tuned"})};
    EXPECT_EQ(process.wait(), 2);
    EXPECT_THAT(process.output(), HasSubstr("expected Fast DDS 2.9, found 3."));
    return;
  }
  const auto figures = run({"--profile", "tuned", "--load", "max"});
  ASSERT_EQ(figures.at("tests").size(), 1u);
  expect_plausible(figures.at("tests")[0]);
  const double mesh = figures.at("tests")[0].at("mesh_mbyte_per_s").get<double>();
  EXPECT_GT(mesh, 0);
  EXPECT_LT(mesh, 12.5) << "MB/s; the flow controller of profile tuned allows 12 kB each ms";
}

TEST_F(LatencyRun, MeasuresCycloneDdsWithAndWithoutMeshRecords) {
  if (!has_cyclone()) GTEST_SKIP() << "built without Cyclone DDS";
  const auto figures = run({"--transport", "cyclone", "--load", "0,max"});
  ASSERT_EQ(figures.at("tests").size(), 2u);
  for (const auto& cell : figures.at("tests")) expect_plausible(cell);
  EXPECT_EQ(figures.at("tests")[0].at("mesh_mbyte_per_s").get<double>(), 0);
  EXPECT_GT(figures.at("tests")[1].at("mesh_mbyte_per_s").get<double>(), 0);
}

TEST_F(LatencyRun, MeasuresRecordsOfTheRequestedSize) {
  const auto figures = run({"--topic", "records", "--payload", "64,1200"});
  ASSERT_EQ(figures.at("tests").size(), 2u);
  for (const auto& cell : figures.at("tests")) {
    expect_plausible(cell);
    EXPECT_EQ(cell.at("lost").get<std::uint64_t>(), 0u) << "records are reliable";
  }
}

TEST_F(LatencyRun, MeasuresTheDelayAndTheLossOfALink) {
  if (const std::string reason = netem::missing_privilege(); !reason.empty()) GTEST_SKIP() << reason;
  const auto figures = run({"--transport", "raw-udp,udp", "--link", "P0:delay=30:loss=20"});
  ASSERT_EQ(figures.at("tests").size(), 2u);
  for (const auto& cell : figures.at("tests")) {
    EXPECT_GE(cell.at("half_round_trip").at("p50").get<double>(), 30'000);
    EXPECT_GE(cell.at("age").at("p50").get<double>(), 30'000);
    const auto expected = cell.at("expected").get<double>();
    EXPECT_NEAR(cell.at("lost").get<double>(), 0.2 * expected, 5 * std::sqrt(expected * 0.2 * 0.8));
  }
}

TEST_F(LatencyRun, RefusesSharedMemoryAcrossALink) {
  Process process{command_line("run", {"--transport", "shm", "--link", "P4"})};
  EXPECT_EQ(process.wait(), 2);
  EXPECT_THAT(process.output(), HasSubstr("bypasses link P4"));
}

TEST_F(LatencyRun, ServesSeveralRunsAndEndsOnInterrupt) {
  Process server{command_line("serve", {"--port", "0"})};
  const std::string port = port_of(server);
  for (int round = 0; round < 2; ++round) {
    const auto figures = run({"--to", "127.0.0.1", "--port", port, "--transport", "raw-udp,udp"});
    ASSERT_EQ(figures.at("tests").size(), 2u);
    for (const auto& cell : figures.at("tests")) expect_plausible(cell);
  }
  server.signal(SIGINT);
  EXPECT_EQ(server.wait(), 0);
}

TEST_F(LatencyRun, TheAgeBetweenTwoClocksIsRightWithinTheClockBound) {
  // In its own time namespace, the clock of the server is 5000 s ahead.
  Words namespaced{"/usr/bin/unshare", "--time", "--monotonic", "5000", "--fork", "--kill-child"};
  Words trial_words = namespaced;
  trial_words.emplace_back("true");
  Process trial{trial_words};
  if (trial.wait() != 0) GTEST_SKIP() << "no time namespace for this user or kernel: " << trial.output();
  for (const std::string& word : command_line("serve", {"--port", "0"})) namespaced.push_back(word);
  Process server{namespaced};
  const std::string port = port_of(server);
  const auto figures = run({"--to", "127.0.0.1", "--port", port, "--transport", "raw-udp,udp"});
  ASSERT_EQ(figures.at("tests").size(), 2u);
  for (const auto& cell : figures.at("tests")) {
    const double bound = cell.at("clock_bound").get<double>();
    EXPECT_GT(bound, 0);
    EXPECT_LT(bound, 1e5) << "us; a loopback is far below it, even on a busy machine";
    EXPECT_GT(cell.at("age").at("p50").get<double>(), -bound);
    EXPECT_LT(cell.at("age").at("p50").get<double>(), 2 * cell.at("half_round_trip").at("p50").get<double>() + bound);
  }
}

TEST_F(LatencyRun, NamesTheMissingCommandIfThereIsNoServer) {
  Process process{command_line("run", {"--to", "127.0.0.1", "--port", "1"})};
  EXPECT_EQ(process.wait(), 2);
  EXPECT_THAT(process.output(),
              HasSubstr("127.0.0.1 port 1: Connection refused; expected `tactus-latency serve` there"));
}

TEST_F(LatencyRun, ReportsFinishedTestsWhenInterrupted) {
  Process process{command_line("run", {"--seconds", "0.5", "--rate", "100,200", "--repeat", "500"})};
  if (!process.wait_for_line("\\[2/1000\\]")) FAIL() << process.output();
  process.signal(SIGINT);
  EXPECT_EQ(process.wait(), 130);
  EXPECT_THAT(process.output(), HasSubstr("half round trip"));
}

TEST_F(LatencyRun, ARefusalNamesTheWrongInput) {
  const auto refused = [](Words words, const char* part) {
    Process process{command_line("run", std::move(words))};
    EXPECT_EQ(process.wait(), 2);
    EXPECT_THAT(process.output(), HasSubstr(part));
  };
  refused({"--transport", "tcp"}, "tcp");
  refused({"--load", "some"}, "load is 'some'; expected Mbit/s, at least 0, or max");
  refused({"--payload", "64"}, "a probe state always has 236");
  refused({"--link", "P0:dealy=3"}, "no setting 'dealy=3'");
  refused({"--to", "here", "--link", "P4"}, "expected none with --to");
  refused({"--qos", path("nowhere")}, "qos directory");
}

}  // namespace
}  // namespace tactus::latency
