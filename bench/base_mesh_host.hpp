/// A host that makes an HRTC decode a base mesh when the benchmark requests it.
///
///     BaseMeshHost                                gateway of the HRTC
///       | catalogue: a new object                         |
///       |------------------------------------------------>|
///       |                          demand: no base mesh   |
///       |<------------------------------------------------|
///       | chunks of the base mesh                         |
///       |------------------------------------------------>| <- sent_ns: the last chunk
///       |                                                 | decodes
///       |                          demand: has base mesh  |
///       |<------------------------------------------------| <- decoded_ns
///       | catalogue: withdrawn                            |
///       |------------------------------------------------>|
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "session/delivery_server.hpp"
#include "spm/codec/compressed_model.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace tactus::bench {

/// The constructor has to run in the namespace of the host (make_in_namespace). One thread uses it. The host does not
/// forward stops.
class BaseMeshHost {
 public:
  /// `hrtc`: name of the HRTC. `model` must outlive the host. It should be too large for the pool of the HRTC, which
  /// then decodes the base mesh and refuses the object. The removal of an admitted base mesh would take seconds.
  BaseMeshHost(const wire::SessionAddress& address, const std::string& hrtc, const spm::codec::CompressedModel& model);
  ~BaseMeshHost();
  BaseMeshHost(const BaseMeshHost&) = delete;
  BaseMeshHost& operator=(const BaseMeshHost&) = delete;

  /// Whether the HRTC can receive base meshes.
  [[nodiscard]] bool matched() const noexcept { return base_.matched() > 0; }
  /// Withdraws the offered object if there is one, and offers the model as an object of a new name.
  void offer();
  void withdraw();
  /// Time at which the last chunk of the base mesh was sent, monotonic ns; 0: not sent yet.
  [[nodiscard]] std::int64_t sent_ns() const noexcept { return sent_ns_; }
  /// Arrival of the first demand that states that the HRTC has decoded the base mesh, monotonic ns; 0: none yet.
  [[nodiscard]] std::int64_t decoded_ns() const noexcept { return decoded_ns_; }

 private:
  void serve();
  void withdraw_offered();
  void send_roster_entry(bool leaving);

  const spm::codec::CompressedModel& model_;
  wire::Participants participants_;
  std::mutex mutex_;                               // guards the members below, up to `beats_`
  std::optional<session::DeliveryServer> server_;  // of the offered object
  session::CatalogueEntry entry_;
  std::uint32_t offers_ = 0;
  wire::Writer<session::CatalogueEntry> catalogue_;
  std::uint64_t beats_ = 0;
  std::atomic<std::int64_t> sent_ns_{0}, decoded_ns_{0};
  wire::Writer<session::RosterEntry> roster_;
  wire::Writer<session::BulkChunk> base_;
  wire::Inbox<session::Demand> demands_{1024};
  wire::Reader<session::Demand> reader_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace tactus::bench
