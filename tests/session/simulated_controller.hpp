/// An HRTC of a simulated session: DeliveryClient, Vigil and UserSlots as they are, its cache and its users' hands as
/// models.
///
/// The cache is the brute-force one: a count for each record of the regions here that list it. It looks at each message
/// that it is handed and at each demand that it publishes, and says what must not be.
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

// The objects of every session: regions stand on a ring, the one touched and its neighbours are wanted.
inline constexpr std::uint64_t kFirstObject = 300;
inline constexpr std::uint64_t kObjects = 2;
inline constexpr std::uint32_t kReach = 2;  ///< regions wanted around the one that is touched
inline constexpr std::uint32_t kKeep = 4;   ///< farther ones are retired
inline constexpr std::uint32_t kMaxCredit = 48 * 1024;
inline constexpr std::size_t kMaxPartialBytes = 200'000;
[[nodiscard]] const spm::OwnedModel& model_of(std::uint64_t object);
[[nodiscard]] const spm::codec::CompressedModel& coded_of(std::uint64_t object);

/// How its decoder and its memory treat messages.
struct ControllerFaults {
  std::int64_t decode_ns = 0;  ///< it answers for a message up to so much later
  double parking = 0;          ///< share of messages that wait as if for room
};

struct ControllerFigures {
  std::uint64_t regions_held = 0;  ///< accepted by the cache
  std::uint64_t regions_refused = 0;
  std::uint64_t regions_released = 0;
  std::uint64_t records_received = 0;
  std::uint64_t records_repeated = 0;  ///< came although a region that was never retired had them
  std::uint64_t deaths_noticed = 0;    ///< of hosts that were counted on, by their silence
  std::int64_t noticed_ns = 0;         ///< the longest that took
  std::uint64_t false_alarms = 0;      ///< hosts that lived
};

class SimulatedController : public Program {
 public:
  SimulatedController(World& world, std::uint64_t id, const ControllerFaults& faults);

  /// All that is wanted of this object is here, and nothing is on its way out.
  [[nodiscard]] bool content_with(std::uint64_t object) const;
  [[nodiscard]] std::vector<session::UserSlot> slots() const { return slots_->list(); }
  [[nodiscard]] const session::DeliveryClient& delivery() const noexcept { return *client_; }
  [[nodiscard]] const ControllerFigures& figures() const noexcept { return figures_; }

 protected:
  void begin() override;
  void hear(const Sample& sample) override;
  void react(const session::RosterEvent& event) override;
  std::int64_t work() override;
  void describe(session::RosterEntry& entry) const override;

 private:
  struct Cache {
    std::vector<std::uint32_t> count;                           // by record, over all regions here
    std::vector<std::uint32_t> firm;                            // by record, over those never retired
    std::map<std::uint32_t, std::vector<std::uint32_t>> lists;  // held or retired regions
    std::map<std::uint32_t, std::uint32_t> retired;             // -> epoch of the demand that omits it; 0: none has
    std::set<std::uint32_t> firm_regions;                       // held and never retired: hosts always count on them
    std::uint32_t touched = 0;
    std::uint32_t epoch = 0;           // of the last demand
    std::uint32_t released_epoch = 0;  // messages of earlier ones may count on what has been released
  };
  struct Answer {  // the decoder's, in time
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

  ControllerFaults faults_;
  std::unique_ptr<session::DeliveryClient> client_;
  std::unique_ptr<session::FailureDetector> failure_detector_;
  std::map<std::uint64_t, std::int64_t> answered_ns_;  // by host that is watched and has answered
  std::set<std::uint64_t> silent_;                     // of these
  std::unique_ptr<session::UserSlots> slots_;
  std::map<std::string, std::uint64_t> client_of_;  // by user
  std::map<std::uint64_t, Cache> caches_;           // by object
  std::deque<Answer> answers_;
  session::Every wander_{15 * kMs};
  ControllerFigures figures_;
};

}  // namespace tactus::test_support
