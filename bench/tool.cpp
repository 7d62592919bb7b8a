// Moves a stylus of 720 triangles with six degrees of freedom over a scan. The stylus slides, rotates, taps and
// presses.
//
// Checks the poses of the tool with queries that the tool does not use. At each pose and midway between poses, the
// check searches for intersecting triangles of stylus and full mesh. If there are any, it measures the depth of the
// stylus' surface below the mesh. At a sample of poses, FCL searches for intersecting triangles, too.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hrtc_model.hpp"
#include "bench/models.hpp"
#include "bench/session_run.hpp"
#include "bench/stopwatch.hpp"
#include "bench/tool_path.hpp"
#include "haptics/rigid_body.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/finest_tree.hpp"
#include "spm/offline/generate.hpp"
#include "study/full_mesh.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kPeriod = 0.001;  // s

struct Settings {
  std::string model;
  std::uint32_t faces = 300'000;
  double seconds = 60;
  double speed = 0.3;   // m/s
  double depth = 0.03;  // m
  double friction = 0.3;
  haptics::ToolGrip grip;
  double deadline_us = 400;  // of the HRTC's cycle
  double pool_share = 0.5;
  std::uint32_t delay_cycles = 2;  // of demands, and of records
  std::uint64_t seed = 1;
  bool with_refined = false;  // also measures a refined mesh
  bool quick = false;
};

/// Measures how deep the tool is in the finest mesh, with queries that the tool does not use.
class DepthChecker {
 public:
  DepthChecker(const LoadedModel& subject, const spm::offline::TriangleMesh& stylus, const spm::MeshProbe& probe)
      : unit_{subject.model.summary.metres_per_unit},
        finest_{subject.model.positions, subject.finest},
        full_{subject.model.positions, subject.finest, hrtc_service::Placement{{}, unit_}, 0.001},
        fcl_{subject.model.positions, subject.finest},
        stylus_{stylus},
        fcl_stylus_{stylus.positions, stylus.faces},
        placed_{probe},
        contacts_(1u << 16) {
    // The samples are the corners, and points between them at distances of at most kSpacing.
    constexpr double kSpacing = 0.00025;  // m
    for (const auto& face : stylus.faces) {
      const auto corner = [&](std::size_t i) {
        const auto& p = stylus.positions[face[i]];
        return Vec3d{p[0], p[1], p[2]};
      };
      const Vec3d a = corner(0), ab = corner(1) - a, ac = corner(2) - a;
      const int n = 1 + static_cast<int>(std::max({ab.norm(), ac.norm(), (ab - ac).norm()}) / kSpacing);
      for (int i = 0; i <= n; ++i)
        for (int j = 0; i + j <= n; ++j) samples_.push_back(a + ab * (double(i) / n) + ac * (double(j) / n));
    }
  }

  /// Returns the max depth of the tool below the mesh, m. Returns 0 if no triangles intersect.
  double depth(const haptics::ToolPose& pose) {
    placed_.set_pose(in_model(pose), 1 / unit_);
    const spm::MeshQueryResult touch = placed_.find_contacts(finest_.tree(), contacts_.data(), 1u << 16);
    if (touch.contacts == 0) return 0;
    double max_depth = 0;
    for (std::uint32_t i = 0; i < std::min(touch.contacts, 1u << 16); ++i)
      max_depth = std::max(max_depth, contacts_[i].depth * unit_);
    for (const Vec3d& sample : samples_) {
      haptics::SurfaceHit hit;
      const Vec3d at = pose.position + pose.orientation * sample;
      if (full_.closest(at, 0.003, hit) && hit.is_side_known) max_depth = std::max(max_depth, -hit.distance);
    }
    return max_depth;
  }
  /// Returns the number of intersecting pairs of triangles, by FCL.
  std::size_t fcl_pairs(const haptics::ToolPose& pose) {
    const Eigen::Isometry3d at = in_model(pose);
    std::vector<std::array<float, 3>> moved;
    for (const auto& p : stylus_.positions) {
      const Vec3d x = at * (Vec3d{p[0], p[1], p[2]} / unit_);
      moved.push_back({static_cast<float>(x[0]), static_cast<float>(x[1]), static_cast<float>(x[2])});
    }
    fcl_stylus_.move(moved);
    fcl_stylus_.refit();
    fcl_.intersecting(fcl_stylus_, pairs_);
    return pairs_.size();
  }
  [[nodiscard]] const spm::AbTree& tree() const { return finest_.tree(); }

 private:
  [[nodiscard]] Eigen::Isometry3d in_model(const haptics::ToolPose& pose) const {
    Eigen::Isometry3d at = Eigen::Isometry3d::Identity();
    at.linear() = pose.orientation.toRotationMatrix();
    at.translation() = pose.position / unit_;
    return at;
  }

