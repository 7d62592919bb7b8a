/// An HRTC of a simulated session: the real DeliveryClient, FailureDetector and UserSlots, with models of its cache and
/// of its users' hands.
///
/// The cache is a brute-force one: for each record it counts the held regions that list it. It checks every message
/// that it receives and every demand that it publishes, and reports violations.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "session/delivery_client.hpp"
#include "session/failure_detector.hpp"
#include "spm/codec/compressed_model.hpp"
#include "tests/session/simulated_program.hpp"
#include "tests/support/random_model.hpp"

namespace tactus::test_support {

// The objects of every session: regions form a ring; the touched one and its neighbours are wanted.
inline constexpr std::uint64_t kFirstObject = 300;
inline constexpr std::uint64_t kObjects = 2;
inline constexpr std::uint32_t kReach = 2;  ///< regions wanted on each side of the touched one
inline constexpr std::uint32_t kKeep = 4;   ///< regions farther away are retired
inline constexpr std::uint32_t kMaxCredit = 48 * 1024;
inline constexpr std::size_t kMaxPartialBytes = 200'000;
[[nodiscard]] const spm::OwnedModel& model_of(std::uint64_t object);
[[nodiscard]] const spm::codec::CompressedModel& coded_of(std::uint64_t object);

/// Delays in the decoder and in the memory.
struct HrtcFaults {
  std::int64_t decode_ns = 0;  ///< max delay of the answer to a message
  double postponing = 0;       ///< share of messages that are postponed
};

struct HrtcFigures {
  std::uint64_t regions_held = 0;  ///< accepted by the cache
  std::uint64_t regions_refused = 0;
  std::uint64_t regions_released = 0;
  std::uint64_t records_received = 0;
  std::uint64_t records_repeated = 0;  ///< received although a region that was never retired lists them
  std::uint64_t deaths_noticed = 0;    ///< suspected hosts that were dead
  std::int64_t noticed_ns = 0;         ///< max delay of these suspicions
  std::uint64_t false_suspicions = 0;  ///< suspected hosts that were alive
};

class SimulatedHrtc : public Program {
 public:
  SimulatedHrtc(World& world, std::uint64_t id, const HrtcFaults& faults);

  /// Whether all wanted regions of this object are held and none is retired.
  [[nodiscard]] bool content_with(std::uint64_t object) const;
  [[nodiscard]] std::vector<session::UserSlot> slots() const { return slots_->list(); }
  [[nodiscard]] const session::DeliveryClient& delivery() const noexcept { return *client_; }
  [[nodiscard]] const HrtcFigures& figures() const noexcept { return figures_; }

 protected:
  void begin() override;
  void on_sample(const Sample& sample) override;
  void react(const session::RosterEvent& event) override;
  std::int64_t work() override;
  void describe(session::RosterEntry& entry) const override;

 private:
  struct Cache {
    std::vector<std::uint32_t> count;                           // by record, over all held regions
    std::vector<std::uint32_t> firm;                            // by record, over regions never retired
    std::map<std::uint32_t, std::vector<std::uint32_t>> lists;  // held or retired regions
    std::map<std::uint32_t, std::uint32_t> retired;             // -> epoch of the demand that omits it; 0: none yet
    std::set<std::uint32_t> firm_regions;                       // held and never retired: hosts may always rely on them
    std::uint32_t touched = 0;
    std::uint32_t epoch = 0;           // of the last demand
    std::uint32_t released_epoch = 0;  // messages of earlier epochs may rely on released regions
  };
  struct Answer {  // of the decoder, due later
    std::int64_t due_ns;
    session::DeliveryClient::Message message;
  };

  void run_failure_detector();
  void take_chunk(const session::BulkChunk& chunk);
  void answer();
  void accept(const session::DeliveryClient::Message& message);
  void wander(std::uint64_t object);
  void retire_and_take_back(std::uint64_t object);
  void release(std::uint64_t object);
  void free(Cache& cache, std::uint32_t region);
  void publish();
  void unless_excused(const std::string& what);

  HrtcFaults faults_;
  std::unique_ptr<session::DeliveryClient> client_;
  std::unique_ptr<session::FailureDetector> failure_detector_;
  std::map<std::uint64_t, std::int64_t> answered_ns_;  // by watched host that has answered
  std::set<std::uint64_t> suspects_;                   // suspected hosts
  std::unique_ptr<session::UserSlots> slots_;
  std::map<std::string, std::uint64_t> client_of_;  // by user
  std::map<std::uint64_t, Cache> caches_;           // by object
  std::deque<Answer> answers_;
  session::PeriodicTimer wander_{15 * kMs};
  HrtcFigures figures_;
};

}  // namespace tactus::test_support
