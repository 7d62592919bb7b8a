/// A Pacer that fills a link in virtual time: one queue, one transmitter, a delay each way, a demand every 5 ms.
#include "session/pacer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "netem/link.hpp"
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
  double share;         // of the link's rate, in the last three quarters of the time
  double p99_queue_ms;  // in the same time
};

/// Sends without end for `seconds`.
Outcome fill(const Path& path, double seconds) {
  struct Chunk {
    std::int64_t sent, arrives;
    bool lost;
  };
  std::mt19937_64 random{1};
  std::uniform_real_distribution<double> share{0, 1};
  Pacer pacer;
  std::deque<Chunk> in_flight;
  std::deque<std::pair<std::int64_t, std::vector<Chunk>>> demands;
  std::int64_t free = 0, next_demand = 0;
  std::vector<double> queues;
  double carried = 0;
  const auto end = static_cast<std::int64_t>(seconds * 1e9);
  const auto takes = static_cast<std::int64_t>((kChunk + kHeaders) * 8 / path.mbit * 1e3);
  for (std::int64_t now = 0; now < end; now += 20'000) {
    if (now >= next_demand) {
      std::vector<Chunk> published;
      for (; !in_flight.empty() && in_flight.front().arrives <= now; in_flight.pop_front())
        published.push_back(in_flight.front());
      if (!published.empty()) demands.emplace_back(now + path.one_way_ns, std::move(published));
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
        feedback.round_trip_ns = std::max(feedback.round_trip_ns, now - chunk.sent);
      }
      pacer.on_feedback(feedback, now);
    }
    while (pacer.may_send(kChunk, now)) {
      pacer.on_sent(kChunk, now);
      if (now > end / 4) {
        queues.push_back(static_cast<double>(std::max<std::int64_t>(0, free - now)) / kMs);
        carried += static_cast<double>(takes);
      }
      free = std::max(free, now) + takes;
      in_flight.push_back({now, free + path.one_way_ns, share(random) < path.loss});
    }
  }
  std::sort(queues.begin(), queues.end());
  return {carried / (static_cast<double>(end) * 0.75), queues.at(queues.size() * 99 / 100)};
}

TEST(Pacer, FillsALinkOfAnyRateWithAShortQueue) {
  for (const double mbit : {10.0, 100.0, 1000.0}) {
    Path path;
    path.mbit = mbit;
    const Outcome outcome = fill(path, 12);
    EXPECT_GT(outcome.share, 0.9) << mbit << " Mbit/s";
    EXPECT_LT(outcome.p99_queue_ms, mbit < 50 ? 5 : 3) << mbit << " Mbit/s";
  }
}

TEST(Pacer, FillsALongLossyLink) {
  Path path;
  path.one_way_ns = 10 * kMs;
  path.loss = 0.01;
  EXPECT_GT(fill(path, 12).share, 0.9);
  path.loss = 0.3;
  EXPECT_GT(fill(path, 12).share, 0.9);
}

struct NamedOutcome {
  double share;   // of the link's rate that arrives in the last two thirds
  double window;  // at the end, bytes
};

