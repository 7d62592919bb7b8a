#include <dds/dds.h>
#include <pthread.h>
#include <tactus.h>

#include <algorithm>
#include <string>
#include <utility>

#include "latency/carrier.hpp"
#include "wire/process.hpp"

namespace tactus::latency {
namespace {

constexpr char kPings[] = "latency_pings", kEchoes[] = "latency_echoes";

dds_entity_t checked(const char* what, dds_entity_t made) {
  if (made < 0) throw LatencyError(std::string{"Cyclone DDS: "} + what + ": " + dds_strretcode(-made));
  return made;
}

/// Its threads inherit the priority of the thread that creates the first participant.
dds_entity_t join(int domain, int priority) {
  int policy = 0;
  sched_param before{}, wanted{};
  wanted.sched_priority = priority;
  pthread_getschedparam(pthread_self(), &policy, &before);
  if (priority > 0) pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted);
  const dds_entity_t made = dds_create_participant(static_cast<dds_domainid_t>(domain), nullptr, nullptr);
  pthread_setschedparam(pthread_self(), policy, &before);
  return checked("participant", made);
}

/// Best effort, keep last 1, read in the listener, as for our own probe states.
class CycloneCarrier final : public Carrier {
 public:
  CycloneCarrier(Part part, int domain, int priority, OnPacket callback)
      : callback_{std::move(callback)}, participant_{join(domain, priority)} {
    const bool pinger = part == Part::kPinger;
    dds_qos_t* const qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1);
    dds_listener_t* const listener = dds_create_listener(this);
    dds_lset_data_available(
        listener, [](dds_entity_t reader, void* self) { static_cast<CycloneCarrier*>(self)->receive(reader); });
    const auto topic = [&](const char* name) {
      return checked(name, dds_create_topic(participant_, &tactus_idl_ProbeState_desc, name, qos, nullptr));
    };
    writer_ = dds_create_writer(participant_, topic(pinger ? kPings : kEchoes), qos, nullptr);
    reader_ = dds_create_reader(participant_, topic(pinger ? kEchoes : kPings), qos, listener);
    dds_delete_listener(listener);
    dds_delete_qos(qos);
    checked("writer", writer_);
    checked("reader", reader_);
  }
  ~CycloneCarrier() override { dds_delete(participant_); }

  bool send(const Packet& packet) noexcept override {
    tactus_idl_ProbeState sample{};
    sample.sequence_number = packet.sequence;
    sample.probe = packet.reader;
    sample.session_time_ns = packet.event_ns;
    sample.stamp.time_ns = packet.sent_ns;
    return dds_write(writer_, &sample) == DDS_RETCODE_OK;
  }
  [[nodiscard]] std::uint32_t matched() const noexcept override {
    dds_publication_matched_status_t out{};
    dds_subscription_matched_status_t in{};
    dds_get_publication_matched_status(writer_, &out);
    dds_get_subscription_matched_status(reader_, &in);
    return std::min(out.current_count, in.current_count);
  }

 private:
  void receive(dds_entity_t reader) {
    const std::int64_t now = wire::monotonic_ns();
    tactus_idl_ProbeState sample{};
    void* samples[]{&sample};
    dds_sample_info_t info;
    while (dds_take(reader, samples, &info, 1, 1) == 1)
      if (info.valid_data)
        callback_({sample.sequence_number, sample.probe, sample.session_time_ns, sample.stamp.time_ns}, now);
  }

  const OnPacket callback_;
  const dds_entity_t participant_;
  dds_entity_t writer_ = 0, reader_ = 0;
};

}  // namespace

std::unique_ptr<Carrier> make_cyclone(Part part, int domain, int priority, OnPacket callback) {
  return std::make_unique<CycloneCarrier>(part, domain, priority, std::move(callback));
}

}  // namespace tactus::latency
