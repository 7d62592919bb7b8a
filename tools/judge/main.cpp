// tactus-judge: compares a session with its bounds.
#include <CLI/CLI.hpp>
#include <cerrno>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "realtime/standard_output.hpp"
#include "session/printable.hpp"
#include "tools/judge/judge.hpp"
#include "wire/address/finite_range.hpp"

namespace {

constexpr char kExamples[] = R"(
Example:
  tactus-sim --session lab --scenario demo --json report.json
  tactus-mesh audit hrtc-1.hlog organ.ply --spm organ.spm --json audit-1.json
  tactus-mesh audit hrtc-2.hlog organ.ply --spm organ.spm --json audit-2.json
  tactus-judge report.json audit-1.json audit-2.json

Exit status: 0 no row falls short, 1 a row falls short or the output could not be written, 2 wrong input.)";

nlohmann::json read(const std::string& path) {
  std::ifstream in{path};
  if (!in) throw std::runtime_error(path + ": cannot be read");
  try {
    return nlohmann::json::parse(in);
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(path + ": " + error.what());
  }
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  std::string report;
  std::vector<std::string> audits;
  judge::Expectations expectations;
  bool as_json = false;
  CLI::App app{"Compares a session's report and the audits of its contacts with their bounds.", "tactus-judge"};
  app.footer(kExamples);
  app.add_option("REPORT", report, "Output of tactus-sim --json")->required();
  app.add_option("AUDIT", audits, "Outputs of tactus-mesh audit --json, one for each HRTC and model")->required();
  app.add_flag("--lift", expectations.has_lift, "Two users lift an object in this session");
  app.add_flag(
      "--eviction", expectations.has_eviction,
      "Regions are evicted and loaded again, because the compressed caches are too small for the touched ones");
  app.add_option("--received-share", expectations.received_share,
                 "Share of all vertex splits that an HRTC may receive, from 0 to 1")
      ->check(wire::finite_range(0.0, 1.0));
  app.add_flag("--json", as_json, "Print the rows as JSON");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    std::vector<nlohmann::json> read_audits;
    for (const std::string& audit : audits) read_audits.push_back(read(audit));
    const std::vector<judge::Row> rows = judge::judge(read(report), read_audits, expectations);
    std::cout << (as_json ? judge::json(rows).dump(2) + "\n" : judge::text(rows));
    return realtime::status_after_output("tactus-judge", judge::all_hold(rows) ? 0 : 1);
  } catch (const std::exception& error) {
    std::cerr << "tactus-judge: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
