/// Who finds whom without multicast: through a discovery server, and by naming machines.
#include <netinet/in.h>
#include <sys/socket.h>

#include <fstream>

#include "netem/pair.hpp"
#include "tests/e2e/session_test.hpp"

#ifndef TACTUS_DISCOVERY_SERVER
#define TACTUS_DISCOVERY_SERVER ""
#endif

namespace tactus::e2e {
namespace {

using Seen = Observer::Seen;
using testing::HasSubstr;

constexpr char kTouch[] = R"(name: one touch
duration: 30
users:
  - name: ann
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 2, force: 1}}]
)";

using Command = std::vector<std::string>;

Command operator+(Command first, const Command& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}

/// One that is free now.
std::string free_udp_port() {
  const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  socklen_t size = sizeof address;
  ::bind(socket, reinterpret_cast<const sockaddr*>(&address), size);
  ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size);
  ::close(socket);
  return std::to_string(ntohs(address.sin_port));
}

class DiscoveryTest : public SessionTest {
 protected:
  /// Why there is no server to start here, or an empty text.
  [[nodiscard]] static std::string missing_server() {
    return *TACTUS_DISCOVERY_SERVER != '\0' ? "" : "no fast-discovery-server (Debian: fastdds-tools)";
  }
  /// Debian's, with our profile.
  [[nodiscard]] static Command server(const std::string& port, const std::string& id = "0") {
    const std::string profile = wire::default_qos_directory() / "discovery_server.xml";
    return {TACTUS_DISCOVERY_SERVER, "-i", id, "-p", port, "-x", profile};
  }
};

TEST_F(DiscoveryTest, ThoseOfOneServerMeetAndOneWhoGoesByMulticastSeesNobody) {
  if (const std::string reason = missing_server(); !reason.empty()) GTEST_SKIP() << reason;
  const std::string port = free_udp_port();
  const Command by_server{"--discovery-server", "127.0.0.1:" + port};
  Process meeting{server(port)};
  Observer outsider{address("outsider")};
  wire::SessionAddress inside = address("insider");
  inside.discovery.servers = {"localhost:" + port};
  Observer insider{inside};
  Process museum{host("museum", models().sphere) + by_server};
  Process desk{hrtc("desk") + by_server};
  Process users{sim(kTouch) + by_server};
  EXPECT_EQ(users.wait(60s), 0) << users.output() << desk.output() << museum.output() << meeting.output();
  EXPECT_GT(insider.seen().user("ann").exact, 0u);
  EXPECT_TRUE(outsider.seen().roster.empty());
}

TEST_F(DiscoveryTest, AServerThatStartsAgainAfterItsLeaseBringsTogetherOldAndNew) {
  if (const std::string reason = missing_server(); !reason.empty()) GTEST_SKIP() << reason;
  const std::string port = free_udp_port();
  const Command by_server{"--discovery-server", "127.0.0.1:" + port};
  auto meeting = std::make_unique<Process>(server(port));
  Process museum{host("museum", models().sphere) + by_server};
  Process desk{hrtc("desk") + by_server};
  ASSERT_TRUE(desk.wait_for_line("host 'museum' joined")) << meeting->output();
  meeting->signal(SIGKILL);
  EXPECT_EQ(meeting->wait(), 128 + SIGKILL);
  std::this_thread::sleep_for(2s);  // the lease is 1 s of the clients' time; nothing tells that they have noticed
  meeting = std::make_unique<Process>(server(port));
  // Half a second as a rule; once in some ninety tries, on a machine that stood still, it took the library 27 s.
  Process users{sim(kTouch, {"--patience", "80"}) + by_server};
  EXPECT_EQ(users.wait(100s), 0) << users.output() << desk.output() << museum.output();
}

TEST_F(DiscoveryTest, OneOfTwoServersIsEnoughForANewcomer) {
  if (const std::string reason = missing_server(); !reason.empty()) GTEST_SKIP() << reason;
  const std::string port = free_udp_port(), other_port = free_udp_port();
  const Command by_both{"--discovery-server", "127.0.0.1:" + port, "--discovery-server", "127.0.0.1:" + other_port};
  Process meeting{server(port)}, other_meeting{server(other_port, "1")};
  Process museum{host("museum", models().sphere) + by_both};
  Process desk{hrtc("desk") + by_both};
  ASSERT_TRUE(desk.wait_for_line("host 'museum' joined")) << meeting.output();
  meeting.signal(SIGKILL);
  EXPECT_EQ(meeting.wait(), 128 + SIGKILL);
  Process users{sim(kTouch) + by_both};
  EXPECT_EQ(users.wait(60s), 0) << users.output() << desk.output() << museum.output();
}