  double unit_;
  spm::FinestTree finest_;
  study::FullMesh full_;
  spm::fcl::FixedMesh fcl_;
  spm::offline::TriangleMesh stylus_;
  spm::fcl::FixedMesh fcl_stylus_;
  spm::PlacedProbe placed_;
  std::vector<spm::MeshContact> contacts_;
  std::vector<Vec3d> samples_;
  std::vector<std::array<std::uint32_t, 2>> pairs_;
};

/// Returns the pose midway between `a` and `b`.
haptics::ToolPose midway(const haptics::ToolPose& a, const haptics::ToolPose& b) {
  return {(a.position + b.position) / 2, a.orientation.slerp(0.5, b.orientation)};
}

/// Results of one path on one mesh.
struct Outcome {
  Samples cpu_us, wall_us, refinement_us, gateway_us;
  Samples changes, work, contacts;        // of each cycle
  Samples force_step_n, torque_step_mnm;  // change from cycle to cycle while the device rests, N and mN m
  double max_depth = 0;                   // m
  double energy = 0, min_energy = 0;      // that the port of the hand received, J
  std::uint64_t cycles = 0, contact_cycles = 0, exact_cycles = 0, lagging_cycles = 0, budget_cycles = 0;
  std::uint64_t dropped_contacts = 0;
  std::uint64_t fcl_cycles = 0, fcl_intersecting_cycles = 0;
};

/// Mesh on which the tool moves. With kWholeAsIfChanged, the tool takes the mesh as changed in each cycle, so that it
/// reuses nothing from the cycle before.
enum class Mesh { kWhole, kWholeAsIfChanged, kRefined };

/// An HRTC and its host. The HRTC refines the mesh along the tool.
class RefinedTool {
 public:
  RefinedTool(const Settings& settings, const LoadedModel& subject, const spm::MeshProbe& probe,
              const haptics::ToolPose& from)
      : run_{subject.model, subject.model.summary.metres_per_unit, settings_of(settings, subject, probe)},
        governor_{std::llround(settings.deadline_us * 1e3)} {
    run_.settle(from.position);
    // The first regions arrive while the tool rests at `from`.
    for (int i = 0; i < 400; ++i) step(from, from);
  }
  /// Runs a cycle. Times the haptic thread's part.
  void step(const haptics::ToolPose& before, const haptics::ToolPose& device) {
    run_.prepare(device.position, (device.position - before.position) / kPeriod, device.orientation);
    const double began = thread_cpu_us();
    Stopwatch watch;
    result_ = &run_.cycle(governor_.limit());
    wall_us_ = watch.lap();
    cpu_us_ = thread_cpu_us() - began;
    const hrtc_service::CycleCosts& costs = result_->costs;
    if (costs.predicted_total > 0)
      governor_.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange, costs.refit,
                        costs.total(), costs.predicted_total);
  }
  [[nodiscard]] const hrtc_service::CycleResult& result() const { return *result_; }
  [[nodiscard]] const haptics::ToolResult& tool() { return run_.haptic().tool(0)->last(); }
  [[nodiscard]] double cpu_us() const { return cpu_us_; }
  [[nodiscard]] double wall_us() const { return wall_us_; }
  [[nodiscard]] double gateway_us() const { return run_.gateway_us(); }

 private:
  static SessionSettings settings_of(const Settings& settings, const LoadedModel& subject,
                                     const spm::MeshProbe& probe) {
    SessionSettings session;
    session.pool = spm::PoolSettings::for_slots(slots_for(subject.model.summary, settings.pool_share, 8192));
    session.cycle.tool = session.loader.tool = &probe;
    session.material = {settings.grip.stiffness, 1, settings.friction, settings.friction};
    session.device.max_torque = session.cycle.force.max_torque;
    session.delay_cycles = settings.delay_cycles;
    return session;
  }

  SessionRun run_;
  hrtc_service::Governor governor_;
  const hrtc_service::CycleResult* result_ = nullptr;
  double cpu_us_ = 0, wall_us_ = 0;
};

