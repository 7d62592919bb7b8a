#include "client_sim/report_page.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client_sim/touch_course.hpp"

namespace tactus::client_sim {
namespace {

using testing::HasSubstr;
using testing::Not;

session::ProbeState touch_with(std::uint32_t status, double force) {
  session::ProbeState state;
  state.status = status;
  state.force = {0, 0, force};
  return state;
}

TEST(TouchCourse, StoresTheMaximaOfEachInterval) {
  TouchCourse course;
  course.add(-0.01, touch_with(session::kFault, 9), 9);  // before the start
  course.add(0.00, touch_with(session::kInContact | session::kExact, 1), 300);
  course.add(0.04, touch_with(session::kInContact, 3), 200);
  course.add(0.12, touch_with(0, 0), 100);
  ASSERT_EQ(course.intervals().size(), 3u);
  const TouchInterval& first = course.intervals()[0];
  EXPECT_EQ(first.states, 2u);
  EXPECT_EQ(first.force_max, 3);
  EXPECT_EQ(first.age_max_us, 300);
  EXPECT_TRUE(first.coarse_contact);
  EXPECT_FALSE(first.fault);
  EXPECT_EQ(course.intervals()[1].states, 0u);
  EXPECT_FALSE(course.intervals()[2].coarse_contact);
}

TEST(TouchCourse, JoinsIntervalsOfALongSession) {
  TouchCourse course;
  constexpr int kStates = 100'000;
  for (int i = 0; i < kStates; ++i) course.add(0.01 * i, touch_with(0, i == 5'000 ? 7 : 1), 100);
  EXPECT_LE(course.intervals().size(), TouchCourse::kMaxIntervals);
  std::uint32_t states = 0;
  for (const TouchInterval& interval : course.intervals()) states += interval.states;
  EXPECT_EQ(states, kStates);
  const auto at = static_cast<std::size_t>(50 / course.interval_length());
  EXPECT_EQ(course.intervals()[at].force_max, 7) << "the state at 50 s";
}

TEST(ReportPage, HasTablesAndPlotsAndNeedsNoOtherFile) {
  Report report;
  report.session = "lab";
  report.scenario = "demo";
  report.duration = 10;
  report.stop_reason = "a < b";
  UserReport ann;
  ann.name = "ann & co";
  for (int i = 0; i < 100; ++i) {
    session::ProbeState state = touch_with(session::kInContact, 2);
    state.sequence = static_cast<std::uint32_t>(i + 1);
    state.session_time_ns = i * 100'000'000LL;
    ann.touch.add(state, 0, state.session_time_ns + 400'000);
  }
  report.users = {ann};
  report.participants.push_back({"desk", session::Role::kHrtc, false, {{"hrtc.cycles", 10'000}}});
  report.events.push_back({1.5, "<b>"});
  const std::string page = html(report);
  for (const char* const text : {"<h1>Session lab, scenario demo</h1>", "a &lt; b", "Force on ann &amp; co", "<svg ",
                                 "desk (gone before the end)", "<td>10000</td>", "&lt;b&gt;", "</html>"})
    EXPECT_THAT(page, HasSubstr(text));
  for (const char* const text : {"http", "src=", "<script", "<link"}) EXPECT_THAT(page, Not(HasSubstr(text)));
}

TEST(ReportPage, IsCompleteForASessionWithoutUsersAndStates) {
  EXPECT_THAT(html({}), HasSubstr("</html>"));
  Report report;
  report.users.emplace_back();
  EXPECT_THAT(html(report), Not(HasSubstr("nan")));
}

}  // namespace
}  // namespace tactus::client_sim
