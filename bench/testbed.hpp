/// The programs, model and recordings of the benchmark of many HRTCs.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "bench/models.hpp"
#include "bench/session_keys.hpp"
#include "bench/surface_recording.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "wire/participants.hpp"

namespace tactus::bench {

/// Settings of the benchmark of many HRTCs.
struct ScaleSettings {
  std::string part;  // empty: all parts
  std::uint32_t faces = 1'000'000;
  int domain = 40;
  int windows = 10;    // number of windows of each kind
  double seconds = 2;  // length of each window
  int joining_hrtcs = 32;
  int min_joining_hrtcs = 0;              // 0: an eighth of joining_hrtcs
  int secured_hrtcs = 8;                  // number of HRTCs that join with keys
  int secured_pairs = 3;                  // number of joins with keys, and without
  int probes = 64;                        // 8 at each HRTC
  std::uint32_t state_faces = 2'950'000;  // of the model of part "state", for about 10,000 regions
};

/// Writes a model and recordings of tips on its surface, and starts programs that use them. Each part of the benchmark
/// has its own session.
class Testbed {
 public:
  explicit Testbed(const ScaleSettings& settings) : settings_{settings} {
    std::fprintf(stderr, "writing the model and the recordings\n");
    LoadedModel subject = load_model({}, settings.faces);
    digest_ = subject.model.summary.digest;
    spm::offline::write_model(folder_.path() / "model.spm", subject.model, {});
    scale_to_edge(subject, kHandEdge);
    std::ofstream config{folder_.path() / "host.yaml"};
    config.precision(17);
    config << "objects:\n  - name: object\n    model: " << (folder_.path() / "model.spm").string()
           << "\n    position: [0, 0, 0]\n    scale: " << subject.model.summary.metres_per_unit << '\n';
    if (!config.flush()) throw std::runtime_error("cannot write " + (folder_.path() / "host.yaml").string());
    write_path("slow.csv", subject, kSlowSpeed);
    if (settings.part.empty() || settings.part == "coded")
      for (int i = 0; i < settings.probes; ++i) write_moving(i);  // on the slow path
    write_path("fast.csv", subject, kFastSpeed);
    const int resting = std::max(settings.joining_hrtcs, settings.secured_hrtcs);
    for (int i = 0; i < resting; ++i) write_resting(i, resting);  // on the fast path
    programs_ = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  }

  [[nodiscard]] std::uint64_t digest() const noexcept { return digest_; }

  /// Whether the programs and observers that start from now on have keys.
  void set_keys(bool has_keys) noexcept { has_keys_ = has_keys; }

  /// Starts a host in `session`, which serves the model when this returns. Throws std::runtime_error if the host ends
  /// first, or does not serve the model within 60 s.
  [[nodiscard]] std::unique_ptr<e2e::Process> host(const std::string& session) const {
    auto host = start("host", session, "host", {"--config", (folder_.path() / "host.yaml").string()});
    if (!host->wait_for_line("serving 'object'", std::chrono::seconds{60}))
      throw std::runtime_error("the host does not serve:\n" + host->output());
    return host;
  }
  /// Starts an HRTC with one user of the same name, whose tip replays the recording `path`.
  [[nodiscard]] std::unique_ptr<e2e::Process> hrtc(const std::string& session, const std::string& name,
                                                   const std::string& path, std::vector<std::string> more = {}) const {
    more.insert(more.end(), {"--replay", name + "=" + (folder_.path() / (path + ".csv")).string()});
    return start("hrtc", session, name, more);
  }
  /// Starts an HRTC with one user for each recording of `paths`. A user's name is "HRTC-RECORDING".
  [[nodiscard]] std::unique_ptr<e2e::Process> hrtc(const std::string& session, const std::string& name,
                                                   const std::vector<std::string>& paths) const {
    std::vector<std::string> arguments;
    for (const std::string& path : paths)
      arguments.insert(arguments.end(),
                       {"--replay", name + "-" + path + "=" + (folder_.path() / (path + ".csv")).string()});
    return start("hrtc", session, name, arguments);
  }
  /// Returns the name of the recording of a tip that moves.
  [[nodiscard]] static std::string moving_recording(int index) { return "path-" + std::to_string(index); }
  /// Returns the name of the recording of a tip that rests.
  [[nodiscard]] static std::string resting_recording(int index) { return "rest-" + std::to_string(index); }
  [[nodiscard]] wire::SessionAddress address(const std::string& session, const std::string& participant) const {
    wire::SessionAddress address;
    address.session = session;
    address.participant = participant;
    address.domain = settings_.domain;
    address.qos = wire::default_qos_directory();
    if (has_keys_) keys_.secure(address);
    return address;
  }

 private:
  /// Starts the program tactus-`kind`, a host or an HRTC.
  [[nodiscard]] std::unique_ptr<e2e::Process> start(const std::string& kind, const std::string& session,
                                                    const std::string& name,
                                                    const std::vector<std::string>& more) const {
    std::vector<std::string> command{
        (programs_ / ("tactus-" + kind)).string(), "--session", session, "--name", name, "--domain",
        std::to_string(settings_.domain)};
    if (has_keys_) {
      const std::vector<std::string> keys = keys_.arguments(kind, name);
      command.insert(command.end(), keys.begin(), keys.end());
    }
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<e2e::Process>(std::move(command));
  }
  /// Writes the recording of a tip that follows a path at `speed`, m/s, and stores the path in `path_`.
  void write_path(const std::string& name, const LoadedModel& subject, double speed) {
    path_ = follow_surface(subject, speed);
    write_recording(folder_.path() / name, path_, kRecordingPeriod);
  }
  /// Writes the recording of a tip that rests at a point of `path_`. The points of all HRTCs are evenly spaced.
  void write_resting(int index, int count) const {
    const std::size_t at = path_.size() * static_cast<std::size_t>(index) / static_cast<std::size_t>(count);
    write_recording(folder_.path() / (resting_recording(index) + ".csv"), std::array{path_[at], path_[at]}, 60);
  }
  /// Writes the recording of a tip that follows a part of `path_`. The starts of all probes' parts are evenly spaced.
  void write_moving(int index) const {
    constexpr std::size_t kSteps = 20'000, kStride = 5;
    const std::size_t steps = std::min(kSteps, path_.size());
    const std::size_t from =
        (path_.size() - steps) * static_cast<std::size_t>(index) / static_cast<std::size_t>(settings_.probes);
    std::vector<spm::Vec3d> positions;
    for (std::size_t i = 0; i < steps; i += kStride) positions.push_back(path_[from + i]);
    write_recording(folder_.path() / (moving_recording(index) + ".csv"), positions, kStride * kRecordingPeriod);
  }

  static constexpr double kSlowSpeed = 0.05;  // m/s
  static constexpr double kFastSpeed = 0.3;   // m/s, of the impaired HRTC's tip

  ScaleSettings settings_;
  std::uint64_t digest_ = 0;
  std::vector<spm::Vec3d> path_;  // the path that write_path wrote last, m
  test_support::TemporaryFolder folder_;
  std::filesystem::path programs_;
  const SessionKeys keys_{folder_.path()};
  bool has_keys_ = false;
};

}  // namespace tactus::bench
