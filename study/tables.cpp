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

/// Returns the value with all digits before the decimal point. Whole numbers have no digits after it. Others have
/// three significant digits, but at most three after the decimal point.
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

std::string title(const FigureEstimates& figure) {
  return figure.name + (figure.unit.empty() ? "" : ", " + figure.unit);
}

/// The first row has the headings. The first column holds text, the others numbers.
struct Table {
  std::string caption;
  std::vector<std::vector<std::string>> rows;
};

template <class Value>
std::vector<Value> distinct(const std::vector<LinkResult>& results, Value LinkResult::*member) {
  std::vector<Value> values;
  for (const LinkResult& result : results)
    if (std::find(values.begin(), values.end(), result.*member) == values.end()) values.push_back(result.*member);
  return values;
}

const FigureEstimates* find(const std::vector<LinkResult>& results, const std::string& scenario,
                            const std::string& profile, const std::string& name) {
  for (const LinkResult& result : results) {
    if (result.scenario != scenario || result.profile != profile) continue;
    for (const FigureEstimates& figure : result.figures)
      if (figure.name == name) return &figure;
  }
  return nullptr;
}

std::vector<LinkResult> of_section(const std::vector<LinkResult>& results, Section section) {
  std::vector<LinkResult> found;
  for (const LinkResult& result : results)
    if (result.section == section) found.push_back(result);
  return found;
}

/// Returns the table of one figure, with a row for each link and a column for each scenario.
Table overview(const std::vector<LinkResult>& results, const std::string& name, const std::string& unit) {
  const std::vector<std::string> scenarios = distinct(results, &LinkResult::scenario);
  Table table{"", {{name + ", " + unit}}};
  table.rows.front().insert(table.rows.front().end(), scenarios.begin(), scenarios.end());
  for (const std::string& profile : distinct(results, &LinkResult::profile)) {
    std::vector<std::string> row{profile};
    for (const std::string& scenario : scenarios) {
      const FigureEstimates* const figure = find(results, scenario, profile, name);
      row.push_back(figure == nullptr ? "" : with_bounds(figure->value));
    }
    table.rows.push_back(row);
  }
  return table;
}

/// Returns the table of all figures, with a row for each result that has values.
Table details(const std::string& caption, const std::vector<LinkResult>& results, Estimate FigureEstimates::*member) {
  Table table{caption, {{"scenario, link"}}};
  for (const FigureEstimates& figure : results.front().figures) table.rows.front().push_back(title(figure));
  for (const LinkResult& result : results) {
    if ((result.figures.front().*member).count == 0) continue;
    std::vector<std::string> row{result.scenario + ", " + result.profile};
    for (const FigureEstimates& figure : result.figures) row.push_back(with_bounds(figure.*member));
    table.rows.push_back(row);
  }
  return table;
}

std::vector<Table> tables_of(const std::vector<LinkResult>& results, Section section) {
  std::vector<Table> tables;
  if (section == Section::kForces || section == Section::kTool)
    tables = {overview(results, "force error rms", "N"), overview(results, "above 1 JND", "% of contact")};
  if (section == Section::kTool) {
    tables.push_back(overview(results, "torque error rms", "mN m"));
    tables.push_back(overview(results, "torque above 1 JND", "% of contact"));
  }
  tables.push_back(details("", results, &FigureEstimates::value));
  if (section != Section::kStiffness && distinct(results, &LinkResult::profile).size() > 1)
    tables.push_back(details("Difference from " + std::string{kBaseline} + ", paired by seed:", results,
                             &FigureEstimates::difference));
  return tables;
}

std::string markdown(const Table& table) {
  std::string text = table.caption.empty() ? "" : table.caption + "\n\n";
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    text += "|";
    for (const std::string& field : table.rows[i]) text += " " + field + " |";
    text += "\n";
    if (i > 0) continue;
    text += "|---|";
    for (std::size_t k = 1; k < table.rows[i].size(); ++k) text += "--:|";
    text += "\n";
  }
  return text + "\n";
}

