#include "wire/lean_transport.hpp"

#include <fastdds/rtps/transport/ChainingTransport.h>

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include "wire/rtps_message.hpp"

namespace tactus::wire {
namespace {

namespace fdds = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

// Lengths of submessages with their heads.
constexpr std::uint32_t kInfoDestination = 16, kInfoTime = 12, kStatistics = kStatisticsSize;
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
    if (sample == 0 || size + kMostPaddings > trimmed.size()) return low->send(message, size, first, last, until);
    auto end = std::copy(message, message + kRtpsHeader, trimmed.begin());
    end = std::copy(message + sample, message + size - kStatistics, end);
    const std::uint32_t padded =
        pad_what_looks_like_statistics(trimmed.data(), static_cast<std::uint32_t>(end - trimmed.begin()));
    return low->send(trimmed.data(), padded, first, last, until);
  }

  void receive(fdds::TransportReceiverInterface* next, const rtps::octet* message, std::uint32_t size,
               const rtps::Locator_t& local, const rtps::Locator_t& remote) override {
    next->OnDataReceived(message, size, local, remote);
  }

 private:
  /// Where the one sample of a message begins that has nothing else but its time, perhaps its destination (none when
  /// several readers have found the writer) and statistics; 0 when it has more.
  static std::uint32_t sample_in(const rtps::octet* message, std::uint32_t size) noexcept {
    if (size <= kRtpsHeader + kInfoDestination + kInfoTime + kStatistics) return 0;
    const bool to_one = message[kRtpsHeader] == kInfoDestinationId;
    const std::uint32_t time = kRtpsHeader + (to_one ? kInfoDestination : 0);
    const std::uint32_t sample = time + kInfoTime;
    const std::optional<Submessage> data = submessage_at(message, size, sample);
    const bool alone = message[time] == kInfoTimeId && data->id == kDataId && data->next == size - kStatistics &&
                       message[data->next] == kStatisticsId;
    // Discovery's own samples to everybody stay as they are: the kind of their writer says that it is built in.
    constexpr std::uint32_t kWriterKind = 15;
    const bool built_in = alone && (message[sample + kWriterKind] & 0xc0) != 0;
    return alone && (to_one || !built_in) ? sample : 0;
  }

  LeanTransportDescriptor descriptor_;
};

}  // namespace

LeanTransportDescriptor::LeanTransportDescriptor(std::shared_ptr<fdds::TransportDescriptorInterface> low)
    : ChainingTransportDescriptor{std::move(low)} {
  maxMessageSize += kStatistics + kInfoDestination + kInfoTime + kNeverSent - kSubmessageHead;
}

fdds::TransportInterface* LeanTransportDescriptor::create_transport() const { return new LeanTransport{*this}; }

}  // namespace tactus::wire
