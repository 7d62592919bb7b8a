#include "wire/lean_transport.hpp"

#include <fastdds/rtps/transport/ChainingTransport.h>

#include <algorithm>
#include <array>
#include <utility>

namespace tactus::wire {
namespace {

namespace fdds = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

// Lengths of a message's header and of submessages with theirs; their ids (RTPS 2.2, 9.4.5).
constexpr std::uint32_t kHeader = 20, kInfoDestination = 16, kInfoTime = 12, kStatistics = 60;
constexpr rtps::octet kInfoDestinationId = 0x0e, kInfoTimeId = 0x09, kDataId = 0x15, kStatisticsId = 0x80;
constexpr std::array<rtps::octet, 4> kPadding{1, 1, 0, 0};  // the shortest submessage
/// When the library reckons whether a sample goes whole into a message it counts a heartbeat and the longer header of a
/// fragment, which messages of best effort samples do not have.
constexpr std::uint32_t kNeverSent = 32 + 12;

class LeanTransport final : public fdds::ChainingTransport {
 public:
  explicit LeanTransport(const LeanTransportDescriptor& descriptor)
      : ChainingTransport{descriptor}, descriptor_{descriptor} {}

  [[nodiscard]] fdds::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }

  bool send(rtps::SenderResource* low, const rtps::octet* message, std::uint32_t size, rtps::LocatorsIterator* first,
            rtps::LocatorsIterator* last, const std::chrono::steady_clock::time_point& until) override {
    std::array<rtps::octet, 2048> trimmed;
    const std::uint32_t sample = sample_in(message, size);
    if (sample == 0 || size > trimmed.size()) return low->send(message, size, first, last, until);
    auto end = std::copy(message, message + kHeader, trimmed.begin());
    end = std::copy(message + sample, message + size - kStatistics, end);
    // What looks like statistics there the transport below would fill in, and the receiver take off: padding moves it.
    while (end[-std::ptrdiff_t{kStatistics}] == kStatisticsId) end = std::copy(kPadding.begin(), kPadding.end(), end);
    return low->send(trimmed.data(), static_cast<std::uint32_t>(end - trimmed.begin()), first, last, until);
  }

  void receive(fdds::TransportReceiverInterface* next, const rtps::octet* message, std::uint32_t size,
               const rtps::Locator_t& local, const rtps::Locator_t& remote) override {
    next->OnDataReceived(message, size, local, remote);
  }

 private:
  /// Where the one sample of a message begins that has nothing else but its time, perhaps its destination (none when
  /// several readers have found the writer) and statistics; 0 when it has more.
  static std::uint32_t sample_in(const rtps::octet* message, std::uint32_t size) noexcept {
    if (size <= kHeader + kInfoDestination + kInfoTime + kStatistics) return 0;
    const bool to_one = message[kHeader] == kInfoDestinationId;
    const std::uint32_t time = kHeader + (to_one ? kInfoDestination : 0);
    const std::uint32_t sample = time + kInfoTime;
    const bool alone = message[time] == kInfoTimeId && message[sample] == kDataId &&
                       message[size - kStatistics] == kStatisticsId &&
                       ends_there(message + sample, size - sample - kStatistics);
    // Discovery's own samples to everybody stay as they are: the kind of their writer says that it is built in.
    constexpr std::uint32_t kWriterKind = 15;
    const bool built_in = alone && (message[sample + kWriterKind] & 0xc0) != 0;
    return alone && (to_one || !built_in) ? sample : 0;
  }
  /// Whether a submessage is the last of so many bytes.
  static bool ends_there(const rtps::octet* submessage, std::uint32_t size) noexcept {
    const bool little = (submessage[1] & 1) != 0;
    const std::uint32_t length = little ? submessage[2] + 256u * submessage[3] : submessage[3] + 256u * submessage[2];
    return length + 4 == size;
  }

  LeanTransportDescriptor descriptor_;
};

}  // namespace

LeanTransportDescriptor::LeanTransportDescriptor(std::shared_ptr<fdds::TransportDescriptorInterface> low)
    : ChainingTransportDescriptor{std::move(low)} {
  maxMessageSize +=
      kStatistics + kInfoDestination + kInfoTime + kNeverSent - static_cast<std::uint32_t>(kPadding.size());
}

fdds::TransportInterface* LeanTransportDescriptor::create_transport() const { return new LeanTransport{*this}; }

}  // namespace tactus::wire
