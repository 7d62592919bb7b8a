/// Every sample of a session as it comes, still encoded: for what records.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "spm/span.hpp"
#include "wire/participants.hpp"

namespace tactus::wire {

/// What one end of a tap hears.
struct TapTopic {
  std::string name;        ///< of the topic; the same twice where ends differ
  std::string type;        ///< as idl_text() names it
  std::string partitions;  ///< of the session, to which it listens; "" is the session as a whole
};

/// Listens to all topics, in every partition of the session. It counts as a reader: best effort samples are sent once
/// more for it, and of the bulk class that is as much as an HRTC gets. Samples that cannot be decoded are left out.
class Tap {
 public:
  /// Of topics()[topic]; `encoded` with its encapsulation, valid during the call. From several threads of DDS, one call
  /// at a time for each topic.
  using OnSample = std::function<void(std::size_t topic, spm::Span<const std::uint8_t> encoded)>;

  /// `links` must be the tap's own: its topics have other types than those of Reader and Writer. Throws WireError.
  Tap(Participants& participants, bool bulk, OnSample on_sample);
  /// After this returns no callback runs.
  ~Tap();

  [[nodiscard]] const std::vector<TapTopic>& topics() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The text of idl/tactus.idl.
[[nodiscard]] const char* idl_text() noexcept;

}  // namespace tactus::wire
