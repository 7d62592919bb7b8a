#include "tools/mesh_tool.hpp"

#include <CLI/CLI.hpp>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <utility>

#include "realtime/standard_output.hpp"
#include "session/printable.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/model_file.hpp"
#include "spm/offline/stage_times.hpp"
#include "spm/offline/verify.hpp"
#include "spm/offline/write_mesh.hpp"
#include "tools/audit.hpp"
#include "tools/audit_report.hpp"
#include "tools/mesh_report.hpp"
#include "trace/private_file.hpp"
#include "wire/address/finite_range.hpp"

namespace tactus::tools {
namespace {

using namespace spm::offline;

/// Shows a progress bar on one line of a terminal. Writes nothing if there is no terminal.
class ProgressBar {
 public:
  explicit ProgressBar(const ToolStreams& streams) : streams_{streams} {}
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  ~ProgressBar() {
    if (shown_) streams_.errors << "\r\033[K" << std::flush;
  }

  void show(std::string_view stage, double done) {
    const auto now = std::chrono::steady_clock::now();
    if (!streams_.progress || (shown_ && now - last_ < std::chrono::milliseconds{100})) return;
    last_ = now;
    shown_ = true;
    constexpr int kWidth = 40;
    const int filled = static_cast<int>(std::lround(done * kWidth));
    std::string bar(static_cast<std::size_t>(filled), '#');
    bar.resize(kWidth, '.');
    streams_.errors << "\r\033[K" << stage << " [" << bar << "] " << std::lround(100 * done) << " %" << std::flush;
  }

