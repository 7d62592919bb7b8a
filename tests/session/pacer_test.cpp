/// A Pacer that fills a link in virtual time: one queue, one transmitter, a way there and back, a demand now and then.
#include "session/pacer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <random>
#include <vector>

#include "session/messages.hpp"

namespace tactus::session {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::uint32_t kChunk = kMaxPayload;
constexpr double kHeaders = 150;

struct Path {
  double mbit = 100;
  std::int64_t one_way_ns = 100'000;
  double loss = 0;
  std::int64_t demand_ns = 5 * kMs;
  std::int64_t clock_offset_ns = -123'456'789'000;  // of the receiver
};

struct Outcome {
  double share;         // of the link's rate, in the last three quarters
  double p99_queue_ms;  // there
};

/// Endless data for `seconds`.
Outcome fill(const Path& path, double seconds) {
  struct Chunk {
    std::int64_t sent, arrives;
    bool lost;
  };
  std::mt19937_64 random{1};
  std::uniform_real_distribution<double> share{0, 1};
  Pacer pacer;
  std::deque<Chunk> under_way;
  std::deque<std::pair<std::int64_t, std::vector<Chunk>>> demands;
  std::int64_t free = 0, next_demand = 0;
  std::vector<double> queues;
  double carried = 0;
  const auto end = static_cast<std::int64_t>(seconds * 1e9);
  const auto takes = static_cast<std::int64_t>((kChunk + kHeaders) * 8 / path.mbit * 1e3);
  for (std::int64_t now = 0; now < end; now += 20'000) {
    if (now >= next_demand) {
      std::vector<Chunk> told;
      for (; !under_way.empty() && under_way.front().arrives <= now; under_way.pop_front())
        told.push_back(under_way.front());
      if (!told.empty()) demands.emplace_back(now + path.one_way_ns, std::move(told));
      next_demand = now + path.demand_ns;
    }
    for (; !demands.empty() && demands.front().first <= now; demands.pop_front()) {
      Pacer::Feedback feedback;
      for (const Chunk& chunk : demands.front().second) {
        (chunk.lost ? feedback.lost_bytes : feedback.arrived_bytes) += kChunk;
        if (chunk.lost) continue;
        const auto way = static_cast<std::uint32_t>((chunk.arrives + path.clock_offset_ns) / 1000) -
                         static_cast<std::uint32_t>(chunk.sent / 1000);
        if (!feedback.one_way_us || static_cast<std::int32_t>(way - *feedback.one_way_us) < 0)
          feedback.one_way_us = way;
        feedback.loop_ns = std::max(feedback.loop_ns, now - chunk.sent);
      }
      pacer.on_feedback(feedback, now);
    }
    while (pacer.may_send(kChunk, now)) {
      pacer.sent(kChunk, now);
      if (now > end / 4) {
        queues.push_back(static_cast<double>(std::max<std::int64_t>(0, free - now)) / kMs);
        carried += static_cast<double>(takes);
      }
      free = std::max(free, now) + takes;
      under_way.push_back({now, free + path.one_way_ns, share(random) < path.loss});
    }
  }
  std::sort(queues.begin(), queues.end());
  return {carried / (static_cast<double>(end) * 0.75), queues.at(queues.size() * 99 / 100)};
}

TEST(Pacer, FillsALinkOfAnyRateAndLeavesItsQueueShort) {
  for (const double mbit : {10.0, 100.0, 1000.0}) {
    Path path;
    path.mbit = mbit;
    const Outcome outcome = fill(path, 12);
    EXPECT_GT(outcome.share, 0.9) << mbit << " Mbit/s";
    EXPECT_LT(outcome.p99_queue_ms, mbit < 50 ? 5 : 3) << mbit << " Mbit/s";
  }
}

TEST(Pacer, FillsALongLinkThatLoses) {
  Path path;
  path.one_way_ns = 10 * kMs;
  path.loss = 0.01;
  EXPECT_GT(fill(path, 12).share, 0.9);
  path.loss = 0.3;
  EXPECT_GT(fill(path, 12).share, 0.9);
}

TEST(Pacer, SendsNoMoreThanItsWindowUntilItIsAnswered) {
  Pacer pacer;
  std::uint32_t sent = 0;
  for (std::int64_t now = 0; now < 1000 * kMs; now += kMs) {
    while (pacer.may_send(kChunk, now)) {
      pacer.sent(kChunk, now);
      sent += kChunk;
    }
  }
  EXPECT_LE(sent, pacer.window());
  EXPECT_GT(sent + kChunk, pacer.window());
  EXPECT_EQ(pacer.under_way(), sent);
}

TEST(Pacer, SpreadsAWindowInsteadOfSendingItAtOnce) {
  Pacer pacer;
  int at_once = 0;
  for (; pacer.may_send(kChunk, kMs * 1000); ++at_once) pacer.sent(kChunk, kMs * 1000);
  EXPECT_LT(at_once, 10);
  EXPECT_GT(pacer.next_ns(), kMs * 1000);
}

}  // namespace
}  // namespace tactus::session
