// Measures how long a new HRTC takes from its first catalogue entry to the first exact contact. The tip touches and
// leaves a large model again and again. A host serves the model to one HRTC after another, each a process of its own,
// over two links: a local network, and a slow link with a long delay. For comparison, the whole mesh is downloaded over
// the same links by TCP.
#include <arpa/inet.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <future>
#include <thread>

#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "bench/models.hpp"
#include "bench/surface_path.hpp"
#include "session/figures.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
namespace names = session::figures;
using netem::Side;
using spm::Vec3d;

struct Settings {
  std::string model;
  std::uint32_t faces = 871'000;
  int tries = 20;
};

constexpr double kRadius = 0.003;     // m, of the tip
constexpr double kDepth = 0.0003;     // m
constexpr double kSpacing = 0.005;    // m along the surface, between the points that tips touch
constexpr double kTapPeriod = 0.02;   // s, from one touch of the tip to the next
constexpr double kKnockingTime = 30;  // s, length of the recording

struct LinkCase {
  const char* name;
  const char* link;
  double bound_ms;
};
/// A local network, and a link of 20 Mbit/s with a round trip of 100 ms.
constexpr std::array<LinkCase, 2> kLinks{LinkCase{"LAN", "P1", 250}, LinkCase{"100 ms", "P0:delay=50:rate=20", 1000}};

/// The model file, the configuration of its host, and the points of its surface that tips touch.
class TapSubject {
 public:
  explicit TapSubject(const Settings& settings) {
    LoadedModel loaded = load_model(settings.model, settings.faces);
    name = loaded.name;
    mesh_bytes = 12.0 * (static_cast<double>(loaded.model.positions.size()) + loaded.model.summary.faces);
    spm::offline::write_model(folder_.path() / "model.spm", loaded.model, {});
    if (settings.model.empty()) scale_to_edge(loaded, kHandEdge);  // the scale is in host.yaml, not in the model
    summary = loaded.model.summary;
    const double unit = summary.metres_per_unit;
    std::ofstream config{path("host.yaml")};
    config.precision(17);
    config << "objects:\n  - name: object\n    model: " << path("model.spm")
           << "\n    position: [0, 0, 0]\n    scale: " << unit << '\n';
    if (!config.flush()) throw std::runtime_error("cannot write " + path("host.yaml"));
    const spm::fcl::FixedMesh finest{loaded.model.positions, loaded.finest};
    const auto tries = static_cast<std::size_t>(settings.tries);
    const auto distance = [&](const Vec3d& at) { return finest.distance(at); };
    // A point is usable if the tip touches the surface there, and is free above it. In a narrow fold it is not free.
    constexpr std::uint32_t kCandidates = 20;  // candidate points for each try
    constexpr double kFreeHeight = 0.01;       // m; at this height above the point the tip has to be free
    const PathSettings path_settings{kRadius / unit, kDepth / unit, kSpacing / unit,
                                     kCandidates * static_cast<std::uint32_t>(tries), 1};
    for (const SurfacePose& pose : surface_poses(loaded.model.positions, loaded.finest, path_settings, distance)) {
      const bool is_touched = distance(pose.centre) * unit < kRadius - kDepth / 2;
      const bool is_free =
          distance(pose.centre + pose.normal * (kFreeHeight / unit)) * unit > 0.9 * (kRadius + kFreeHeight);
      if (is_touched && is_free && points.size() < tries) points.push_back({pose.centre * unit, pose.normal});
    }
    if (points.size() < tries)
      throw std::runtime_error("found " + std::to_string(points.size()) + " points that a tip can touch, expected " +
                               std::to_string(tries));
  }

