#include "latency/report.hpp"

#include <gmock/gmock.h>
#include <tinyxml2.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/support/temporary_folder.hpp"

namespace tactus::latency {
namespace {

using testing::HasSubstr;
using testing::Not;

/// A result in which a transit takes 1 to 7 times `us`, and one ping of a hundred is lost.
Result example_result(double us) {
  Timestamps timestamps;
  timestamps.test.seconds = 2;
  timestamps.shares_clock = true;
  for (std::uint32_t i = 0; i < timestamps.test.ticks(); ++i) {
    const std::int64_t sent_ns = i * INT64_C(1'000'000);
    const auto transit_ns = static_cast<std::int64_t>(us * 1e3 * (1 + i % 7));
    timestamps.pings.push_back({sent_ns, sent_ns, true});
    if (i % 100 == 50) continue;
    timestamps.arrivals.push_back({i, 0, sent_ns + transit_ns});
    timestamps.echoes.push_back({i, 0, sent_ns + transit_ns, sent_ns + transit_ns, sent_ns + 2 * transit_ns});
  }
  timestamps.notes = {"pinger: SCHED_FIFO 60"};
  return evaluate(timestamps);
}

class ReportTest : public testing::Test {
 protected:
  [[nodiscard]] std::string path(const char* name) const { return (folder_.path() / name).string(); }
  test_support::TemporaryFolder folder_;
  RunInfo info_{"tactus-latency run --link \"<P4>\"", "2 x Something & Co", "0.1"};
  std::vector<Result> results_{example_result(40), example_result(4000)};
};

TEST_F(ReportTest, TheTableHasALineForEachResultAndShowsEqualNotesOnce) {
  results_[1].test.link = "P4";
  std::ostringstream table;
  print_table(table, info_, results_);
  EXPECT_THAT(table.str(), HasSubstr("udp tactus probe_state 236 B 1000 Hz x1\n"));
  EXPECT_THAT(table.str(), HasSubstr("udp tactus probe_state 236 B 1000 Hz x1, link P4"));
  EXPECT_EQ(table.str().find("SCHED_FIFO 60"), table.str().rfind("SCHED_FIFO 60"));
}

TEST_F(ReportTest, JsonHasTheFiguresAndTheCurve) {
  write_json(path("r.json"), info_, results_);
  const auto json = nlohmann::json::parse(test_support::read_bytes(path("r.json")));
  ASSERT_EQ(json.at("cells").size(), 2u);
  const auto& cell = json.at("cells")[0];
  EXPECT_EQ(cell.at("half_round_trip").at("p50").get<double>(), results_[0].half_round_trip.p50);
  EXPECT_EQ(cell.at("lost").get<std::uint64_t>(), 17u) << "one of a hundred of 1700 pings";
  EXPECT_EQ(cell.at("curve").size(), json.at("curve_shares").size());
}

TEST_F(ReportTest, ThePageIsWellFormedAndSelfContained) {
  write_html(path("r.html"), info_, results_);
  const std::string page = test_support::read_bytes(path("r.html"));
  EXPECT_THAT(page, Not(HasSubstr("<script")));
  EXPECT_THAT(page, Not(HasSubstr("http")));
  EXPECT_THAT(page, HasSubstr("&quot;&lt;P4&gt;&quot;"));
  int drawings = 0;
  for (std::size_t begin = 0; (begin = page.find("<svg", begin)) != std::string::npos; ++begin, ++drawings) {
    const std::string drawing = page.substr(begin, page.find("</svg>", begin) + 6 - begin);
    tinyxml2::XMLDocument svg;
    EXPECT_EQ(svg.Parse(drawing.c_str()), tinyxml2::XML_SUCCESS) << svg.ErrorStr();
    EXPECT_THAT(drawing, Not(HasSubstr("nan")));
    EXPECT_THAT(drawing, Not(HasSubstr("inf")));
  }
  EXPECT_EQ(drawings, 3) << "the distributions, and the times of each of two runs";
}

TEST_F(ReportTest, WritesAPageForARunWithoutEchoes) {
  Timestamps timestamps;
  timestamps.pings.resize(timestamps.test.ticks());
  timestamps.shares_clock = true;
  write_html(path("r.html"), info_, {evaluate(timestamps)});
  EXPECT_THAT(test_support::read_bytes(path("r.html")), HasSubstr("100.000"));
}

TEST_F(ReportTest, ThrowsForAFileThatCannotBeWritten) {
  EXPECT_THROW(write_json(path("no/such/r.json"), info_, results_), LatencyError);
  EXPECT_THROW(write_html(path("no/such/r.html"), info_, results_), LatencyError);
}

}  // namespace
}  // namespace tactus::latency
