#include "wire/tap.hpp"

#include <atomic>
#include <mutex>

#include "session/check.hpp"
#include "wire/convert.hpp"
#include "wire/dds.hpp"
#include "wire/endpoints.hpp"
#include "wire/idl_text.hpp"
#include "wire/sample_filter.hpp"
#include "wire/topics.hpp"

namespace tactus::wire {
namespace {

using Bytes = std::vector<std::uint8_t>;

/// The common base of the samples of all types.
struct Encoded {
  Bytes bytes;
};

/// The encoded bytes, and the decoded sample, from which the key is computed.
template <class Type>
struct RawSample : Encoded {
  Type decoded;
};

/// A generated type whose samples also contain their encoded bytes.
template <class Support>
class Raw final : public ReadOnlyType<Guarded<Support>, RawSample<typename Support::type>> {
 public:
  using Sample = RawSample<typename Support::type>;
  explicit Raw(bool has_one_instance) : ReadOnlyType<Guarded<Support>, Sample>{has_one_instance} {}

  bool decode(rtps::SerializedPayload_t& payload, void* data) override {
    Sample& sample = *static_cast<Sample*>(data);
    if (!Guarded<Support>::decode(payload, &sample.decoded)) return false;
    sample.bytes.assign(payload.data, payload.data + payload.length);
    return true;
  }
  [[nodiscard]] Key compute(const void* data) const override {
    return Guarded<Support>::compute(&static_cast<const Sample*>(data)->decoded);
  }
  /// Returns the decoded sample of which `encoded` is a part.
  [[nodiscard]] static const typename Support::type& decoded(const Encoded& encoded) {
    return static_cast<const Sample&>(encoded).decoded;
  }
};

/// Reads the encoded samples of one topic of any type.
class RawReader final : public dds::DataReaderListener {
 public:
  RawReader(dds::DomainParticipant& participant, dds::Topic& topic, const std::vector<std::string>& partitions,
            dds::DataReaderQos qos, std::function<void(const Encoded&, const dds::SampleInfo&)> on_sample)
      : participant_{participant}, data_{topic}, on_sample_{std::move(on_sample)} {
    dds::SubscriberQos subscriber = dds::SUBSCRIBER_QOS_DEFAULT;
    for (const std::string& partition : partitions) subscriber.partition().push_back(partition.c_str());
    // With this history, no sample replaces another one before the reader takes it.
    qos.history().kind = dds::KEEP_ALL_HISTORY_QOS;
    subscriber_ = participant_.create_subscriber(subscriber);
    if (subscriber_ != nullptr) reader_ = subscriber_->create_datareader(&topic, qos, this);
    if (reader_ != nullptr) return;
    if (subscriber_ != nullptr) participant_.delete_subscriber(subscriber_);
    throw WireError("topic " + topic.get_name() + ": DDS cannot create a reader to record it");
  }
  ~RawReader() override {
    reader_->set_listener(nullptr);
    {
      const std::lock_guard lock{mutex_};  // waits for a running callback, and stops one that is about to run
      closed_ = true;
    }
    subscriber_->delete_datareader(reader_);
    participant_.delete_subscriber(subscriber_);
  }

  void on_data_available(dds::DataReader* from) override {
    const std::lock_guard lock{mutex_};
    if (closed_) return;
    dds::SampleInfo info;
    while (succeeded(from->take_next_sample(data_.get(), &info)))
      if (info.valid_data) on_sample_(*static_cast<const Encoded*>(data_.get()), info);
  }

 private:
  /// A sample of the topic's type.
  class Data {
   public:
    explicit Data(const dds::Topic& topic) : type_{topic.get_participant()->find_type(topic.get_type_name())} {
      sample_ = type_.create_data();
    }
    ~Data() { type_.delete_data(sample_); }
    Data(const Data&) = delete;
    Data& operator=(const Data&) = delete;
    [[nodiscard]] void* get() const noexcept { return sample_; }

   private:
    dds::TypeSupport type_;
    void* sample_ = nullptr;
  };

