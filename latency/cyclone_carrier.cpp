#include <dds/dds.h>
#include <netinet/in.h>
#include <netinet/ip.h>
#include <pthread.h>
#include <sys/socket.h>
#include <tactus.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <filesystem>
#include <set>
#include <string>
#include <thread>
#include <utility>

#include "latency/carrier.hpp"
#include "latency/statistics.hpp"
#include "realtime/process.hpp"

namespace tactus::latency {
namespace {

constexpr char kPings[] = "latency_pings", kEchoes[] = "latency_echoes", kMesh[] = "latency_mesh";
/// Messages of one frame, large buffers, and a queue for 2 MB of samples that are not yet acknowledged.
constexpr char kConfig[] =
    "<General><MaxMessageSize>1452B</MaxMessageSize><FragmentSize>1344B</FragmentSize></General>"
    "<Internal><SocketReceiveBufferSize min=\"1MB\" max=\"4MB\"/>"
    "<Watermarks><WhcHigh>2MB</WhcHigh></Watermarks></Internal>";

dds_entity_t checked(const char* what, dds_entity_t made) {
  if (made < 0) throw LatencyError(std::string{"Cyclone DDS: "} + what + ": " + dds_strretcode(-made));
  return made;
}

std::set<int> datagram_sockets() {
  std::set<int> found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    const int fd = std::stoi(entry.path().filename().string());
    int type = 0;
    socklen_t size = sizeof type;
    if (::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_DGRAM) found.insert(fd);
  }
  return found;
}

/// A domain with its own sockets and threads.
///
/// The constructor runs at `priority` while it creates the domain, because threads inherit the priority of their
/// creator. If `marks_sockets`, the constructor sets the marks of the new sockets, because Cyclone DDS cannot (issue
/// 2225 of Cyclone DDS).
class Domain {
 public:
  Domain(int number, int priority, bool marks_sockets) {
    const std::set<int> before = datagram_sockets();
    int policy = 0;
    sched_param previous{}, requested{};
    requested.sched_priority = priority;
    pthread_getschedparam(pthread_self(), &policy, &previous);
    if (priority > 0) pthread_setschedparam(pthread_self(), SCHED_FIFO, &requested);
    const auto id = static_cast<dds_domainid_t>(number);
    domain_ = dds_create_domain(id, kConfig);
    if (domain_ >= 0) participant_ = dds_create_participant(id, nullptr, nullptr);
    pthread_setschedparam(pthread_self(), policy, &previous);
    checked("domain", domain_);
    if (participant_ < 0) dds_delete(domain_);
    checked("participant", participant_);
    constexpr int kExpeditedTos = 184, kPriority = 6;  // as qos/flow.yaml marks the probe class
    for (const int fd : datagram_sockets()) {
      if (!marks_sockets || before.count(fd) != 0) continue;
      ::setsockopt(fd, IPPROTO_IP, IP_TOS, &kExpeditedTos, sizeof kExpeditedTos);
      ::setsockopt(fd, SOL_SOCKET, SO_PRIORITY, &kPriority, sizeof kPriority);
    }
  }
  ~Domain() { dds_delete(domain_); }
  Domain(const Domain&) = delete;
  Domain& operator=(const Domain&) = delete;

  [[nodiscard]] dds_entity_t topic(const char* name, const dds_topic_descriptor_t& type, const dds_qos_t* qos) const {
    return checked(name, dds_create_topic(participant_, &type, name, qos, nullptr));
  }
  [[nodiscard]] dds_entity_t writer(dds_entity_t topic, const dds_qos_t* qos) const {
    return checked("writer", dds_create_writer(participant_, topic, qos, nullptr));
  }
  /// `on_data` runs in a thread of the domain.
  [[nodiscard]] dds_entity_t reader(dds_entity_t topic, const dds_qos_t* qos, dds_on_data_available_fn on_data,
                                    void* self) const {
    dds_listener_t* const listener = dds_create_listener(self);
    dds_lset_data_available(listener, on_data);
    const dds_entity_t made = dds_create_reader(participant_, topic, qos, listener);
    dds_delete_listener(listener);
    return checked("reader", made);
  }

 private:
  dds_entity_t domain_ = 0, participant_ = 0;
};

class Qos {
 public:
  explicit Qos(bool reliable) {
    dds_qset_reliability(qos_, reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, DDS_MSECS(100));
    dds_qset_history(qos_, reliable ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST, 1);
  }
  ~Qos() { dds_delete_qos(qos_); }
  Qos(const Qos&) = delete;
  Qos& operator=(const Qos&) = delete;
  operator const dds_qos_t*() const noexcept { return qos_; }

