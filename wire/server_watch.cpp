#include "wire/server_watch.hpp"

#include <algorithm>

namespace tactus::wire {

std::vector<std::string> ServerWatch::lost() const {
  const std::lock_guard lock{mutex_};
  std::vector<std::string> names;
  for (std::size_t i = 0; i < names_.size(); ++i) {
    const bool is_present =
        std::any_of(present_.begin(), present_.end(), [&](const auto& server) { return server.second == i; });
    if (was_present_[i] && !is_present) names.push_back(names_[i]);
  }
  return names;
}

void ServerWatch::on_present(const rtps::GUID_t& participant, const std::vector<rtps::Locator_t>& addresses) {
  for (std::size_t i = 0; i < servers_.size(); ++i) {
    // Version 3.1 announces no loopback address.
    const auto is_server = [&](const rtps::Locator_t& address) {
      return rtps::IPLocator::isLocal(servers_[i])
                 ? rtps::IPLocator::getPhysicalPort(address) == rtps::IPLocator::getPhysicalPort(servers_[i])
                 : rtps::IPLocator::compareAddressAndPhysicalPort(address, servers_[i]);
    };
    if (std::none_of(addresses.begin(), addresses.end(), is_server)) continue;
    const std::lock_guard lock{mutex_};
    present_[participant] = i;
    was_present_[i] = true;
  }
}

void ServerWatch::on_gone(const rtps::GUID_t& participant) {
  const std::lock_guard lock{mutex_};
  present_.erase(participant);
}

}  // namespace tactus::wire
