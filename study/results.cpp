#include "study/results.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "study/study.hpp"

namespace tactus::study {
namespace {

using nlohmann::ordered_json;

ordered_json to_json(const Run& run) {
  ordered_json figures = ordered_json::array();
  for (const Figure& figure : run.figures)
    figures.push_back({{"name", figure.name}, {"unit", figure.unit}, {"value", figure.value}});
  return {{"scenario", run.scenario}, {"profile", run.profile}, {"seed", run.seed}, {"figures", figures}};
}

Run run_from(const ordered_json& line) {
  Run run{line.at("scenario"), line.at("profile"), line.at("seed"), {}};
  for (const ordered_json& figure : line.at("figures"))
    run.figures.push_back({figure.at("name"), figure.at("unit"), figure.at("value")});
  return run;
}

/// Three digits that matter, but no more than a thousandth.
std::string number(double value) {
  char text[32];
  const double size = std::abs(value);
  const int digits = size >= 99.95 || value == std::round(value) ? 0 : size >= 9.995 ? 1 : size >= 0.9995 ? 2 : 3;
  std::snprintf(text, sizeof text, "%.*f", digits, size < 5e-4 ? 0 : value);
  return text;
}

std::string with_bounds(const Estimate& estimate) {
  if (estimate.count == 0) return "";
  const std::string low = number(estimate.low), high = number(estimate.high);
  return low == high ? low : number(estimate.mean) + " (" + low + " to " + high + ")";
}

std::string title(const CellFigure& figure) { return figure.name + (figure.unit.empty() ? "" : ", " + figure.unit); }

/// A table of Markdown; the first column is text.
class Table {
 public:
  explicit Table(const std::vector<std::string>& head) {
    row(head);
    text_ += "|---|";
    for (std::size_t i = 1; i < head.size(); ++i) text_ += "--:|";
    text_ += "\n";
  }
  void row(const std::vector<std::string>& cells) {
    text_ += "|";
    for (const std::string& cell : cells) text_ += " " + cell + " |";
    text_ += "\n";
  }
  [[nodiscard]] std::string text() const { return text_ + "\n"; }