 private:
  const ToolStreams& streams_;
  bool shown_ = false;
  std::chrono::steady_clock::time_point last_;
};

/// Values of the options of all commands.
struct Settings {
  std::string model, out, file, shape, unit = "m";
  std::string log, spm, json_file;
  AuditOptions audit;
  double size = 0, radius_mm = 3, speed = 0.05, pairs_mm = 0;
  unsigned threads = 0, grid_bits = 0;
  std::uint32_t base_faces = SimplifyOptions{}.base_faces;
  std::uint32_t cell_faces = PartitionOptions{}.cell_faces;
  std::uint32_t faces = 4096;
  std::uint64_t seed = 1;
  bool json = false, allow_losses = false;
};

BuildOptions build_options(const Settings& settings, bool sized) {
  BuildOptions options;
  options.simplify.base_faces = settings.base_faces;
  options.partition.cell_faces = settings.cell_faces;
  options.partition.max_cell_faces = settings.cell_faces * 5 / 2;
  options.metres_per_unit = settings.unit == "mm" ? 1e-3 : settings.unit == "cm" ? 1e-2 : 1;
  options.grid_bits = settings.grid_bits;
  if (sized) options.size = settings.size;
  options.pair_distance = settings.pairs_mm * 1e-3;
  options.losses = settings.allow_losses ? LossPolicy::kAllow : LossPolicy::kRefuse;
  options.threads = settings.threads;
  return options;
}

Certificate certificate_of(const Settings& settings, const spm::Model& model) {
  const double unit = model.summary.metres_per_unit;
  return certify(model, settings.radius_mm * 1e-3 / unit, settings.speed / unit);
}

std::string times_text(const StageTimes& times) {
  char number[64];
  std::snprintf(number, sizeof number, "%.2f s, at most %.0f MiB resident:", times.sum().seconds,
                peak_resident_bytes() / (1 << 20));
  std::string text = std::string{"built in "} + number;
  for (const StageTimes::Stage& stage : times.stages()) {
    std::snprintf(number, sizeof number, " %.2f", stage.seconds);
    text += (&stage == &times.stages().front() ? " " : ", ") + stage.name + number;
  }
  return text + "\n";
}

/// Warns about a size that hands do not touch, because it is probably that of another unit.
void warn_of_unusual_size(const spm::ModelSummary& summary, const ToolStreams& streams) {
  const double longest = spm::longest_side(summary) * summary.metres_per_unit;
  if (spm::is_touchable(longest)) return;
  streams.errors << "warning: the longest side is " << longest << " m; set --unit or --size if that is wrong\n";
}

void report_built(const Settings& settings, const BuiltModel& built, const Provenance& provenance,
                  const ToolStreams& streams, const StageTimes& times) {
  const spm::Model model = built.model();
  const Certificate certificate = certificate_of(settings, model);
  warn_of_unusual_size(model.summary, streams);
  if (settings.json) {
    nlohmann::ordered_json json = info_json(model, provenance, certificate);
    json["build_seconds"] = times.sum().seconds;
    for (const StageTimes::Stage& stage : times.stages()) json["stage_seconds"][stage.name] = stage.seconds;
    json["peak_resident_bytes"] = peak_resident_bytes();
    streams.out << json.dump(2) << "\n";
  } else {
    streams.out << info_text(model, provenance, certificate) << times_text(times);
  }
}

/// Calls `make` with a progress callback, writes the model that it returns, and reports the result.
template <class Make>
int build_into_file(const Settings& settings, const std::string& source, const ToolStreams& streams, Make make) {
  StageTimes times;
  std::optional<ProgressBar> bar{std::in_place, streams};
  const BuiltModel built = make([&](std::string_view stage, double done) {
    times.begin(stage);
    bar->show(stage, done);
  });
  const Provenance provenance{source, built.cleaned};
  times.begin("write");
  write_model(settings.out, built.model(), provenance);
  times.end();
  bar.reset();  // the report begins on its line
  report_built(settings, built, provenance, streams, times);
  return kDone;
}

int build(const Settings& settings, bool sized, const ToolStreams& streams) {
  const std::filesystem::path source{settings.model};
  return build_into_file(settings, source.filename().string(), streams, [&](const Progress& progress) {
    return build_model_file(source, build_options(settings, sized), progress);
  });
}

int info(const Settings& settings, const ToolStreams& streams) {
  const MappedModel mapped{settings.file};
  const spm::OwnedModel decoded = mapped.decode();
  const Certificate certificate = certificate_of(settings, decoded.model());
  if (settings.json) {
    streams.out << info_json(decoded.model(), mapped.provenance(), certificate, &mapped.compressed()).dump(2) << "\n";
  } else {
    streams.out << info_text(decoded.model(), mapped.provenance(), certificate, &mapped.compressed());
  }
  return kDone;
}

int check(const Settings& settings, const ToolStreams& streams) {
  const spm::OwnedModel decoded = MappedModel{settings.file}.decode();
  TriangleMesh original = import_mesh(settings.model, LossPolicy::kAllow);
  Verification result;
  {
    ProgressBar bar{streams};
    result = verify(decoded.model(), std::move(original), [&bar](double done) { bar.show("verify", done); });
  }
  streams.out << (settings.json ? verification_json(result).dump(2) + "\n" : verification_text(result));
  return result.mismatches.empty() ? kDone : kCheckFailed;
}

void write_and_report(const Settings& settings, const std::string& source, const TriangleMesh& mesh,
                      const ToolStreams& streams) {
  write_mesh(settings.out, mesh);
  if (settings.json) {
    streams.out << nlohmann::ordered_json{{"vertices", mesh.positions.size()}, {"faces", mesh.faces.size()}}.dump(2)
                << "\n";
  } else {
    streams.out << source << ": " << mesh.positions.size() << " vertices, " << mesh.faces.size() << " faces in "
                << settings.out << "\n";
  }
}

int make(const Settings& settings, const ToolStreams& streams) {
  const std::filesystem::path path{settings.out};
  TriangleMesh mesh = generate(shape_from_name(settings.shape), settings.faces, settings.seed);
  if (path.extension() == ".spm") {
    return build_into_file(settings, settings.shape, streams, [&](const Progress& progress) {
      return build_model(std::move(mesh), build_options(settings, false), progress);
    });
  }
  write_and_report(settings, settings.shape, mesh, streams);
  return kDone;
}

int export_finest(const Settings& settings, const ToolStreams& streams) {
  spm::OwnedModel decoded = MappedModel{settings.file}.decode();
  TriangleMesh mesh;
  mesh.faces = finest_faces(decoded.model());
  mesh.positions = std::move(decoded.positions);
  write_and_report(settings, settings.file, mesh, streams);
  return kDone;
}

int audit_log(const Settings& settings, bool json, const ToolStreams& streams) {
  std::optional<trace::PrivateFile> file;  // opened before the audit, which takes up to a minute
  if (!settings.json_file.empty() && file.emplace(settings.json_file).get() == nullptr)
    throw AuditError(settings.json_file + ": cannot be written: " + std::strerror(errno));
  const AuditReport report = audit_files(settings.log, settings.model, settings.spm, settings.audit);
  if (json && settings.json_file.empty()) {
    streams.out << audit_json(report).dump(2) << "\n";
  } else {
    streams.out << audit_text(report);
  }
  if (file && (std::fputs((audit_json(report).dump(2) + "\n").c_str(), file->get()) == EOF || !file->commit()))
    throw AuditError(settings.json_file + ": cannot be written completely");
  return report.clean() ? kDone : kCheckFailed;
}

class CommandLine {
 public:
  CommandLine() {
    app_.require_subcommand(1);
    app_.footer(
        "Examples:\n"
        "  tactus-mesh generate organ --faces 500000 --seed 7 organ.ply\n"
        "  tactus-mesh build organ.ply organ.spm --size 0.1\n"
        "  tactus-mesh info organ.spm --json\n"
        "  tactus-mesh verify organ.spm organ.ply\n"
        "  tactus-mesh export organ.spm finest.ply\n"
        "  tactus-mesh audit hrtc-1.hlog organ.ply --spm organ.spm\n"
        "Exit status: 0 done, 1 a check failed or the output could not be written, 2 bad input.");
    add_build();
    add_info();
    add_verify();
    add_generate();
    add_export();
    add_audit();
  }

