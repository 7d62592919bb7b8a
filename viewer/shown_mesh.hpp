/// The shown faces of an object, as rows of corners, with the change numbers by which a page gets only the rows that
/// changed since its last mesh frame.
///
/// A face has the same row as long as it is shown. The row of a hidden face is empty until another face takes it. So
/// the rows of a page are buffers of WebGL, and an update writes some of their rows.
///
/// Model frame, file units. One thread at a time. Not realtime.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/forest.hpp"

namespace tactus::viewer {

class ShownMesh {
 public:
  struct Face {
    std::array<float, 9> corners{};  ///< x y z of three corners; all zero: the row is empty
    bool finest = false;             ///< the face has its finest version
    [[nodiscard]] bool operator==(const Face&) const = default;
  };

  /// Reads the shown faces. Does nothing if the mesh has not changed since the last call. O(shown faces), allocates.
  void update(const spm::Forest& forest);

  /// Grows with each update that changed a row. 0: no face was ever shown.
  [[nodiscard]] std::uint32_t change_number() const noexcept { return change_number_; }
  /// See Forest::mesh_hash; of the last update.
  [[nodiscard]] std::uint64_t mesh_hash() const noexcept { return mesh_hash_; }
  /// Number of faces, without empty rows.
  [[nodiscard]] std::uint32_t faces() const noexcept { return faces_; }
  [[nodiscard]] std::uint32_t finest_faces() const noexcept { return finest_faces_; }
  /// All rows, also empty ones.
  [[nodiscard]] const std::vector<Face>& rows() const noexcept { return rows_; }
  /// Returns the numbers of the rows that changed after change number `since`, ascending. O(rows).
  [[nodiscard]] std::vector<std::uint32_t> changed_since(std::uint32_t since) const;

 private:
  void set(std::uint32_t row, const Face& face);
  [[nodiscard]] std::uint32_t take_row();

  std::vector<Face> rows_;
  std::vector<std::uint32_t> changes_;  // by row: number of its last change
  std::vector<std::uint32_t> seen_;     // by row: number of the last update in which a face had it
  std::vector<std::uint32_t> free_rows_;
  std::vector<std::uint32_t> page_row_of_;  // by LeafLane::number(); kNone: no face is shown there
  std::uint32_t updates_ = 0, change_number_ = 0;
  std::uint64_t mesh_hash_ = 0, base_faces_ = 0;
  std::uint32_t faces_ = 0, finest_faces_ = 0;
  bool changed_ = false;  // the current update has changed a row
};

}  // namespace tactus::viewer