 private:
  dds_qos_t* const qos_ = dds_create_qos();
};

/// Best effort, keep last 1, read in the listener, as for probe states over Fast DDS.
class CycloneCarrier final : public Carrier {
 public:
  CycloneCarrier(Role role, int domain, int priority, OnPacket callback)
      : callback_{std::move(callback)}, domain_{domain, priority, true} {
    const bool pinger = role == Role::kPinger;
    const Qos qos{false};
    const auto topic = [&](const char* name) { return domain_.topic(name, tactus_idl_ProbeState_desc, qos); };
    writer_ = domain_.writer(topic(pinger ? kPings : kEchoes), qos);
    reader_ = domain_.reader(
        topic(pinger ? kEchoes : kPings), qos,
        [](dds_entity_t reader, void* self) { static_cast<CycloneCarrier*>(self)->receive(reader); }, this);
  }

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
    const std::int64_t now = realtime::monotonic_ns();
    tactus_idl_ProbeState sample{};
    void* samples[]{&sample};
    dds_sample_info_t info;
    while (dds_take(reader, samples, &info, 1, 1) == 1)
      if (info.valid_data)
        callback_({sample.sequence_number, sample.probe, sample.session_time_ns, sample.stamp.time_ns}, now);
  }

  const OnPacket callback_;
  const Domain domain_;
  dds_entity_t writer_ = 0, reader_ = 0;
};

class CycloneLoad final : public LoadSource {
 public:
  explicit CycloneLoad(int domain) : domain_{domain, 0, false} {
    const Qos qos{true};
    writer_ = domain_.writer(domain_.topic(kMesh, tactus_idl_BulkChunk_desc, qos), qos);
  }
  ~CycloneLoad() override {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  [[nodiscard]] bool matched() const noexcept override {
    dds_publication_matched_status_t out{};
    dds_get_publication_matched_status(writer_, &out);
    return out.current_count > 0;
  }
  void start() override {
    thread_ = std::thread{[this] {
      std::array<std::uint8_t, kTunedChunkBytes> bytes;
      bytes.fill(0x5a);
      tactus_idl_BulkChunk chunk{};
      chunk.payload = {kTunedChunkBytes, kTunedChunkBytes, bytes.data(), false};
      for (; !stop_; ++chunk.sequence_number) (void)dds_write(writer_, &chunk);  // waits while the queue is full
    }};
  }

 private:
  const Domain domain_;
  dds_entity_t writer_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

class CycloneSink final : public LoadSink {
 public:
  CycloneSink(int domain, double seconds) : seconds_{seconds}, domain_{domain, 0, false} {
    const Qos qos{true};
    (void)domain_.reader(
        domain_.topic(kMesh, tactus_idl_BulkChunk_desc, qos), qos,
        [](dds_entity_t reader, void* self) { static_cast<CycloneSink*>(self)->receive(reader); }, this);
  }
  [[nodiscard]] double bytes_per_s() override { return latency::bytes_per_s(bytes_, first_ns_, last_ns_, seconds_); }

 private:
  void receive(dds_entity_t reader) {
    constexpr std::size_t kMaxSamples = 64;
    std::array<void*, kMaxSamples> samples{};
    std::array<dds_sample_info_t, kMaxSamples> infos;
    for (int count; (count = dds_take(reader, samples.data(), infos.data(), kMaxSamples, kMaxSamples)) > 0;) {
      const std::int64_t now = realtime::monotonic_ns();
      for (int i = 0; i < count; ++i) {
        if (!infos[static_cast<std::size_t>(i)].valid_data) continue;
        if (first_ns_ == 0)
          first_ns_ = now;
        else
          bytes_ += static_cast<const tactus_idl_BulkChunk*>(samples[static_cast<std::size_t>(i)])->payload._length;
        last_ns_ = now;
      }
      dds_return_loan(reader, samples.data(), count);
    }
  }

  const double seconds_;  // duration of the test
  std::atomic<std::uint64_t> bytes_{0};
  std::atomic<std::int64_t> first_ns_{0}, last_ns_{0};
  const Domain domain_;  // last: its threads use the other members
};

}  // namespace

std::unique_ptr<Carrier> make_cyclone(Role role, int domain, int priority, OnPacket callback) {
  return std::make_unique<CycloneCarrier>(role, domain, priority, std::move(callback));
}
std::unique_ptr<LoadSource> make_cyclone_load(int domain) { return std::make_unique<CycloneLoad>(domain); }
std::unique_ptr<LoadSink> make_cyclone_sink(int domain, double seconds) {
  return std::make_unique<CycloneSink>(domain, seconds);
}

}  // namespace tactus::latency
