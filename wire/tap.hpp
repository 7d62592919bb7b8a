/// Receives all samples of a session in encoded form, for recorders.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "wire/participants.hpp"

namespace tactus::wire {

/// One reader of a tap.
struct TapTopic {
  std::string name;        ///< of the topic; two readers of one topic have the same
  std::string type;        ///< as idl_text() names it
  std::string partitions;  ///< that it reads; "" is the session as a whole
};

/// Reads all topics in every partition of the session. Its readers are additional: writers send best-effort samples
/// once more; for class bulk that doubles the traffic. Drops samples that cannot be decoded.
class Tap {
 public:
  /// `topic` is an index into topics(); `encoded` includes the encapsulation and is valid during the call. Called from
  /// several DDS threads, one call at a time for each topic.
  using OnSample = std::function<void(std::size_t topic, std::span<const std::uint8_t> encoded)>;

  /// `participants` must be the tap's own: its types differ from those of Reader and Writer. Throws WireError.
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
