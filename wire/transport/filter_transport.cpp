#include "wire/transport/filter_transport.hpp"

#include <fastdds/rtps/transport/ChainingTransport.h>

#include <fastdds/rtps/common/LocatorList.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "wire/process.hpp"
#include "wire/transport/announcements.hpp"
#include "wire/transport/rtps_message.hpp"
#include "wire/transport/trimming.hpp"

namespace tactus::wire {
namespace {

namespace fdds = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

class FilterTransport final : public fdds::ChainingTransport {
 public:
  explicit FilterTransport(const FilterTransportDescriptor& descriptor)
      : ChainingTransport{descriptor}, descriptor_{descriptor}, announcements_{descriptor.settings.ignored} {}

  [[nodiscard]] fdds::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }

  bool send(rtps::SenderResource* low, const rtps::octet* message, std::uint32_t size, rtps::LocatorsIterator* first,
            rtps::LocatorsIterator* last, const std::chrono::steady_clock::time_point& until) override {
    TrimmedMessage trimmed;
    if (descriptor_.settings.trims_samples && trim(message, size, trimmed)) {
      message = trimmed.bytes.data();
      size = trimmed.size;
    }
    const std::optional<std::uint64_t> announcement = Announcements::sequence_of(message, size);
    if (!announcement) return low->send(message, size, first, last, until);
    std::vector<rtps::Locator_t> to;
    for (; *first != *last; ++*first) to.push_back(**first);
    const std::vector<rtps::Locator_t> due = announcements_.due(low, *announcement, to, monotonic_ns());
    if (due.empty()) return true;
    rtps::Locators from{due.begin()}, end{due.end()};
    return low->send(message, size, &from, &end, until);
  }

  void receive(fdds::TransportReceiverInterface* next, const rtps::octet* message, std::uint32_t size,
               const rtps::Locator_t& local, const rtps::Locator_t& remote) override {
    descriptor_.settings.gate->pass();
    if (!announcements_.on_received(message, size)) return;
    next->OnDataReceived(message, size_without_statistics(message, size), local, remote);
  }

 private:
  FilterTransportDescriptor descriptor_;
  Announcements announcements_;
};

}  // namespace

FilterTransportDescriptor::FilterTransportDescriptor(std::shared_ptr<fdds::TransportDescriptorInterface> udp,
                                                     FilterSettings filter_settings)
    : ChainingTransportDescriptor{std::move(udp)}, settings{std::move(filter_settings)} {
  if (settings.trims_samples) maxMessageSize += kMaxTrimmed;
}

fdds::TransportInterface* FilterTransportDescriptor::create_transport() const { return new FilterTransport{*this}; }

}  // namespace tactus::wire
