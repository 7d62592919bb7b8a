#include <tinyxml2.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <fstream>

#include "latency/carrier.hpp"
#include "realtime/process.hpp"
#include "wire/endpoints.hpp"

namespace tactus::latency {
namespace {

constexpr char kPings[] = "latency/pings", kEchoes[] = "latency/echoes";

void encode(const Packet& packet, std::uint32_t, session::ProbeState& sample) {
  sample.sequence = packet.sequence;
  sample.probe = packet.reader;
  sample.session_time_ns = packet.event_ns;
}
Packet decode(const session::ProbeState& sample) {
  return {sample.sequence, sample.probe, sample.session_time_ns, sample.origin.time_ns};
}

void encode(const Packet& packet, std::uint32_t payload, session::BulkChunk& sample) {
  sample.sequence = packet.sequence + 1;  // 0 is no sequence number of a stream
  sample.pieces.resize(1);
  session::BulkPiece& piece = sample.pieces.front();
  piece.region = packet.reader;
  piece.payload.resize(payload);
  const std::array<std::int64_t, 2> times{packet.event_ns, packet.sent_ns};
  std::memcpy(piece.payload.data(), times.data(), sizeof times);
}
Packet decode(const session::BulkChunk& sample) {
  Packet packet{sample.sequence - 1, 0, 0, 0};
  if (sample.pieces.empty()) return packet;
  const session::BulkPiece& piece = sample.pieces.front();
  packet.reader = piece.region;
  std::array<std::int64_t, 2> times{};
  if (piece.payload.size() >= sizeof times) std::memcpy(times.data(), piece.payload.data(), sizeof times);
  packet.event_ns = times[0];
  packet.sent_ns = times[1];
  return packet;
}

template <class Sample>
class DdsCarrier final : public Carrier {
 public:
  DdsCarrier(Role role, std::uint32_t payload, wire::Participants& participants, const wire::TopicSpec<Sample>& topic,
             OnPacket callback)
      : payload_{payload},
        participants_{participants},
        callback_{std::move(callback)},
        writer_{participants, topic, {role == Role::kPinger ? kPings : kEchoes}},
        reader_{participants,
                topic,
                [this](Sample&& sample) { callback_(decode(sample), realtime::monotonic_ns()); },
                {role == Role::kPinger ? kEchoes : kPings}} {}

  bool send(const Packet& packet) noexcept override {
    if constexpr (!std::is_same_v<Sample, session::BulkChunk>) {
      sample_.origin = participants_.origin();
      sample_.origin.time_ns = packet.sent_ns;
    }
    encode(packet, payload_, sample_);
    return writer_.send(sample_) == wire::SendStatus::kSent;
  }
  [[nodiscard]] std::uint32_t matched() const noexcept override {
    return static_cast<std::uint32_t>(std::max(0, std::min(writer_.matched(), reader_.matched())));
  }

 private:
  const std::uint32_t payload_;
  wire::Participants& participants_;
  const OnPacket callback_;
  Sample sample_{};
  wire::Writer<Sample> writer_;
  wire::Reader<Sample> reader_;  // last: its callback uses the other members
};

/// A temporary copy of a qos directory with the settings of a test; the destructor removes it. It is on disk, because
/// wire::Participants and Fast DDS read profiles only from files.
class QosCopy {
 public:
  QosCopy(const std::filesystem::path& from, Profile profile, Transport transport) {
    for (const char* file : {"session.xml", "probe.xml", "bulk.xml"}) {
      tinyxml2::XMLDocument document;
      if (document.LoadFile((from / file).c_str()) != tinyxml2::XML_SUCCESS)
        throw LatencyError((from / file).string() + ": " + document.ErrorStr());
      auto* const profiles = document.RootElement()->FirstChildElement("profiles");
      if (profiles == nullptr)
        throw LatencyError((from / file).string() + ": found no element <profiles>, expected one");
      if (profile != Profile::kTactus) strip(*profiles);
      if (profile != Profile::kTactus || transport != Transport::kUdp)
        set_transport(*profiles, transport, std::string{"latency_"} + file);
      if (profile == Profile::kTuned) tune(*profiles, std::strcmp(file, "bulk.xml") == 0);
      tinyxml2::XMLPrinter text;  // to memory, because SaveFile ignores failed writes
      document.Print(&text);
      write(file, text.CStr());
    }
    if (profile == Profile::kPlain || profile == Profile::kShared) {
      write("flow.yaml",
            "sockets: {session: {tos: 0, priority: 0}, probe: {tos: 0, priority: 0}, bulk: {tos: 0, priority: 0}}\n");
    } else {
      std::filesystem::copy_file(from / "flow.yaml", path() / "flow.yaml");
    }
  }
  [[nodiscard]] const std::filesystem::path& path() const noexcept { return folder_.path; }

 private:
  using Element = tinyxml2::XMLElement;

