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

std::vector<std::string> plots_of(const std::string& page) {
  std::vector<std::string> plots;
  for (std::size_t begin = 0; (begin = page.find("<svg", begin)) != std::string::npos; ++begin)
    plots.push_back(page.substr(begin, page.find("</svg>", begin) + 6 - begin));
  return plots;
}

auto has_finite_coordinates() { return testing::AllOf(Not(HasSubstr("nan")), Not(HasSubstr("inf"))); }

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
  ASSERT_EQ(json.at("tests").size(), 2u);
  const auto& cell = json.at("tests")[0];
  EXPECT_EQ(cell.at("half_round_trip").at("p50").get<double>(), results_[0].half_round_trip.p50);
  EXPECT_EQ(cell.at("lost").get<std::uint64_t>(), 17u) << "one of a hundred of 1700 pings";
  EXPECT_EQ(cell.at("age_of_information").at("p50").get<double>(), results_[0].age_of_information.p50);
  EXPECT_EQ(cell.at("wake_up_lateness").at("n").get<std::uint64_t>(), results_[0].timer.count);
  EXPECT_EQ(cell.at("curve").size(), json.at("quantile_shares").size());
}

TEST_F(ReportTest, ThePageIsWellFormedAndSelfContained) {
  write_html(path("r.html"), info_, results_);
  const std::string page = test_support::read_bytes(path("r.html"));
  EXPECT_THAT(page, Not(HasSubstr("<script")));
  EXPECT_THAT(page, Not(HasSubstr("http")));
  EXPECT_THAT(page, HasSubstr("&quot;&lt;P4&gt;&quot;"));
  const std::vector<std::string> plots = plots_of(page);
  for (const std::string& plot : plots) {
    tinyxml2::XMLDocument svg;
    EXPECT_EQ(svg.Parse(plot.c_str()), tinyxml2::XML_SUCCESS) << svg.ErrorStr();
    EXPECT_THAT(plot, has_finite_coordinates());
  }
  EXPECT_EQ(plots.size(), 3u) << "the distributions, and the times of each of two runs";
}

TEST_F(ReportTest, LabelsThePlotOverTimeWithTheTimeAfterTheWarmUp) {
  write_html(path("r.html"), info_, {example_result(40)});
  const std::vector<std::string> plots = plots_of(test_support::read_bytes(path("r.html")));
  ASSERT_EQ(plots.size(), 2u);
  EXPECT_THAT(plots[1], HasSubstr(">1.7 s</text>")) << "2 s, without the warm-up of 0.3 s";
  EXPECT_THAT(plots[1], Not(HasSubstr(">2.0 s</text>")));
  EXPECT_THAT(plots[1], HasSubstr("time after the warm-up"));
}

TEST_F(ReportTest, WritesAPageForARunWithoutEchoes) {
  Timestamps timestamps;
  timestamps.pings.resize(timestamps.test.ticks());
  timestamps.shares_clock = true;
  write_html(path("r.html"), info_, {evaluate(timestamps)});
  const std::string page = test_support::read_bytes(path("r.html"));
  EXPECT_THAT(page, HasSubstr("100.000"));
  const std::vector<std::string> plots = plots_of(page);
  EXPECT_EQ(plots.size(), 2u);
  for (const std::string& plot : plots) {
    EXPECT_THAT(plot, has_finite_coordinates());
    EXPECT_THAT(plot, HasSubstr("text-anchor=\"end\">1 us</text>")) << "a label of the vertical axis";
  }
}

TEST_F(ReportTest, ThrowsForAFileThatCannotBeWritten) {
  EXPECT_THROW(write_json(path("no/such/r.json"), info_, results_), LatencyError);
  EXPECT_THROW(write_html(path("no/such/r.html"), info_, results_), LatencyError);
}

}  // namespace
}  // namespace tactus::latency