 private:
  std::string text_;
};

template <class Value>
std::vector<Value> distinct(const std::vector<Cell>& cells, Value Cell::*member) {
  std::vector<Value> values;
  for (const Cell& cell : cells)
    if (std::find(values.begin(), values.end(), cell.*member) == values.end()) values.push_back(cell.*member);
  return values;
}

const CellFigure* find(const std::vector<Cell>& cells, const std::string& scenario, const std::string& profile,
                       const std::string& name) {
  for (const Cell& cell : cells) {
    if (cell.scenario != scenario || cell.profile != profile) continue;
    for (const CellFigure& figure : cell.figures)
      if (figure.name == name) return &figure;
  }
  return nullptr;
}

/// One figure by profile and scenario.
std::string overview(const std::vector<Cell>& cells, const std::string& name, const std::string& unit) {
  const std::vector<std::string> scenarios = distinct(cells, &Cell::scenario);
  std::vector<std::string> head{name + ", " + unit};
  head.insert(head.end(), scenarios.begin(), scenarios.end());
  Table table{head};
  for (const std::string& profile : distinct(cells, &Cell::profile)) {
    std::vector<std::string> row{profile};
    for (const std::string& scenario : scenarios) {
      const CellFigure* const figure = find(cells, scenario, profile, name);
      row.push_back(figure == nullptr ? "" : with_bounds(figure->value));
    }
    table.row(row);
  }
  return table.text();
}

/// All figures of one scenario, by profile.
std::string details(const std::vector<Cell>& cells, const std::string& scenario, Estimate CellFigure::*member) {
  std::vector<std::string> head{"link"};
  std::vector<std::vector<std::string>> rows;
  for (const Cell& cell : cells) {
    if (cell.scenario != scenario || (cell.figures.front().*member).count == 0) continue;
    std::vector<std::string> row{cell.profile};
    for (const CellFigure& figure : cell.figures) {
      if (rows.empty()) head.push_back(title(figure));
      row.push_back(with_bounds(figure.*member));
    }
    rows.push_back(row);
  }
  Table table{head};
  for (const std::vector<std::string>& row : rows) table.row(row);
  return table.text();
}

ordered_json to_json(const Estimate& estimate) {
  return {{"n", estimate.count}, {"mean", estimate.mean}, {"low", estimate.low}, {"high", estimate.high}};
}

}  // namespace

RunLog::RunLog(const std::filesystem::path& folder, const std::string& study) : file_{folder / "runs.jsonl"} {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  std::ifstream in{file_};
  std::string line;
  std::uint64_t complete = 0;  // bytes: a line that was cut short is written anew
  if (in && std::getline(in, line)) {
    if (line != study) {
      throw std::runtime_error(file_.string() + ": has runs of another study, program or model; expected none, or '" +
                               study + "'");
    }
    complete = line.size() + 1;
    while (std::getline(in, line) && !in.eof()) {
      const ordered_json parsed = ordered_json::parse(line, nullptr, false);
      if (parsed.is_discarded()) break;
      runs_.push_back(run_from(parsed));
      complete += line.size() + 1;
    }
    in.close();
    std::filesystem::resize_file(file_, complete, error);
  }
  out_.open(file_, std::ios::app);
  if (complete == 0) out_ << study << std::endl;
  if (!out_) throw std::runtime_error("cannot write " + file_.string());
}

bool RunLog::has(const std::string& scenario, const std::string& profile, std::uint64_t seed) const {
  return std::any_of(runs_.begin(), runs_.end(), [&](const Run& run) {
    return run.scenario == scenario && run.profile == profile && run.seed == seed;
  });
}

void RunLog::add(const Run& run) {
  runs_.push_back(run);
  out_ << to_json(run).dump() << std::endl;
  if (!out_) throw std::runtime_error("cannot write " + file_.string());
}

std::vector<Cell> cells_of(const std::vector<Run>& runs, const std::vector<std::string>& scenarios,
                           const std::vector<std::string>& profiles) {
  std::vector<Cell> cells;
  for (const std::string& scenario : scenarios) {
    for (const std::string& profile : profiles) {
      Cell cell{scenario, profile, {}};
      std::vector<std::vector<double>> values, differences;
      for (const Run& run : runs) {
        if (run.scenario != scenario || run.profile != profile) continue;
        const auto base = std::find_if(runs.begin(), runs.end(), [&](const Run& other) {
          return other.scenario == scenario && other.profile == kBaseline && other.seed == run.seed;
        });
        for (std::size_t i = 0; i < run.figures.size(); ++i) {
          if (i == cell.figures.size()) {
            cell.figures.push_back({run.figures[i].name, run.figures[i].unit, {}, {}});
            values.emplace_back();
            differences.emplace_back();
          }
          values[i].push_back(run.figures[i].value);
          if (base != runs.end() && profile != kBaseline && i < base->figures.size())
            differences[i].push_back(run.figures[i].value - base->figures[i].value);
        }
      }
      for (std::size_t i = 0; i < cell.figures.size(); ++i) {
        cell.figures[i].value = estimate(values[i]);
        cell.figures[i].difference = estimate(differences[i]);
      }
      if (!cell.figures.empty()) cells.push_back(std::move(cell));
    }
  }
  return cells;
}

std::string markdown(const About& about, const std::vector<Cell>& cells) {
  std::string text =
      "# Study " + about.study + "\n\n`" + about.command + "`\n\n" + about.machine + "; commit " + about.build + ".\n";
  for (const std::string& note : about.notes) text += "\n" + note + "\n";
  text += "\n## Force fidelity by link\n\n";
  text += overview(cells, "force error rms", "N") + overview(cells, "above 1 JND", "% of contact");
  for (const std::string& scenario : distinct(cells, &Cell::scenario)) {
    text += "## " + scenario + "\n\n" + details(cells, scenario, &CellFigure::value);
    if (distinct(cells, &Cell::profile).size() > 1)
      text += "Difference from " + std::string{kBaseline} + ", paired by seed:\n\n" +
              details(cells, scenario, &CellFigure::difference);
  }
  return text;
}

std::string csv(const std::vector<Cell>& cells) {
  std::string text =
      "scenario,link,figure,unit,n,mean,low,high,difference_n,difference_mean,difference_low,difference_high\n";
  for (const Cell& cell : cells) {
    for (const CellFigure& figure : cell.figures) {
      char numbers[256];
      const Estimate &value = figure.value, &difference = figure.difference;
      std::snprintf(numbers, sizeof numbers, ",%zu,%.9g,%.9g,%.9g,%zu,%.9g,%.9g,%.9g\n", value.count, value.mean,
                    value.low, value.high, difference.count, difference.mean, difference.low, difference.high);
      text += cell.scenario + "," + cell.profile + ",\"" + figure.name + "\"," + figure.unit + numbers;
    }
  }
  return text;
}

std::string json(const About& about, const std::vector<Cell>& cells) {
  ordered_json all{{"study", about.study}, {"command", about.command}, {"machine", about.machine},
                   {"build", about.build}, {"notes", about.notes},     {"cells", ordered_json::array()}};
  for (const Cell& cell : cells) {
    ordered_json figures = ordered_json::array();
    for (const CellFigure& figure : cell.figures)
      figures.push_back({{"name", figure.name},
                         {"unit", figure.unit},
                         {"value", to_json(figure.value)},
                         {"difference", to_json(figure.difference)}});
    all["cells"].push_back({{"scenario", cell.scenario}, {"link", cell.profile}, {"figures", figures}});
  }
  return all.dump(2) + "\n";
}

void write_file(const std::filesystem::path& file, const std::string& text) {
  const std::filesystem::path part = file.string() + ".part";
  std::ofstream out{part};
  out << text;
  out.close();
  std::error_code error;
  if (out) std::filesystem::rename(part, file, error);
  if (!out || error) throw std::runtime_error("cannot write " + file.string());
}

}  // namespace tactus::study
