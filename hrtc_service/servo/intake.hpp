/// Receives objects and regions from the gateway, checks them, and passes them to the haptic thread.
///
///     IntakeLink::messages --> [assemble, check] --> TouchObjects --> arrivals ring --> haptic thread
///     IntakeLink::answers  <-- [free]            <------------------- departures ring <-'
///
/// Trusts nothing in the link: a wrong message is refused and changes nothing. After an invalid header (unknown kind,
/// index or size) the intake reads no further until another gateway attaches, because it cannot find the next message.
///
/// One thread, not the haptic one. Allocates.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "hrtc_service/servo/intake_link.hpp"
#include "hrtc_service/servo/touch_objects.hpp"

namespace tactus::hrtc_service {

class Intake {
 public:
  /// Allocates the memory of all meshes and the rings. `link` must outlive the intake, which must outlive the last
  /// cycle of the servo.
  /// `directory_bytes`: max bytes of the directories of all objects (spm/directory.hpp).
  Intake(const spm::PoolSettings& settings, IntakeLink& link, std::uint64_t directory_bytes = ~std::uint64_t{0});

  /// Processes the messages and departures that have arrived. Call it every few milliseconds, and soon after the gateway
  /// has sent messages.
  void tick();

  [[nodiscard]] ArrivalRing& arrivals() noexcept { return arrivals_; }
  [[nodiscard]] DepartureRing& departures() noexcept { return departures_; }
  [[nodiscard]] const TouchObjects& objects() const noexcept { return objects_; }
  /// Returns whether a header was invalid. Later messages of this gateway are ignored.
  [[nodiscard]] bool is_broken() const noexcept { return is_broken_; }

 private:
  void attach_if_requested();
  [[nodiscard]] bool answer_loaded_regions();
  [[nodiscard]] bool push_arrivals();
  void process_departures();
  [[nodiscard]] bool assemble();
  void process_message();
  void answer(IntakeAnswer::Kind kind, std::uint32_t object, spm::RegionId region, spm::AcceptResult result);
  [[nodiscard]] spm::AcceptResult add_object(IntakeAnswer::Kind& kind);
  [[nodiscard]] bool keep_object(const ObjectDescription& description);
  [[nodiscard]] std::uint64_t directory_bytes_left() const noexcept;
  [[nodiscard]] spm::AcceptResult add_page(spm::RegionId& number);
  [[nodiscard]] spm::AcceptResult add_region(spm::RegionId& region);

  IntakeLink& link_;
  TouchObjects objects_;
  RingReader<std::byte, IntakeLink::kMessageBytes> messages_;
  RingWriter<IntakeAnswer, IntakeLink::kAnswers> answers_;
  MailboxWriter<AttachAnswer> attach_answers_;
  ArrivalRing arrivals_;
  DepartureRing departures_;
  std::optional<Arrival> pending_;  // an arrival for which the ring was full
  std::uint64_t max_bytes_;         // of a message
  std::uint64_t max_directory_bytes_;
  std::array<std::uint64_t, kMaxObjects> directory_bytes_{};  // by object index
  std::optional<IntakeHeader> header_;                        // of the message that is being assembled
  std::vector<std::byte> message_;                            // without its header
  std::uint64_t processed_ = 0;                               // messages
  std::uint32_t movable_ = 0;                                 // objects with a body
  bool is_broken_ = false;
  std::uint32_t attached_ = 0;                         // newest attach that is answered
  std::array<bool, kMaxObjects> waits_for_gateway_{};  // there before the attach, and not sent by the new gateway yet
  std::uint32_t kept_object_ = spm::kNone;             // whose pages and regions are being answered
  std::size_t next_page_ = 0;                          // its next page to answer
  spm::BlockIndex next_block_{};                       // where the search for its next loaded region begins
};

}  // namespace tactus::hrtc_service
