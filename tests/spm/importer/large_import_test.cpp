// The import of an OBJ file of more than 2^31 bytes, as by `tactus mesh build`. It takes minutes and runs every night.
#include <gtest/gtest.h>
#include <linux/magic.h>
#include <sys/resource.h>
#include <sys/vfs.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "spm/offline/import.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::spm::offline {
namespace {

// A torus with kSide vertices along each of its two circles.
constexpr std::uint64_t kSide = 3600, kFaces = 2 * kSide * kSide;
constexpr double kRadius = 1, kTubeRadius = 0.5;

// What this test takes, expected from a measurement of 4.7 bytes of memory for each byte of a file of 2 GB: 9.6 GiB in
// the reader, 1.2 GiB for its result, which is a file in memory, and 1.2 GiB for the mesh in this process.
constexpr std::uint64_t kGibibyte = 1ULL << 30, kMemory = 13 * kGibibyte, kDisk = 3 * kGibibyte;

/// Returns the bytes of memory that programs can still get, or 0 if the system does not state them.
std::uint64_t available_memory() {
  std::ifstream file{"/proc/meminfo"};
  std::string name, unit;
  for (std::uint64_t kib = 0; file >> name >> kib && std::getline(file, unit);)
    if (name == "MemAvailable:") return kib << 10;
  return 0;
}

/// True if files in a folder take memory instead of space on a disk.
bool is_in_memory(const std::filesystem::path& folder) {
  struct statfs status {};
  return statfs(folder.c_str(), &status) == 0 && status.f_type == TMPFS_MAGIC;
}

/// Writes text in large blocks.
class TextFile {
 public:
  explicit TextFile(const std::filesystem::path& path) : file_{path, std::ios::binary} {
    text_.reserve(kBlock + kLongestLine);
  }
  void line(const char* keyword, double x, double y, double z) {
    text_ += keyword;
    for (const double number : {x, y, z}) add_number(number);
    end_line();
  }
  /// A triangle whose corners have normals with the numbers of their vertices.
  void face(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
    text_ += 'f';
    for (const std::uint64_t vertex : {a, b, c}) {
      const std::string number = std::to_string(vertex + 1);
      ((((text_ += ' ') += number) += "//") += number);
    }
    end_line();
  }
  /// Returns false if the disk was full.
  [[nodiscard]] bool close() {
    write_block();
    file_.close();
    return !file_.fail();
  }

 private:
  static constexpr std::size_t kBlock = 4 << 20, kLongestLine = 256;

  /// Adds a number of one digit with six digits after the point. Streams would take minutes for all numbers.
  void add_number(double number) {
    constexpr std::uint64_t kMillion = 1'000'000;
    const auto millionths = static_cast<std::uint64_t>(std::llround(std::abs(number) * kMillion));
    text_ += number < 0 ? " -" : " ";
    text_ += static_cast<char>('0' + millionths / kMillion);
    text_ += '.';
    text_.append(std::to_string(kMillion + millionths % kMillion), 1);
  }
  void end_line() {
    text_ += '\n';
    if (text_.size() >= kBlock) write_block();
  }
  void write_block() {
    file_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
    text_.clear();
  }

  std::ofstream file_;
  std::string text_;
};

/// Writes the vertices, normals and faces of the torus. Returns false if the disk was full.
bool write_torus(const std::filesystem::path& path) {
  std::vector<std::pair<double, double>> circle;  // cosine and sine
  for (std::uint64_t i = 0; i < kSide; ++i) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(i) / kSide;
    circle.emplace_back(std::cos(angle), std::sin(angle));
  }
  TextFile file{path};
  for (const auto& [cos_ring, sin_ring] : circle) {
    for (const auto& [cos_tube, sin_tube] : circle) {
      const double distance = kRadius + kTubeRadius * cos_tube;  // from the axis
      file.line("v", distance * cos_ring, distance * sin_ring, kTubeRadius * sin_tube);
    }
  }
  for (const auto& [cos_ring, sin_ring] : circle)
    for (const auto& [cos_tube, sin_tube] : circle) file.line("vn", cos_tube * cos_ring, cos_tube * sin_ring, sin_tube);
  for (std::uint64_t i = 0; i < kSide; ++i) {
    const std::uint64_t ring = i * kSide, next_ring = (i + 1) % kSide * kSide;
    for (std::uint64_t j = 0; j < kSide; ++j) {
      const std::uint64_t next = (j + 1) % kSide;
      file.face(ring + j, next_ring + j, next_ring + next);
      file.face(ring + j, next_ring + next, ring + next);
    }
  }
  return file.close();
}

/// The volume of a closed mesh, positive if its faces are counter-clockwise seen from outside.
double volume(const TriangleMesh& mesh) {
  double six_volumes = 0;
  for (const Triangle& face : mesh.faces) {
    const auto& [a, b, c] = face;
    const auto &p = mesh.positions[a], &q = mesh.positions[b], &r = mesh.positions[c];
    six_volumes += double{p[0]} * (double{q[1]} * r[2] - double{q[2]} * r[1]) +
                   double{p[1]} * (double{q[2]} * r[0] - double{q[0]} * r[2]) +
                   double{p[2]} * (double{q[0]} * r[1] - double{q[1]} * r[0]);
  }
  return six_volumes / 6;
}

TEST(LargeImport, ReadsAnObjFileOfTwoGibibytesWithinTheLimits) {
  const test_support::TemporaryFolder folder;  // removes the file
  const std::uint64_t memory = available_memory(), disk = std::filesystem::space(folder.path()).available;
  const std::uint64_t needed = kMemory + (is_in_memory(folder.path()) ? kDisk : 0);
  if (memory < needed)
    GTEST_SKIP() << memory / kGibibyte << " GiB of memory are available; needs " << needed / kGibibyte << " GiB";
  if (disk < kDisk)
    GTEST_SKIP() << disk / kGibibyte << " GiB are free in " << folder.path() << "; needs " << kDisk / kGibibyte
                 << " GiB";

  const std::filesystem::path path = folder.path() / "torus.obj";
  ASSERT_TRUE(write_torus(path)) << "the disk is full";
  const std::uint64_t bytes = std::filesystem::file_size(path);
  ASSERT_GT(bytes, std::uint64_t{1} << 31);

  const TriangleMesh mesh = import_mesh(path);  // throws if the reader exceeds a limit
  rusage reader{};
  ASSERT_EQ(getrusage(RUSAGE_CHILDREN, &reader), 0);
  RecordProperty("file_bytes", std::to_string(bytes));
  RecordProperty("reader_memory_kib", std::to_string(reader.ru_maxrss));
  RecordProperty("reader_computing_s", std::to_string(reader.ru_utime.tv_sec + reader.ru_stime.tv_sec));

  EXPECT_EQ(mesh.faces.size(), kFaces);
  // Of the torus itself. The volume of the mesh differs by 4e-6, because its edges are chords of the circles.
  EXPECT_NEAR(volume(mesh), 2 * std::numbers::pi * std::numbers::pi * kRadius * kTubeRadius * kTubeRadius, 1e-4);
}

}  // namespace
}  // namespace tactus::spm::offline
