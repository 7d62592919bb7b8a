// Measures the resident memory of an HRTC that touches a model larger than its memory. tactus-host and tactus-hrtc run
// as a user starts them, and the kernel counts the resident pages.
//
// 1. An idle HRTC without a model and with a minimal pool is the baseline.
// 2. An HRTC with --memory replays a surface path. `tactus mesh audit` compares its contact log with the model.
// 3. An HRTC with a pool for the base mesh and a tenth of the certificate does the same. Its contacts must be correct,
//    and at least a tenth of its queries marked as not exact.
// 4. Loader and cycle run in this process, with both pools. Allocations are counted, and distances are compared with a
//    static tree.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hrtc_model.hpp"
#include "bench/models.hpp"
#include "bench/process_status.hpp"
#include "bench/session_run.hpp"
#include "bench/surface_path.hpp"
#include "hrtc_service/servo/flight_saver.hpp"
#include "spm/directory.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/offline/certificate.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "trace/contact_log.hpp"

namespace tactus::bench {
namespace {

using e2e::Process;
using spm::Vec3d;

constexpr double kPeriod = 0.001;  // s
constexpr double kMiB = 1 << 20;
constexpr double kApproachTime = 6;  // s before the first touch, in which host and HRTC connect
constexpr std::uint64_t kIdlePoolBytes = 3u << 20;
constexpr double kTolerance = 1e-6;  // m, of distances
/// Below this memory, the bytes of a decoded face have no bound. In a small pool, the parts that do not depend on the
/// number of slots take most of these bytes.
constexpr std::uint64_t kMinMemoryOfFaceBound = 64u << 20;

struct Settings {
  std::string model;
  std::uint32_t faces = 28'000'000;
  double edge = 0;                   // m, mean edge to which the model is scaled; 0: no scaling
  std::uint64_t memory = 64u << 20;  // bytes
  double seconds = 30;
  double radius = 0.003;  // m, of the tip
  double speed = 0.05;    // m/s, of the tip
  double depth = 0.0002;  // m, overlap of tip and surface
  std::uint64_t seed = 1;
  int domain = 60;
  bool quick = false;
};

/// Positions of the tip's centre, and their distances from the finest mesh.
struct Path {
  std::vector<Vec3d> tips;        // m
  std::vector<double> distances;  // m, from the finest mesh
  Vec3d away = Vec3d::Zero();     // m, far from the model
};

/// Returns the resident part of a mapping whose name contains `name`, bytes.
double mapped_bytes(int pid, const std::string& name) {
  std::ifstream mappings{"/proc/" + std::to_string(pid) + "/smaps"};
  double bytes = 0;
  bool is_wanted = false;
  for (std::string line; std::getline(mappings, line);) {
    if (line.find('-') < line.find(' ')) is_wanted = line.find(name) != std::string::npos;  // the head of a mapping
    if (is_wanted && line.rfind("Rss:", 0) == 0) bytes += std::stod(line.substr(4)) * 1024;
  }
  return bytes;
}

/// Returns the peak resident memory of both processes of an HRTC, bytes. The block that they share counts once.
double peak_resident(const Process& hrtc) {
  double bytes = 0;
  for (const pid_t pid : hrtc.pids()) {
    bytes += status_bytes(pid, "VmHWM");
    if (pid != hrtc.pid()) bytes -= mapped_bytes(pid, "memfd:tactus-hrtc");
  }
  return bytes;
}

struct ProgramRun {
  double peak_resident = 0;                      // bytes
  std::uint64_t queries = 0, exact_queries = 0;  // in the contact log
  int exit_status = -1, audit_status = -1;
  std::string output;
  [[nodiscard]] double percent_exact() const {
    return queries == 0 ? 0 : 100.0 * static_cast<double>(exact_queries) / static_cast<double>(queries);
  }
};

/// Writes the path as a recording. It begins away from the model.
void write_recording(const std::filesystem::path& file, const Path& path) {
  std::ofstream out{file};
  out.precision(9);
  const auto line = [&](double time, const Vec3d& at) {
    out << time << ',' << at[0] << ',' << at[1] << ',' << at[2] << '\n';
  };
  line(0, path.away);
  line(kApproachTime - 1, path.away);
  for (std::size_t i = 0; i < path.tips.size(); ++i)
    line(kApproachTime + static_cast<double>(i) * kPeriod, path.tips[i]);
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

class Programs {
 public:
  Programs(const Settings& settings, std::filesystem::path model, const Path& path, double scale)
      : settings_{settings}, model_{std::move(model)} {
    write_recording(poses(), path);
    std::ofstream config{folder_.path() / "host.yaml"};
    config.precision(17);
    config << "objects:\n  - name: object\n    model: " << std::filesystem::absolute(model_).string()
           << "\n    position: [0, 0, 0]\n    scale: " << scale << '\n';
    if (!config.flush()) throw std::runtime_error("cannot write " + (folder_.path() / "host.yaml").string());
    programs_ = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  }

  /// Returns the peak resident memory of an HRTC without a model, minus its pool, bytes.
  double measure_idle() {
    Process hrtc{hrtc_command("idle", {"--memory", std::to_string(kIdlePoolBytes)})};
    (void)hrtc.wait(whole_path());
    const double resident = peak_resident(hrtc) - static_cast<double>(kIdlePoolBytes);
    hrtc.signal(SIGTERM);
    (void)hrtc.wait();
    if (resident <= 0) throw std::runtime_error("the idle HRTC ended early:\n" + hrtc.output());
    return resident;
  }

  /// Runs host and HRTC along the path, then the audit. `memory`: option of the HRTC that sets its pool.
  ProgramRun run(const std::string& name, const std::vector<std::string>& memory) {
    Process host{{(programs_ / "tactus-host").string(), "--session", name, "--domain", std::to_string(settings_.domain),
                  "--config", (folder_.path() / "host.yaml").string()}};
    if (!host.wait_for_line("serving 'object'", std::chrono::seconds{300}))
      throw std::runtime_error("the host does not serve the object:\n" + host.output());
    Process hrtc{hrtc_command(name, memory)};
    (void)hrtc.wait(whole_path());
    ProgramRun run;
    run.peak_resident = peak_resident(hrtc);
    hrtc.signal(SIGTERM);
    run.exit_status = hrtc.wait().value_or(-1);
    host.signal(SIGTERM);
    (void)host.wait();
    run.output = hrtc.output();
    read_log(log(name), run);
    Process audit{{(programs_ / "tactus-mesh").string(), "audit", log(name).string(), model_.string()}};
    run.audit_status = audit.wait(std::chrono::seconds{1800}).value_or(-1);
    run.output += audit.output();
    return run;
  }

 private:
  [[nodiscard]] std::filesystem::path poses() const { return folder_.path() / "poses.csv"; }
  [[nodiscard]] std::filesystem::path log(const std::string& name) const { return folder_.path() / (name + ".hlog"); }
  [[nodiscard]] std::chrono::seconds whole_path() const {
    return std::chrono::seconds{static_cast<int>(kApproachTime + settings_.seconds)};
  }
  [[nodiscard]] std::vector<std::string> hrtc_command(const std::string& name,
                                                      const std::vector<std::string>& memory) const {
    std::vector<std::string> command{(programs_ / "tactus-hrtc").string(),
                                     "--session",
                                     name,
                                     "--domain",
                                     std::to_string(settings_.domain),
                                     "--tip-radius",
                                     std::to_string(settings_.radius * 1e3),
                                     "--replay",
                                     "tip=" + poses().string(),
                                     "--log",
                                     log(name).string()};
    command.insert(command.end(), memory.begin(), memory.end());
    return command;
  }

  /// Counts the queries of a contact log.
  static void read_log(const std::filesystem::path& log, ProgramRun& run) {
    trace::ContactLogReader reader{log};
    constexpr std::int64_t kSettlingNs = 1'000'000'000;  // the approach is faster than a hand
    std::int64_t first_ns = 0;
    for (trace::ContactLogReader::Entry entry; (entry = reader.next()) != trace::ContactLogReader::Entry::kEnd;) {
      if (entry != trace::ContactLogReader::Entry::kQuery) continue;
      if (first_ns == 0) first_ns = reader.query.time_ns;
      if (reader.query.time_ns - first_ns < kSettlingNs) continue;
      ++run.queries;
      run.exact_queries += reader.query.exact ? 1 : 0;
    }
  }

  Settings settings_;
  std::filesystem::path model_, programs_;
  test_support::TemporaryFolder folder_;
};

/// Returns the distance from the tip's centre to the active mesh, file units. In an exact query, only finest faces
/// count.
double active_mesh_distance(const spm::Forest& forest, const Vec3d& centre, double radius) {
  if (!forest.is_exact(centre, radius)) {
    spm::NearestFace found;
    return forest.tree().nearest(centre, 1e12, found) ? std::sqrt(found.squared_distance) : 1e300;
  }
  std::array<spm::Contact, 2048> contacts;
  const std::uint32_t count =
      std::min<std::uint32_t>(forest.tree().find_contacts(centre, radius, contacts.data(), 2048), 2048);
  double depth = -1e300;
  for (std::uint32_t i = 0; i < count; ++i)
    if (contacts[i].is_finest()) depth = std::max(depth, contacts[i].depth(centre, radius));
  return radius - depth;
}

struct InProcess {
  std::uint64_t allocations = 0, contact_cycles = 0, exact_cycles = 0;
  std::uint64_t wrong_cycles = 0;  // contact cycles whose distance differs from that of the finest mesh by more than
                                   // the error bound
};
/// Runs loader and cycle in this process along the path.
InProcess run_in_process(const spm::Model& model, const Settings& settings, const spm::PoolSettings& pool,
                         const Path& path) {
  SessionSettings session;
  session.pool = pool;
  session.cycle.radius = session.loader.radius = settings.radius;
  const double scale = model.summary.metres_per_unit;
  SessionRun run{model, scale, session};
  run.settle(path.away);
  InProcess outcome;
  for (std::size_t i = 0; i + 1 < path.tips.size(); ++i) {
    run.prepare(path.tips[i], (path.tips[i + 1] - path.tips[i]) / kPeriod);
    std::uint32_t status = 0;
    double error_bound = 0;
    {
      const test_support::AllocationCounter guard;
      const hrtc_service::CycleResult& result = run.cycle(spm::Budget{4000});
      outcome.allocations += guard.count();
      status = result.probes[0].status;
      error_bound = static_cast<double>(result.probes[0].error_bound);
    }
    if (path.distances[i] > settings.radius) continue;
    ++outcome.contact_cycles;
    const bool is_exact = (status & session::kExact) != 0;
    outcome.exact_cycles += is_exact ? 1 : 0;
    const spm::Forest& forest = *run.haptic().objects().front()->forest;
    const double distance = active_mesh_distance(forest, path.tips[i] / scale, settings.radius / scale) * scale;
    if (std::abs(distance - path.distances[i]) > (is_exact ? 0 : error_bound) + kTolerance) ++outcome.wrong_cycles;
  }
  return outcome;
}

Path make_path(const LoadedModel& subject, const Settings& settings) {
  const spm::ModelSummary& summary = subject.model.summary;
  const double unit = summary.metres_per_unit;
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  const PathSettings path_settings{settings.radius / unit, settings.depth / unit, settings.speed * kPeriod / unit,
                                   static_cast<std::uint32_t>(settings.seconds / kPeriod), settings.seed};
  Path path;
  for (const Vec3d& centre : surface_path(subject.model.positions, subject.finest, path_settings,
                                          [&](const Vec3d& p) { return finest.distance(p); })) {
    path.tips.push_back(centre * unit);
    path.distances.push_back(finest.distance(centre) * unit);
  }
  path.away = Eigen::Map<const spm::Vec3f>(summary.bounds_max.data()).cast<double>() * unit +
              Vec3d::Constant(3 * model_length(summary));
  return path;
}

double bytes_of_face(const spm::PoolSettings& pool) { return static_cast<double>(pool.bytes()) / (2.0 * pool.slots); }

double bytes_of_decoded_face(spm::PoolSettings pool) {
  pool.compressed_blocks = 0;
  return bytes_of_face(pool);
}

/// Returns the slots of a pool for the base mesh and a tenth of the slots and tree nodes that a probe needs at most.
std::uint32_t slots_of_small_pool(const spm::Model& model, const spm::offline::Certificate& certificate) {
  const std::uint32_t base_nodes = spm::tree_nodes_above(model.base_faces, model.summary.faces);
  std::uint32_t slots = std::max(slots_for(model.summary, 0) + certificate.parts / 10, 256u);
  while (spm::PoolSettings::for_slots(slots).tree_nodes < base_nodes + certificate.nodes / 10) slots += 16;
  return slots;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  const test_support::TemporaryFolder folder;
  LoadedModel subject = load_model(settings.model, settings.faces);
  std::filesystem::path file = settings.model;
  if (file.extension() != ".spm") {
    file = folder.path() / "model.spm";
    spm::offline::write_model(file, subject.model, {});
  }
  if (settings.edge > 0) scale_to_edge(subject, settings.edge);
  const spm::ModelSummary& summary = subject.model.summary;
  const double unit = summary.metres_per_unit;
  std::fprintf(stderr, "making the path\n");
  const Path path = make_path(subject, settings);
  subject.finest = {};
  std::fprintf(stderr, "certifying\n");
  const spm::offline::Certificate certificate =
      spm::offline::certify(subject.model, settings.radius / unit, settings.speed / unit);
  const std::uint32_t small_slots = slots_of_small_pool(subject.model, certificate);

  Programs programs{settings, file, path, unit};
  std::fprintf(stderr, "running an idle HRTC\n");
  const double idle = programs.measure_idle();
  std::fprintf(stderr, "touching with --memory\n");
  const ProgramRun whole = programs.run("whole", {"--memory", std::to_string(settings.memory)});
  std::fprintf(stderr, "touching with a small pool\n");
  const ProgramRun small = programs.run("small", {"--pool", std::to_string(small_slots)});
  for (const ProgramRun* run : {&whole, &small})
    if (run->exit_status != 0 || run->audit_status != 0 || run->queries == 0)
      std::fprintf(stderr, "%s", run->output.c_str());
  std::fprintf(stderr, "touching in this process\n");
  hrtc_service::FlightOptions flight;
  const std::uint64_t recorder = hrtc_service::limit_flight(flight, settings.memory, kPeriod, hrtc_service::kMaxProbes);
  const spm::MemoryShares shares = spm::memory_shares(settings.memory - recorder);
  const InProcess whole_here = run_in_process(subject.model, settings, shares.pool, path);
  const InProcess small_here = run_in_process(subject.model, settings, spm::PoolSettings::for_slots(small_slots), path);

  char text[256];
  std::snprintf(text, sizeof text,
                "radius %g mm, %g cm/s for %g s, %.3g m long, %u regions, memory %.4g MiB, seed %llu",
                settings.radius * 1e3, settings.speed * 1e2, settings.seconds, model_length(summary), summary.regions,
                static_cast<double>(settings.memory) / kMiB, static_cast<unsigned long long>(settings.seed));
  const Population with_memory{"HRTC with --memory", 1}, with_small{"HRTC with a small pool", 1};
  const Population certificate_of_any_probe{"certificate for any probe", 1};
  Report report{{subject.name, summary.digest, summary.faces, text}};
  report.add_note("The small pool has the base mesh and a tenth of the slots that the certificate states.");
  const std::optional<std::uint64_t> memory_needed = spm::offline::memory_needed(summary, certificate);
  if (memory_needed)
    report.add_value("certificate: memory, min", certificate_of_any_probe, "MiB",
                     static_cast<double>(*memory_needed) / kMiB);
  else
    report.add_note("No pool has enough slots for the certificate.");
  report.add_value("certificate: slots without the base mesh", certificate_of_any_probe, "", certificate.parts);
  report.add_value("certificate: tree nodes", certificate_of_any_probe, "", certificate.nodes);
  report.add_value("tree nodes of the pool", with_memory, "", shares.pool.tree_nodes);
  report.add_value("slots of the pool", with_memory, "", shares.pool.slots);
  report.add_value("slots of the pool", with_small, "", small_slots);
  const double decoded_face = bytes_of_decoded_face(shares.pool);
  if (settings.memory >= kMinMemoryOfFaceBound)
    report.add_at_most("pool without compressed cache, by decoded face", with_memory, "bytes", decoded_face, 120);
  else
    report.add_value("pool without compressed cache, by decoded face", with_memory, "bytes", decoded_face);
  report.add_value("compressed cache, by decoded face", with_memory, "bytes",
                   bytes_of_face(shares.pool) - decoded_face);
  report.add_value("flight recorder, max", with_memory, "MiB", static_cast<double>(recorder) / kMiB);
  report.add_value("directory of the model", with_memory, "MiB",
                   static_cast<double>(spm::directory_bytes(summary, shares.pool)) / kMiB);
  report.add_value("resident memory without pool, max", {"idle HRTC", 1}, "MiB", idle / kMiB);
  report.add_value("resident memory, max", with_memory, "MiB", whole.peak_resident / kMiB);
  report.add_value("resident memory, max", with_small, "MiB", small.peak_resident / kMiB);
  report.add_at_most("resident memory minus idle HRTC and --memory", with_memory, "MiB",
                     (whole.peak_resident - idle - static_cast<double>(settings.memory)) / kMiB, 8);
  const Population queries{"queries, --memory", whole.queries}, small_queries{"queries, small pool", small.queries};
  report.add_at_least("number in labelled cells", queries, "", static_cast<double>(whole.queries),
                      settings.seconds / kPeriod / 2);
  report.add_at_least("exact", queries, "%", whole.percent_exact(), 90);
  report.add_at_least("number in labelled cells", small_queries, "", static_cast<double>(small.queries),
                      settings.seconds / kPeriod / 2);
  report.add_at_most("marked as exact", small_queries, "%", small.percent_exact(), 90);
  for (const auto& [run, hrtc] : {std::pair{&whole, with_memory}, std::pair{&small, with_small}}) {
    report.add_at_most("exit status of the HRTC", hrtc, "", run->exit_status, 0);
    report.add_at_most("exit status of the audit", hrtc, "", run->audit_status, 0);
  }
  report.set_virtual_time(true);
  for (const auto& [run, name] : {std::pair{&whole_here, "--memory"}, std::pair{&small_here, "small pool"}}) {
    const Population population{std::string{"contact cycles, "} + name, run->contact_cycles};
    report.add_value("exact, in this process", population, "%",
                     100.0 * static_cast<double>(run->exact_cycles) / static_cast<double>(run->contact_cycles));
    report.add_at_least("number, in this process", population, "", static_cast<double>(run->contact_cycles),
                        settings.seconds / kPeriod / 2);
    report.add_at_most("distance error above the error bound", population, "cycles",
                       static_cast<double>(run->wrong_cycles), 0);
    report.add_at_most("allocations in all cycles", population, "", static_cast<double>(run->allocations), 0);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "memory", "Resident memory of an HRTC that touches a model larger than its memory, compared with an idle HRTC",
      "300,000 faces and 6 s, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  CLI::Option* faces =
      app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  CLI::Option* edge = app.add_option("--edge", settings.edge,
                                     "mean edge to which the model is scaled, m (default for the organ: 0.0002)")
                          ->check(tactus::wire::finite_positive());
  app.add_option("--memory", settings.memory, "memory of the HRTC, such as 16MiB or 64MiB")
      ->transform(CLI::AsSizeValue(false));
  app.add_option("--seconds", settings.seconds, "duration of the path, s")
      ->check(tactus::wire::finite_range(3.0, 3600.0));
  app.add_option("--speed", settings.speed, "speed of the tip, m/s")->check(tactus::wire::finite_range(0.001, 2.0));
  app.add_option("--domain", settings.domain, "first of the three DDS domains used")->check(CLI::Range(1, 95));
  app.add_option("--seed", settings.seed, "seed of the path");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.seconds = std::min(settings.seconds, 6.0);
      if (faces->count() == 0) settings.faces = 300'000;
    }
    if (settings.model.empty() && edge->count() == 0) settings.edge = tactus::bench::kHandEdge;
    return tactus::bench::run(settings);
  });
}
