/// The memory that the processes of servo and gateway share: a ServoLink, and the ring of logged queries if there is a
/// contact log.
///
///     servo:   SharedBlock::create(...)          --> memory without a name, of a size that nobody can change
///     gateway: SharedBlock::open(descriptor)     --> the same memory; refused if another build has made it
///
/// The servo reads nothing here without a check (servo_link.hpp), and never reads the header again.
#pragma once

#include <sys/types.h>

#include <utility>

#include "hrtc_service/servo/contact_query.hpp"
#include "hrtc_service/servo/servo_link.hpp"
#include "realtime/shared_memory.hpp"

namespace tactus::hrtc_service {

class SharedBlock {
 public:
  /// Allocates a block and constructs its content. Throws std::system_error.
  [[nodiscard]] static SharedBlock create(bool has_log);
  /// Maps the block of `descriptor`, which it takes over. Throws std::runtime_error if it is not a block, or if the
  /// program that made it is another build than this one.
  [[nodiscard]] static SharedBlock open(int descriptor);

  [[nodiscard]] ServoLink& link() const noexcept;
  /// Returns the ring of logged queries; null: none.
  [[nodiscard]] ContactQuery::LogRing* log() const noexcept;
  /// Returns the process id of the servo, which has made the block.
  [[nodiscard]] pid_t servo() const noexcept;
  [[nodiscard]] const realtime::SharedMemory& memory() const noexcept { return memory_; }

 private:
  struct Content;
  explicit SharedBlock(realtime::SharedMemory memory) : memory_{std::move(memory)} {}
  [[nodiscard]] Content& content() const noexcept;

  realtime::SharedMemory memory_;
};

}  // namespace tactus::hrtc_service