  CLI::App& app() { return app_; }

  int run(const ToolStreams& streams) const {
    if (build_->parsed()) return build(settings_, size_->count() > 0, streams);
    if (info_->parsed()) return info(settings_, streams);
    if (verify_->parsed()) return check(settings_, streams);
    if (export_->parsed()) return export_finest(settings_, streams);
    if (audit_->parsed()) return audit_log(settings_, audit_json_->count() > 0, streams);
    return make(settings_, streams);
  }

 private:
  void add_build() {
    build_ = app_.add_subcommand("build", "Build an .spm model from a triangle mesh");
    build_->footer("Example: tactus-mesh build bunny.obj bunny.spm --unit cm");
    build_->add_option("MODEL", settings_.model, "Mesh file: OBJ, PLY, STL, glTF, GLB, OFF or another format")
        ->required();
    build_->add_option("OUT", settings_.out, "The .spm file to write")->required();
    CLI::Option* unit = build_->add_option("--unit", settings_.unit, "Unit of length of the file")
                            ->check(CLI::IsMember({"mm", "cm", "m"}))
                            ->capture_default_str();
    size_ = build_->add_option("--size", settings_.size, "Longest side in metres, instead of --unit")
                ->check(wire::finite_positive())
                ->excludes(unit);
    build_
        ->add_option("--pairs", settings_.pairs_mm,
                     "Distance in millimetres below which vertices are contracted even if the topology changes; closes "
                     "cracks and tunnels in coarse versions")
        ->check(wire::finite_non_negative());
    build_->add_flag("--allow-losses", settings_.allow_losses,
                     "Build even if most vertices or faces of MODEL are dropped");
    build_->add_option("--threads", settings_.threads,
                       "Threads for the build; 0: one per processor. The result is the same with any number");
    add_density(build_);
    add_report(build_);
  }
  void add_info() {
    info_ = app_.add_subcommand("info", "Describe an .spm model: size, trees, regions, certificate");
    info_->footer("Example: tactus-mesh info bunny.spm --radius 2 --speed 0.1 --json");
    info_->add_option("FILE", settings_.file, "The .spm file")->required();
    add_report(info_);
  }
  void add_verify() {
    verify_ = app_.add_subcommand("verify", "Check that an .spm model reproduces its original to the bit");
    verify_->footer("Example: tactus-mesh verify bunny.spm bunny.obj");
    verify_->add_option("FILE", settings_.file, "The .spm file")->required();
    verify_->add_option("MODEL", settings_.model, "The mesh from which FILE was built")->required();
    verify_->add_flag("--json", settings_.json, "Report as JSON");
  }
  void add_generate() {
    generate_ = app_.add_subcommand("generate",
                                    "Generate a mesh: sphere, torus, organ, terrain, wall or box, about 0.1 m in size");
    generate_->footer("Example: tactus-mesh generate terrain --faces 200000 --seed 3 terrain.stl");
    std::vector<std::string> shapes;
    for (const std::string_view name : shape_names()) shapes.emplace_back(name);
    generate_->add_option("SHAPE", settings_.shape, "sphere, torus, organ, terrain, wall or box")
        ->required()
        ->check(CLI::IsMember(shapes));
    generate_->add_option("OUT", settings_.out, "The file to write: .ply, .obj, .stl or .spm")->required();
    generate_->add_option("--faces", settings_.faces, "Approximate number of faces")->capture_default_str();
    generate_->add_option("--seed", settings_.seed, "Seed of organ and terrain")->capture_default_str();
    add_density(generate_);
    add_report(generate_);
  }
  void add_export() {
    export_ = app_.add_subcommand("export", "Write the finest mesh of an .spm model as a mesh file");
    export_->footer(
        "Example: tactus-mesh export organ.spm finest.ply\n"
        "Vertices and faces are in the order of their ids. Coordinates have the bits of FILE.");
    export_->add_option("FILE", settings_.file, "The .spm file")->required();
    export_->add_option("OUT", settings_.out, "The file to write: .ply, .obj or .stl")->required();
    export_->add_flag("--json", settings_.json, "Report as JSON");
  }
  void add_audit() {
    audit_ = app_.add_subcommand("audit", "Check an HRTC's contact log against the original model");
    audit_->footer(
        "Example: tactus-mesh audit hrtc-1.hlog organ.ply --spm organ.spm --json audit.json\n"
        "The audited object of the log is the one with the digest of the .spm file. Without an .spm file, it is the "
        "one\n"
        "with the name of MODEL, or else the only one. A missing or untouched object is not a failure. FCL gives a\n"
        "second opinion on every audited cycle. If it disagrees by more than 1e-6 m, the check fails.");
    audit_->add_option("LOG", settings_.log, "Contact log of tactus-hrtc --log")->required();
    audit_->add_option("MODEL", settings_.model, "The original mesh, or an .spm file for its finest mesh")->required();
    audit_->add_option("--spm", settings_.spm, "The .spm file of MODEL, to count the records that the paths needed");
    audit_->add_option("--cycles", settings_.audit.cycles, "Maximum number of audited cycles")->capture_default_str();
    audit_json_ = audit_
                      ->add_option("--json", settings_.json_file,
                                   "Write the report as JSON: into FILE, or to the output instead of the text")
                      ->type_name("[FILE]")
                      ->expected(0, 1);
  }
  void add_density(CLI::App* command) {
    command->add_option("--base-faces", settings_.base_faces, "Faces of the base mesh")
        ->check(CLI::Range(1u, spm::offline::kMaxBuiltFaces - 1))
        ->capture_default_str();
    command->add_option("--cell-faces", settings_.cell_faces, "Target number of finest faces per region")
        ->check(CLI::Range(8u, 1u << 20))
        ->capture_default_str();
    command
        ->add_option("--grid", settings_.grid_bits,
                     "Compact profile: round coordinates to a grid with this number of bits over the longest side")
        ->check(CLI::Range(4u, 20u));
  }
  void add_report(CLI::App* command) {
    command->add_option("--radius", settings_.radius_mm, "Probe radius of the certificate, in mm")
        ->check(wire::finite_positive())
        ->capture_default_str();
    command->add_option("--speed", settings_.speed, "Probe speed of the certificate, in m/s")
        ->check(wire::finite_positive())
        ->capture_default_str();
    command->add_flag("--json", settings_.json, "Report as JSON");
  }

  CLI::App app_{"Builds, describes, checks and generates models for Tactus", "tactus-mesh"};
  CLI::App *build_ = nullptr, *info_ = nullptr, *verify_ = nullptr, *generate_ = nullptr, *export_ = nullptr,
           *audit_ = nullptr;
  CLI::Option *size_ = nullptr, *audit_json_ = nullptr;
  Settings settings_;
};

}  // namespace

int run_mesh_tool(int argc, const char* const* argv, ToolStreams streams) {
  CommandLine line;
  try {
    line.app().parse(argc, argv);
    const int status = line.run(streams);
    if (status != kDone || streams.out.flush()) return status;
    return realtime::failed_output_status("tactus-mesh", errno, streams.errors);
  } catch (const CLI::ParseError& e) {
    return line.app().exit(e, streams.out, streams.errors) == 0 ? kDone : kBadInput;
  } catch (const std::bad_alloc&) {
    streams.errors << "tactus-mesh: not enough memory\n";
  } catch (const std::exception& e) {
    streams.errors << "tactus-mesh: " << session::printable(e.what()) << "\n";
  }
  return kBadInput;
}

}  // namespace tactus::tools
