#include "wire/patient_transport.hpp"

#include <fastdds/rtps/transport/ChainingTransport.h>

#include <fastdds/rtps/common/LocatorList.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "wire/announcements.hpp"
#include "wire/process.hpp"
#include "wire/rtps_message.hpp"

namespace tactus::wire {
namespace {

namespace fdds = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

class PatientTransport final : public fdds::ChainingTransport {
 public:
  explicit PatientTransport(const PatientTransportDescriptor& descriptor)
      : ChainingTransport{descriptor}, descriptor_{descriptor}, announcements_{descriptor.ignored} {}

  [[nodiscard]] fdds::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }

  bool send(rtps::SenderResource* low, const rtps::octet* message, std::uint32_t size, rtps::LocatorsIterator* first,
            rtps::LocatorsIterator* last, const std::chrono::steady_clock::time_point& until) override {
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
    descriptor_.gate->pass();
    if (descriptor_.direct && descriptor_.direct->on_received(message, size)) return;
    if (!announcements_.on_received(message, size)) return;
    next->OnDataReceived(message, size_without_statistics(message, size), local, remote);
  }

 private:
  PatientTransportDescriptor descriptor_;
  Announcements announcements_;
};

}  // namespace

void Gate::open() noexcept {
  const std::lock_guard<std::mutex> lock{mutex_};
  open_ = true;
  opened_.notify_all();
}

void Gate::pass() {
  if (open_) return;
  std::unique_lock<std::mutex> lock{mutex_};
  opened_.wait_for(lock, patience_, [this] { return open_.load(); });
}

PatientTransportDescriptor::PatientTransportDescriptor(std::shared_ptr<fdds::TransportDescriptorInterface> low,
                                                       std::shared_ptr<Gate> gate_of, std::string ignored_name,
                                                       std::shared_ptr<DirectPath> direct_path)
    : ChainingTransportDescriptor{std::move(low)},
      gate{std::move(gate_of)},
      direct{std::move(direct_path)},
      ignored{std::move(ignored_name)} {}

fdds::TransportInterface* PatientTransportDescriptor::create_transport() const { return new PatientTransport{*this}; }

}  // namespace tactus::wire