  dds::DomainParticipant& participant_;
  dds::Subscriber* subscriber_ = nullptr;
  dds::DataReader* reader_ = nullptr;
  std::mutex mutex_;
  bool closed_ = false;
  Data data_;
  std::function<void(const Encoded&, const dds::SampleInfo&)> on_sample_;
};

/// Used only for its return type.
template <class Sample>
Sample sample_of(const TopicSpec<Sample>&);

}  // namespace

std::optional<AnySample> decode(const std::string& topic, std::span<const std::uint8_t> encoded) {
  std::optional<AnySample> decoded;
  bool is_found = false;
  topics::for_each([&](const auto& spec) {
    if (is_found || topic != spec.name) return;
    is_found = true;
    using Sample = std::decay_t<decltype(sample_of(spec))>;
    using Support = typename IdlOf<Sample>::Support;
    Bytes bytes{encoded.begin(), encoded.end()};
    rtps::SerializedPayload_t payload;
    payload.data = bytes.data();
    payload.length = payload.max_size = static_cast<std::uint32_t>(bytes.size());
    typename Support::type from;
    const bool is_valid = Guarded<Support>{has_one_instance(spec)}.decode(payload, &from);
    payload.data = nullptr;  // it is not the payload's, which would free it
    if (!is_valid) return;
    Sample sample;
    from_idl(from, sample);
    if (invalid_field(sample) == nullptr) decoded = AnySample{std::move(sample)};
  });
  return decoded;
}

struct Tap::Impl {
  Impl(Participants& participants, const Selection& is_selected, OnSample on_sample, OnDecoded on_decoded) {
    Participants::Impl& in = participants.impl();
    const std::string& session = participants.address().session;
    topics::for_each([&](const auto& spec) {
      if (!is_selected(spec.name, spec.traffic)) return;
      using Sample = std::decay_t<decltype(sample_of(spec))>;
      using Support = typename IdlOf<Sample>::Support;
      dds::Topic& topic = in.topic(spec.name, spec.traffic, dds::TypeSupport{new Raw<Support>{has_one_instance(spec)}});
      // Full-rate probe states and copies of objects use the partitions of groups, with profiles of their own.
      const std::string profile = spec.profile;
      const bool is_group_topic =
          profile == topics::kProbeStateFullRate.profile || profile == topics::kObjectCopy.profile;
      const std::vector<std::string> parts =
          is_group_topic ? std::vector<std::string>{"/g/*"}
                         : std::vector<std::string>{"", "/u/*", "/h/*", std::string{"/"} + kLossesPartition};
      std::vector<std::string> partitions;
      for (const std::string& part : parts) partitions.push_back(session + part);
      const std::size_t number = tap_topics.size();
      tap_topics.push_back(
          {spec.name, topic.get_type_name(), is_group_topic ? "g/*" : std::string{", u/*, h/*, "} + kLossesPartition});
      readers.push_back(std::make_unique<RawReader>(
          in.participant(spec.traffic), topic, partitions, in.reader_qos.at(spec.profile),
          [this, filter = SampleFilter<Sample>{in, spec}, sample = Sample{}, on_sample, on_decoded, number](
              const Encoded& encoded, const dds::SampleInfo& info) mutable {
            const Verdict verdict = filter.check(Raw<Support>::decoded(encoded), info, sample);
            if (verdict == Verdict::kExcess) ++excess;
            if (verdict != Verdict::kAccepted) return;
            on_sample(number, encoded.bytes);
            if (on_decoded) on_decoded(AnySample{std::move(sample)});
          }));
    });
  }

  std::vector<TapTopic> tap_topics;
  std::atomic<std::uint64_t> excess{0};
  std::vector<std::unique_ptr<RawReader>> readers;
};

Tap::Tap(Participants& participants, const Selection& is_selected, OnSample on_sample, OnDecoded on_decoded)
    : impl_{std::make_unique<Impl>(participants, is_selected, std::move(on_sample), std::move(on_decoded))} {}
Tap::~Tap() = default;

const std::vector<TapTopic>& Tap::topics() const noexcept { return impl_->tap_topics; }
std::uint64_t Tap::excess() const noexcept { return impl_->excess; }

const char* idl_text() noexcept { return kIdlText; }

}  // namespace tactus::wire
