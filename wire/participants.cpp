#include "wire/participants.hpp"

#include <netinet/in.h>
#include <netinet/ip.h>
#include <pthread.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <set>
#include <string_view>
#include <system_error>
#include <utility>

#include "keys/documents.hpp"
#include "session/printable.hpp"
#include "wire/dds.hpp"
#include "wire/discovery.hpp"
#include "wire/footprint.hpp"
#include "wire/incarnation.hpp"
#include "wire/profiles.hpp"
#include "wire/security.hpp"
#include "wire/session_keys.hpp"
#include "wire/topics.hpp"
#include "wire/transport/filter_transport.hpp"

namespace tactus::wire {
namespace {

constexpr char kPlain[] = "NOT SECURED (--plain): everyone who reaches the network can read and change this session";

constexpr char kLacksFunctions[] =
    "probe states with keys get no real-time priority, because this program has Tactus in a shared library; expected "
    "tactus_wire linked into the program (wire/session_keys.hpp)";

/// DDS name of the participants that only read bulk, by which they ignore each other.
constexpr char kReadsBulk[] = "tactus_bulk_reader";

/// Held while a Participants loads and copies profiles, because Fast DDS stores them in one global table.
std::mutex& factory_mutex() {
  static std::mutex mutex;
  return mutex;
}

void check_name(const char* what, const std::string& name) {
  if (name.empty() || name.size() > session::kMaxName) {
    throw WireError(std::string{what} + " name '" + name + "' has " + std::to_string(name.size()) +
                    " bytes; expected 1 to " + std::to_string(session::kMaxName));
  }
  if (session::has_control_character(name) || name.find_first_of("*?[]/\\") != std::string::npos) {
    throw WireError(std::string{what} + " name '" + name +
                    "' has a control character or one of * ? [ ] / \\, which "
                    "would match other partitions");
  }
}

/// File descriptors of this process that are IPv4 datagram sockets.
std::set<int> datagram_sockets() {
  std::set<int> found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    const int fd = std::stoi(entry.path().filename().string());
    int type = 0, domain = 0;
    socklen_t size = sizeof type;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) != 0 || type != SOCK_DGRAM) continue;
    size = sizeof domain;
    if (getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &size) == 0 && domain == AF_INET) found.insert(fd);
  }
  return found;
}

/// Sets the options of the sockets that were opened since `before`, because Fast DDS 2.9 cannot. Sets IP_TOS first: the
/// kernel then also sets a priority, which SO_PRIORITY replaces.
void mark_new_sockets(const std::set<int>& before, const SocketOptions& marks) {
  if (marks.tos == 0 && marks.priority == 0) return;
  for (const int fd : datagram_sockets()) {
    if (before.count(fd) != 0) continue;
    if (marks.tos != 0) setsockopt(fd, IPPROTO_IP, IP_TOS, &marks.tos, sizeof marks.tos);
    if (marks.priority != 0) setsockopt(fd, SOL_SOCKET, SO_PRIORITY, &marks.priority, sizeof marks.priority);
  }
}

/// Gives SCHED_FIFO to the calling thread until destruction, if the system allows it, so that the threads that it
/// creates inherit the priority. Fast DDS 2.9 has no setting for the priority of its threads.
class InheritedPriority {
 public:
  explicit InheritedPriority(int priority) {
    if (priority <= 0 || pthread_getschedparam(pthread_self(), &policy_, &before_) != 0) return;
    sched_param wanted{};
    wanted.sched_priority = priority;
    applied_ = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted) == 0;
  }
  ~InheritedPriority() {
    if (applied_) pthread_setschedparam(pthread_self(), policy_, &before_);
  }
  InheritedPriority(const InheritedPriority&) = delete;
  InheritedPriority& operator=(const InheritedPriority&) = delete;
  [[nodiscard]] bool applied() const noexcept { return applied_; }

 private:
  int policy_ = 0;
  sched_param before_{};
  bool applied_ = false;
};

std::filesystem::path file_of(const Participants::Impl& impl, TrafficClass traffic) {
  return impl.address.qos / (std::string{kClassNames[static_cast<std::size_t>(traffic)]} + ".xml");
}

