/// An HRTC of a simulated session: the production classes DeliveryClient, FailureDetector and UserTable, with models of
/// the cache and of the users' hands.
///
/// The model of the cache counts, for each record, the held regions whose closed lists contain the record. The HRTC
/// checks every message that it receives and every demand that it publishes, and reports violations.
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

// The objects of every session. The regions of an object form a ring. An HRTC wants the touched region and its
// neighbours in the ring, and two pages of the directory. The pages form a ring, too; most of them have no regions.
inline constexpr std::uint64_t kFirstObject = 300;
inline constexpr std::uint64_t kObjects = 2;
inline constexpr std::uint32_t kWantedDistance = 2;  ///< regions up to this distance from the touched one are wanted
inline constexpr std::uint32_t kRetireDistance = 4;  ///< regions beyond this distance are retired
inline constexpr std::uint32_t kSimulatedPages = 8, kWantedPages = 2;
inline constexpr std::uint32_t kSimulatedMaxCredit = 48 * 1024;
inline constexpr std::size_t kMaxPartialBytes = 200'000;
[[nodiscard]] const spm::OwnedModel& model_of(std::uint64_t object);
[[nodiscard]] const spm::codec::CompressedModel& compressed_of(std::uint64_t object);

/// Delays of an HRTC's answers to messages. Decoding and a lack of memory cause them.
struct HrtcFaults {
  std::int64_t decode_ns = 0;  ///< max time until a message is decoded
  double postponing = 0;       ///< probability that the HRTC postpones the answer about a region
};

struct HrtcFigures {
  std::uint64_t regions_held = 0;  ///< number of times that the cache accepted a region
  std::uint64_t regions_refused = 0;
  std::uint64_t pages_held = 0;       ///< number of times that an HRTC stored a page of the directory
  std::uint64_t pages_refused = 0;    ///< because the memory for directories was full
  std::uint64_t pages_forgotten = 0;  ///< dropped, wanted ones included
  std::uint64_t regions_released = 0;
  std::uint64_t records_received = 0;
  std::uint64_t records_repeated = 0;   ///< received although a region that was never retired contains them
  std::uint64_t failures_detected = 0;  ///< suspicions of hosts that had stopped
  std::int64_t max_detection_ns = 0;    ///< max time from the stop of a host to its suspicion
  std::uint64_t false_suspicions = 0;   ///< suspicions of hosts that ran
};

class SimulatedHrtc : public Program {
 public:
  SimulatedHrtc(World& world, std::uint64_t id, const HrtcFaults& faults);

  /// Whether all wanted regions and pages of the object are held and no region is retired.
  [[nodiscard]] bool holds_wanted_parts(std::uint64_t object) const;
  [[nodiscard]] std::vector<session::UserProbe> served_users() const { return user_table_->list(); }
  [[nodiscard]] const session::DeliveryClient& delivery() const noexcept { return *client_; }
  [[nodiscard]] const HrtcFigures& figures() const noexcept { return figures_; }

 protected:
  void on_start() override;
  void on_sample(const Sample& sample) override;
  void on_roster_event(const session::RosterEvent& event) override;
  std::int64_t work() override;
  void complete_entry(session::RosterEntry& entry) const override;

 private:
  struct Cache {
    std::map<std::uint32_t, std::vector<std::uint32_t>> closed_lists;  // of held and retired regions, by region
    std::vector<std::uint32_t> regions_with;                           // number of `closed_lists` with the record
    std::set<std::uint32_t> never_retired;                             // held regions on which hosts may always rely
    std::vector<std::uint32_t> never_retired_with;                     // like `regions_with`, of `never_retired`
    std::map<std::uint32_t, std::uint32_t> retired_epoch;  // of the first demand without a region; 0: not published yet
    std::set<std::uint32_t> pages;                         // held, by number (session::number_of)
    std::uint32_t touched = 0;                             // region
    std::uint32_t epoch = 0;                               // of the last demand
    std::uint32_t released_epoch = 0;                      // messages of earlier epochs may rely on released regions
  };
  struct Decoding {
    std::int64_t end_ns;
    session::DeliveryClient::Message message;
  };

  void run_failure_detector();
  void take_chunk(const session::BulkChunk& chunk);
  void answer_decoded();
  void answer_region(const session::DeliveryClient::Message& message);
  void answer_page(const session::DeliveryClient::Message& message);
  void forget_pages(std::uint64_t object);
  void move_user(std::uint64_t object);
  void retire_and_hold_again(std::uint64_t object);
  void release(std::uint64_t object);
  void free(Cache& cache, std::uint32_t region);
  void publish_demands();
  void check_demand(const Cache& cache, const session::Demand& demand);
  void report_unless_explained(const std::string& description);

  HrtcFaults faults_;
  std::unique_ptr<session::DeliveryClient> client_;
  std::unique_ptr<session::FailureDetector> failure_detector_;
  std::map<std::uint64_t, std::int64_t> last_answer_ns_;  // by watched host that has answered
  std::set<std::uint64_t> suspects_;                      // hosts
  std::unique_ptr<session::UserTable> user_table_;
  std::map<std::string, std::uint64_t> client_of_;  // by user
  std::map<std::uint64_t, Cache> caches_;           // by object
  std::deque<Decoding> decodings_;                  // in the order of their ends
  session::PeriodicTimer move_timer_{15 * kMs};
  HrtcFigures figures_;
};

}  // namespace tactus::test_support