/// Sends over a named link for `seconds`: without end, or `burst` bytes every 200 ms.
NamedOutcome send_named(const netem::NamedLink& named, double seconds, std::uint64_t seed, std::uint32_t burst = 0) {
  constexpr std::int64_t kEcho = 100 * kMs;  // delay of an echo after the last chunk
  struct Chunk {
    std::int64_t sent;
    std::uint32_t bytes;
    std::optional<std::int64_t> arrives;
  };
  netem::Link forth{named.each_direction, 2 * seed + 1}, back{named.each_direction, 2 * seed + 2};
  Pacer pacer;
  std::deque<Chunk> in_flight;
  struct Published {
    std::int64_t at;
    Pacer::Feedback feedback;
    std::int64_t first_sent;
  };
  std::deque<Published> published;
  Published unpublished{0, {}, 0};
  double arrived = 0;
  const auto end = static_cast<std::int64_t>(seconds * 1e9);
  std::int64_t next_demand = 0, next_echo = 0;
  std::uint32_t to_send = 0;
  const auto send = [&](std::uint32_t bytes, std::int64_t now) {
    in_flight.push_back({now, bytes, forth.departure(now, bytes + static_cast<std::size_t>(kHeaders))});
    next_echo = now + kEcho;
  };
  for (std::int64_t now = 0; now < end; now += 50'000) {
    if (burst == 0 || now % (200 * kMs) == 0) to_send = burst == 0 ? kChunk : burst;
    if (now >= next_demand) {
      next_demand = now + 5 * kMs;
      // Chunks stay in order, so a loss is detected when the next one arrives.
      const auto newest = std::find_if(in_flight.rbegin(), in_flight.rend(),
                                       [&](const Chunk& chunk) { return chunk.arrives && *chunk.arrives <= now; });
      for (auto left = in_flight.rend() - newest; left > 0; --left, in_flight.pop_front()) {
        const Chunk& chunk = in_flight.front();
        Pacer::Feedback& feedback = unpublished.feedback;
        (chunk.arrives ? feedback.arrived_bytes : feedback.lost_bytes) += chunk.bytes;
        if (!chunk.arrives || chunk.bytes == 0) continue;
        if (now > end / 3) arrived += chunk.bytes + kHeaders;
        const auto way = static_cast<std::uint32_t>((*chunk.arrives - chunk.sent) / 1000);
        if (!feedback.one_way_us) unpublished.first_sent = chunk.sent;
        feedback.one_way_us = std::min(feedback.one_way_us.value_or(way), way);
      }
      if (unpublished.feedback.arrived_bytes != 0 || unpublished.feedback.lost_bytes != 0) {
        // The next demand includes the feedback of a lost one.
        if (const auto at = back.departure(now, 300)) {
          unpublished.at = *at;
          published.push_back(std::exchange(unpublished, Published{0, {}, 0}));
        }
      }
    }
    for (; !published.empty() && published.front().at <= now; published.pop_front()) {
      published.front().feedback.round_trip_ns = now - published.front().first_sent;
      pacer.on_feedback(published.front().feedback, now);
    }
    while (to_send >= kChunk && pacer.may_send(kChunk, now)) {
      pacer.on_sent(kChunk, now);
      if (burst != 0) to_send -= kChunk;
      send(kChunk, now);
    }
    if (!in_flight.empty() && now >= next_echo) send(0, now);
    if (to_send < kChunk) pacer.set_idle();
  }
  const double rate = named.each_direction.rate_mbit * 1e6 / 8 * (1 - named.each_direction.mean_loss());
  return {arrived / (rate * seconds * 2 / 3), pacer.window()};
}

/// The values of several seeds, ascending, because bursts of losses make a single seed unreliable.
template <class Value>
std::vector<double> of_seeds(const Value& value) {
  std::vector<double> all;
  for (std::uint64_t seed = 0; seed < 5; ++seed) all.push_back(value(seed));
  std::sort(all.begin(), all.end());
  return all;
}

TEST(Pacer, FillsLinksWithVaryingDelay) {
  for (const netem::NamedLink& link : netem::kNamedLinks) {
    if (link.each_direction.rate_mbit == 0) continue;
    const std::vector<double> shares = of_seeds([&](std::uint64_t seed) { return send_named(link, 60, seed).share; });
    const bool loses_in_bursts = std::string{link.name} == "P7";
    EXPECT_GT(shares[2], loses_in_bursts ? 0.8 : 0.9) << link.name << ", " << link.description;
    EXPECT_GT(shares[0], loses_in_bursts ? 0.4 : 0.85) << link.name << ", " << link.description;
  }
}

TEST(Pacer, KeepsAWindowForABurstOnLinksWithVaryingDelay) {
  constexpr std::uint32_t kBurst = 4 * kChunk;
  for (const netem::NamedLink& link : netem::kNamedLinks) {
    if (link.each_direction.rate_mbit == 0) continue;
    const std::vector<double> windows =
        of_seeds([&](std::uint64_t seed) { return send_named(link, 60, seed, kBurst).window; });
    EXPECT_GE(windows[2], 2 * kBurst) << link.name << ", " << link.description;
    EXPECT_GE(windows[0], kBurst / 2) << link.name << ", " << link.description;
  }
}

TEST(Pacer, SendsNoMoreThanItsWindowWithoutFeedback) {
  Pacer pacer;
  std::uint32_t sent = 0;
  for (std::int64_t now = 0; now < 1000 * kMs; now += kMs) {
    while (pacer.may_send(kChunk, now)) {
      pacer.on_sent(kChunk, now);
      sent += kChunk;
    }
  }
  EXPECT_LE(sent, pacer.window());
  EXPECT_GT(sent + kChunk, pacer.window());
  EXPECT_EQ(pacer.in_flight(), sent);
}

TEST(Pacer, SpreadsAWindowInsteadOfSendingItAtOnce) {
  Pacer pacer;
  int at_once = 0;
  for (; pacer.may_send(kChunk, kMs * 1000); ++at_once) pacer.on_sent(kChunk, kMs * 1000);
  EXPECT_LT(at_once, 10);
  EXPECT_GT(pacer.next_ns(), kMs * 1000);
}

}  // namespace
}  // namespace tactus::session
