#include "viewer/page_server.hpp"

#include <gmock/gmock.h>

#include <atomic>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "realtime/process.hpp"
#include "session/units.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/viewer/page_client.hpp"
#include "tests/viewer/viewer_session.hpp"

namespace tactus::viewer {
namespace {

using test_support::http_status;
using test_support::PageClient;

/// A server that runs in a thread of its own, with a viewer that has received the base mesh.
class PageServerTest : public ViewerSession {
 protected:
  explicit PageServerTest(const std::string& control_token = "", const std::string& observer_token = "") {
    run(500 * kMs);
    test_support::write_bytes(folder_.path() / "index.html", "<!doctype html>");
    test_support::write_bytes(folder_.path() / "view.js", "let page;");
    server_.emplace(ServerSettings{folder_.path(), "127.0.0.1", 0, control_token, observer_token}, viewer_);
    server_->on_event = [this](const std::string& text) {
      const std::lock_guard lock{mutex_};
      events_.push_back(text);
    };
    server_->on_request = [this](PageId page, const PageRequest& request) {
      const std::lock_guard lock{mutex_};
      if (const auto* const stop = std::get_if<StopRequest>(&request)) stop_reason_ = stop->reason;
      if (std::holds_alternative<TouchRequest>(request)) server_->notify(page, "no probe");
    };
    server_->on_page_closed = [this](PageId) { ++closed_pages_; };
    thread_ = std::thread{[this] {
      while (!ended_) {
        server_->poll(realtime::monotonic_ns());
        pages_ = server_->pages();
        has_reader_ = server_->has_reader();
        std::this_thread::sleep_for(std::chrono::milliseconds{1});
      }
    }};
  }
  ~PageServerTest() override {
    ended_ = true;
    thread_.join();
  }
  /// Receives messages until the server closes the connection. The timeout of ctest limits the wait.
  static void wait_until_closed(PageClient& page) {
    while (page.receive()) {
    }
  }
  /// Waits for an event and returns it. The timeout of ctest limits the wait.
  [[nodiscard]] std::string wait_for_event() {
    for (;; std::this_thread::yield()) {
      const std::lock_guard lock{mutex_};
      if (events_.empty()) continue;
      const std::string first = events_.front();
      events_.erase(events_.begin());
      return first;
    }
  }
  [[nodiscard]] std::string stop_reason() {
    const std::lock_guard lock{mutex_};
    return stop_reason_;
  }