dds::DomainParticipant* join(Participants::Impl& impl, TrafficClass traffic, const Profiles& profiles,
                             LogCapture& log) {
  auto* factory = dds::DomainParticipantFactory::get_instance();
  const auto index = static_cast<std::size_t>(traffic);
  const std::string profile = std::string{kClassNames[index]} + "_participant";
  dds::DomainParticipantQos qos;
  if (!profiles.read(*factory, profile, qos)) {
    throw WireError(file_of(impl, traffic).string() + ": no participant profile '" + profile + "'; expected one");
  }
  apply(impl.locators, qos);
  if (impl.security) impl.security->apply(qos);
  disable_type_propagation(qos);
  std::string ignored;
  if (traffic == TrafficClass::kBulk && impl.address.only_reads_bulk && impl.address.discovery.servers.empty()) {
    ignored = kReadsBulk;
    qos.name(kReadsBulk);
  }
  const auto domain = static_cast<dds::DomainId_t>(impl.address.domain + static_cast<int>(index));
  const FilterSettings filters{static_cast<int>(domain),
                               std::make_shared<Gate>(),
                               ignored,
                               std::make_shared<std::atomic<bool>>(false),
                               traffic != TrafficClass::kSession,
                               !impl.security && !impl.address.plain && !impl.address.is_test,
                               impl.security.get()};
  if (qos.transport().use_builtin_transports && (filters.only_local || filters.security != nullptr))
    throw WireError(file_of(impl, traffic).string() + ": found built-in transports, expected only UDPv4");
  for (auto& udp : qos.transport().user_transports) {
    const auto descriptor = std::dynamic_pointer_cast<transport::UDPv4TransportDescriptor>(udp);
    if (descriptor == nullptr) {
      if (filters.only_local || filters.security != nullptr)
        throw WireError(file_of(impl, traffic).string() + ": found a transport that is not UDPv4, expected only UDPv4");
      continue;
    }
    if (impl.security) descriptor->maxMessageSize = kSecuredMessageBytes;
    if (filters.only_local) descriptor->TTL = 0;  // multicast reaches no other machine
    udp = std::make_shared<FilterTransportDescriptor>(udp, filters);
  }
  const std::set<int> before = datagram_sockets();
  dds::DomainParticipant* made = nullptr;
  {
    int probe_priority = traffic == TrafficClass::kProbe ? impl.address.probe_priority : 0;
    if (probe_priority > 0 && impl.security && !replaces_message_crypto()) {
      probe_priority = 0;
      report(kLacksFunctions);
    }
    const InheritedPriority priority{probe_priority};
    if (traffic == TrafficClass::kSession)
      impl.servers = std::make_unique<ServerWatch>(impl.address.discovery.servers, qos);
    dds::DomainParticipantListener* listener = impl.security.get();
    if (listener == nullptr && traffic == TrafficClass::kSession) listener = impl.servers.get();
    made = factory->create_participant(domain, qos, listener, dds::StatusMask::none());
    filters.gate->open();
    if (traffic == TrafficClass::kProbe) impl.probe_realtime = priority.applied();
  }
  if (made == nullptr) {
    throw WireError("cannot join DDS domain " + std::to_string(domain) + " with profile '" + profile + "' of " +
                    file_of(impl, traffic).string() + ": " + log.take() +
                    (impl.security ? "; the files in " + impl.address.keys.string() +
                                         " may not fit together: copy the whole folder of the member again"
                                   : ""));
  }
  if (*filters.multicast_is_taken && impl.address.discovery.peers.empty() && impl.address.discovery.servers.empty()) {
    factory->delete_participant(made);
    throw WireError("cannot join DDS domain " + std::to_string(domain) + ": another program uses UDP " +
                    std::to_string(discovery_port(static_cast<int>(domain))) +
                    " and does not share it; find it with ss -lunp, or use another --domain");
  }
  mark_new_sockets(before, impl.flow.sockets[index]);
  if (impl.security) impl.security->sent_keys().add(*made);
  return made;
}

