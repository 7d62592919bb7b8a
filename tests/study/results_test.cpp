#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <sstream>

#include "study/tables.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::study {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Run run_of(const std::string& profile, std::uint64_t seed, double error) {
  return {"tap", profile, seed, {{"force error rms", "N", error}, {"above 1 JND", "%", 10 * error}}};
}

Experiment tap_experiment(std::vector<std::string> profiles) {
  return {"tap", Section::kForces, 0, std::move(profiles), 3, {}};
}

TEST(LinkResults, CompareRunsOfTheSameSeed) {
  // Seeds differ more than links. Only a comparison of equal seeds shows that P4 always adds an error of 0.5.
  const std::vector<study::Run> runs{run_of("P0", 1, 1), run_of("P0", 2, 5), run_of("P4", 2, 5.5), run_of("P4", 1, 1.5),
                                     run_of("P4", 3, 9)};
  const std::vector<LinkResult> results = results_by_link(runs, {tap_experiment({"P0", "P4", "P6"})});
  ASSERT_EQ(results.size(), 2u);
  EXPECT_EQ(results[0].profile, "P0");
  EXPECT_EQ(results[0].figures[0].value.mean, 3);
  EXPECT_EQ(results[0].figures[0].difference.count, 0u);
  EXPECT_EQ(results[1].figures[0].value.count, 3u);
  EXPECT_EQ(results[1].figures[0].difference.count, 2u);
  EXPECT_EQ(results[1].figures[0].difference.mean, 0.5);
  EXPECT_EQ(results[1].figures[0].difference.low, 0.5);
  EXPECT_EQ(results[1].figures[0].difference.high, 0.5);
}

TEST(LinkResults, OmitRunsWithoutTheFigure) {
  const std::vector<LinkResult> results = results_by_link(
      {run_of("P0", 1, 1), run_of("P4", 1, std::nan("")), run_of("P4", 2, 3)}, {tap_experiment({"P0", "P4"})});
  EXPECT_EQ(results[1].figures[0].value.count, 1u);
  EXPECT_EQ(results[1].figures[0].value.mean, 3);
  EXPECT_EQ(results[1].figures[0].difference.count, 0u);
}

TEST(Tables, HaveProfilesAsRowsAndScenariosAsColumns) {
  const std::vector<LinkResult> results =
      results_by_link({run_of("P0", 1, 0), run_of("P4", 1, 0.123456)}, {tap_experiment({"P0", "P4"})});
  const std::string text = markdown({"s", "tactus sim study", "machine", "abc", {"a note"}}, results);
  EXPECT_THAT(text, HasSubstr("| force error rms, N | tap |\n|---|--:|\n| P0 | 0 |\n| P4 | 0.123 |\n"));
  EXPECT_THAT(text, HasSubstr("a note"));
  EXPECT_THAT(csv(results), HasSubstr("\"tap\",P4,\"force error rms\",N,1,0.123456,0.123456,0.123456,1,0.123456"));
}

TEST(Tables, DoubleTheQuotesOfNamesInCsv) {
  std::vector<LinkResult> results = results_by_link({run_of("P0", 1, 0)}, {tap_experiment({"P0"})});
  results[0].scenario = "a \"soft\" tap";
  EXPECT_THAT(csv(results), HasSubstr("Force fidelity,\"a \"\"soft\"\" tap\",P0,\"force error rms\",N,1,"));
}

TEST(TraceFile, HasANameOfItsOwnInTheFolder) {
  const auto name_of = [](const std::string& scenario) { return trace_file_name({scenario, "P0:delay=25", 3, {}}, 0); };
  EXPECT_EQ(trace_file_name({"tap-scan", "P4", 3, {}}, 1), "tap-scan-P4-3-2.csv");
  EXPECT_EQ(name_of("../a/b"), "..%2Fa%2Fb-P0%3Adelay%3D25-3-1.csv");
  EXPECT_NE(name_of("a/b"), name_of("a_b"));
  EXPECT_NE(name_of("a/b"), name_of("a%2Fb"));
}

TEST(Page, HasAPlotPerFigureAndIsSelfContained) {
  const std::vector<LinkResult> results = results_by_link(
      {run_of("P0", 1, 0), run_of("P4", 1, 0.2), run_of("P4", 2, std::nan(""))}, {tap_experiment({"P0", "P4"})});
  const std::string page = html({"<s>", "tactus sim study", "machine", "abc", {}}, results);
  EXPECT_THAT(page, HasSubstr("<h1>Study &lt;s&gt;</h1>"));
  EXPECT_THAT(page, HasSubstr("<h2>Force fidelity</h2>"));
  EXPECT_THAT(page, HasSubstr("<th>force error rms, N</th>"));
  EXPECT_THAT(page, Not(HasSubstr("Stiffness")));
  EXPECT_THAT(page, Not(HasSubstr("<script")));
  EXPECT_THAT(page, Not(HasSubstr("http")));
  std::size_t drawings = 0;
  for (std::size_t begin = 0; (begin = page.find("<svg", begin)) != std::string::npos; ++begin, ++drawings) {
    const std::string drawing = page.substr(begin, page.find("</svg>", begin) - begin);
    EXPECT_THAT(drawing, Not(HasSubstr("nan")));
    EXPECT_THAT(drawing, Not(HasSubstr("inf")));
    EXPECT_THAT(drawing, HasSubstr("<polyline"));
  }
  EXPECT_EQ(drawings, 2u) << "error rms and share above a JND; these runs have no onsets";
}