/// A plot of one figure over links, with a curve for each scenario and confidence intervals.
struct Drawing {
  Section section;
  const char* figure;
  bool logarithmic;
};
constexpr Drawing kDrawings[]{{Section::kForces, "above 1 JND", false},
                              {Section::kForces, "force error rms", false},
                              {Section::kForces, "onset time error", true},
                              {Section::kTool, "above 1 JND", false},
                              {Section::kTool, "torque above 1 JND", false},
                              {Section::kTool, "force error rms", false},
                              {Section::kTool, "torque error rms", false},
                              {Section::kFirstTouch, "time to exact contact", true},
                              {Section::kFirstTouch, "above 1 JND", false},
                              {Section::kTarget, "time on target", false},
                              {Section::kLift, "time held up", false},
                              {Section::kLift, "largest distance of copies", true},
                              {Section::kHandOver, "time to grant, mean", true},
                              {Section::kCollaboration, "largest distance of copies", true},
                              {Section::kCollaboration, "apparent mass / mass", false},
                              {Section::kCollaboration, "injected energy", true}};

/// The range of the values of a plot. A logarithmic scale ignores values below kMin.
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

std::string draw(const std::vector<LinkResult>& results, const Drawing& drawing) {
  const std::vector<std::string> profiles = distinct(results, &LinkResult::profile);
  const std::vector<std::string> scenarios = distinct(results, &LinkResult::scenario);
  Range range{drawing.logarithmic};
  const FigureEstimates* any = nullptr;
  for (const LinkResult& result : results) {
    const FigureEstimates* const figure = find(results, result.scenario, result.profile, drawing.figure);
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
      const FigureEstimates* const figure = find(results, scenarios[k], profiles[i], drawing.figure);
      if (figure == nullptr || figure->value.count == 0) continue;
      points.emplace_back(share(i), figure->value.mean);
      plot.bar(share(i), figure->value.low, figure->value.high, page::colour(k));
    }
    plot.curve(points, page::colour(k), 1.8);
  }
  plot.caption("link");
  return "<h3>" + page::escaped(title(*any)) + "</h3>\n" + plot.svg() + page::legend(scenarios);
}

/// Draws the stiffness over the round trip, with a curve for each method. Curves of analytic bounds are dashed.
std::string draw_stiffness(const std::vector<LinkResult>& results) {
  constexpr double kShortest = 1;  // ms, position of a zero round trip
  std::vector<std::string> names;
  Range range{true};
  for (const FigureEstimates& figure : results.front().figures)
    if (figure.name != kRoundTrip) names.push_back(figure.name);
  double longest = 2 * kShortest;
  for (const LinkResult& result : results)
    for (const FigureEstimates& figure : result.figures) {
      if (figure.name == kRoundTrip)
        longest = std::max(longest, figure.value.mean);
      else
        range.add(figure.value.mean);
    }
  page::Plot plot{range.scale()};
  const auto share = [&](double ms) {
    return std::log(std::max(ms, kShortest) / kShortest) / std::log(longest / kShortest);
  };
  for (const LinkResult& result : results) {
    const double ms = find(results, result.scenario, result.profile, kRoundTrip)->value.mean;
    plot.tick(share(ms), number(ms) + " ms");
  }
  for (std::size_t k = 0; k < names.size(); ++k) {
    std::vector<std::pair<double, double>> points;
    for (const LinkResult& result : results)
      points.emplace_back(share(find(results, result.scenario, result.profile, kRoundTrip)->value.mean),
                          find(results, result.scenario, result.profile, names[k])->value.mean);
    plot.curve(points, page::colour(k), 1.8, names[k].find("(") != std::string::npos);
  }
  plot.caption("round trip; dashed: analytic bounds");
  return "<h3>largest stable stiffness, N/m</h3>\n" + plot.svg() + page::legend(names);
}

ordered_json to_json(const Estimate& estimate) {
  return {{"n", estimate.count}, {"mean", estimate.mean}, {"low", estimate.low}, {"high", estimate.high}};
}

}  // namespace

