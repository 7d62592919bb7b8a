#include "hrtc_service/snapshot.hpp"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <stdexcept>

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMinContactNs = 2'000'000'000;  // exact contact before a snapshot; the first needs a quarter

struct Colour {
  unsigned char red, green, blue;
};

bool is_in_regions(const spm::RegionGrid& grid, const std::vector<std::uint32_t>& regions, const Vec3d& point,
                   double margin) {
  return std::any_of(regions.begin(), regions.end(), [&](std::uint32_t region) {
    return grid.box(spm::RegionId{region}).squared_distance(point) <= margin * margin;
  });
}

}  // namespace

void expect_snapshot_directory(const std::filesystem::path& directory) {
  const auto refuse = [&](const std::string& found) {
    throw std::runtime_error("snapshot directory " + directory.string() + ": " + found +
                             ", expected a directory to write into or a place to make one");
  };
  std::error_code ignored;
  std::filesystem::path there = std::filesystem::absolute(directory);
  while (!std::filesystem::exists(there, ignored) && there.has_relative_path()) there = there.parent_path();
  if (!std::filesystem::is_directory(there, ignored)) refuse("found " + there.string() + ", which is no directory");
  std::string probe =
      (there / ".tactus-XXXXXX").string();  // the access rights are not enough: the file system may be read-only
  const int file = ::mkstemp(probe.data());
  if (file < 0) refuse("found that " + there.string() + " cannot be written into (" + std::strerror(errno) + ")");
  ::close(file);
  ::unlink(probe.c_str());
}

void write_snapshot(const std::filesystem::path& file, const std::vector<SnapshotFace>& faces,
                    const spm::RegionGrid& grid, const std::vector<std::uint32_t>& contact_regions,
                    const std::vector<std::uint32_t>& predicted_regions) {
  const std::filesystem::path temporary = file.string() + ".part";
  std::ofstream out{temporary, std::ios::binary};
  out << "ply\nformat ascii 1.0\ncomment red: contact region, yellow: predicted, green: full resolution, grey: coarse\n"
      << "element vertex " << 3 * faces.size() << "\nproperty float x\nproperty float y\nproperty float z\n"
      << "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      << "element face " << faces.size() << "\nproperty list uchar int vertex_indices\nend_header\n";
  const auto size = [](const SnapshotFace& face) {
    const auto corner = [&](int i) {
      return Vec3d{face.corners[3 * i], face.corners[3 * i + 1], face.corners[3 * i + 2]};
    };
    return std::max((corner(1) - corner(0)).norm(), (corner(2) - corner(0)).norm());
  };
  double largest = 0;
  for (const SnapshotFace& face : faces) largest = std::max(largest, size(face));
  for (const SnapshotFace& face : faces) {
    const Vec3d centre{(face.corners[0] + face.corners[3] + face.corners[6]) / 3.0,
                       (face.corners[1] + face.corners[4] + face.corners[7]) / 3.0,
                       (face.corners[2] + face.corners[5] + face.corners[8]) / 3.0};
    Colour colour{60, 160, 80};
    if (!face.finest) {
      const auto shade = static_cast<unsigned char>(200 - 130 * std::sqrt(size(face) / largest));
      colour = {shade, shade, shade};
    } else if (is_in_regions(grid, contact_regions, centre, 0)) {
      colour = {205, 50, 45};
    } else if (is_in_regions(grid, predicted_regions, centre, 0)) {
      colour = {230, 190, 50};
    }
    for (int corner = 0; corner < 3; ++corner)
      out << face.corners[3 * corner] << ' ' << face.corners[3 * corner + 1] << ' ' << face.corners[3 * corner + 2]
          << ' ' << int{colour.red} << ' ' << int{colour.green} << ' ' << int{colour.blue} << '\n';
  }
  for (std::size_t i = 0; i < faces.size(); ++i) out << "3 " << 3 * i << ' ' << 3 * i + 1 << ' ' << 3 * i + 2 << '\n';
  out.close();
  std::error_code error;
  if (out) std::filesystem::rename(temporary, file, error);
  if (!out || error) {
    std::filesystem::remove(temporary, error);
    throw std::runtime_error("cannot write the snapshot " + file.string());
  }
}

SnapshotTaker::SnapshotTaker(std::filesystem::path directory, std::string name, const Loader& loader, ServoLink& link)
    : directory_{std::move(directory)},
      name_{std::move(name)},
      loader_{loader},
      link_{link},
      parts_{link.snapshot_parts} {}

/// Takes the faces that have arrived. Returns whether the snapshot is complete.
bool SnapshotTaker::take_parts() {
  for (SnapshotPart part; parts_.pop(part);) {
    if (part.object == spm::kNone) return true;
    if (part.object < kMaxObjects) faces_[part.object].push_back(part.face);
  }
  return false;
}

void SnapshotTaker::write() {
  ++snapshots_taken_;
  for (const Loader::ObjectInfo& object : loader_.objects()) {
    const std::vector<SnapshotFace> faces = std::exchange(faces_[object.index], {});
    if (faces.empty() || object.digest != digests_[object.index]) continue;
    const std::filesystem::path file =
        directory_ / (name_ + "-" + object.name + "-" + std::to_string(snapshots_taken_) + ".ply");
    write_snapshot(file, faces, loader_.grid(object.index), contacts_[object.index], predictions_[object.index]);
    spdlog::info("snapshot {} ({} faces)", file.string(), faces.size());
  }
  faces_ = {};
}

void SnapshotTaker::tick(std::int64_t now_ns, bool touches_exactly,
                         const std::array<ReportedProbe, kMaxProbes>& probes) {
  if (is_requested_) {
    if (!take_parts()) return;
    is_requested_ = false;
    contact_began_ns_ = 0;
    write();
    return;
  }
  if (!touches_exactly) {
    contact_began_ns_ = 0;
    return;
  }
  if (contact_began_ns_ == 0) contact_began_ns_ = now_ns;
  if (now_ns - contact_began_ns_ < (snapshots_taken_ == 0 ? kMinContactNs / 4 : kMinContactNs) ||
      snapshots_taken_ >= kMaxSnapshots)
    return;
  digests_.fill(0);
  for (const Loader::ObjectInfo& object : loader_.objects()) {
    digests_[object.index] = object.digest;
    contacts_[object.index] = loader_.regions_at_probes(object.index, probes);
    predictions_[object.index] = loader_.predicted(object.index);
  }
  is_requested_ = true;
  link_.request_snapshot();
}

}  // namespace tactus::hrtc_service
