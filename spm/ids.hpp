/// Names of things in a model. Each is its own type, so that a face cannot be passed for a vertex.
///
/// Ids are what files and the wire carry and never change for a model's life; slots are places in one
/// controller's pool and mean nothing outside it.
#pragma once

#include <cstdint>
#include <type_traits>

namespace tactus::spm {

/// A vertex of the finest mesh. Base vertices come first: `[0, base_vertices)`; vertex `base_vertices + r` is the one
/// that record `r` brings.
enum class VertexId : std::uint32_t {};
/// A face of the finest mesh, which keeps its id in every coarser version; also its leaf in the AB-tree.
enum class FaceId : std::uint32_t {};
/// A vertex split. Ids ascend in an order in which every record comes after all that it depends on, so an ascending
/// list may be applied from front to back and undone from back to front.
enum class RecordId : std::uint32_t {};
/// A labelled cell of the partition of the model's bounding volume.
enum class RegionId : std::uint32_t {};
/// A place in the pool for one record, its vertex and the faces it bears.
enum class Slot : std::uint32_t {};

/// The plain number behind an id.
template <class Id>
[[nodiscard]] constexpr std::uint32_t index(Id id) noexcept {
  static_assert(std::is_enum_v<Id>);
  return static_cast<std::uint32_t>(id);
}

inline constexpr std::uint32_t kNone = 0xffffffffu;

}  // namespace tactus::spm