std::string markdown(const About& about, const std::vector<LinkResult>& results) {
  std::string text =
      "# Study " + about.study + "\n\n`" + about.command + "`\n\n" + about.machine + "; commit " + about.build + ".\n";
  for (const std::string& note : about.notes) text += "\n" + note + "\n";
  for (std::size_t i = 0; i < std::size(kSectionNames); ++i) {
    const std::vector<LinkResult> of = of_section(results, static_cast<Section>(i));
    if (of.empty()) continue;
    text += std::string{"\n## "} + kSectionNames[i] + "\n\n";
    for (const Table& table : tables_of(of, static_cast<Section>(i))) text += markdown(table);
  }
  return text;
}

std::string html(const About& about, const std::vector<LinkResult>& results) {
  std::string body = "<h1>Study " + page::escaped(about.study) + "</h1>\n<p><code>" + page::escaped(about.command) +
                     "</code><br>" + page::escaped(about.machine) + "; commit " + page::escaped(about.build) + "</p>\n";
  for (const std::string& note : about.notes) body += "<p>" + page::escaped(note) + "</p>\n";
  for (std::size_t i = 0; i < std::size(kSectionNames); ++i) {
    const auto section = static_cast<Section>(i);
    const std::vector<LinkResult> of = of_section(results, section);
    if (of.empty()) continue;
    body += "<h2>" + page::escaped(kSectionNames[i]) + "</h2>\n";
    for (const Drawing& drawing : kDrawings)
      if (drawing.section == section) body += draw(of, drawing);
    if (section == Section::kStiffness) body += draw_stiffness(of);
    for (const Table& table : tables_of(of, section)) {
      if (!table.caption.empty()) body += "<p>" + page::escaped(table.caption) + "</p>\n";
      body += page::table(table.rows);
    }
  }
  return page::page("Study " + about.study, body);
}

namespace {

/// Returns the text as a field of a CSV file, in quotes.
std::string csv_field(const std::string& text) {
  std::string field = "\"";
  for (const char c : text) field += c == '"' ? std::string{"\"\""} : std::string(1, c);
  return field + "\"";
}

}  // namespace

std::string csv(const std::vector<LinkResult>& results) {
  std::string text =
      "topic,scenario,link,figure,unit,n,mean,low,high,difference_n,difference_mean,difference_low,difference_high\n";
  for (const LinkResult& result : results) {
    for (const FigureEstimates& figure : result.figures) {
      char numbers[256];
      const Estimate &value = figure.value, &difference = figure.difference;
      std::snprintf(numbers, sizeof numbers, ",%zu,%.9g,%.9g,%.9g,%zu,%.9g,%.9g,%.9g\n", value.count, value.mean,
                    value.low, value.high, difference.count, difference.mean, difference.low, difference.high);
      text += std::string{kSectionNames[static_cast<std::size_t>(result.section)]} + "," + csv_field(result.scenario) +
              "," + result.profile + "," + csv_field(figure.name) + "," + figure.unit + numbers;
    }
  }
  return text;
}

std::string json(const About& about, const std::vector<LinkResult>& results) {
  ordered_json all{{"study", about.study}, {"command", about.command}, {"machine", about.machine},
                   {"build", about.build}, {"notes", about.notes},     {"results", ordered_json::array()}};
  for (const LinkResult& result : results) {
    ordered_json figures = ordered_json::array();
    for (const FigureEstimates& figure : result.figures)
      figures.push_back({{"name", figure.name},
                         {"unit", figure.unit},
                         {"value", to_json(figure.value)},
                         {"difference", to_json(figure.difference)}});
    all["results"].push_back({{"topic", kSectionNames[static_cast<std::size_t>(result.section)]},
                              {"scenario", result.scenario},
                              {"link", result.profile},
                              {"figures", figures}});
  }
  return all.dump(2) + "\n";
}

}  // namespace tactus::study
