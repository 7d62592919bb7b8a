/// Memory that a process shares with its children. It has no name, and a size that nobody can change: otherwise a child
/// could end this process by making the memory smaller.
#pragma once

#include <cstddef>

namespace tactus::realtime {

class SharedMemory {
 public:
  /// Allocates `bytes` bytes of zeros. `name` shows in /proc/PID/maps. Throws std::system_error.
  [[nodiscard]] static SharedMemory create(const char* name, std::size_t bytes);
  /// Maps the memory of `descriptor`, which it takes over, in a child. Throws std::runtime_error if it is not such
  /// memory of at least `min_bytes`.
  [[nodiscard]] static SharedMemory open(int descriptor, std::size_t min_bytes);
  ~SharedMemory();
  SharedMemory(SharedMemory&& other) noexcept;
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;

  /// Begins at a page.
  [[nodiscard]] std::byte* data() const noexcept { return static_cast<std::byte*>(data_); }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  /// A descriptor of the memory, closed by an exec and by the destructor.
  [[nodiscard]] int descriptor() const noexcept { return descriptor_; }

 private:
  SharedMemory(int descriptor, std::size_t bytes);

  int descriptor_;
  std::size_t bytes_;
  void* data_ = nullptr;
};

}  // namespace tactus::realtime
