/// The effect of a link on Ethernet frames, and the named links that tests, benchmarks and users share.
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace tactus::netem {

/// Invalid settings of a link, or a link that cannot be made. The message has the value found and the remedy.
class LinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One direction of a link.
struct LinkProfile {
  double delay_ms = 0;   ///< mean time from the last bit sent to the last bit received
  double jitter_ms = 0;  ///< standard deviation of the delay, which is normally distributed and at least 0
  /// False: the delay varies smoothly, as in a queue, with correlation time kJitterCorrelationMs, and frames stay in order.
  /// True: each frame has an independent delay and may overtake others.
  bool reorder = false;
  double loss = 0;  ///< probability that a frame outside a burst is lost, 0 to 1
  /// Gilbert-Elliott p: probability per frame that a burst begins. All frames of a burst are lost.
  double burst_start = 0;
  /// Gilbert-Elliott r: probability per frame of a burst that the burst ends. The mean length of a burst is 1/r frames.
  double burst_end = 1;
  double rate_mbit = 0;                 ///< 10^6 bits of Ethernet frames per second, at least 0.001; 0: no limit
  std::uint32_t queue_bytes = 300'000;  ///< size of the queue with a limited rate; a frame that does not fit is dropped
  double repeat = 0;                    ///< probability that a frame that arrives does so twice, 0 to 1

  /// Share of all frames that are lost, in bursts and outside them.
  [[nodiscard]] constexpr double mean_loss() const noexcept {
    const double in_burst = burst_start > 0 ? burst_start / (burst_start + burst_end) : 0;
    return in_burst + (1 - in_burst) * loss;
  }
};

/// Correlation time of smooth jitter, ms. If the delay fell by 1 ms in each ms, the intervals between frames would
/// become zero. The delay almost never falls so fast, because the correlation time is at least four times the standard
/// deviation of the jitter of any profile below.
inline constexpr double kJitterCorrelationMs = 100;

/// The connection between two namespaces.
enum class Medium {
  kRelay,  ///< a Relay, which supports all of LinkProfile and adds about 50 us (docs/how-to/link-emulation.md)
  kVeth    ///< a veth pair of the kernel, which supports rate and queue (a token bucket with three priority bands)
};

struct NamedLink {
  const char* name;
  const char* description;
  Medium medium;
  LinkProfile each_direction;
};

/// Named links. Delay, jitter and loss are from published studies. We chose rates and queues where the studies state
/// none. P7 loses 3.8 % of the frames in bursts of four frames, and 1.2 % of the others.
inline constexpr std::array kNamedLinks{
    NamedLink{"veth", "no emulation: the kernel's link between two namespaces", Medium::kVeth, {}},
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

/// Both directions, and the seed that makes a run repeatable.
struct LinkSettings {
  std::string name;
  Medium medium = Medium::kRelay;
  LinkProfile a_to_b;
  LinkProfile b_to_a;
  std::uint64_t seed = 1;
};

/// Parses a link: a name of kNamedLinks, then settings for both directions. After the name, the suffix `a` means the
/// asymmetric variant, with 70 % of the round trip's delay and jitter from a to b. Settings are `:delay=MS :jitter=MS
/// :reorder :loss=PERCENT :burst=P/R :repeat=PERCENT :rate=MBIT :queue=BYTES`. Examples: "P4", "P4a",
/// "P0:delay=10:loss=1:rate=100". Throws LinkError with the expected form.
[[nodiscard]] LinkSettings parse_link(const std::string& text);

/// Throws LinkError for a setting that is out of range or that the medium does not support.
void check(const LinkSettings& settings);

/// Returns a text such as "15 ms +- 2, loss 0.5 %, 100 Mbit/s with 300 kB of queue".
[[nodiscard]] std::string describe(const LinkProfile& profile);

}  // namespace tactus::netem
