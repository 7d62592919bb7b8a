// From the first catalogue entry to the first exact contact of a tip that knocks at a large model: real programs, a new
// HRTC each time, on a local and on a long narrow link. Beside it, the whole mesh over the same link.
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

constexpr double kRadius = 0.003;  // m, of the tip
constexpr double kDepth = 0.0003;  // m
constexpr double kApart = 0.005;   // m along the surface, from one place to the next
constexpr double kKnock = 0.02;    // s, from one to the next
constexpr double kPatience = 30;   // s

struct LinkCase {
  const char* name;
  const char* link;
  double bound_ms;
};
/// A local network; 20 Mbit/s with a round trip of 100 ms.
constexpr std::array<LinkCase, 2> kLinks{LinkCase{"LAN", "P1", 250}, LinkCase{"100 ms", "P0:delay=50:rate=20", 1000}};

/// A model and places on its surface.
class Subject {
 public:
  explicit Subject(const Settings& settings) {
    LoadedModel loaded = load_model(settings.model, settings.faces);
    name = loaded.name;
    mesh_bytes = 12.0 * (static_cast<double>(loaded.model.positions.size()) + loaded.model.summary.faces);
    spm::offline::write_model(folder_.path() / "model.spm", loaded.model, {});
    if (settings.model.empty()) scale_to_edge(loaded, kHandEdge);  // the host's scale, not in the file
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
    // Only places that a hand reaches from outside, and where it then touches: not in folds that hold the tip.
    constexpr std::uint32_t kSpare = 20;
    constexpr double kFree = 0.01;  // m above the place, where nothing is near
    const PathSettings walk{kRadius / unit, kDepth / unit, kApart / unit, kSpare * static_cast<std::uint32_t>(tries),
                            1};
    for (const SurfacePose& pose : surface_poses(loaded.model.positions, loaded.finest, walk, distance)) {
      const bool touches = distance(pose.centre) * unit < kRadius - kDepth / 2;
      const bool open = distance(pose.centre + pose.normal * (kFree / unit)) * unit > 0.9 * (kRadius + kFree);
      if (touches && open && places.size() < tries) places.push_back({pose.centre * unit, pose.normal});
    }
    if (places.size() < tries) throw std::runtime_error("found too few places in which the tip touches");
  }

  /// A device that knocks at a place: in and out again within kKnock.
  [[nodiscard]] std::string knocking(std::size_t place) const {
    const std::string file = path("knock-" + std::to_string(place) + ".csv");
    std::ofstream out{file};
    out.precision(9);
    const auto& [in, normal] = places.at(place);
    for (int knock = 0; knock * kKnock < kPatience; ++knock)
      for (const double share : {0.0, 0.5}) {
        const Vec3d at = share == 0 ? Vec3d{in + 2 * kDepth * normal} : in;
        out << (knock + share) * kKnock << ',' << at[0] << ',' << at[1] << ',' << at[2] << '\n';
      }
    if (!out.flush()) throw std::runtime_error("cannot write " + file);
    return file;
  }
  [[nodiscard]] std::string path(const std::string& file) const { return folder_.path() / file; }

  std::string name;
  spm::ModelSummary summary;
  double mesh_bytes = 0;
  std::vector<SurfacePose> places;  // world, m

 private:
  test_support::TemporaryFolder folder_;
};

// ---- beside it