/// Moves the tool along `path` on the mesh of kind `mesh`, then checks its poses.
Outcome move_tool(const Settings& settings, const LoadedModel& subject, const std::vector<ToolPathPose>& path,
                  const spm::MeshProbe& probe, Mesh mesh, DepthChecker& checker) {
  constexpr std::size_t kFclEvery = 20;  // cycles
  Outcome outcome;
  haptics::Tool tool{probe};
  tool.set_grip(settings.grip);
  haptics::ToolObject object;
  object.tree = &checker.tree();
  object.scale = subject.model.summary.metres_per_unit;
  object.friction = settings.friction;
  haptics::ToolPose device_before = path.front().device;
  std::optional<RefinedTool> refined;
  if (mesh == Mesh::kRefined) refined.emplace(settings, subject, probe, device_before);
  Vec3d force = Vec3d::Zero(), torque = Vec3d::Zero();
  std::vector<haptics::ToolPose> poses;
  poses.reserve(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    const haptics::ToolPose& device = path[i].device;
    if (refined) {
      refined->step(device_before, device);
      const hrtc_service::CycleResult& result = refined->result();
      outcome.refinement_us.add((result.costs.refine + result.costs.refit) * 1e-3);
      outcome.changes.add(result.costs.changes);
      outcome.gateway_us.add(refined->gateway_us());
      outcome.wall_us.add(refined->wall_us());
      outcome.cpu_us.add(refined->cpu_us());
      const std::uint32_t status = result.probes[0].status;
      if ((status & session::kInContact) != 0) outcome.exact_cycles += (status & session::kExact) != 0 ? 1 : 0;
      outcome.budget_cycles += result.budget_spent ? 1 : 0;
    } else {
      const double began = thread_cpu_us();
      Stopwatch watch;
      tool.step(device, kPeriod, {&object, 1}, mesh != Mesh::kWhole || i == 0);
      outcome.wall_us.add(watch.lap());
      outcome.cpu_us.add(thread_cpu_us() - began);
    }
    const haptics::ToolResult& at = refined ? refined->tool() : tool.last();

    ++outcome.cycles;
    outcome.contact_cycles += at.in_contact ? 1 : 0;
    outcome.lagging_cycles += at.lagging ? 1 : 0;
    outcome.dropped_contacts += at.dropped;
    outcome.contacts.add(at.contacts);
    outcome.work.add(at.work);
    poses.push_back(at.pose);

    // Energy from the hand since the last pose. The wrench is constant during a cycle, so that this product is exact.
    outcome.energy -= force.dot(device.position - device_before.position) +
                      torque.dot(haptics::log_map(device.orientation * device_before.orientation.conjugate()));
    outcome.min_energy = std::min(outcome.min_energy, outcome.energy);
    const Vec3d force_before = force, torque_before = torque;
    force = settings.grip.stiffness * at.displacement;
    torque = settings.grip.rotational_stiffness * at.rotation;
    if (path[i].at_rest && at.in_contact) {
      outcome.force_step_n.add((force - force_before).norm());
      outcome.torque_step_mnm.add((torque - torque_before).norm() * 1e3);
    }
    device_before = device;
  }
  // The checks come last, since they would evict the data of the timed code from the CPU caches.
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double depth = std::max(checker.depth(poses[i]), i == 0 ? 0 : checker.depth(midway(poses[i - 1], poses[i])));
    outcome.max_depth = std::max(outcome.max_depth, depth);
    if (i % kFclEvery != 0) continue;
    ++outcome.fcl_cycles;
    outcome.fcl_intersecting_cycles += checker.fcl_pairs(poses[i]) > 0 ? 1 : 0;
  }
  return outcome;
}

