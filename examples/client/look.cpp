// Joins a session as a viewer. Prints one participant, one object and the position of one probe, then ends.
// docs/tutorials/first-client.md explains it.
#include <atomic>
#include <iostream>
#include <thread>

#include "wire/endpoints.hpp"

int main(int argc, char** argv) try {
  using namespace tactus;
  if (argc != 3) throw std::runtime_error("expected SESSION DOMAIN");
  wire::SessionAddress address;
  address.session = argv[1];
  address.participant = "outside";
  address.domain = std::stoi(argv[2]);
  address.qos = TACTUS_QOS_DIR;
  wire::Participants participants{address};
  std::atomic<bool> someone{false}, something{false}, touching{false};
  const auto print_once = [](std::atomic<bool>& printed, const std::string& line) {
    if (!printed.exchange(true)) std::cout << line << std::endl;
  };
  const wire::Reader<session::RosterEntry> roster{
      participants, wire::topics::kRoster,
      [&](session::RosterEntry&& entry) { print_once(someone, "here: " + entry.name); }};
  const wire::Reader<session::CatalogueEntry> catalogue{
      participants, wire::topics::kCatalogue,
      [&](session::CatalogueEntry&& entry) { print_once(something, "object: " + entry.object); }};
  const wire::Reader<session::ProbeState> probes{
      participants, wire::topics::kProbeState, [&](session::ProbeState&& state) {
        print_once(touching, "probe at z = " + std::to_string(state.device.position[2]));
      }};
  wire::Writer<session::RosterEntry> presence{participants, wire::topics::kRoster};
  session::RosterEntry self;
  self.name = address.participant;
  self.session = address.session;
  for (int beat = 0; beat < 300 && !(someone && something && touching); ++beat) {
    self.origin = participants.origin();
    self.heartbeat = static_cast<std::uint64_t>(beat);
    if (presence.send(self) != wire::SendStatus::kSent) std::cerr << presence.invalid_reason() << '\n';
    std::this_thread::sleep_for(std::chrono::milliseconds{100});
  }
  return someone && something && touching ? 0 : 1;
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 2;
}