class RunLogTest : public ::testing::Test {
 protected:
  test_support::TemporaryFolder folder_;
};

TEST_F(RunLogTest, ContinuesAfterTheCompleteRunsOfAnInterruptedStudy) {
  {
    RunLog log{folder_.path(), "study A"};
    log.add(run_of("P0", 1, 0.25));
    log.add(run_of("P4", 1, 0.1));
  }
  std::ofstream{folder_.path() / "runs.jsonl", std::ios::app} << "{\"scenario\":\"tap\",\"pro";  // an incomplete line
  {
    RunLog log{folder_.path(), "study A"};
    EXPECT_EQ(log.runs().size(), 2u);
    EXPECT_TRUE(log.has("tap", "P4", 1));
    EXPECT_FALSE(log.has("tap", "P4", 2));
    EXPECT_EQ(log.runs()[1].figures[0].value, 0.1);
    log.add(run_of("P4", 2, 3));
    log.add(run_of("P4", 3, std::nan("")));
  }
  const RunLog reopened{folder_.path(), "study A"};
  ASSERT_EQ(reopened.runs().size(), 4u);
  EXPECT_TRUE(std::isnan(reopened.runs()[3].figures[0].value));
}

TEST_F(RunLogTest, HasEachRunOnce) {
  {
    RunLog log{folder_.path(), "study A"};
    log.add(run_of("P4", 1, 0.25));
    log.add(run_of("P4", 1, 0.5));
    log.add(run_of("P4", 2, 0.75));
    EXPECT_EQ(log.runs().size(), 2u);
  }
  const std::filesystem::path file = folder_.path() / "runs.jsonl";
  const std::string text = test_support::read_bytes(file);
  std::ofstream{file, std::ios::app} << text.substr(text.find('\n') + 1);
  const RunLog log{folder_.path(), "study A"};
  ASSERT_EQ(log.runs().size(), 2u);
  EXPECT_EQ(log.runs()[0].figures[0].value, 0.25);
}

TEST_F(RunLogTest, RefusesAFolderInWhichAStudyRuns) {
  const RunLog running{folder_.path(), "study A"};
  const std::filesystem::path file = folder_.path() / "runs.jsonl";
  std::ofstream{file, std::ios::app} << "{\"scenario\":\"tap\",\"pro";  // the running study writes a line
  const std::string text = test_support::read_bytes(file);
  std::string error;
  try {
    RunLog{folder_.path(), "study A"};
  } catch (const std::runtime_error& refusal) {
    error = refusal.what();
  }
  EXPECT_EQ(error, file.string() + ": another running study writes it; expected a folder of its own (--out)");
  EXPECT_EQ(test_support::read_bytes(file), text);
}

TEST_F(RunLogTest, RefusesAFileWhoseIncompleteLineItCannotCutOff) {
  // The file is in memory and sealed, so that it can grow but not shrink.
  const int sealed = ::memfd_create("runs", MFD_ALLOW_SEALING);
  ASSERT_GE(sealed, 0);
  const std::string lines = "study A\n{\"scenario\":\"tap\",\"pro";
  ASSERT_EQ(::write(sealed, lines.data(), lines.size()), static_cast<ssize_t>(lines.size()));
  ASSERT_EQ(::fcntl(sealed, F_ADD_SEALS, F_SEAL_SHRINK), 0);
  std::filesystem::create_symlink("/proc/self/fd/" + std::to_string(sealed), folder_.path() / "runs.jsonl");
  std::string error;
  try {
    RunLog{folder_.path(), "study A"};
  } catch (const std::runtime_error& refusal) {
    error = refusal.what();
  }
  ::close(sealed);
  EXPECT_THAT(error, HasSubstr("cannot cut off an incomplete line"));
}

TEST_F(RunLogTest, WritesAnIncompleteFirstLineAgain) {
  for (const char* written : {"stu", "study A"}) {
    SCOPED_TRACE(written);
    std::ofstream{folder_.path() / "runs.jsonl"} << written;
    RunLog{folder_.path(), "study A"}.add(run_of("P0", 1, 0.25));
    EXPECT_EQ((RunLog{folder_.path(), "study A"}.runs().size()), 1u);
  }
}

TEST_F(RunLogTest, RefusesTheRunsOfAnotherStudy) {
  RunLog{folder_.path(), "study A"}.add(run_of("P0", 1, 0));
  EXPECT_THROW((RunLog{folder_.path(), "study B"}), std::runtime_error);
  EXPECT_THROW((RunLog{"/proc/nowhere", "study A"}), std::runtime_error);
}

}  // namespace
}  // namespace tactus::study
