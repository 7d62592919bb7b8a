/// The gateway's end of an IntakeLink: writes messages, reads answers, and counts the memory that stays free.
///
/// One thread. Not realtime: allocates for messages that do not fit into the ring yet.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>
#include <type_traits>
#include <vector>

#include "hrtc_service/servo/intake_link.hpp"
#include "spm/model.hpp"
#include "spm/pool.hpp"
#include "spm/region_data.hpp"

namespace tactus::hrtc_service {

class IntakeSender {
 public:
  /// Attaches to the intake if an earlier sender has used the link. `link` must outlive the sender. `pool`: settings of
  /// the intake's pool, which is empty if nobody has used the link.
  IntakeSender(IntakeLink& link, const spm::PoolSettings& pool);

  /// Returns whether the intake has answered the attach. Until then nothing is sent, and no memory counts as free.
  [[nodiscard]] bool is_attached() const noexcept { return is_attached_; }
  /// Takes the answer to the attach, once. Returns false if there is none yet, or if no attach was necessary.
  [[nodiscard]] bool take_attach_answer(AttachAnswer& answer);

  /// Each of these appends a message to those that `flush` sends. `base.summary` replaces `object.summary`.
  void add_object(std::uint32_t index, IntakeObject object, const spm::BaseMesh& base);
  void add_page(std::uint32_t index, const spm::Page& page);
  void drop_page(std::uint32_t index, spm::PageId page);
  void add_region(std::uint32_t index, const spm::RegionData& region, const spm::ListSummary& expected);
  void retire(std::uint32_t index, spm::RegionId region);
  void withdraw(std::uint32_t index);
  /// Sends what fits into the ring. Returns whether that was all. Call it after messages were appended, and again until it
  /// returns true.
  bool flush();

  /// Returns false if no answer waits.
  [[nodiscard]] bool take(IntakeAnswer& answer);
  /// Returns a lower bound of the pool memory that is free once the intake has processed all messages.
  [[nodiscard]] const spm::Cache::Space& free_space() const noexcept { return free_; }

 private:
  struct Cost {
    std::uint64_t message;     // number of the message
    spm::Cache::Space memory;  // max memory that it takes
  };
  /// Appends a message that may take `cost`. `parts`: objects and spans, whose bytes are copied.
  template <class... Parts>
  void append(IntakeKind kind, std::uint32_t index, const spm::Cache::Space& cost, const Parts&... parts);

  bool is_attached_;
  std::uint32_t request_ = 0;  // of the attach
  MailboxReader<AttachAnswer> attach_answers_;
  RingWriter<std::byte, IntakeLink::kMessageBytes> messages_;
  RingReader<IntakeAnswer, IntakeLink::kAnswers> answers_;
  std::vector<std::byte> waiting_;  // bytes that the ring has not taken yet begin at `sent_`
  std::size_t sent_ = 0;
  std::uint64_t message_count_ = 0;
  std::deque<Cost> unanswered_;
  spm::Cache::Space reported_;  // free memory in the newest answer
  spm::Cache::Space free_;      // reported_ without the costs of unanswered messages
};

}  // namespace tactus::hrtc_service