TEST_F(DiscoveryTest, AWrongServerOrPeerIsNamed) {
  for (const auto& [option, value, said] :
       {std::array{"--discovery-server", "127.0.0.1:0", "port '0'"},
        std::array{"--discovery-server", "127.0.0.1:x", "port 'x'"},
        std::array{"--peer", "no.such.host.invalid", "'no.such.host.invalid' is no IPv4 address"}}) {
    Process desk{hrtc("desk", {option, value})};
    EXPECT_EQ(desk.wait(), 2);
    EXPECT_THAT(desk.output(), HasSubstr(said));
  }
  Process both{hrtc("desk", {"--peer", "127.0.0.1", "--discovery-server", "127.0.0.1"})};
  EXPECT_EQ(both.wait(), 2);
  EXPECT_THAT(both.output(), HasSubstr("--peer"));
}

/// Host on one side, the others on the other, of a link that no multicast crosses: the programs send theirs with TTL 0.
class WithoutMulticast : public DiscoveryTest {
 protected:
  void SetUp() override {
    if (const std::string reason = netem::missing_privilege(); !reason.empty()) GTEST_SKIP() << reason;
    pair_.emplace(netem::parse_link("veth"));
    std::filesystem::copy(wire::default_qos_directory(), qos_);
    for (const char* file : {"session.xml", "probe.xml", "bulk.xml"}) {
      std::ifstream in{qos_ / file};
      std::string text{std::istreambuf_iterator<char>{in}, {}};
      const std::string ttl = "<TTL>1</TTL>";
      ASSERT_THAT(text, HasSubstr(ttl));
      std::ofstream{qos_ / file} << text.replace(text.find(ttl), ttl.size(), "<TTL>0</TTL>");
    }
  }
  [[nodiscard]] Command in(netem::Side side, const Command& command) const {
    return Command{"/sbin/ip", "netns", "exec", pair_->name(side)} + command;
  }
  [[nodiscard]] Command program_in(netem::Side side, const Command& command) const {
    return in(side, command) + Command{"--qos", qos_};
  }
  void expect_a_session(const Command& options_a, const Command& options_b) {
    Process museum{program_in(netem::Side::kA, host("museum", models().sphere) + options_a)};
    Process desk{program_in(netem::Side::kB, hrtc("desk") + options_b)};
    Process users{program_in(netem::Side::kB, sim(kTouch) + options_b)};
    EXPECT_EQ(users.wait(60s), 0) << users.output() << desk.output() << museum.output();
  }

  const std::filesystem::path qos_ = path("qos");
  std::optional<netem::LinkedPair> pair_;
};

TEST_F(WithoutMulticast, NobodyIsFoundUnlessNamed) {
  Process museum{program_in(netem::Side::kA, host("museum", models().sphere))};
  Process desk{program_in(netem::Side::kB, hrtc("desk", {"--wait-host", "3"}))};
  EXPECT_EQ(desk.wait(), 1) << desk.output();
  EXPECT_THAT(desk.output(), HasSubstr("no host"));
}

TEST_F(WithoutMulticast, PeersMeetWhenEitherNamesTheOther) {
  const std::string a = netem::LinkedPair::address(netem::Side::kA), b = netem::LinkedPair::address(netem::Side::kB);
  expect_a_session({"--peer", b}, {"--peer", a});
  expect_a_session({}, {"--peer", a});
}

TEST_F(WithoutMulticast, ThoseOfOneServerMeet) {
  if (const std::string reason = missing_server(); !reason.empty()) GTEST_SKIP() << reason;
  Process meeting{in(netem::Side::kA, server("11811"))};
  const Command by_server{"--discovery-server", netem::LinkedPair::address(netem::Side::kA)};
  expect_a_session(by_server, by_server);
}

}  // namespace
}  // namespace tactus::e2e
