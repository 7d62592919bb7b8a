/// A session of real programs whose users rest on one point of an object.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "bench/live_session.hpp"
#include "bench/resting_touch.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {

/// A thread constructs and uses it as a LiveSession.
class TouchedSession {
 public:
  /// `faces`: of the object. `link`, `protection`: as of LiveSession.
  explicit TouchedSession(int faces = 20'000, const std::string& link = "veth",
                          Protection protection = Protection::kPlain)
      : session_{link, protection} {
    run_program("mesh", {"generate", "organ", path("organ.ply"), "--faces", std::to_string(faces), "--seed", "7"});
    run_program("mesh", {"build", path("organ.ply"), path("organ.spm")});
    write_resting_touch(path("organ.spm"), path("touch.csv"));
  }
  [[nodiscard]] LiveSession& session() { return session_; }
  [[nodiscard]] std::string path(const std::string& name) const { return folder_.path() / name; }
  void start_host(netem::Side side) { host_ = session_.start(side, "host", {"--name", "museum", path("organ.spm")}); }
  /// Arguments of an HRTC whose users replay the touch.
  [[nodiscard]] std::vector<std::string> hrtc_arguments(const std::string& name, const std::vector<std::string>& users,
                                                        std::vector<std::string> more = {}) const {
    more.insert(more.end(), {"--name", name});
    for (const std::string& user : users) more.insert(more.end(), {"--replay", user + "=" + path("touch.csv")});
    return more;
  }
  [[nodiscard]] std::unique_ptr<e2e::Process> start_hrtc(netem::Side side, const std::string& name,
                                                         const std::vector<std::string>& users,
                                                         std::vector<std::string> more = {}) {
    return session_.start(side, "hrtc", hrtc_arguments(name, users, std::move(more)));
  }
  /// Waits until the user touches exactly in states that arrive from now on.
  void wait_for_touch(const std::string& user) {
    session_.forget_states();
    session_.wait_until(("exact contact of " + user).c_str(),
                        [&](const ObservedSession& observed) { return observed.touches_exactly(user); });
  }

 private:
  test_support::TemporaryFolder folder_;
  LiveSession session_;
  std::unique_ptr<e2e::Process> host_;
};

}  // namespace tactus::bench