class Socket {
 public:
  Socket() : number_{::socket(AF_INET, SOCK_STREAM, 0)} { expect(number_ >= 0, "socket"); }
  explicit Socket(int number) : number_{number} { expect(number_ >= 0, "accept"); }
  ~Socket() { ::close(number_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int number() const noexcept { return number_; }
  static void expect(bool went_well, const char* what) {
    if (!went_well) throw std::runtime_error(std::string{what} + ": " + std::strerror(errno));
  }

 private:
  int number_;
};

sockaddr_in address_of(Side side) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(7391);
  ::inet_pton(AF_INET, netem::LinkedPair::address(side), &address.sin_addr);
  return address;
}

/// ms from connecting to the last of so many bytes, by TCP from a to b.
double download(const netem::LinkedPair& pair, std::size_t bytes) {
  std::promise<void> listening;
  bool listens = false;
  std::exception_ptr trouble;
  std::thread sender{[&] {
    try {
      pair.enter(Side::kA);
      const Socket server;
      const sockaddr_in here = address_of(Side::kA);
      const int yes = 1;
      ::setsockopt(server.number(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
      Socket::expect(::bind(server.number(), reinterpret_cast<const sockaddr*>(&here), sizeof here) == 0, "bind");
      Socket::expect(::listen(server.number(), 1) == 0, "listen");
      listens = true;
      listening.set_value();
      const Socket peer{::accept(server.number(), nullptr, nullptr)};
      const std::vector<char> block(1 << 16, 'm');
      for (std::size_t left = bytes; left > 0;) {
        const ssize_t sent = ::send(peer.number(), block.data(), std::min(left, block.size()), MSG_NOSIGNAL);
        Socket::expect(sent > 0, "send");
        left -= static_cast<std::size_t>(sent);
      }
    } catch (...) {
      if (listens)
        trouble = std::current_exception();
      else
        listening.set_exception(std::current_exception());
    }
  }};
  double ms = 0;
  const auto receive = [&] {
    listening.get_future().get();
    pair.enter(Side::kB);
    const Socket socket;
    const sockaddr_in there = address_of(Side::kA);
    const std::int64_t began_ns = wire::monotonic_ns();
    Socket::expect(::connect(socket.number(), reinterpret_cast<const sockaddr*>(&there), sizeof there) == 0, "connect");
    std::vector<char> block(1 << 16);
    for (std::size_t came = 0; came < bytes;) {
      const ssize_t got = ::recv(socket.number(), block.data(), block.size(), 0);
      Socket::expect(got > 0, "recv");
      came += static_cast<std::size_t>(got);
    }
    ms = static_cast<double>(wire::monotonic_ns() - began_ns) * 1e-6;
  };
  try {
    in_own_thread(receive);
  } catch (...) {
    trouble = std::current_exception();
  }
  sender.join();
  if (trouble) std::rethrow_exception(trouble);
  return ms;
}

// ---- touching

struct Touches {
  Samples base_ms, exact_ms, bytes;
};

/// An HRTC for each try, whose tip knocks at the surface before anything of the model is there.
Touches touch(LiveSession& session, const Subject& subject) {
  const auto host = session.start(Side::kA, "host", {"--name", "host", "--config", subject.path("host.yaml")});
  const auto await = [&](const e2e::Process& program, const char* what, const auto& condition) {
    try {
      session.until(what, condition);
    } catch (const std::runtime_error& error) {
      throw std::runtime_error(error.what() + std::string{"\n"} + program.output());
    }
  };
  await(*host, "the host", [](const SeenSession& seen) { return seen.roster.count(session::id_of("host")) != 0; });
  Touches touches;
  for (std::size_t i = 0; i < subject.places.size(); ++i) {
    std::fprintf(stderr, "\rtouch %zu of %zu ", i + 1, subject.places.size());
    const std::string name = "desk-" + std::to_string(i);
    const auto hrtc =
        session.start(Side::kB, "hrtc", {"--name", name, "--users", "1", "--replay", name + "=" + subject.knocking(i)});
    await(*hrtc, "an exact contact",
          [&](const SeenSession& seen) { return seen.figure(name, names::kFirstExact) >= 0; });
    const SeenSession seen = session.seen();
    touches.base_ms.add(seen.figure(name, names::kFirstBase) * 1e-3);
    touches.exact_ms.add(seen.figure(name, names::kFirstExact) * 1e-3);
    touches.bytes.add(seen.figure(name, names::kFirstExactBytes));
    hrtc->signal(SIGTERM);
    (void)hrtc->wait();
  }
  std::fprintf(stderr, "\n");
  host->signal(SIGTERM);
  (void)host->wait();
  return touches;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  const Subject subject{settings};
  char text[120];
  std::snprintf(text, sizeof text, "a 3 mm tip that knocks at the surface, %d HRTCs on each link", settings.tries);
  Report report{{subject.name, subject.summary.digest, subject.summary.faces, text}};
  report.figure("indexed mesh of floats", "12 B a vertex and a face", "kB", subject.mesh_bytes * 1e-3);
  for (const LinkCase& link : kLinks) {
    double whole_ms = 0;
    Touches touches;
    in_own_thread([&] {
      LiveSession session{link.link};
      whole_ms = download(session.pair(), static_cast<std::size_t>(subject.mesh_bytes));
      touches = touch(session, subject);
    });
    const std::string name = std::string{link.name} + ": ";
    report.row(name + "base mesh", "since the catalogue", "ms", touches.base_ms);
    report.row(name + "exact contact", "since the catalogue", "ms", touches.exact_ms);
    report.figure(name + "the whole mesh", "TCP, from connecting", "ms", whole_ms);
    report.at_most(name + "exact contact, p95", {"tries", touches.exact_ms.size()}, "ms",
                   touches.exact_ms.percentile(0.95), link.bound_ms);
    report.at_most(name + "bytes until then, p95", {"of the indexed mesh's", touches.bytes.size()}, "%",
                   100 * touches.bytes.percentile(0.95) / subject.mesh_bytes, 1);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"first-touch", "From the first catalogue entry to the first exact contact; needs root",
                         "3 HRTCs, for CI"};
  app.add_option("--model", settings.model, "any model file; default: a generated organ");
  app.add_option("--faces", settings.faces, "of the generated organ")->check(CLI::Range(10'000, 10'000'000));
  app.add_option("--tries", settings.tries, "HRTCs on each link")->check(CLI::Range(1, 1000));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.tries = 3;
    return tactus::bench::run(settings);
  });
}
