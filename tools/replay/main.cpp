// tactus-replay: recomputes the forces of a flight recording and compares them to the bit.
#include <CLI/CLI.hpp>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "hrtc_service/flight_replay.hpp"
#include "realtime/standard_output.hpp"
#include "session/printable.hpp"
#include "spm/offline/model_file.hpp"
#include "trace/private_file.hpp"

namespace {

using namespace tactus;

constexpr char kExamples[] = R"(
Examples:
  tactus-replay desk-20261122T101500Z-1.mcap --model organ.spm --model tool.spm
  tactus-replay desk.mcap --model organ.spm --to-csv forces.csv

Exit status: 0 every force is the same to the bit, 1 some forces differ or the output could not be written, 2 wrong
input: not a flight recording, no complete cycle, another build, or a missing model.)";

/// Writes a CSV file with a line for each probe and cycle. The file gets its name at `close`.
class Table {
 public:
  explicit Table(const std::string& file) : name_{file}, file_{file} {
    if (file_.get() == nullptr) fail();
    line_ << "cycle,time_ns,probe,x,y,z,status,force_x,force_y,force_z,replayed_x,replayed_y,replayed_z\n";
    line_.precision(17);
    write();
  }
  void add(const trace::FlightTouch& touch, const trace::FlightProbe& probe,
           const hrtc_service::ProbeOutput& replayed) {
    line_ << touch.cycle << ',' << touch.time_ns << ',' << probe.probe;
    for (const double x : probe.position) line_ << ',' << x;
    line_ << ',' << probe.status;
    for (const double x : probe.force) line_ << ',' << x;
    for (const double x : replayed.force) line_ << ',' << x;
    line_ << '\n';
    write();
  }
  void close() {
    if (!file_.commit()) fail();
  }

 private:
  /// Writes the line and clears it.
  void write() {
    if (std::fputs(line_.str().c_str(), file_.get()) == EOF) fail();
    line_.str({});
  }
  [[noreturn]] void fail() const { throw std::runtime_error("cannot write " + name_ + ": " + std::strerror(errno)); }

  std::string name_;
  trace::PrivateFile file_;
  std::ostringstream line_;
};

void print(const hrtc_service::FlightReport& report) {
  std::cout << session::printable(report.start.participant) << ", " << report.cycles << " cycles in " << report.seconds
            << " s, from "
            << (report.from_the_beginning ? "the beginning" : "cycle " + std::to_string(report.start.first_cycle))
            << "; written for: " << session::printable(report.start.reason) << "\nbuild "
            << session::printable(report.start.build) << '\n'
            << report.probe_cycles << " forces, of these " << report.in_contact << " in contact (" << report.exact
            << " exact), " << report.stale << " of stale poses, " << report.faulted << " switched off by a fault\n"
            << report.objects << " objects; " << report.regions_arrived << " regions arrived, "
            << report.regions_departed << " left; the deadline ended refinement in " << report.budget_spent
            << " cycles; " << report.moves << " moves, " << report.stops << " stops, " << report.resets << " resets\n";
  if (report.gaps > 0)
    std::cout << report.gaps << " gaps of " << report.lost << " cycles: the replay continues after each gap\n";
  if (report.is_truncated) std::cout << "the file is truncated; everything before is replayed\n";
  if (report.different_cycles == 0)
    std::cout << "every force is the same to the bit\n";
  else
    std::cout << report.different_cycles << " cycles differ, first " << session::printable(report.first_difference)
              << '\n';
  if (!report.abort_reason.empty()) std::cout << "stopped after " << session::printable(report.abort_reason) << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  std::string file, csv;
  std::vector<std::string> model_files;
  hrtc_service::FlightReplayOptions options;
  CLI::App app{"Recomputes the forces of a flight recording and compares them to the bit.", "tactus-replay"};
  app.footer(kExamples);
  app.add_option("FILE", file, "A flight recording of tactus-hrtc")->required();
  app.add_option("--model", model_files, "The .spm file of a touched object; repeatable")->allow_extra_args(false);
  app.add_option("--to-csv", csv, "Write each pose with its force, recorded and replayed, into this file");
  app.add_flag("--any-build", options.accepts_any_build,
               "Also replay a recording of another build, if it begins at cycle 0, to find the first difference");
  app.add_option("--max-pool", options.max_pool_bytes, "Refuse a recording with a larger pool; default: 16GiB")
      ->transform(CLI::AsSizeValue(false));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    std::map<std::uint64_t, spm::offline::MappedModel> models;
    for (const std::string& model : model_files) {
      spm::offline::MappedModel mapped{model};
      mapped.check_checksums();
      const std::uint64_t digest = mapped.summary().digest;
      models.emplace(digest, std::move(mapped));
    }
    options.model = [&](std::uint64_t digest) -> const spm::codec::CompressedModel* {
      const auto found = models.find(digest);
      return found == models.end() ? nullptr : &found->second.compressed();
    };
    std::unique_ptr<Table> table;
    if (!csv.empty()) {
      table = std::make_unique<Table>(csv);
      options.on_probe = [&](const auto&... probe) { table->add(probe...); };
    }
    const hrtc_service::FlightReport report = hrtc_service::replay_flight(file, options);
    if (table) table->close();
    print(report);
    return realtime::status_after_output("tactus-replay", report.different_cycles > 0 ? 1 : 0);
  } catch (const std::exception& error) {
    std::cerr << "tactus-replay: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
