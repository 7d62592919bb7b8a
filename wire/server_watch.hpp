/// Watches whether the discovery servers of a participant are present. Only wire/ includes this header.
#pragma once

#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "wire/library.hpp"

namespace tactus::wire {

/// The listener of a participant, for its whole life. Threads: any.
class ServerWatch : public ParticipantListener {
 public:
  /// `names`: of the servers of `qos`, in their order.
  ServerWatch(std::vector<std::string> names, const dds::DomainParticipantQos& qos)
      : names_{std::move(names)}, servers_{discovery_servers(qos)} {}

  /// Names of the servers that were present, and whose lease has ended.
  [[nodiscard]] std::vector<std::string> lost() const;

 private:
  void on_present(const rtps::GUID_t& participant, const std::vector<rtps::Locator_t>& addresses) override;
  void on_gone(const rtps::GUID_t& participant) override;

  const std::vector<std::string> names_;
  const std::vector<rtps::Locator_t> servers_;   // by number of the name
  mutable std::mutex mutex_;                     // for the members below
  std::map<rtps::GUID_t, std::size_t> present_;  // number of the server, by participant
  std::vector<bool> was_present_ = std::vector<bool>(names_.size());
};

}  // namespace tactus::wire
