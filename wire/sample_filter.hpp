/// Decides which received samples of a topic a program processes, and reports the others. Only the sources of wire/
/// include this header.
#pragma once

#include <cstdint>

#include "realtime/process.hpp"
#include "session/check.hpp"
#include "wire/convert.hpp"
#include "wire/dds.hpp"
#include "wire/rate_limit.hpp"
#include "wire/topics.hpp"

namespace tactus::wire {

enum class Verdict {
  kAccepted,
  kOwn,      ///< the sample was sent by the same Participants
  kExcess,   ///< above TopicSpec::max_rate of its participant
  kForeign,  ///< of another session
  kInvalid,  ///< undecodable, out of bounds or not finite
  kRefused   ///< with keys: of another member than it claims, or not permitted
};

/// One for each DDS reader. One thread at a time.
template <class Sample>
class SampleFilter {
 public:
  /// `participants` must outlive this. `user`: id of the only user whose samples are expected; 0: those of all.
  SampleFilter(const Participants::Impl& participants, const TopicSpec<Sample>& topic, std::uint64_t user = 0)
      : participants_{&participants}, topic_{topic}, limit_{topic.max_rate}, user_{user} {}

  /// Converts and checks the sample that the library has just decoded in this thread. `info`: of this sample.
  [[nodiscard]] Verdict check(const typename IdlOf<Sample>::Type& encoded, const dds::SampleInfo& info,
                              Sample& sample) {
    const bool is_decoded = is_last_sample_decoded;
    const GuidPrefix author = prefix_of(info.sample_identity.writer_guid());
    if (author == prefix_of(participants_->participant(topic_.traffic).guid())) return Verdict::kOwn;
    if (const std::int64_t now_ns = realtime::monotonic_ns(); !limit_.admits(author, now_ns)) {
      report_excess(author, now_ns);
      return Verdict::kExcess;
    }
    if (!is_decoded) return refuse_invalid(author, "encoding: expected the encoding of the type");
    if constexpr (kHasOrigin<Sample>)
      if (encoded.stamp().session() != participants_->session_id) return Verdict::kForeign;
    from_idl(encoded, sample);
    if (const char* const wrong = session::invalid_field(sample)) return refuse_invalid(author, wrong);
    if constexpr (requires { sample.user_id; })
      if (user_ != 0 && sample.user_id != user_)
        return refuse_invalid(author, "user_id: expected the user of the partition");
    if constexpr (!kHasOrigin<Sample>) {
      sample.is_from_member = participants_->security != nullptr;
      sample.senders = participants_->authors_of(info);
    }
    return participants_->is_author(info, claim_of(sample), topic_.name) ? Verdict::kAccepted : Verdict::kRefused;
  }

  /// The invalid field of the last sample that `check` found kInvalid; empty if there was none. Static text.
  [[nodiscard]] const char* invalid_reason() const noexcept { return invalid_reason_; }

 private:
  Verdict refuse_invalid(const GuidPrefix& author, const char* reason) {
    invalid_reason_ = reason;
    participants_->report_invalid(author, topic_.name, reason);
    return Verdict::kInvalid;
  }
  /// Reports at most once in a second.
  void report_excess(const GuidPrefix& author, std::int64_t now_ns) {
    constexpr std::int64_t kReportNs = 1'000'000'000;
    if (now_ns - excess_reported_ns_ <= kReportNs) return;
    excess_reported_ns_ = now_ns;
    participants_->report_excess(author, topic_.name);
  }

  const Participants::Impl* participants_;
  TopicSpec<Sample> topic_;
  RateLimit limit_;
  std::uint64_t user_;
  std::int64_t excess_reported_ns_ = 0;
  const char* invalid_reason_ = "";
};

}  // namespace tactus::wire
