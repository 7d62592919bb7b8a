/// What a link does to the frames that cross it, and the named links that tests, benchmarks and users share.
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace tactus::netem {

/// A link that cannot be had, or settings that make none: says what, the value found, and the mend.
class LinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One direction of a link.
struct LinkProfile {
  double delay_ms = 0;   ///< from the last bit sent to the last bit received, mean
  double jitter_ms = 0;  ///< standard deviation of the delay: normal, cut off at 0
  /// False: the delay wanders smoothly (correlated over kJitterMemoryMs), as a queue on the way makes it, and frames
  /// stay in order. True: each frame draws a delay of its own and may overtake others.
  bool reorder = false;
  double loss = 0;  ///< chance of a frame to be lost outside a burst, 0..1
  double burst_start =
      0;  ///< Gilbert-Elliott p: chance of each frame outside a burst to begin one; all of a burst is lost
  double burst_end =
      1;  ///< Gilbert-Elliott r: chance of each frame after a lost one to end the burst; its mean length is 1/r
  double rate_mbit = 0;                 ///< 10^6 bits of Ethernet frames a second; 0: no limit
  std::uint32_t queue_bytes = 300'000;  ///< that may wait for a limited rate; a frame that does not fit is dropped

  /// Share of all frames that losses and bursts take together.
  [[nodiscard]] constexpr double mean_loss() const noexcept {
    const double in_burst = burst_start > 0 ? burst_start / (burst_start + burst_end) : 0;
    return in_burst + (1 - in_burst) * loss;
  }
};

/// Time over which smooth jitter forgets, ms: longer than four standard deviations of any profile below, so that the
/// delay practically never falls faster than time passes, which would push frames together.
inline constexpr double kJitterMemoryMs = 100;

/// How two namespaces are joined.
enum class Medium {
  kRelay,  ///< through our relay, which can do all of a LinkProfile; costs some 50 us (docs/how-to/link-emulation.md)
  kVeth    ///< by the kernel's own pair, which can do rate and queue alone (a token bucket with three priority bands)
};

struct NamedLink {
  const char* name;
  const char* what;
  Medium medium;
  LinkProfile each_way;
};

/// Delay, jitter and loss as published studies have them; rates and queues are ours, where those name none. P7 loses
/// 3.8 % in bursts of four frames and 1.2 % beside them.
inline constexpr std::array kNamedLinks{
    NamedLink{"veth", "no emulation: what the kernel does between two namespaces", Medium::kVeth, {}},
    NamedLink{"P0", "no delay: the relay's own cost", Medium::kRelay, {}},
    NamedLink{"P1", "local network", Medium::kRelay, {0.2, 0.02, false, 0, 0, 1, 100, 300'000}},
    NamedLink{"P2", "across a city", Medium::kRelay, {5, 0.5, false, 0.0001, 0, 1, 100, 300'000}},
    NamedLink{"P3", "cellular", Medium::kRelay, {10, 4, false, 0.001, 0, 1, 50, 300'000}},
    NamedLink{"P4", "across a country", Medium::kRelay, {15, 2, false, 0.005, 0, 1, 100, 300'000}},
    NamedLink{"P5", "across a continent", Medium::kRelay, {40, 5, false, 0.01, 0, 1, 100, 300'000}},
    NamedLink{"P6", "across an ocean", Medium::kRelay, {60, 5, false, 0.01, 0, 1, 100, 300'000}},
    NamedLink{"P7", "poor, loses in bursts", Medium::kRelay, {100, 25, false, 0.012, 0.01, 0.25, 10, 150'000}},
    NamedLink{"P8", "satellite", Medium::kRelay, {300, 15, false, 0.02, 0, 1, 20, 600'000}},
};

/// Both directions, and what makes a run repeatable.
struct LinkSettings {
  std::string name;
  Medium medium = Medium::kRelay;
  LinkProfile forth;  ///< a to b
  LinkProfile back;   ///< b to a
  std::uint64_t seed = 1;
};

/// The link that `text` says: a name of kNamedLinks; with an `a` behind it the asymmetric one, whose way forth has 70 %
/// of the round trip's delay and jitter; then any of these, for both ways: `:delay=MS :jitter=MS :reorder :loss=PERCENT
/// :burst=P/R :rate=MBIT :queue=BYTES`. "P4", "P4a", "P0:delay=10:loss=1:rate=100". Throws LinkError with what is
/// expected.
[[nodiscard]] LinkSettings parse_link(const std::string& text);

/// Throws LinkError for a number out of its range, or one that the medium cannot do.
void check(const LinkSettings& settings);

/// "15 ms +- 2, loss 0.5 %, 100 Mbit/s with 300 kB of queue".
[[nodiscard]] std::string describe(const LinkProfile& profile);

}  // namespace tactus::netem
