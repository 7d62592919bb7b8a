#include "bench/page.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <set>
#include <stdexcept>

namespace tactus::bench {
namespace {

using Json = nlohmann::json;

constexpr const char* kTableHead =
    "| figure | population | n | bound | value | verdict |\n"
    "|---|---|---:|---|---|---|\n";
constexpr const char* kShortfallHead =
    "| command | figure | population | n | bound | value | verdict |\n"
    "|---|---|---|---:|---|---|---|\n";

std::string text_of(const Json& row, const char* field) { return row.at(field).get<std::string>(); }

/// Returns the text of a table cell. Escapes |, which would end the cell.
std::string table_cell(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2) text.insert(at, 1, '\\');
  return text.empty() ? "" : text + " ";
}

bool falls_short(const Json& row) { return row.at("verdict") == "falls short"; }

/// Returns a row of JSON as a row of a table that begins with `first_fields`.
std::string table_row(const Json& row, std::initializer_list<const char*> first_fields) {
  std::string line = "| ";
  for (const char* field : first_fields) line += table_cell(text_of(row, field)) + "| ";
  line += table_cell(text_of(row, "population") + (row.at("virtual_time").get<bool>() ? ", virtual time" : "")) + "| ";
  line += std::to_string(row.at("n").get<std::size_t>()) + " | ";
  for (const char* field : {"bound", "text", "verdict"}) line += table_cell(text_of(row, field)) + "| ";
  line.pop_back();
  return line + "\n";
}

/// Returns the distinct texts that `get` returns for the runs, joined by commas.
template <class Get>
std::string distinct(const std::vector<Json>& runs, Get&& get) {
  std::set<std::string> texts;
  for (const Json& run : runs) texts.insert(get(run));
  std::string all;
  for (const std::string& text : texts) all += (all.empty() ? "" : ", ") + text;
  return all;
}

}  // namespace

std::vector<Json> read_runs(const std::string& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator{folder})
    if (entry.path().extension() == ".json") files.push_back(entry.path());
  if (files.empty()) throw std::runtime_error("no .json file in '" + folder + "'");
  std::sort(files.begin(), files.end());
  std::vector<Json> runs;
  for (const std::filesystem::path& file : files) {
    std::ifstream in{file};
    runs.push_back(Json::parse(in, nullptr, false));
    if (runs.back().is_discarded()) throw std::runtime_error("'" + file.string() + "' is not JSON");
  }
  return runs;
}

std::string page(const std::vector<Json>& runs) {
  const std::string commits = distinct(runs, [](const Json& run) { return text_of(run.at("build"), "commit"); });
  if (commits.find(',') != std::string::npos) throw std::runtime_error("runs of several commits: " + commits);
  std::string out =
      "# Benchmarks\n\n"
      "`scripts/bench report` wrote this page. A figure falls short if it has no samples, or if its work did not "
      "finish.\n"
      "*Virtual time* marks figures of a simulated clock. They are the same on every machine.\n\n";
  const bool quick = std::any_of(runs.begin(), runs.end(), [](const Json& run) {
    return text_of(run, "command").find(" --quick") != std::string::npos;
  });
  out +=
      std::string{"- Command: `scripts/bench all"} + (quick ? " --quick" : "") + " --json DIR`\n- Commit: " + commits;
  out += "\n- Date: " + distinct(runs, [](const Json& run) { return text_of(run, "date"); });
  out += "\n- Machine: " + distinct(runs, [](const Json& run) {
           const Json& machine = run.at("machine");
           return std::to_string(machine.at("processors").get<unsigned>()) + " x " + text_of(machine, "processor") +
                  ", " + text_of(machine, "kernel");
         });
  out += "\n- Build: " + distinct(runs, [](const Json& run) {
           return text_of(run.at("build"), "type") + ", " + text_of(run.at("build"), "compiler");
         });
  out += "\n\n## Rows that fall short\n\n";
  std::string rows;
  for (const Json& run : runs)
    for (const Json& row : run.at("rows"))
      if (falls_short(row)) rows += table_row(row, {"command", "figure"});
  out += rows.empty() ? "None.\n" : kShortfallHead + rows;
  for (const Json& run : runs) {
    out += "\n## " + text_of(run, "command") + "\n\n";
    out += text_of(run.at("model"), "name") + ". " + text_of(run, "settings") + "\n\n" + kTableHead;
    for (const bool bounded : {true, false})
      for (const Json& row : run.at("rows"))
        if ((row.at("verdict") != "no bound") == bounded) out += table_row(row, {"figure"});
  }
  return out;
}

std::vector<std::string> shortfalls(const std::vector<Json>& runs) {
  std::vector<std::string> lines;
  for (const Json& run : runs)
    for (const Json& row : run.at("rows"))
      if (falls_short(row))
        lines.push_back(text_of(row, "command") + ": " + text_of(row, "figure") + ", " + text_of(row, "population") +
                        " (n " + std::to_string(row.at("n").get<std::size_t>()) + "): " + text_of(row, "text") +
                        ", bound " + text_of(row, "bound"));
  return lines;
}

}  // namespace tactus::bench
