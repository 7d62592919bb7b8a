#include "viewer/shown_mesh.hpp"

#include "spm/tree_faces.hpp"

namespace tactus::viewer {

void ShownMesh::set(std::uint32_t row, const Face& face) {
  if (rows_[row] == face) return;
  rows_[row] = face;
  changed_ = true;
  changes_[row] = change_number_ + 1;  // `update` increments change_number_ once for all rows
}

/// Returns an empty row.
std::uint32_t ShownMesh::take_row() {
  if (!free_rows_.empty()) {
    const std::uint32_t row = free_rows_.back();
    free_rows_.pop_back();
    return row;
  }
  rows_.emplace_back();
  changes_.push_back(0);
  seen_.push_back(0);
  return static_cast<std::uint32_t>(rows_.size() - 1);
}

void ShownMesh::update(const spm::Forest& forest) {
  if (updates_ > 0 && forest.mesh_hash() == mesh_hash_ && forest.base_faces_shown() == base_faces_) return;
  mesh_hash_ = forest.mesh_hash();
  base_faces_ = forest.base_faces_shown();
  ++updates_;
  faces_ = finest_faces_ = 0;
  changed_ = false;

  spm::for_each_face(forest.tree(), [&](spm::LeafLane at, const spm::TreeNode& node) {
    const unsigned lane = at.lane();
    if (at.number() >= page_row_of_.size()) page_row_of_.resize(at.number() + 1, spm::kNone);
    std::uint32_t& row = page_row_of_[at.number()];
    if (row == spm::kNone) row = take_row();
    Face face;
    for (std::size_t i = 0; i < face.corners.size(); ++i) face.corners[i] = node.lanes[i][lane];
    face.finest = (node.finest >> lane & 1u) != 0;
    seen_[row] = updates_;
    set(row, face);
    ++faces_;
    finest_faces_ += face.finest ? 1 : 0;
  });
  for (std::uint32_t& row : page_row_of_) {
    if (row == spm::kNone || seen_[row] == updates_) continue;
    set(row, Face{});
    free_rows_.push_back(row);
    row = spm::kNone;
  }
  if (changed_) ++change_number_;
}

std::vector<std::uint32_t> ShownMesh::changed_since(std::uint32_t since) const {
  std::vector<std::uint32_t> rows;
  for (std::uint32_t row = 0; row < rows_.size(); ++row)
    if (changes_[row] > since) rows.push_back(row);
  return rows;
}

}  // namespace tactus::viewer