  /// Writes the poses of a device that touches a point once in each kTapPeriod, and leaves it. Returns the file.
  [[nodiscard]] std::string write_recording(std::size_t point) const {
    const std::string file = path("knock-" + std::to_string(point) + ".csv");
    std::ofstream out{file};
    out.precision(9);
    const auto& [contact, normal] = points.at(point);
    for (int knock = 0; knock * kTapPeriod < kKnockingTime; ++knock)
      for (const double phase : {0.0, 0.5}) {
        const Vec3d tip = phase == 0 ? Vec3d{contact + 2 * kDepth * normal} : contact;
        out << (knock + phase) * kTapPeriod << ',' << tip[0] << ',' << tip[1] << ',' << tip[2] << '\n';
      }
    if (!out.flush()) throw std::runtime_error("cannot write " + file);
    return file;
  }
  [[nodiscard]] std::string path(const std::string& file) const { return folder_.path() / file; }

  std::string name;
  spm::ModelSummary summary;
  double mesh_bytes = 0;            // of an indexed mesh: 12 bytes for each vertex and each face
  std::vector<SurfacePose> points;  // m, world frame

 private:
  test_support::TemporaryFolder folder_;
};

// ---- download of the whole mesh

class Socket {
 public:
  Socket() : descriptor_{::socket(AF_INET, SOCK_STREAM, 0)} { expect(descriptor_ >= 0, "socket"); }
  explicit Socket(int descriptor) : descriptor_{descriptor} { expect(descriptor_ >= 0, "accept"); }
  ~Socket() { ::close(descriptor_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int descriptor() const noexcept { return descriptor_; }
  static void expect(bool success, const char* what) {
    if (!success) throw std::runtime_error(std::string{what} + ": " + std::strerror(errno));
  }

 private:
  int descriptor_;
};

sockaddr_in address_of(Side side) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(7391);
  ::inet_pton(AF_INET, netem::LinkedPair::address(side), &address.sin_addr);
  return address;
}

/// Sends `bytes` by TCP from namespace a to namespace b of the link. Returns the time from the start of the connection
/// to the arrival of the last byte, ms.
double download(const netem::LinkedPair& pair, std::size_t bytes) {
  std::promise<void> listening;
  bool is_listening = false;
  std::exception_ptr failure;
  std::thread sender{[&] {
    try {
      pair.enter_namespace(Side::kA);
      const Socket server;
      const sockaddr_in server_address = address_of(Side::kA);
      const int yes = 1;
      ::setsockopt(server.descriptor(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
      Socket::expect(
          ::bind(server.descriptor(), reinterpret_cast<const sockaddr*>(&server_address), sizeof server_address) == 0,
          "bind");
      Socket::expect(::listen(server.descriptor(), 1) == 0, "listen");
      is_listening = true;
      listening.set_value();
      const Socket peer{::accept(server.descriptor(), nullptr, nullptr)};
      const std::vector<char> block(1 << 16, 'm');
      for (std::size_t remaining = bytes; remaining > 0;) {
        const ssize_t sent = ::send(peer.descriptor(), block.data(), std::min(remaining, block.size()), MSG_NOSIGNAL);
        Socket::expect(sent > 0, "send");
        remaining -= static_cast<std::size_t>(sent);
      }
    } catch (...) {
      if (is_listening)
        failure = std::current_exception();
      else
        listening.set_exception(std::current_exception());
    }
  }};
  double ms = 0;
  const auto receive = [&] {
    listening.get_future().get();
    pair.enter_namespace(Side::kB);
    const Socket socket;
    const sockaddr_in server_address = address_of(Side::kA);
    const std::int64_t start_ns = realtime::monotonic_ns();
    Socket::expect(
        ::connect(socket.descriptor(), reinterpret_cast<const sockaddr*>(&server_address), sizeof server_address) == 0,
        "connect");
    std::vector<char> block(1 << 16);
    for (std::size_t received = 0; received < bytes;) {
      const ssize_t count = ::recv(socket.descriptor(), block.data(), block.size(), 0);
      Socket::expect(count > 0, "recv");
      received += static_cast<std::size_t>(count);
    }
    ms = static_cast<double>(realtime::monotonic_ns() - start_ns) * 1e-6;
  };
  try {
    in_own_thread(receive);
  } catch (...) {
    failure = std::current_exception();
  }
  sender.join();
  if (failure) std::rethrow_exception(failure);
  return ms;
}

// ---- first contacts

/// One sample for each HRTC: times from its first catalogue entry to its first base mesh and to its first exact
/// contact, and the bytes that it had received by then.
struct FirstContacts {
  Samples base_ms, exact_ms, bytes;
};

/// Starts one HRTC for each point. When its tip begins to touch and leave the point, no part of the model has arrived.
FirstContacts measure_contacts(LiveSession& session, const TapSubject& subject) {
  const auto host = session.start(Side::kA, "host", {"--name", "host", "--config", subject.path("host.yaml")});
  const auto wait_for = [&](const e2e::Process& program, const char* what, const auto& condition) {
    try {
      session.wait_until(what, condition);
    } catch (const std::runtime_error& error) {
      throw std::runtime_error(error.what() + std::string{"\n"} + program.output());
    }
  };
  wait_for(*host, "the host",
           [](const ObservedSession& observed) { return observed.roster.count(session::id_of("host")) != 0; });
  FirstContacts contacts;
  for (std::size_t i = 0; i < subject.points.size(); ++i) {
    std::fprintf(stderr, "\rtry %zu of %zu ", i + 1, subject.points.size());
    const std::string name = "desk-" + std::to_string(i);
    const auto hrtc = session.start(
        Side::kB, "hrtc", {"--name", name, "--users", "1", "--replay", name + "=" + subject.write_recording(i)});
    wait_for(*hrtc, "an exact contact",
             [&](const ObservedSession& observed) { return observed.figure(name, names::kFirstExact) >= 0; });
    const ObservedSession observed = session.observed();
    contacts.base_ms.add(observed.figure(name, names::kFirstBase) * 1e-3);
    contacts.exact_ms.add(observed.figure(name, names::kFirstExact) * 1e-3);
    contacts.bytes.add(observed.figure(name, names::kFirstExactBytes));
    hrtc->signal(SIGTERM);
    (void)hrtc->wait();
  }
  std::fprintf(stderr, "\n");
  host->signal(SIGTERM);
  (void)host->wait();
  return contacts;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  const TapSubject subject{settings};
  char text[120];
  std::snprintf(text, sizeof text, "a 3 mm tip that knocks at the surface, %d HRTCs on each link", settings.tries);
  Report report{{subject.name, subject.summary.digest, subject.summary.faces, text}};
  report.add_value("indexed mesh, 12 bytes for each vertex and face", {"model", 1}, "kB", subject.mesh_bytes * 1e-3);
  for (const LinkCase& link : kLinks) {
    double whole_ms = 0;
    FirstContacts contacts;
    in_own_thread([&] {
      LiveSession session{link.link};
      whole_ms = download(session.pair(), static_cast<std::size_t>(subject.mesh_bytes));
      contacts = measure_contacts(session, subject);
    });
    const std::string name = std::string{link.name} + ": ";
    report.add_percentiles(name + "catalogue to base mesh", "HRTCs", "ms", contacts.base_ms);
    report.add_percentiles(name + "catalogue to exact contact", "HRTCs", "ms", contacts.exact_ms);
    report.add_value(name + "TCP download of the indexed mesh", {"download", 1}, "ms", whole_ms);
    report.add_at_most(name + "catalogue to exact contact, p95", {"HRTCs", contacts.exact_ms.size()}, "ms",
                       contacts.exact_ms.percentile(0.95), link.bound_ms);
    report.add_at_most(name + "bytes until exact contact, p95", {"HRTCs", contacts.bytes.size()},
                       "% of the indexed mesh", 100 * contacts.bytes.percentile(0.95) / subject.mesh_bytes, 1);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"first-touch", "Time from the first catalogue entry to the first exact contact; needs root",
                         "3 HRTCs on each link, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)");
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(10'000, 10'000'000));
  app.add_option("--tries", settings.tries, "HRTCs on each link")->check(CLI::Range(1, 1000));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.tries = 3;
    return tactus::bench::run(settings);
  });
}
