#include "wire/patient_transport.hpp"

#include <fastdds/rtps/transport/ChainingTransport.h>

#include <utility>

namespace tactus::wire {
namespace {

namespace fdds = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

class PatientTransport final : public fdds::ChainingTransport {
 public:
  explicit PatientTransport(const PatientTransportDescriptor& descriptor)
      : ChainingTransport{descriptor}, descriptor_{descriptor} {}

  [[nodiscard]] fdds::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }

  bool send(rtps::SenderResource* low, const rtps::octet* message, std::uint32_t size, rtps::LocatorsIterator* first,
            rtps::LocatorsIterator* last, const std::chrono::steady_clock::time_point& until) override {
    return low->send(message, size, first, last, until);
  }

  void receive(fdds::TransportReceiverInterface* next, const rtps::octet* message, std::uint32_t size,
               const rtps::Locator_t& local, const rtps::Locator_t& remote) override {
    descriptor_.gate->pass();
    next->OnDataReceived(message, size, local, remote);
  }

 private:
  PatientTransportDescriptor descriptor_;
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
                                                       std::shared_ptr<Gate> gate_of)
    : ChainingTransportDescriptor{std::move(low)}, gate{std::move(gate_of)} {}

fdds::TransportInterface* PatientTransportDescriptor::create_transport() const { return new PatientTransport{*this}; }

}  // namespace tactus::wire