  test_support::TemporaryFolder folder_;
  std::optional<PageServer> server_;
  std::mutex mutex_;
  std::vector<std::string> events_;
  std::string stop_reason_;
  std::atomic<bool> ended_{false}, has_reader_{false};
  std::atomic<std::size_t> pages_{0}, closed_pages_{0};
  std::thread thread_;
};

TEST_F(PageServerTest, ServesTheFilesOfThePage) {
  std::string body;
  EXPECT_EQ(http_status(server_->port(), "/", {}, &body), 200u);
  EXPECT_EQ(body, "<!doctype html>");
  EXPECT_EQ(http_status(server_->port(), "/view.js?v=1", {}, &body), 200u);
  EXPECT_EQ(body, "let page;");
  EXPECT_EQ(http_status(server_->port(), "/session.json", {}, &body), 200u);
  EXPECT_EQ(body, R"({"isPlain":false})");
  EXPECT_EQ(http_status(server_->port(), "/../page_server_test.cpp"), 404u);
  EXPECT_EQ(http_status(server_->port(), "/other"), 404u);
}

TEST_F(PageServerTest, RefusesRequestsForOtherHostsAndFromForeignPages) {
  EXPECT_EQ(http_status(server_->port(), "/", {{"Host", "attacker.example"}}), 403u);
  EXPECT_EQ(http_status(server_->port(), "/", {{"Host", "localhost.attacker.example"}}), 403u);
  EXPECT_EQ(http_status(server_->port(), "/", {{"Host", "127.0.0.1:" + std::to_string(server_->port())}}), 200u);
  EXPECT_THROW(PageClient(server_->port(), "http://attacker.example"), std::runtime_error);
  EXPECT_NO_THROW(PageClient(server_->port(), "http://localhost:" + std::to_string(server_->port())));
}

TEST_F(PageServerTest, APageReceivesSceneProbesAndMesh) {
  PageClient page{server_->port()};
  nlohmann::json scene;
  bool has_probes = false, has_mesh = false;
  while (scene.empty() || !has_probes || !has_mesh) {
    const auto message = page.receive();
    ASSERT_TRUE(message);
    if (message->is_text) {
      const nlohmann::json text = nlohmann::json::parse(message->bytes);
      if (text["type"] == "scene") scene = text;
      continue;
    }
    has_probes = has_probes || message->bytes[0] == 2;
    if (message->bytes[0] == 1) {
      has_mesh = true;
      EXPECT_EQ(message->bytes.size(), 32 + 40 * model_.summary.base_faces);
    }
  }
  ASSERT_EQ(scene["objects"].size(), 1u);
  EXPECT_EQ(scene["objects"][0]["name"], "sphere");
  EXPECT_EQ(scene["objects"][0]["faces"], model_.summary.faces);
  EXPECT_EQ(scene["stop"]["stopped"], 0);
}

TEST_F(PageServerTest, APageCanStopAllForces) {
  PageClient page{server_->port()};
  page.send(R"({"stop": "needle bent"})");
  while (stop_reason().empty() && page.receive()) {
  }
  EXPECT_EQ(stop_reason(), "needle bent");
}

TEST_F(PageServerTest, APageThatSendsNoKnownRequestIsDisconnectedAndNamed) {
  for (const std::string& garbage :
       {std::string{"garbage"}, std::string{"{}"}, std::string{R"({"stop": 1})"},
        std::string{R"({"stop": "x", "and": 1})"}, std::string{R"({"stop": "a\u0000b"})"}, std::string{"\xff\xfe"}}) {
    PageClient page{server_->port()};
    page.send(garbage);
    wait_until_closed(page);
    EXPECT_THAT(wait_for_event(), testing::MatchesRegex("page .* is disconnected: it sent no valid .*")) << garbage;
  }
}

TEST_F(PageServerTest, APageThatFloodsOrSendsALongRequestIsDisconnectedAndNamed) {
  {
    PageClient page{server_->port()};
    for (int i = 0; i < 2000; ++i) page.send(R"({"stop": "again"})");
    wait_until_closed(page);
    EXPECT_THAT(wait_for_event(), testing::HasSubstr("more than 200 requests a second"));
  }
  PageClient page{server_->port()};
  page.send(R"({"stop": ")" + std::string(5000, 'x') + "\"}");
  wait_until_closed(page);
  EXPECT_THAT(wait_for_event(), testing::HasSubstr("longer than 4096 bytes"));
}

TEST_F(PageServerTest, APageReceivesTheNoticeForItAndItsEndIsReported) {
  {
    PageClient page{server_->port()}, other{server_->port()};
    page.send(R"({"touch": {"user": "guest"}})");
    std::string notice;
    while (notice.empty()) {
      const auto message = page.receive();
      ASSERT_TRUE(message);
      if (message->is_text && nlohmann::json::parse(message->bytes)["type"] == "notice") notice = message->bytes;
    }
    EXPECT_EQ(nlohmann::json::parse(notice)["text"], "no probe");
    for (int i = 0; i < 5; ++i) {
      const auto message = other.receive();
      ASSERT_TRUE(message);
      EXPECT_THAT(message->bytes, testing::Not(testing::HasSubstr("no probe")));
    }
  }
  while (closed_pages_ < 2) std::this_thread::yield();  // the timeout of ctest limits the wait
}

/// A server that other machines could reach.
class PageServerWithTokensTest : public PageServerTest {
 protected:
  PageServerWithTokensTest() : PageServerTest{"control-token", "observer-token"} {}
  [[nodiscard]] static std::string first_text(PageClient& page) {
    while (const auto message = page.receive())
      if (message->is_text) return message->bytes;
    return "closed";
  }
};

TEST_F(PageServerWithTokensTest, SendsNothingBeforeAToken) {
  PageClient page{server_->port()};
  EXPECT_FALSE(page.receive(std::chrono::milliseconds{300}));
}

TEST_F(PageServerWithTokensTest, ThePageOfTheControlTokenCanStopForces) {
  PageClient page{server_->port()};
  page.send(R"({"token": "control-token"})");
  EXPECT_EQ(nlohmann::json::parse(first_text(page))["control"], true);
  page.send(R"({"stop": "needle bent"})");
  while (stop_reason().empty() && page.receive()) {
  }
  EXPECT_EQ(stop_reason(), "needle bent");
}

TEST_F(PageServerWithTokensTest, APageOfTheObserverTokenReceivesAndIsDisconnectedWhenItRequests) {
  PageClient page{server_->port()};
  page.send(R"({"token": "observer-token"})");
  EXPECT_EQ(nlohmann::json::parse(first_text(page))["control"], false);
  EXPECT_EQ(nlohmann::json::parse(first_text(page))["type"], "scene");
  page.send(R"({"stop": "needle bent"})");
  wait_until_closed(page);
  EXPECT_THAT(wait_for_event(), testing::HasSubstr("its token is for observers"));
  EXPECT_EQ(stop_reason(), "");
}

TEST_F(PageServerWithTokensTest, AWrongTokenOrARequestWithoutATokenEndsTheConnection) {
  for (const char* const request : {R"({"token": "control-tokem"})", R"({"token": ""})", R"({"stop": "now"})"}) {
    PageClient page{server_->port()};
    page.send(request);
    EXPECT_EQ(first_text(page), "closed") << request;
    EXPECT_THAT(wait_for_event(), testing::HasSubstr("is disconnected")) << request;
  }
  EXPECT_EQ(stop_reason(), "");
}

TEST_F(PageServerWithTokensTest, SixteenPagesThatHaveSentNoTokenHavePlacesOfTheirOwn) {
  std::vector<std::unique_ptr<PageClient>> pages;
  const auto connect = [&] { pages.push_back(std::make_unique<PageClient>(server_->port())); };
  for (std::size_t i = 0; i < PageServer::kMaxPages; ++i) {
    connect();
    pages.back()->send(R"({"token": "observer-token"})");
    ASSERT_EQ(nlohmann::json::parse(first_text(*pages.back()))["control"], false) << i;
  }
  for (std::size_t i = 0; i < PageServer::kMaxPages; ++i) connect();
  EXPECT_THROW(PageClient{server_->port()}, std::runtime_error);
  pages.back()->send(R"({"token": "observer-token"})");
  EXPECT_EQ(first_text(*pages.back()), "closed");
  EXPECT_THAT(wait_for_event(), testing::HasSubstr("16 pages are connected already"));
}

TEST_F(PageServerTest, APageThatReportsNothingGetsEightMessages) {
  PageClient page{server_->port()};
  page.reports_seen = false;
  for (int i = 0; i < 8; ++i) ASSERT_TRUE(page.receive()) << i;
  EXPECT_FALSE(page.receive(std::chrono::milliseconds{300}));
}

TEST_F(PageServerTest, MoreMessagesFollowThoseThatAPageHasSeen) {
  PageClient page{server_->port()};
  page.reports_seen = false;
  for (int i = 0; i < 8; ++i) ASSERT_TRUE(page.receive()) << i;
  page.send(R"({"seen": 3})");
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(page.receive()) << i;
  EXPECT_FALSE(page.receive(std::chrono::milliseconds{300}));
}

TEST_F(PageServerTest, APageThatReportsNothingIsNoReaderAfterASecond) {
  PageClient page{server_->port()};
  page.reports_seen = false;
  for (int i = 0; i < 8; ++i) ASSERT_TRUE(page.receive()) << i;
  EXPECT_TRUE(has_reader_);
  while (has_reader_) std::this_thread::yield();  // the timeout of ctest limits the wait
  page.send(R"({"seen": 8})");
  ASSERT_TRUE(page.receive());
  while (!has_reader_) std::this_thread::yield();
}

TEST_F(PageServerTest, APageThatHasSeenMoreThanWasSentOrTheSameAgainIsDisconnected) {
  for (const char* const second : {R"({"seen": 1})", R"({"seen": 1000000})"}) {
    PageClient page{server_->port()};
    page.reports_seen = false;
    ASSERT_TRUE(page.receive());
    page.send(R"({"seen": 1})");
    page.send(second);
    wait_until_closed(page);
    EXPECT_THAT(wait_for_event(), testing::HasSubstr("found \"seen\"")) << second;
  }
}

TEST_F(PageServerTest, ServesSixteenPagesOfWhichTenDoNotRead) {
  std::vector<std::unique_ptr<PageClient>> pages;
  for (std::size_t i = 0; i < PageServer::kMaxPages; ++i)
    pages.push_back(std::make_unique<PageClient>(server_->port()));
  EXPECT_THROW(PageClient{server_->port()}, std::runtime_error);
  // Pages 0 to 9 do not read.
  for (int i = 0; i < 100; ++i)
    for (std::size_t page = 10; page < pages.size(); ++page) ASSERT_TRUE(pages[page]->receive());

  pages.clear();
  while (pages_ > 0) std::this_thread::yield();  // the timeout of ctest limits the wait
  EXPECT_NO_THROW(PageClient{server_->port()});
}

TEST(PageServer, NamesThePortOrTheFolderIfItCannotStart) {
  const ViewerCore core{
      session::Origin{kSession, 900, 1, 0}, {"view", "session", spm::PoolSettings::for_slots(100)}, 0};
  const test_support::TemporaryFolder folder;
  const auto reason = [&](const ServerSettings& settings) -> std::string {
    try {
      const PageServer server{settings, core};
    } catch (const ServerError& error) {
      return error.what();
    }
    return "";
  };
  const auto at = [&](const std::string& address, std::uint16_t port) {
    return ServerSettings{folder.path(), address, port, "", ""};
  };
  EXPECT_THAT(reason(at("127.0.0.1", 0)),
              testing::HasSubstr("found no index.html; the package tactus has the page, scripts/page builds it"));
  test_support::write_bytes(folder.path() / "index.html", "page");
  const PageServer first{at("127.0.0.1", 0), core};
  EXPECT_THAT(reason(at("127.0.0.1", first.port())), testing::HasSubstr("cannot listen at 127.0.0.1, port"));
  EXPECT_THAT(reason(at("lab-pc", 0)), testing::HasSubstr("expected an IP address"));
}

}  // namespace
}  // namespace tactus::viewer
