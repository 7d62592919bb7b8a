/// Issues emergency stops and resets as `tactus control` does, and waits for their acknowledgement.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "session/roster.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace tactus::bench {

/// The constructor has to run in the namespace of the operator (make_in_namespace). One thread at a time.
class StopIssuer {
 public:
  /// `receivers`: names of the hosts and HRTCs that have to acknowledge.
  StopIssuer(const wire::SessionAddress& address, std::vector<std::string> receivers);

  /// Waits until all receivers are in the roster and match the writers. Throws std::runtime_error after 20 s.
  void wait_for_receivers();
  /// Publishes a new stop until all receivers have acknowledged it, at most for 5 s. Returns the time just before the
  /// first write, monotonic ns.
  [[nodiscard]] std::int64_t stop();
  /// Publishes a reset that names the newest stop. Throws std::runtime_error if a receiver has not acknowledged it
  /// within 5 s.
  void reset();

  /// Whether the newest stop had to be published again.
  [[nodiscard]] bool was_repeated() const noexcept { return was_repeated_; }
  /// States whether the stops were published at a real-time priority.
  [[nodiscard]] const std::string& priority_note() const noexcept { return priority_note_; }

 private:
  template <class Sample>
  struct Delivery {
    Sample sample;
    std::int64_t first_ns = 0;  // just before the first write
    int writes = 0;
    bool is_acknowledged = false;
  };
  template <class Sample>
  void deliver(wire::Writer<Sample>& out, Delivery<Sample>& delivery);
  template <class Sample>
  [[nodiscard]] bool is_acknowledged(const Sample& sample) const;
  void receive_until(std::int64_t until_ns);

  wire::Participants participants_;
  std::vector<std::string> receivers_;
  session::Roster roster_;
  std::uint32_t stops_ = 0, resets_ = 0;  // numbers of the newest
  session::StopName newest_;
  bool was_repeated_ = false;
  std::string priority_note_;
  wire::Writer<session::EmergencyStop> stop_out_;
  wire::Writer<session::ForceReset> reset_out_;
  wire::Inbox<session::RosterEntry> inbox_{1u << 12};
  wire::Reader<session::RosterEntry> reader_;  // last, so that its callback does not outlive the inbox
};

}  // namespace tactus::bench
