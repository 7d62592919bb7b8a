/// Sends which regions determine the mesh of each object (topic tactus_shown_regions), while a reader is matched.
///
/// The servo copies the regions of one object at a time, in the cycle after the request. Service thread.
#pragma once

#include <array>
#include <cstdint>

#include "hrtc_service/loader.hpp"
#include "hrtc_service/servo/servo_link.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class ShownSender {
 public:
  /// All must outlive the sender.
  ShownSender(wire::Participants& participants, ServoLink& link, const Loader& loader)
      : link_{link},
        mesh_hashes_{link.mesh_hashes},
        reports_{link.shown_reports},
        loader_{loader},
        out_{participants, wire::topics::kShownRegions} {}

  /// Sends the regions that the servo has copied, and requests those of the next object that is due.
  void tick(std::int64_t now_ns, const session::Origin& origin);

 private:
  void send(std::int64_t now_ns, const session::Origin& origin);
  void request_next(std::int64_t now_ns);

  struct Sent {
    std::uint64_t object_id = 0, mesh_hash = 0;
    std::int64_t at_ns = 0;
  };
  ServoLink& link_;
  MailboxReader<MeshHashes> mesh_hashes_;
  MailboxReader<ShownReport> reports_;
  const Loader& loader_;
  wire::Writer<session::ShownRegions> out_;
  std::array<Sent, kMaxObjects> sent_{};  // by object index
  ShownReport report_;
  std::uint64_t requested_id_ = 0;  // of the object
  std::int64_t requested_ns_ = 0;
};

}  // namespace tactus::hrtc_service
