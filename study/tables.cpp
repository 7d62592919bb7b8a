#include "study/tables.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "page/page.hpp"
#include "page/plot.hpp"

namespace tactus::study {
namespace {

using nlohmann::ordered_json;

/// Three significant digits, at most a thousandth.
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

/// The first row is the head, the first column text.
struct Table {
  std::string caption;
  std::vector<std::vector<std::string>> rows;
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

std::vector<Cell> of_topic(const std::vector<Cell>& cells, Topic topic) {
  std::vector<Cell> found;
  for (const Cell& cell : cells)
    if (cell.topic == topic) found.push_back(cell);
  return found;
}

/// One figure by link and scenario.
Table overview(const std::vector<Cell>& cells, const std::string& name, const std::string& unit) {
  const std::vector<std::string> scenarios = distinct(cells, &Cell::scenario);
  Table table{"", {{name + ", " + unit}}};
  table.rows.front().insert(table.rows.front().end(), scenarios.begin(), scenarios.end());
  for (const std::string& profile : distinct(cells, &Cell::profile)) {
    std::vector<std::string> row{profile};
    for (const std::string& scenario : scenarios) {
      const CellFigure* const figure = find(cells, scenario, profile, name);
      row.push_back(figure == nullptr ? "" : with_bounds(figure->value));
    }
    table.rows.push_back(row);
  }
  return table;
}

/// All figures; one row for each cell with values.
Table details(const std::string& caption, const std::vector<Cell>& cells, Estimate CellFigure::*member) {
  Table table{caption, {{"scenario, link"}}};
  for (const CellFigure& figure : cells.front().figures) table.rows.front().push_back(title(figure));
  for (const Cell& cell : cells) {
    if ((cell.figures.front().*member).count == 0) continue;
    std::vector<std::string> row{cell.scenario + ", " + cell.profile};
    for (const CellFigure& figure : cell.figures) row.push_back(with_bounds(figure.*member));
    table.rows.push_back(row);
  }
  return table;
}

std::vector<Table> tables_of(const std::vector<Cell>& cells, Topic topic) {
  std::vector<Table> tables;
  if (topic == Topic::kForces || topic == Topic::kTool)
    tables = {overview(cells, "force error rms", "N"), overview(cells, "above 1 JND", "% of contact")};
  if (topic == Topic::kTool) {
    tables.push_back(overview(cells, "torque error rms", "mN m"));
    tables.push_back(overview(cells, "torque above 1 JND", "% of contact"));
  }
  tables.push_back(details("", cells, &CellFigure::value));
  if (topic != Topic::kStiffness && distinct(cells, &Cell::profile).size() > 1)
    tables.push_back(
        details("Difference from " + std::string{kBaseline} + ", paired by seed:", cells, &CellFigure::difference));
  return tables;
}

std::string markdown(const Table& table) {
  std::string text = table.caption.empty() ? "" : table.caption + "\n\n";
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    text += "|";
    for (const std::string& cell : table.rows[i]) text += " " + cell + " |";
    text += "\n";
    if (i > 0) continue;
    text += "|---|";
    for (std::size_t k = 1; k < table.rows[i].size(); ++k) text += "--:|";
    text += "\n";
  }
  return text + "\n";
}

/// A figure over links, one curve per scenario, with confidence intervals.
struct Drawing {
  Topic topic;
  const char* figure;
  bool logarithmic;
};
constexpr Drawing kDrawings[]{{Topic::kForces, "above 1 JND", false},
                              {Topic::kForces, "force error rms", false},
                              {Topic::kForces, "onset off by", true},
                              {Topic::kTool, "above 1 JND", false},
                              {Topic::kTool, "torque above 1 JND", false},
                              {Topic::kTool, "force error rms", false},
                              {Topic::kTool, "torque error rms", false},
                              {Topic::kFirstTouch, "first exact contact after", true},
                              {Topic::kFirstTouch, "above 1 JND", false},
                              {Topic::kTarget, "on target", false},
                              {Topic::kLift, "held up for", false},
                              {Topic::kLift, "copies apart, most", true},
                              {Topic::kHandOver, "granted after, mean", true},
                              {Topic::kCollaboration, "copies apart, most", true},
                              {Topic::kCollaboration, "apparent mass, of the mass", false},
                              {Topic::kCollaboration, "injected", true}};

/// Smallest and largest value that a scale can show.
class Range {
 public:
  explicit Range(bool logarithmic) : logarithmic_{logarithmic} {}
  void add(double value) {
    if (logarithmic_ && value < kMin) return;
    low_ = std::min(low_, value);
    high_ = std::max(high_, value);
  }
  [[nodiscard]] page::Scale scale() const {
    if (low_ > high_) return {kMin, 1, logarithmic_};
    return {logarithmic_ ? low_ : std::min(low_, 0.0), high_, logarithmic_};
  }

