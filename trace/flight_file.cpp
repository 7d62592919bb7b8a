#include "trace/flight_file.hpp"

#include <optional>
#include <utility>

#include "trace/cdr.hpp"
#include "trace/flight_idl.hpp"
#include "trace/idl_schema.hpp"

namespace tactus::trace {
namespace {

constexpr std::size_t kTypes = std::variant_size_v<FlightMessage>;
/// Topic and IDL type of each alternative of FlightMessage.
constexpr std::array<std::pair<const char*, const char*>, kTypes> kChannels{
    {{"flight_start", "tactus::flight::Start"},
     {"flight_object", "tactus::flight::Object"},
     {"flight_state", "tactus::flight::State"},
     {"flight_event", "tactus::flight::Event"},
     {"flight_move", "tactus::flight::Move"},
     {"flight_probe", "tactus::flight::Probe"},
     {"flight_touch", "tactus::flight::Touch"},
     {"flight_refine", "tactus::flight::Refine"}}};

/// Decodes the bytes as alternative `type` of FlightMessage.
template <std::size_t i = 0>
FlightMessage decode(std::size_t type, std::span<const std::uint8_t> bytes) {
  if constexpr (i < kTypes) {
    if (type != i) return decode<i + 1>(type, bytes);
    std::variant_alternative_t<i, FlightMessage> message;
    CdrReader{bytes}(message);
    return message;
  } else {
    throw CdrError("found an unknown type");  // not reached: the caller passes an index of kChannels
  }
}

}  // namespace

struct FlightFileWriter::Impl {
  explicit Impl(std::filesystem::path file) : mcap{std::move(file), "tactus flight"} {}
  McapWriter mcap;
  std::array<std::optional<McapWriter::Channel>, kTypes> channels;
  std::array<std::uint32_t, kTypes> sequences{};
  CdrWriter encoded;
  std::uint64_t time = 0;
};

FlightFileWriter::FlightFileWriter(std::filesystem::path file) : impl_{std::make_unique<Impl>(std::move(file))} {}
FlightFileWriter::~FlightFileWriter() = default;

void FlightFileWriter::set_time(std::uint64_t since_1970_ns) noexcept { impl_->time = since_1970_ns; }

void FlightFileWriter::write(const FlightMessage& message) {
  const std::size_t type = message.index();
  auto& channel = impl_->channels[type];
  if (!channel) {
    const auto& [topic, name] = kChannels[type];
    channel = impl_->mcap.add_channel(impl_->mcap.add_schema(name, "omgidl", kFlightIdl), topic, "cdr");
  }
  impl_->encoded.clear();
  std::visit([&](const auto& value) { impl_->encoded(value); }, message);
  impl_->mcap.write(*channel, impl_->time, impl_->time, ++impl_->sequences[type], impl_->encoded.bytes());
}

void FlightFileWriter::close() { impl_->mcap.close(); }
std::uint64_t FlightFileWriter::messages() const noexcept { return impl_->mcap.messages(); }
std::uint64_t FlightFileWriter::bytes() const noexcept { return impl_->mcap.bytes(); }

struct FlightFileReader::Impl {
  explicit Impl(const std::filesystem::path& file) : name{file.string()}, mcap{file} {}
  std::string name;
  McapReader mcap;
  McapMessage message;
  std::string accepted_idl = kFlightIdl;  // text whose types are those of this program
};

FlightFileReader::FlightFileReader(const std::filesystem::path& file) : impl_{std::make_unique<Impl>(file)} {}
FlightFileReader::~FlightFileReader() = default;

bool FlightFileReader::next(FlightMessage& message) {
  if (!impl_->mcap.next(impl_->message)) return false;
  const McapMessage& found = impl_->message;
  const auto fail = [&](const std::string& what) {
    throw FlightError(impl_->name + ", topic " + found.topic + ", message " + std::to_string(found.sequence) + ": " +
                      what);
  };
  std::size_t type = 0;
  while (type < kTypes && found.topic != kChannels[type].first) ++type;
  if (type == kTypes) fail("not a topic of a flight recording; is this a recording of tactus record?");
  if (*found.schema_text != impl_->accepted_idl) {
    if (!has_same_types(*found.schema_text, kFlightIdl)) fail("found IDL text that differs from that of this program");
    impl_->accepted_idl = *found.schema_text;
  }
  try {
    message = decode(type, {found.bytes.data(), found.bytes.size()});
  } catch (const CdrError& error) {
    fail(error.what());
  }
  return true;
}

bool FlightFileReader::is_truncated() const noexcept { return impl_->mcap.is_truncated(); }

}  // namespace tactus::trace
