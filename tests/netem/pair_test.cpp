/// Tests two namespaces and the traffic between them. The tests are skipped, with the reason, where the system does not
/// allow namespaces.
#include "netem/pair.hpp"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <future>
#include <thread>

namespace tactus::netem {
namespace {

using namespace std::chrono_literals;

constexpr int kPort = 5999;
constexpr char kGroup[] = "239.255.0.77";
constexpr int kWatchdogMs = 20'000;

sockaddr_in address(const char* text) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(kPort);
  ::inet_pton(AF_INET, text, &result.sin_addr);
  return result;
}

/// A datagram socket that was created in a namespace and stays there.
class Socket {
 public:
  Socket(const LinkedPair& pair, Side side) {
    std::thread{[&] {
      pair.enter_namespace(side);
      fd_ = ::socket(AF_INET, SOCK_DGRAM, 0);
      const sockaddr_in any = address("0.0.0.0");
      EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&any), sizeof any), 0);
      ip_mreqn group{};
      group.imr_multiaddr = address(kGroup).sin_addr;
      EXPECT_EQ(::setsockopt(fd_, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group), 0);
      const int disabled = 0;
      ::setsockopt(fd_, IPPROTO_IP, IP_MULTICAST_LOOP, &disabled, sizeof disabled);
    }}.join();
  }
  ~Socket() { ::close(fd_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;

  void send(const char* to, int number) const {
    const sockaddr_in destination = address(to);
    EXPECT_EQ(
        ::sendto(fd_, &number, sizeof number, 0, reinterpret_cast<const sockaddr*>(&destination), sizeof destination),
        static_cast<ssize_t>(sizeof number));
  }
  [[nodiscard]] std::optional<int> next(int limit_ms = kWatchdogMs) const {
    pollfd poll_entry{fd_, POLLIN, 0};
    int number = 0;
    if (::poll(&poll_entry, 1, limit_ms) != 1 || ::recv(fd_, &number, sizeof number, 0) != sizeof number)
      return std::nullopt;
    return number;
  }

 private:
  int fd_ = -1;
};

class PairTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string reason = missing_privilege(); !reason.empty()) GTEST_SKIP() << reason;
  }
  static bool exists(const std::string& name) { return std::filesystem::exists("/run/netns/" + name); }
};

class BothMedia : public PairTest, public testing::WithParamInterface<const char*> {};
INSTANTIATE_TEST_SUITE_P(Links, BothMedia, testing::Values("veth", "P0"));

TEST_P(BothMedia, CarryUnicastAndMulticastBothWays) {
  const LinkedPair pair{parse_link(GetParam())};
  const Socket a{pair, Side::kA}, b{pair, Side::kB};
  a.send("10.77.0.2", 1);
  EXPECT_EQ(b.next(), 1);
  b.send("10.77.0.1", 2);
  EXPECT_EQ(a.next(), 2);
  a.send(kGroup, 3);
  EXPECT_EQ(b.next(), 3);
  b.send(kGroup, 4);
  EXPECT_EQ(a.next(), 4);
}

TEST_F(PairTest, EachDirectionHasItsOwnProfile) {
  LinkSettings link = parse_link("P0");
  link.a_to_b.loss = 1;
  link.b_to_a.delay_ms = 40;
  const LinkedPair pair{link};
  const Socket a{pair, Side::kA}, b{pair, Side::kB};
  for (int i = 0; i < 20; ++i) a.send("10.77.0.2", i);
  const auto start = std::chrono::steady_clock::now();
  b.send("10.77.0.1", 5);
  EXPECT_EQ(a.next(), 5);
  EXPECT_GE(std::chrono::steady_clock::now() - start, 40ms);
  EXPECT_EQ(b.next(0), std::nullopt);
  EXPECT_GE(pair.figures().a_to_b.lost, 20u);
  EXPECT_EQ(pair.figures().b_to_a.lost, 0u);
}

TEST_F(PairTest, RemovesItsNamespaces) {
  std::string a, b;
  {
    const LinkedPair pair{parse_link("P1")};
    a = pair.name(Side::kA);
    b = pair.name(Side::kB);
    EXPECT_TRUE(exists(a) && exists(b));
  }
  EXPECT_FALSE(exists(a) || exists(b));
}

TEST_F(PairTest, TwoPairsAreIndependent) {
  const LinkedPair one{parse_link("P0")}, two{parse_link("P0")};
  const Socket a{one, Side::kA}, b{one, Side::kB}, stranger{two, Side::kB};
  a.send("10.77.0.2", 9);
  EXPECT_EQ(b.next(), 9);
  EXPECT_EQ(stranger.next(0), std::nullopt);
}

TEST_F(PairTest, RemovesTheNamespacesOfAKilledPair) {
  std::array<int, 2> pipe{};
  ASSERT_EQ(::pipe(pipe.data()), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const LinkedPair pair{parse_link("P0")};
    const std::string& name = pair.name(Side::kA);
    (void)!::write(pipe[1], name.data(), name.size());
    ::kill(::getpid(), SIGKILL);
  }
  ::close(pipe[1]);
  ::waitpid(child, nullptr, 0);
  std::array<char, 128> text{};
  const ssize_t bytes = ::read(pipe[0], text.data(), text.size());
  ::close(pipe[0]);
  ASSERT_GT(bytes, 0);
  const std::string name(text.data(), static_cast<std::size_t>(bytes));
  // Another program may already have removed the stale namespace.
  const LinkedPair next{parse_link("P0")};
  while (exists(name)) std::this_thread::yield();  // ctest's timeout fails the test otherwise
}

}  // namespace
}  // namespace tactus::netem