void add_rows(Outcome& outcome, const std::string& mesh, Report& report) {
  report.add_percentiles("CPU time of a cycle", mesh, "us", outcome.cpu_us);
  report.add_percentiles("wall time of a cycle", mesh, "us", outcome.wall_us);
  if (outcome.refinement_us.size() > 0) {
    report.add_percentiles("time of refinement and refit in a cycle", mesh, "us", outcome.refinement_us);
    report.add_percentiles("records split and collapsed in a cycle", mesh, "", outcome.changes);
    report.add_percentiles("CPU time of the loader's tick", mesh, "us", outcome.gateway_us);
  }
  report.add_percentiles("work of the tool", mesh, "", outcome.work);
  report.add_percentiles("contacts with a force", mesh, "", outcome.contacts);
  report.add_percentiles("change of the force in a cycle while the device rests", mesh, "N", outcome.force_step_n);
  report.add_percentiles("change of the torque in a cycle while the device rests", mesh, "mN m",
                         outcome.torque_step_mnm);
  const Population cycles{mesh, outcome.cycles};
  const auto share = [&](std::uint64_t part) {
    return 100.0 * static_cast<double>(part) / static_cast<double>(outcome.cycles);
  };
  report.add_value("contact cycles divided by cycles", cycles, "%", share(outcome.contact_cycles));
  if (outcome.refinement_us.size() > 0) {
    report.add_value("cycles whose refinement ended at the deadline, divided by cycles", cycles, "%",
                     share(outcome.budget_cycles));
    report.add_at_least("exact contact cycles divided by contact cycles", {mesh, outcome.contact_cycles}, "%",
                        100.0 * static_cast<double>(outcome.exact_cycles) / static_cast<double>(outcome.contact_cycles),
                        99);
  }
  report.add_value("cycles in which the tool lags behind its target, divided by cycles", cycles, "%",
                   share(outcome.lagging_cycles));
  report.add_value("contacts dropped over the capacity", cycles, "", static_cast<double>(outcome.dropped_contacts));
  report.add_value("energy that the port of the hand received", cycles, "J", outcome.energy);
  report.add_value("cycles checked by FCL", cycles, "", static_cast<double>(outcome.fcl_cycles));
  report.add_at_most("max depth of the tool in the mesh", {mesh, outcome.cpu_us.size()}, "mm", outcome.max_depth * 1e3,
                     0.05);
  report.add_at_most("cycles in which FCL finds intersecting triangles", {mesh, outcome.fcl_cycles}, "",
                     static_cast<double>(outcome.fcl_intersecting_cycles), 0);
  report.add_at_most("CPU time of a cycle, p99.9", {mesh, outcome.cpu_us.size()}, "us",
                     outcome.cpu_us.percentile(0.999), 500);
  report.add_at_most("max change of the force in a cycle while the device rests", {mesh, outcome.force_step_n.size()},
                     "N", outcome.force_step_n.max(), 0.05);
  report.add_at_least("min energy that the port of the hand has received", {mesh, outcome.cpu_us.size()}, "J",
                      outcome.min_energy, -1e-6);
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "building the model\n");
  const LoadedModel subject = load_model(settings.model, settings.faces);
  const spm::ModelSummary& summary = subject.model.summary;
  std::fprintf(stderr, "computing the path\n");
  ToolPathSettings path_settings;
  path_settings.speed = settings.speed;
  path_settings.depth = settings.depth;
  path_settings.poses = static_cast<std::uint32_t>(settings.seconds / kPeriod);
  path_settings.seed = settings.seed;
  const std::vector<ToolPathPose> path = tool_path(subject, path_settings);
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  DepthChecker checker{subject, stylus, probe};

  double max_speed = 0, max_rotation = 0;  // m/s, rad/s
  for (std::size_t i = 1; i < path.size(); ++i) {
    const haptics::ToolPose &a = path[i - 1].device, &b = path[i].device;
    max_speed = std::max(max_speed, (b.position - a.position).norm() / kPeriod);
    max_rotation = std::max(max_rotation, haptics::log_map(b.orientation * a.orientation.conjugate()).norm() / kPeriod);
  }
  char text[320];
  std::snprintf(text, sizeof text,
                "stylus of %zu triangles, %g s, along the surface up to %g m/s, tip up to %.2f m/s, rotation up to "
                "%.1f rad/s, depth up to %g cm, friction %g, %g N/m, %g N m/rad, collision margin %g mm, seed %llu",
                stylus.faces.size(), settings.seconds, settings.speed, max_speed, max_rotation, settings.depth * 1e2,
                settings.friction, settings.grip.stiffness, settings.grip.rotational_stiffness,
                haptics::ToolSettings{}.collision_margin * 1e3, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  for (const auto& [mesh, name] : {std::pair{Mesh::kWhole, "cycles, whole mesh"},
                                   {Mesh::kWholeAsIfChanged, "cycles, whole mesh as if changed"},
                                   {Mesh::kRefined, "cycles, refined mesh"}}) {
    if (mesh == Mesh::kRefined && !settings.with_refined) continue;
    std::fprintf(stderr, "%s\n", name);
    Outcome outcome = move_tool(settings, subject, path, probe, mesh, checker);
    add_rows(outcome, name, report);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"tool", "Moves a stylus with six degrees of freedom over a scan and checks its depth",
                         "uses a path of 5 s, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--seconds", settings.seconds, "length of the path, s")
      ->check(tactus::wire::finite_range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "max speed along the surface, m/s")
      ->check(tactus::wire::finite_range(0.001, 1.0));
  app.add_option("--depth", settings.depth, "max depth of the device below the surface, m")
      ->check(tactus::wire::finite_range(0.0, 0.1));
  app.add_option("--friction", settings.friction, "friction coefficient")->check(tactus::wire::finite_range(0.0, 2.0));
  app.add_option("--deadline", settings.deadline_us, "deadline of the HRTC's cycle, us")
      ->check(tactus::wire::finite_range(10.0, 10000.0));
  app.add_option("--pool-share", settings.pool_share, "pool divided by the model's records")
      ->check(tactus::wire::finite_range(0.01, 1.0));
  app.add_option("--delay", settings.delay_cycles, "delay of demands, and of records, ms")->check(CLI::Range(0u, 500u));
  app.add_option("--seed", settings.seed, "seed of the path");
  app.add_flag("--refined", settings.with_refined, "also measures a mesh that an HRTC refines along the tool");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return tactus::bench::run(settings);
  });
}
