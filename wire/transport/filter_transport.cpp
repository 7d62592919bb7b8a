#include "wire/transport/filter_transport.hpp"

#include <atomic>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "realtime/inheriting_mutex.hpp"
#include "realtime/process.hpp"
#include "wire/dds.hpp"
#include "wire/footprint.hpp"
#include "wire/security.hpp"
#include "wire/transport/announcements.hpp"
#include "wire/transport/local_addresses.hpp"
#include "wire/transport/removals.hpp"
#include "wire/transport/rtps_message.hpp"
#include "wire/transport/trimming.hpp"

namespace tactus::wire {
namespace {

constexpr char kOtherMachine[] =
    "there are programs on other machines. Without keys, this program takes part only with programs of its own "
    "machine; expected --keys DIR (docs/how-to/secure.md), or --plain for a session that everyone can read and change";

class FilterTransport final : public WholeMessageTransport {
 public:
  using Receiver = transport::TransportReceiverInterface;
  explicit FilterTransport(const FilterTransportDescriptor& descriptor)
      : WholeMessageTransport{descriptor}, descriptor_{descriptor}, announcements_{descriptor.settings.ignored} {}

  [[nodiscard]] transport::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }

  bool getDefaultMetatrafficUnicastLocators(rtps::LocatorList_t& locators, std::uint32_t) const override {
    return low_level_transport_->getDefaultMetatrafficUnicastLocators(locators, first_port());
  }
  bool getDefaultUnicastLocators(rtps::LocatorList_t& locators, std::uint32_t) const override {
    return low_level_transport_->getDefaultUnicastLocators(locators, first_port() + 1);
  }

  bool OpenInputChannel(const rtps::Locator_t& at, Receiver* receiver, std::uint32_t max_bytes) override {
    const bool opened = WholeMessageTransport::OpenInputChannel(at, receiver, max_bytes);
    if (!opened && rtps::IPLocator::isMulticast(at)) *descriptor_.settings.multicast_is_taken = true;
    return opened;
  }

  bool send_whole(Lower& lower, const rtps::octet* message, std::uint32_t size, Receivers& first, Receivers& last,
                  const Time& until) override {
    TrimmedMessage trimmed;
    if (descriptor_.settings.trims_samples && first != last &&
        !is_discovery_port(rtps::IPLocator::getPhysicalPort(*first)) && trim(message, size, trimmed)) {
      message = trimmed.bytes.data();
      size = trimmed.size;
    }
    const std::optional<std::uint64_t> announcement = Announcements::sequence_of(message, size);
    if (!announcement) return pass_on(lower, message, size, first, last, until);
    std::vector<rtps::Locator_t> to;
    for (; first != last; ++first) to.push_back(*first);
    const std::vector<rtps::Locator_t> due = announcements_.due(&lower, *announcement, to, realtime::monotonic_ns());
    if (due.empty()) return true;
    const std::vector<rtps::octet> completed = with_own_removals(message, size);
    if (!completed.empty()) {
      message = completed.data();
      size = static_cast<std::uint32_t>(completed.size());
    }
    rtps::Locators from{due.begin()}, end{due.end()};
    return pass_on(lower, message, size, from, end, until);
  }

  void receive(transport::TransportReceiverInterface* next, const rtps::octet* message, std::uint32_t size,
               const rtps::Locator_t& local, const rtps::Locator_t& remote) override {
    descriptor_.settings.gate->pass();
    if (descriptor_.settings.only_local && !local_.contains(remote, realtime::monotonic_ns())) {
      if (!has_reported_.exchange(true)) report(kOtherMachine);
      return;
    }
    if (has_removed_this(message, size)) descriptor_.settings.security->on_removed_by(sender_of(message));
    if (descriptor_.settings.security != nullptr && !descriptor_.settings.security->admits(message, size, remote))
      return;
    if (!announcements_.on_received(message, size)) return;
    if (descriptor_.settings.security != nullptr && Announcements::sequence_of(message, size))
      descriptor_.settings.security->on_announcement(message);
    std::unique_lock lock{handshake_mutex_, std::defer_lock};
    if (starts_handshake(message, size)) lock.lock();
    next->OnDataReceived(message, size_without_statistics(message, size), local, remote);
  }

 private:
  [[nodiscard]] std::uint32_t first_port() const {
    return static_cast<std::uint32_t>(own_port(descriptor_.settings.domain, 0));
  }

  /// Returns whether a message is an announcement or of a handshake of a secured session. All others are encrypted.
  [[nodiscard]] bool starts_handshake(const rtps::octet* message, std::uint32_t size) const {
    return descriptor_.settings.security != nullptr && find_submessage(message, size, kDataId).has_value();
  }

  /// Returns an announcement of this participant with those that it has removed; empty if there are none.
  [[nodiscard]] std::vector<rtps::octet> with_own_removals(const rtps::octet* message, std::uint32_t size) {
    if (descriptor_.settings.security == nullptr) return {};
    {
      const std::lock_guard lock{own_mutex_};
      own_ = sender_of(message);
    }
    const std::vector<GuidPrefix> removed = descriptor_.settings.security->removed();
    return removed.empty() ? std::vector<rtps::octet>{} : with_removals(message, size, removed);
  }

  /// Returns whether a message announces a participant that has removed this one.
  [[nodiscard]] bool has_removed_this(const rtps::octet* message, std::uint32_t size) {
    if (!starts_handshake(message, size)) return false;
    std::optional<GuidPrefix> own;
    {
      const std::lock_guard lock{own_mutex_};
      own = own_;
    }
    return own && names_removal_of(*own, message, size);
  }

  FilterTransportDescriptor descriptor_;
  Announcements announcements_;
  LocalAddresses local_;
  std::atomic<bool> has_reported_{false};
  std::mutex handshake_mutex_;
  realtime::InheritingMutex own_mutex_;  // a thread with a real-time priority may wait for it
  std::optional<GuidPrefix> own_;        // this participant; known when it has announced itself
};

}  // namespace

FilterTransportDescriptor::FilterTransportDescriptor(std::shared_ptr<transport::TransportDescriptorInterface> udp,
                                                     FilterSettings filter_settings)
    : ChainingTransportDescriptor{std::move(udp)}, settings{std::move(filter_settings)} {
  if (settings.trims_samples) maxMessageSize += kMaxTrimmed;
}

transport::TransportInterface* FilterTransportDescriptor::create_transport() const {
  return new FilterTransport{*this};
}

}  // namespace tactus::wire
