/// Strong index types: vertices, faces, records and so on each have their own type, so the compiler rejects a FaceId in
/// place of a VertexId.
///
/// The ids `VertexId`, `FaceId`, `RecordId`, `RegionId` and `PartIndex` appear in files and samples and never change
/// while a model exists. The other indices are valid in one HRTC only. An index costs as much as a std::uint32_t.
/// Kernels that compute with raw numbers name the index type in a comment.
#pragma once

#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

namespace tactus::spm {

/// A vertex of the finest mesh. Base vertices come first: `[0, base_vertices)`. Record `r` adds vertex
/// `base_vertices + r`.
enum class VertexId : std::uint32_t {};
/// A face of the finest mesh. A coarser version of the face has the same id. In the AB-tree it is child `id % 8` of
/// leaf `id / 8`.
enum class FaceId : std::uint32_t {};
/// A vertex split. Ids are in topological order: an ascending list can be applied from front to back and undone from
/// back to front.
enum class RecordId : std::uint32_t {};
/// A record part in a file or message. The first part of record `r` in a file is part `r`.
enum class PartIndex : std::uint32_t {};
/// A labelled cell of the partition of the model's bounds.
enum class RegionId : std::uint32_t {};
/// A page of the partition (spm/region_grid.hpp): the Morton code of its coordinates, below kMaxPages.
enum class PageId : std::uint32_t {};

/// An object of one HRTC, below kMaxObjects.
enum class ObjectIndex : std::uint32_t {};
/// A slot of the pool: one record part, its vertex and the two faces that it bears.
enum class Slot : std::uint32_t {};
/// A face row of the pool. Slot `s` has the rows `2 s` and `2 s + 1`.
enum class RowIndex : std::uint32_t {};
/// A list block of the pool.
enum class BlockIndex : std::uint32_t {};
/// A node of the AB-trees in a NodePool.
enum class NodeIndex : std::uint32_t {};

/// One of the types above.
template <class Id>
concept Index = std::is_enum_v<Id> && sizeof(Id) == 4 && !std::is_convertible_v<Id, std::uint32_t>;

/// The number behind an index.
[[nodiscard]] constexpr std::uint32_t index(Index auto id) noexcept { return static_cast<std::uint32_t>(id); }

/// The value that means "no such index". Converts to every index type and to a raw number.
struct None {
  static constexpr std::uint32_t kValue = 0xffffffffu;
  constexpr operator std::uint32_t() const noexcept { return kValue; }
  template <Index Id>
  constexpr operator Id() const noexcept {
    return Id{kValue};
  }
  template <Index Id>
  friend constexpr bool operator==(Id id, None) noexcept {
    return id == Id{kValue};
  }
};
inline constexpr None kNone{};

/// The range of all indices below `count`, in order: `for (RegionId region : ids<RegionId>(count))`.
template <Index Id>
class IdRange {
 public:
  struct Iterator {
    std::uint32_t at;
    Id operator*() const noexcept { return Id{at}; }
    Iterator& operator++() noexcept {
      ++at;
      return *this;
    }
    bool operator==(const Iterator&) const noexcept = default;
  };
  explicit IdRange(std::uint32_t count) noexcept : count_{count} {}
  [[nodiscard]] Iterator begin() const noexcept { return {0}; }
  [[nodiscard]] Iterator end() const noexcept { return {count_}; }

 private:
  std::uint32_t count_;
};
template <Index Id>
[[nodiscard]] IdRange<Id> ids(std::size_t count) noexcept {
  return IdRange<Id>{static_cast<std::uint32_t>(count)};
}

/// A borrowed array that only an `Id` subscripts.
template <Index Id, class T>
class IdSpan {
 public:
  IdSpan() = default;
  template <class Values>
  explicit IdSpan(Values& values) noexcept : data_{values.data()}, size_{static_cast<std::uint32_t>(values.size())} {}

  [[nodiscard]] T& operator[](Id id) const noexcept { return data_[index(id)]; }
  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }
  [[nodiscard]] T* data() const noexcept { return data_; }
  [[nodiscard]] T* begin() const noexcept { return data_; }
  [[nodiscard]] T* end() const noexcept { return data_ + size_; }

 private:
  T* data_ = nullptr;
  std::uint32_t size_ = 0;
};

/// A std::vector that only an `Id` subscripts.
template <Index Id, class T>
class IdVector {
 public:
  IdVector() = default;
  explicit IdVector(std::size_t size, const T& value = T{}) : values_(size, value) {}
  explicit IdVector(std::vector<T> values) : values_{std::move(values)} {}

  [[nodiscard]] decltype(auto) operator[](Id id) noexcept { return values_[index(id)]; }
  [[nodiscard]] decltype(auto) operator[](Id id) const noexcept { return values_[index(id)]; }
  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(values_.size()); }
  [[nodiscard]] IdRange<Id> ids() const noexcept { return IdRange<Id>{size()}; }
  /// The values in the order of their indices.
  [[nodiscard]] std::vector<T>& values() noexcept { return values_; }
  [[nodiscard]] const std::vector<T>& values() const noexcept { return values_; }
  [[nodiscard]] auto begin() noexcept { return values_.begin(); }
  [[nodiscard]] auto begin() const noexcept { return values_.begin(); }
  [[nodiscard]] auto end() noexcept { return values_.end(); }
  [[nodiscard]] auto end() const noexcept { return values_.end(); }

 private:
  std::vector<T> values_;
};

}  // namespace tactus::spm