 private:
  static constexpr double kMin = 1e-3;
  bool logarithmic_;
  double low_ = 1e300, high_ = -1e300;
};

std::string draw(const std::vector<Cell>& cells, const Drawing& drawing) {
  const std::vector<std::string> profiles = distinct(cells, &Cell::profile);
  const std::vector<std::string> scenarios = distinct(cells, &Cell::scenario);
  Range range{drawing.logarithmic};
  const CellFigure* any = nullptr;
  for (const Cell& cell : cells) {
    const CellFigure* const figure = find(cells, cell.scenario, cell.profile, drawing.figure);
    if (figure == nullptr || figure->value.count == 0) continue;
    any = figure;
    range.add(figure->value.low);
    range.add(figure->value.high);
  }
  if (any == nullptr) return "";
  page::Plot plot{range.scale()};
  const auto share = [&](std::size_t i) {
    return (static_cast<double>(i) + 0.5) / static_cast<double>(profiles.size());
  };
  for (std::size_t i = 0; i < profiles.size(); ++i) plot.tick(share(i), profiles[i]);
  for (std::size_t k = 0; k < scenarios.size(); ++k) {
    std::vector<std::pair<double, double>> points;
    for (std::size_t i = 0; i < profiles.size(); ++i) {
      const CellFigure* const figure = find(cells, scenarios[k], profiles[i], drawing.figure);
      if (figure == nullptr || figure->value.count == 0) continue;
      points.emplace_back(share(i), figure->value.mean);
      plot.bar(share(i), figure->value.low, figure->value.high, page::colour(k));
    }
    plot.curve(points, page::colour(k), 1.8);
  }
  plot.caption("link");
  return "<h3>" + page::escaped(title(*any)) + "</h3>\n" + plot.svg() + page::key(scenarios);
}

/// A curve for each method over the round trip; analytic bounds are dashed.
std::string draw_stiffness(const std::vector<Cell>& cells) {
  constexpr double kShortest = 1;  // ms, position of a zero round trip
  std::vector<std::string> names;
  Range range{true};
  for (const CellFigure& figure : cells.front().figures)
    if (figure.name != kRoundTrip) names.push_back(figure.name);
  double longest = 2 * kShortest;
  for (const Cell& cell : cells)
    for (const CellFigure& figure : cell.figures) {
      if (figure.name == kRoundTrip)
        longest = std::max(longest, figure.value.mean);
      else
        range.add(figure.value.mean);
    }
  page::Plot plot{range.scale()};
  const auto share = [&](double ms) {
    return std::log(std::max(ms, kShortest) / kShortest) / std::log(longest / kShortest);
  };
  for (const Cell& cell : cells) {
    const double ms = find(cells, cell.scenario, cell.profile, kRoundTrip)->value.mean;
    plot.tick(share(ms), number(ms) + " ms");
  }
  for (std::size_t k = 0; k < names.size(); ++k) {
    std::vector<std::pair<double, double>> points;
    for (const Cell& cell : cells)
      points.emplace_back(share(find(cells, cell.scenario, cell.profile, kRoundTrip)->value.mean),
                          find(cells, cell.scenario, cell.profile, names[k])->value.mean);
    plot.curve(points, page::colour(k), 1.8, names[k].find("(") != std::string::npos);
  }
  plot.caption("round trip; dashed: analytic bounds");
  return "<h3>largest stable stiffness, N/m</h3>\n" + plot.svg() + page::key(names);
}

ordered_json to_json(const Estimate& estimate) {
  return {{"n", estimate.count}, {"mean", estimate.mean}, {"low", estimate.low}, {"high", estimate.high}};
}

}  // namespace

std::string markdown(const About& about, const std::vector<Cell>& cells) {
  std::string text =
      "# Study " + about.study + "\n\n`" + about.command + "`\n\n" + about.machine + "; commit " + about.build + ".\n";
  for (const std::string& note : about.notes) text += "\n" + note + "\n";
  for (std::size_t i = 0; i < std::size(kTopicNames); ++i) {
    const std::vector<Cell> of = of_topic(cells, static_cast<Topic>(i));
    if (of.empty()) continue;
    text += std::string{"\n## "} + kTopicNames[i] + "\n\n";
    for (const Table& table : tables_of(of, static_cast<Topic>(i))) text += markdown(table);
  }
  return text;
}

std::string html(const About& about, const std::vector<Cell>& cells) {
  std::string body = "<h1>Study " + page::escaped(about.study) + "</h1>\n<p><code>" + page::escaped(about.command) +
                     "</code><br>" + page::escaped(about.machine) + "; commit " + page::escaped(about.build) + "</p>\n";
  for (const std::string& note : about.notes) body += "<p>" + page::escaped(note) + "</p>\n";
  for (std::size_t i = 0; i < std::size(kTopicNames); ++i) {
    const auto topic = static_cast<Topic>(i);
    const std::vector<Cell> of = of_topic(cells, topic);
    if (of.empty()) continue;
    body += "<h2>" + page::escaped(kTopicNames[i]) + "</h2>\n";
    for (const Drawing& drawing : kDrawings)
      if (drawing.topic == topic) body += draw(of, drawing);
    if (topic == Topic::kStiffness) body += draw_stiffness(of);
    for (const Table& table : tables_of(of, topic)) {
      if (!table.caption.empty()) body += "<p>" + page::escaped(table.caption) + "</p>\n";
      body += page::table(table.rows);
    }
  }
  return page::page("Study " + about.study, body);
}

std::string csv(const std::vector<Cell>& cells) {
  std::string text =
      "topic,scenario,link,figure,unit,n,mean,low,high,difference_n,difference_mean,difference_low,difference_high\n";
  for (const Cell& cell : cells) {
    for (const CellFigure& figure : cell.figures) {
      char numbers[256];
      const Estimate &value = figure.value, &difference = figure.difference;
      std::snprintf(numbers, sizeof numbers, ",%zu,%.9g,%.9g,%.9g,%zu,%.9g,%.9g,%.9g\n", value.count, value.mean,
                    value.low, value.high, difference.count, difference.mean, difference.low, difference.high);
      text += std::string{kTopicNames[static_cast<std::size_t>(cell.topic)]} + ",\"" + cell.scenario + "\"," +
              cell.profile + ",\"" + figure.name + "\"," + figure.unit + numbers;
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
    all["cells"].push_back({{"topic", kTopicNames[static_cast<std::size_t>(cell.topic)]},
                            {"scenario", cell.scenario},
                            {"link", cell.profile},
                            {"figures", figures}});
  }
  return all.dump(2) + "\n";
}

}  // namespace tactus::study
