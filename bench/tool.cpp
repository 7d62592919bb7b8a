// A stylus of 720 triangles with six degrees of freedom, slid, turned, tapped and pressed over a scan.
//
// What judges is not what steers: exact pairs of triangles on the full mesh at every cycle and half-way between, FCL's
// in a sample, and, when any pair meets, how deep the tool's surface is below the mesh.
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
  double deadline_us = 400;  // by which the HRTC refines
  double pool_share = 0.5;
  std::uint32_t delay = 2;  // cycles that demands and records are under way, each
  std::uint64_t seed = 1;
  bool refined = false;
  bool quick = false;
};

/// How far the tool is in the mesh, by all that the tool's own code does not use.
class Judge {
 public:
  Judge(const LoadedModel& subject, const spm::offline::TriangleMesh& stylus, const spm::MeshProbe& probe)
      : unit_{subject.model.summary.metres_per_unit},
        finest_{subject.model.positions, subject.finest},
        full_{subject.model.positions, subject.finest, hrtc_service::Placement{{}, unit_}, 0.001},
        fcl_{subject.model.positions, subject.finest},
        stylus_{stylus},
        fcl_stylus_{stylus.positions, stylus.faces},
        placed_{probe},
        contacts_(1u << 16) {
    // Corners, and points between them no further apart than this.
    constexpr double kSpacing = 0.00025;
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

  /// m; 0 when no triangle of the tool meets one of the mesh.
  double depth(const haptics::ToolPose& pose) {
    placed_.place(in_model(pose), 1 / unit_);
    const spm::MeshTouch touch = placed_.touching(finest_.tree(), contacts_.data(), 1u << 16);
    if (touch.contacts == 0) return 0;
    double deepest = 0;
    for (std::uint32_t i = 0; i < std::min(touch.contacts, 1u << 16); ++i)
      deepest = std::max(deepest, contacts_[i].depth * unit_);
    for (const Vec3d& sample : samples_) {
      haptics::SurfaceHit hit;
      const Vec3d at = pose.position + pose.orientation * sample;
      if (full_.closest(at, 0.003, hit) && hit.sided) deepest = std::max(deepest, -hit.distance);
    }
    return deepest;
  }
  /// Pairs that meet, by FCL.
  std::size_t by_fcl(const haptics::ToolPose& pose) {
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

haptics::ToolPose between(const haptics::ToolPose& a, const haptics::ToolPose& b) {
  return {(a.position + b.position) / 2, a.orientation.slerp(0.5, b.orientation)};
}

struct Outcome {
  Samples cpu, wall, refining, changes, loader, work, contacts, force_step, torque_step;
  double deepest = 0, energy = 0, lowest = 0;
  std::uint64_t cycles = 0, touching = 0, lagging = 0, dropped = 0, meeting = 0, exact = 0, spent = 0;
  std::uint64_t by_fcl = 0, fcl_meeting = 0;
};

enum class On { kFullRate, kWholeAsIfChanging, kRefined };

/// An HRTC at a host that keeps the mesh fine along the tool, as a service has it.
class Refined {
 public:
  Refined(const Settings& settings, const LoadedModel& subject, const spm::MeshProbe& probe,
          const haptics::ToolPose& from)
      : run_{subject.model, subject.model.summary.metres_per_unit, settings_of(settings, subject, probe)},
        governor_{std::llround(settings.deadline_us * 1e3)} {
    run_.settle(from.position);
    // The first regions come while the tool is still away.
    for (int i = 0; i < 400; ++i) step(from, from);
  }
  /// The haptic thread's part; CPU time, us.
  void step(const haptics::ToolPose& before, const haptics::ToolPose& device) {
    run_.prepare(device.position, (device.position - before.position) / kPeriod, device.orientation);
    const double began = thread_cpu_us();
    Stopwatch watch;
    result_ = &run_.cycle(governor_.limit());
    wall_ = watch.lap();
    cpu_ = thread_cpu_us() - began;
    const hrtc_service::CycleCosts& costs = result_->costs;
    if (costs.foreseen > 0)
      governor_.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange, costs.refit,
                        costs.total(), costs.foreseen);
  }
  [[nodiscard]] const hrtc_service::CycleResult& result() const { return *result_; }
  [[nodiscard]] const haptics::ToolResult& tool() { return run_.haptic().tool(0)->last(); }
  [[nodiscard]] double cpu() const { return cpu_; }
  [[nodiscard]] double wall() const { return wall_; }
  [[nodiscard]] double loader() const { return run_.loader_us(); }

 private:
  static SessionSettings settings_of(const Settings& settings, const LoadedModel& subject,
                                     const spm::MeshProbe& probe) {
    SessionSettings session;
    session.pool = spm::PoolSettings::for_slots(slots_for(subject.model.summary, settings.pool_share, 8192));
    session.cycle.tool = session.loader.tool = &probe;
    session.material = {settings.grip.stiffness, 1, settings.friction, settings.friction};
    session.device.max_torque = session.cycle.force.max_torque;
    session.delay_cycles = settings.delay;
    return session;
  }

  SessionRun run_;
  hrtc_service::Governor governor_;
  const hrtc_service::CycleResult* result_ = nullptr;
  double cpu_ = 0, wall_ = 0;
};

/// On a mesh that stays, on one of which nothing is known from the last cycle, or on one that an HRTC refines.
Outcome slide(const Settings& settings, const LoadedModel& subject, const std::vector<ToolPathPose>& path,
              const spm::MeshProbe& probe, On on, Judge& judge) {
  constexpr std::size_t kByFcl = 20;  // every so many cycles
  Outcome outcome;
  haptics::Tool tool{probe};
  tool.set_grip(settings.grip);
  haptics::ToolObject object;
  object.tree = &judge.tree();
  object.scale = subject.model.summary.metres_per_unit;
  object.friction = settings.friction;
  haptics::ToolPose device_before = path.front().device;
  std::optional<Refined> refined;
  if (on == On::kRefined) refined.emplace(settings, subject, probe, device_before);
  Vec3d force = Vec3d::Zero(), torque = Vec3d::Zero();
  std::vector<haptics::ToolPose> poses;
  poses.reserve(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    const haptics::ToolPose& device = path[i].device;
    if (refined) {
      refined->step(device_before, device);
      const hrtc_service::CycleResult& result = refined->result();
      outcome.refining.add((result.costs.refine + result.costs.refit) * 1e-3);
      outcome.changes.add(result.costs.changes);
      outcome.loader.add(refined->loader());
      outcome.wall.add(refined->wall());
      outcome.cpu.add(refined->cpu());
      const std::uint32_t status = result.probes[0].status;
      if ((status & session::kInContact) != 0) outcome.exact += (status & session::kExact) != 0 ? 1 : 0;
      outcome.spent += result.budget_spent ? 1 : 0;
    } else {
      const double began = thread_cpu_us();
      Stopwatch watch;
      tool.step(device, kPeriod, {&object, 1}, on != On::kFullRate || i == 0);
      outcome.wall.add(watch.lap());
      outcome.cpu.add(thread_cpu_us() - began);
    }
    const haptics::ToolResult& at = refined ? refined->tool() : tool.last();

    ++outcome.cycles;
    outcome.touching += at.in_contact ? 1 : 0;
    outcome.lagging += at.lagging ? 1 : 0;
    outcome.dropped += at.dropped;
    outcome.contacts.add(at.contacts);
    outcome.work.add(at.work);
    poses.push_back(at.pose);

    // What the port took from the hand since the last pose: exact, as a wrench is held for a cycle.
    outcome.energy -= force.dot(device.position - device_before.position) +
                      torque.dot(haptics::log_map(device.orientation * device_before.orientation.conjugate()));
    outcome.lowest = std::min(outcome.lowest, outcome.energy);
    const Vec3d force_before = force, torque_before = torque;
    force = settings.grip.stiffness * at.displacement;
    torque = settings.grip.rotational_stiffness * at.rotation;
    if (path[i].at_rest && at.in_contact) {
      outcome.force_step.add((force - force_before).norm());
      outcome.torque_step.add((torque - torque_before).norm() * 1e3);
    }
    device_before = device;
  }
  // Apart from what is timed, which would find its memory gone from the caches.
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double depth = std::max(judge.depth(poses[i]), i == 0 ? 0 : judge.depth(between(poses[i - 1], poses[i])));
    outcome.deepest = std::max(outcome.deepest, depth);
    outcome.meeting += depth > 0 ? 1 : 0;
    if (i % kByFcl != 0) continue;
    ++outcome.by_fcl;
    outcome.fcl_meeting += judge.by_fcl(poses[i]) > 0 ? 1 : 0;
  }
  return outcome;
}

void note(Outcome& outcome, const std::string& on, Report& report) {
  report.row("cycle, CPU time", on, "us", outcome.cpu);
  report.row("cycle, wall time", on, "us", outcome.wall);
  if (outcome.refining.size() > 0) {
    report.row("  of that, refinement and refit", on, "us", outcome.refining);
    report.row("records split and collapsed in a cycle", on, "", outcome.changes);
    report.row("loader's tick, CPU time", on, "us", outcome.loader);
  }
  report.row("work of the tool", on, "", outcome.work);
  report.row("contacts that press", on, "", outcome.contacts);
  report.row("force's step in 1 ms at rest", on, "N", outcome.force_step);
  report.row("torque's step in 1 ms at rest", on, "mN m", outcome.torque_step);
  const auto share = [&](std::uint64_t part) {
    return 100.0 * static_cast<double>(part) / static_cast<double>(outcome.cycles);
  };
  report.figure("cycles in contact", on, "%", share(outcome.touching));
  if (outcome.refining.size() > 0) {
    report.figure("cycles whose time to refine was over first", on, "%", share(outcome.spent));
    report.at_least("cycles in contact with the finest mesh all along the tool", {on, outcome.touching}, "%",
                    100.0 * static_cast<double>(outcome.exact) / static_cast<double>(outcome.touching), 99);
  }
  report.figure("cycles in which the tool did not get where it was pulled", on, "%", share(outcome.lagging));
  report.figure("contacts without room", on, "", static_cast<double>(outcome.dropped));
  report.figure("energy that the port took", on, "J", outcome.energy);
  report.figure("cycles looked at by FCL", on, "", static_cast<double>(outcome.by_fcl));
  report.at_most("interpenetration", {on, outcome.cpu.size()}, "mm", outcome.deepest * 1e3, 0.05);
  report.at_most("cycles in which FCL finds triangles that meet", on, "", static_cast<double>(outcome.fcl_meeting), 0);
  report.at_most("cycle, p99.9, CPU time", {on, outcome.cpu.size()}, "us", outcome.cpu.percentile(0.999), 500);
  report.at_most("force's step in 1 ms at rest", {on, outcome.force_step.size()}, "N", outcome.force_step.max(), 0.05);
  report.at_least("energy of the port, lowest", {on, outcome.cpu.size()}, "J", outcome.lowest, -1e-6);
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  const LoadedModel subject = load_model(settings.model, settings.faces);
  const spm::ModelSummary& summary = subject.model.summary;
  std::fprintf(stderr, "making the path\n");
  ToolPathSettings path_settings;
  path_settings.speed = settings.speed;
  path_settings.depth = settings.depth;
  path_settings.poses = static_cast<std::uint32_t>(settings.seconds / kPeriod);
  path_settings.seed = settings.seed;
  const std::vector<ToolPathPose> path = tool_path(subject, path_settings);
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  Judge judge{subject, stylus, probe};

  double fastest = 0, turning = 0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    const haptics::ToolPose &a = path[i - 1].device, &b = path[i].device;
    fastest = std::max(fastest, (b.position - a.position).norm() / kPeriod);
    turning = std::max(turning, haptics::log_map(b.orientation * a.orientation.conjugate()).norm() / kPeriod);
  }
  char text[256];
  std::snprintf(text, sizeof text,
                "stylus of %zu triangles, %g s, along the surface up to %g m/s, tip up to %.2f m/s, turning up to "
                "%.1f rad/s, pressed up to %g cm, friction %g, %g N/m, %g N m/rad, rounding %g mm, seed %llu",
                stylus.faces.size(), settings.seconds, settings.speed, fastest, turning, settings.depth * 1e2,
                settings.friction, settings.grip.stiffness, settings.grip.rotational_stiffness,
                haptics::ToolSettings{}.collision_margin * 1e3, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  for (const auto& [on, name] : {std::pair{On::kFullRate, "whole mesh"},
                                 {On::kWholeAsIfChanging, "whole, as if changing"},
                                 {On::kRefined, "refined"}}) {
    if (on == On::kRefined && !settings.refined) continue;
    std::fprintf(stderr, "%s\n", name);
    Outcome outcome = slide(settings, subject, path, probe, on, judge);
    note(outcome, name, report);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"tool", "A stylus with six degrees of freedom over a scan", "5 s, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--seconds", settings.seconds, "length of the path")->check(CLI::Range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "along the surface, m/s")->check(CLI::Range(0.001, 1.0));
  app.add_option("--depth", settings.depth, "by which the device is pressed in, m")->check(CLI::Range(0.0, 0.1));
  app.add_option("--friction", settings.friction, "coefficient")->check(CLI::Range(0.0, 2.0));
  app.add_option("--deadline", settings.deadline_us, "of the HRTC's cycle, us")->check(CLI::Range(10.0, 10000.0));
  app.add_option("--pool-share", settings.pool_share, "of the model's records that the HRTC has room for")
      ->check(CLI::Range(0.01, 1.0));
  app.add_option("--delay", settings.delay, "of demands and records, ms each")->check(CLI::Range(0u, 500u));
  app.add_option("--seed", settings.seed, "of the path");
  app.add_flag("--refined", settings.refined, "also on a mesh that an HRTC refines around the tool");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return tactus::bench::run(settings);
  });
}
