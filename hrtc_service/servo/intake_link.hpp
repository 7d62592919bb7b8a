/// The messages by which the gateway passes objects and regions to the intake of the servo, and the answers.
///
///     gateway                                                        servo
///     Loader --> IntakeSender --messages--> SharedRing of bytes --> Intake --arrivals--> haptic thread
///                     ^-----------answers-- SharedRing ------------'
///
/// A message consists of the bytes of an IntakeHeader, of the struct for its kind, and of its arrays. Both ends are of
/// the same build, on the same machine.
///
/// A gateway that begins with a link that an earlier one has used attaches first, and sends nothing until the intake
/// has answered:
///
///     gateway                                             intake
///     increments attach_requests    -------------------> drops the rest of the earlier gateway's messages
///     receives the list of the servo's objects  <------  answers the attach
///     kObject with the same id, digest and index  ------> keeps the object, and answers kLoaded for it, its pages and
///                                                         its regions
///     kWithdraw for the objects that no host offers  ---> removes them
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "hrtc_service/servo/shared_mailbox.hpp"
#include "hrtc_service/servo/shared_ring.hpp"
#include "hrtc_service/servo/touch_object.hpp"
#include "session/messages.hpp"
#include "spm/cache.hpp"

namespace tactus::hrtc_service {

enum class IntakeKind : std::uint32_t {
  kObject,    ///< IntakeObject; then positions, radii and faces of the base mesh
  kRegion,    ///< IntakeRegion; then list, sent, residuals and parts of a RegionData
  kRetire,    ///< RegionId
  kWithdraw,  ///< nothing; the last message of an object
  kPage,      ///< IntakePage; then its regions
  kDropPage   ///< PageId
};

struct IntakeHeader {
  IntakeKind kind = IntakeKind::kObject;
  std::uint32_t object = 0;  ///< index, below kMaxObjects
  std::uint64_t bytes = 0;   ///< size of the message without this header
};

struct IntakeObject {
  std::uint64_t id = 0;
  std::array<char, session::kMaxName + 1> name{};  ///< ends with a zero byte
  session::Pose pose;
  double scale = 1;
  session::Material material;
  session::Body body;
  spm::ModelSummary summary{};
  std::uint32_t max_pages = 0;  ///< max number of pages that follow
};

struct IntakePage {
  spm::PageId id{};
  std::uint32_t first = 0;    ///< as in spm::Page
  std::uint32_t regions = 0;  ///< number
};

struct IntakeRegion {
  spm::RegionId region{};
  spm::ListSummary expected;
  std::uint32_t list = 0, sent = 0, residuals = 0, parts = 0;  ///< sizes of the arrays
};

/// Reports the result of a message, or that the haptic thread has returned a region or an object.
struct IntakeAnswer {
  enum class Kind : std::uint8_t {
    kObject,      ///< an object has been added, kept or refused
    kDiffers,     ///< the servo has the object as it was for an earlier gateway, and it must be withdrawn first
    kRegion,      ///< a region has been loaded or refused
    kOther,       ///< another message has been processed
    kRegionGone,  ///< the haptic thread has returned a retired region, and its memory is free
    kObjectGone,  ///< the haptic thread has returned a withdrawn object, and all its memory is free
    kPage         ///< a page has been loaded or refused
  } kind = Kind::kOther;
  spm::AcceptResult result =
      spm::AcceptResult::kAccepted;  ///< of kObject, kRegion and kPage; kLoaded: the servo has it already
  std::uint32_t object = 0;          ///< index
  spm::RegionId region{};            ///< or the number of a page
  std::uint64_t processed = 0;       ///< number of messages that the intake has processed
  spm::Cache::Space free;            ///< memory of the pool that is free now
};

/// An object that the servo has when a gateway attaches.
struct KeptObject {
  std::uint64_t id = 0, digest = 0;
  bool exists = false;
  bool is_withdrawn = false;  ///< its memory is still in use
};

/// The answer to an attach.
struct AttachAnswer {
  std::uint32_t request = 0;                      ///< IntakeLink::attach_requests
  std::uint64_t answers_begin = 0;                ///< RingWriter::position of the first answer for this gateway
  spm::Cache::Space free;                         ///< as in IntakeAnswer
  std::array<KeptObject, kMaxObjects> objects{};  ///< by index
};

struct IntakeLink {
  static constexpr std::uint32_t kMessageBytes = 1u << 18, kAnswers = 4096;
  SharedRing<std::byte, kMessageBytes> messages;
  SharedRing<IntakeAnswer, kAnswers> answers;
  std::atomic<std::uint32_t> attach_requests{0};
  SharedMailbox<AttachAnswer> attach_answers;
};

}  // namespace tactus::hrtc_service