/// Copies the profiles of all topics of a traffic class.
void copy_profiles(Participants::Impl& impl, TrafficClass traffic, const Profiles& profiles) {
  dds::DomainParticipant& participant = impl.participant(traffic);
  dds::Publisher* publisher = participant.create_publisher(dds::PUBLISHER_QOS_DEFAULT);
  dds::Subscriber* subscriber = participant.create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
  std::string missing;
  topics::for_each([&](const auto& topic) {
    if (topic.traffic != traffic || !missing.empty()) return;
    const std::string name = topic.profile;
    dds::DataWriterQos writer;
    dds::DataReaderQos reader;
    const char* end = nullptr;
    if (!profiles.read(*publisher, name + "_writer", writer)) {
      end = "_writer";
    } else if (!profiles.read(*subscriber, name + "_reader", reader)) {
      end = "_reader";
    }
    if (end != nullptr) {
      missing = file_of(impl, traffic).string() + ": no profile '" + name + end + "' for topic " + topic.name +
                "; expected one";
      return;
    }
    impl.writer_qos[name] = writer;
    impl.reader_qos[name] = reader;
  });
  participant.delete_publisher(publisher);
  participant.delete_subscriber(subscriber);
  if (!missing.empty()) throw WireError(missing);
}

}  // namespace

Participants::Participants(SessionAddress address) : impl_{std::make_unique<Impl>()} {
  check_name("session", address.session);
  check_name("participant", address.participant);
  if (address.domain < kMinDomain || address.domain > kMaxDomain) {
    throw WireError("domain " + std::to_string(address.domain) + " is out of range; expected " +
                    std::to_string(kMinDomain) + " to " + std::to_string(kMaxDomain) +
                    " (ROS 2 uses domain 0; higher domains would use ephemeral ports of the system)");
  }
  if (address.incarnation == 0) {
    const auto clock = std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
    address.incarnation = next_incarnation(incarnation_file(), static_cast<std::uint64_t>(std::max<long>(1, clock)));
  }
  if (!address.keys.empty() && !address.discovery.servers.empty())
    throw WireError(
        "--discovery-server cannot be used with --keys, because the discovery server of Fast DDS 2.9 has no "
        "security; expected multicast or --peer");
  if (!address.keys.empty() && address.plain)
    throw WireError("--plain cannot be used with --keys; expected one of them");
  impl_->locators = resolve(address.discovery);
  if (address.keys.empty() && !address.plain && !address.is_test) require_local(impl_->locators);
  if (address.plain) report(kPlain, session::Severity::kError);
  if (!address.keys.empty()) {
    impl_->security = std::make_unique<Security>(address);
    check_name("participant", address.participant);
  }
  impl_->session_id = session::id_of(address.session);
  impl_->participant_id = session::id_of(address.participant);
  impl_->address = std::move(address);

  const std::lock_guard<std::mutex> lock{factory_mutex()};
  LogCapture log;
  ignore_environment();
  const Profiles profiles = load_profiles(impl_->address.qos, log);
  impl_->flow = read_flow(impl_->address.qos / "flow.yaml");
  for (const TrafficClass traffic : {TrafficClass::kProbe, TrafficClass::kSession, TrafficClass::kBulk}) {
    if (!impl_->address.one_participant)
      impl_->participants[static_cast<std::size_t>(traffic)] = join(*impl_, traffic, profiles, log);
    else if (impl_->participants[0] == nullptr)
      impl_->participants.fill(join(*impl_, TrafficClass::kSession, profiles, log));
    copy_profiles(*impl_, traffic, profiles);
  }
}

Participants::~Participants() = default;

const SessionAddress& Participants::address() const noexcept { return impl_->address; }

session::Origin Participants::origin() const noexcept {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return {impl_->session_id, impl_->participant_id, impl_->address.incarnation, std::chrono::nanoseconds(now).count()};
}

std::vector<std::string> Participants::lost_servers() const { return impl_->servers->lost(); }

bool Participants::may_write(const char* topic) const {
  if (!impl_->security) return true;
  const std::vector<keys::WriteRight> rights = keys::rights_of(impl_->security->member().role);
  return std::any_of(rights.begin(), rights.end(),
                     [&](const keys::WriteRight& right) { return std::string_view{right.topic} == topic; });
}