  struct Folder {
    Folder() {
      std::string name = (std::filesystem::temp_directory_path() / "tactus-qos-XXXXXX").string();
      if (::mkdtemp(name.data()) == nullptr)
        throw LatencyError("no temporary directory: " + std::string{std::strerror(errno)});
      path = name;
    }
    ~Folder() {
      std::error_code ignored;
      std::filesystem::remove_all(path, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
    std::filesystem::path path;
  };

  void write(const char* file, const std::string& text) const {
    std::ofstream out{path() / file};
    out << text;
    out.close();
    if (!out) throw LatencyError((path() / file).string() + ": cannot be written");
  }

  /// Removes all settings from the profiles, so that the library's defaults apply.
  static void strip(Element& profiles) {
    for (Element* profile = profiles.FirstChildElement(); profile != nullptr; profile = profile->NextSiblingElement()) {
      if (profile->Attribute("profile_name") == nullptr) continue;
      const bool is_participant = std::strcmp(profile->Name(), "participant") == 0;
      profile->DeleteChildren();
      if (is_participant) profile->InsertNewChildElement("rtps");
    }
  }

  /// `id` must be unique among the files, because the library has one table of ids for all files.
  static void set_transport(Element& profiles, Transport transport, const std::string& id) {
    if (Element* const descriptors = profiles.FirstChildElement("transport_descriptors"))
      profiles.DeleteChild(descriptors);
    for (Element* participant = profiles.FirstChildElement("participant"); participant != nullptr;
         participant = participant->NextSiblingElement("participant")) {
      Element* const rtps = participant->FirstChildElement("rtps");
      for (const char* name : {"useBuiltinTransports", "userTransports"})
        if (Element* const old = rtps->FirstChildElement(name)) rtps->DeleteChild(old);
      if (transport == Transport::kBuiltin) continue;
      rtps->InsertNewChildElement("useBuiltinTransports")->SetText("false");
      rtps->InsertNewChildElement("userTransports")->InsertNewChildElement("transport_id")->SetText(id.c_str());
    }
    if (transport == Transport::kBuiltin) return;
    Element* const descriptors = profiles.GetDocument()->NewElement("transport_descriptors");
    profiles.InsertFirstChild(descriptors);
    Element* const descriptor = descriptors->InsertNewChildElement("transport_descriptor");
    descriptor->InsertNewChildElement("transport_id")->SetText(id.c_str());
    descriptor->InsertNewChildElement("type")->SetText(transport == Transport::kShm ? "SHM" : "UDPv4");
  }

  /// Adds to stripped profiles the settings that an expert of Fast DDS would choose: one frame for each message, large
  /// buffers, and
  ///   probe: best effort, keep last 1, sent by the writing thread, not blocked by a full socket
  ///   bulk:  reliable, keep all, asynchronous, 12 kB each ms (96 % of a link of 100 Mbit/s)
  static void tune(Element& profiles, bool is_bulk) {
    constexpr char kProbe[] =
        "<all><topic><historyQos><kind>KEEP_LAST</kind><depth>1</depth></historyQos></topic>"
        "<qos><reliability><kind>BEST_EFFORT</kind></reliability><durability><kind>VOLATILE</kind></durability>"
        "<publishMode><kind>SYNCHRONOUS</kind></publishMode><data_sharing><kind>OFF</kind></data_sharing></qos>"
        "<historyMemoryPolicy>PREALLOCATED_WITH_REALLOC</historyMemoryPolicy></all>";
    constexpr char kBulk[] =
        "<all><topic><historyQos><kind>KEEP_ALL</kind></historyQos></topic>"
        "<qos><reliability><kind>RELIABLE</kind></reliability><durability><kind>VOLATILE</kind></durability>"
        "<publishMode><kind>ASYNCHRONOUS</kind></publishMode><data_sharing><kind>OFF</kind></data_sharing></qos>"
        "<throughputController><bytesPerPeriod>12000</bytesPerPeriod><periodMillisecs>1</periodMillisecs>"
        "</throughputController><historyMemoryPolicy>PREALLOCATED_WITH_REALLOC</historyMemoryPolicy></all>";
    Element* const descriptor =
        profiles.FirstChildElement("transport_descriptors")->FirstChildElement("transport_descriptor");
    for (const auto& [name, value] : {std::pair{"maxMessageSize", "1472"},
                                      {"sendBufferSize", "1048576"},
                                      {"receiveBufferSize", "4194304"},
                                      {"non_blocking_send", is_bulk ? "false" : "true"}})
      descriptor->InsertNewChildElement(name)->SetText(value);
    tinyxml2::XMLDocument tuned;
    tuned.Parse(is_bulk ? kBulk : kProbe);
    for (Element* profile = profiles.FirstChildElement(); profile != nullptr; profile = profile->NextSiblingElement()) {
      const bool is_writer = std::strcmp(profile->Name(), "data_writer") == 0;
      if (!is_writer && std::strcmp(profile->Name(), "data_reader") != 0) continue;
      for (const Element* setting = tuned.RootElement()->FirstChildElement(); setting != nullptr;
           setting = setting->NextSiblingElement()) {
        if (!is_writer && std::strcmp(setting->Name(), "throughputController") == 0) continue;
        tinyxml2::XMLNode* const copy = profile->InsertEndChild(setting->DeepClone(profiles.GetDocument()));
        if (Element* const mode = copy->FirstChildElement("publishMode"); mode != nullptr && !is_writer)
          copy->DeleteChild(mode);
      }
    }
  }

  Folder folder_;
};

}  // namespace

std::unique_ptr<Carrier> make_dds(Role role, const TestCase& test, wire::Participants& participants,
                                  OnPacket callback) {
  if (test.topic == Topic::kProbeState)
    return std::make_unique<DdsCarrier<session::ProbeState>>(role, test.payload, participants,
                                                             wire::topics::kProbeState, std::move(callback));
  return std::make_unique<DdsCarrier<session::BulkChunk>>(role, test.payload, participants, wire::topics::kRecords,
                                                          std::move(callback));
}

std::unique_ptr<wire::Participants> join_session(const TestCase& test, wire::SessionAddress address) {
  if (test.profile == Profile::kTactus && (test.transport == Transport::kUdp || test.transport == Transport::kRawUdp))
    return std::make_unique<wire::Participants>(std::move(address));
  const QosCopy copy{address.qos, test.profile, test.transport};
  address.qos = copy.path();
  address.one_participant = test.profile == Profile::kShared;
  return std::make_unique<wire::Participants>(std::move(address));
}

}  // namespace tactus::latency
