/// How import_mesh() and the program tactus-import, its child process, exchange data, and the limits of the child.
///
///     import_mesh()  <-- name of a file -----  tactus-import     kSocket, one packet each
///                    --- its descriptor ---->
///                    <-- result ------------                     kResult, a file in memory
///
/// The child requests the model first, then files that the model names. The result is complete once the child has
/// ended with status 0.
#pragma once

#include <cstddef>
#include <cstdint>

namespace tactus::spm::offline::import_channel {

inline constexpr int kSocket = 3, kResult = 4;    // descriptors of the child, which has no other but 0, 1 and 2
inline constexpr int kOutOfMemory = 3;            // exit status of the child
inline constexpr std::size_t kMaxName = 4096;     // bytes of a file's name
inline constexpr std::size_t kMaxMessage = 4096;  // bytes of an error message

/// The answer to a name. The descriptor is ancillary data of the same packet.
enum class Answer : char { kRefused, kOpened };

/// The result begins with it. A message of an error follows, or vertices with three floats each, then faces with three
/// vertex numbers of 32 bits each.
struct ResultHeader {
  std::uint64_t message_bytes = 0;  // 0: no error
  std::uint64_t vertices = 0, faces = 0;
};

/// Limits of the child.
struct Limits {
  std::uint64_t memory_bytes = 0;
  std::uint64_t computing_s = 0, elapsed_s = 0;
};

/// Returns the limits for files of this size: a constant, and more for each byte. An OBJ file of 2 GB took 4.7 bytes of
/// memory for each byte, and 14 MB/s; the nightly test LargeImport reports both for a similar file. With one digit for
/// each coordinate, a file takes much more memory for each byte.
[[nodiscard]] constexpr Limits limits_for(std::uint64_t bytes) noexcept {
  constexpr std::uint64_t kMemory = 1ULL << 30, kMemoryPerByte = 64;
  constexpr std::uint64_t kSeconds = 10, kBytesPerSecond = 2'000'000, kElapsedFactor = 10;
  const std::uint64_t computing_s = kSeconds + bytes / kBytesPerSecond;
  return {kMemory + kMemoryPerByte * bytes, computing_s, kElapsedFactor * computing_s};
}

}  // namespace tactus::spm::offline::import_channel