bool Participants::may_serve(const std::string& user, std::uint64_t client) const {
  if (!impl_->security || wire::permits(impl_->security->member(), user)) return true;
  impl_->security->members().report_refused_user(client, user);
  return false;
}

void Participants::expect_permitted(const std::string& user) const {
  if (impl_->security) wire::expect_permitted(impl_->security->member(), "user", user);
}

void check_keys(SessionAddress address, const std::vector<std::string>& objects) {
  if (address.keys.empty()) return;
  const keys::Member member = read_keys(address);
  for (const std::string& object : objects) expect_permitted(member, "object", object);
}

std::size_t Participants::chunk_bytes() const noexcept {
  // A chunk of kMaxPayload leaves 4 bytes of its frame for padding (pad_if_it_looks_like_statistics). One chunk of
  // 65,536 needs 8 bytes: one in some seconds at full rate. One of 16 million needs more.
  constexpr std::size_t kMorePadding = 4;
  return session::kMaxPayload - kMorePadding - (impl_->security ? kProtectionBytes : 0);
}

bool Participants::probe_is_realtime() const noexcept { return impl_->probe_realtime; }

Participants::Impl::~Impl() {
  if (security) security->sent_keys().clear();
  for (dds::DomainParticipant* participant :
       std::set<dds::DomainParticipant*>{participants.begin(), participants.end()}) {
    if (participant == nullptr) continue;
    participant->delete_contained_entities();
    dds::DomainParticipantFactory::get_instance()->delete_participant(participant);
  }
}

bool Participants::Impl::is_author(const dds::SampleInfo& sample, const Claim& claim, const char* topic) const noexcept
    try {
  return security == nullptr ||
         security->members().is_author(prefix_of(sample.sample_identity.writer_guid()), claim, topic);
} catch (...) {  // out of memory
  return false;
}

void Participants::Impl::report_excess(const GuidPrefix& participant, const char* topic) const noexcept try {
  report(std::string{"topic "} + topic +
         ": a participant sends more samples than the limit of its rate; those above it " + "are dropped");
  if (security) security->members().report_excess(participant, topic);
} catch (...) {  // out of memory: the audit log lacks an event
}

void Participants::Impl::report_invalid(const GuidPrefix& participant, const char* topic,
                                        const char* reason) const noexcept try {
  if (security) security->members().report_invalid(participant, topic, reason);
} catch (...) {  // out of memory: the audit log lacks an event
}

std::vector<std::uint64_t> Participants::Impl::authors_of(const dds::SampleInfo& sample) const {
  if (security == nullptr) return {};
  return security->members().ids_of(prefix_of(sample.sample_identity.writer_guid()));
}

dds::Topic& Participants::Impl::topic(const char* name, TrafficClass traffic, dds::TypeSupport type) {
  const std::lock_guard<std::mutex> lock{topics_mutex};
  dds::DomainParticipant& in = participant(traffic);
  if (auto* existing = dynamic_cast<dds::Topic*>(in.lookup_topicdescription(name))) return *existing;
  const std::string& type_name = type.get_type_name();
  if (in.find_type(type_name).empty()) type.register_type(&in);
  dds::Topic* made = in.create_topic(name, type_name, dds::TOPIC_QOS_DEFAULT);
  if (made == nullptr) throw WireError(std::string{"topic "} + name + ": DDS refuses it with type " + type_name);
  return *made;
}

std::string Participants::Impl::partition(const std::string& part) const {
  if (part.empty()) return address.session;
  if (session::has_control_character(part) || part.find_first_of("*?[]\\") != std::string::npos) {
    throw WireError("partition '" + part +
                    "' has a control character or one of * ? [ ] \\, which would match other partitions");
  }
  return address.session + "/" + part;
}

}  // namespace tactus::wire

#ifdef __SANITIZE_ADDRESS__
/// Disables a check of AddressSanitizer that Debian's Fast DDS fails: it deletes its statistics classes through a base
/// class without a virtual destructor. Tactus has no such class.
extern "C" const char* __asan_default_options();
extern "C" const char* __asan_default_options() { return "new_delete_type_mismatch=0"; }
#endif
