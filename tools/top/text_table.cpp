#include "tools/top/text_table.hpp"

#include <algorithm>

#include "session/printable.hpp"

namespace tactus::top {
namespace {

bool begins_character(char byte) { return (static_cast<unsigned char>(byte) & 0xc0u) != 0x80u; }

/// Number of characters of UTF-8 text.
std::size_t width(const std::string& text) {
  return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), begins_character));
}

/// Returns the first `count` characters.
std::string first_characters(const std::string& text, std::size_t count) {
  std::size_t at = 0;
  for (std::size_t seen = 0; at < text.size(); ++at)
    if (begins_character(text[at]) && seen++ == count) break;
  return text.substr(0, at);
}

}  // namespace

std::vector<Line> table(const std::vector<Row>& rows, const std::string& alignment) {
  // The widths are those of the printable cells, which differ from those of the cells.
  std::vector<std::vector<std::string>> cells;
  std::vector<std::size_t> widths(alignment.size(), 0);
  for (const Row& row : rows) {
    std::vector<std::string>& of_row = cells.emplace_back();
    for (const std::string& cell : row.cells) {
      of_row.push_back(session::printable(cell));
      std::size_t& max_width = widths.at(of_row.size() - 1);
      max_width = std::max(max_width, width(of_row.back()));
    }
  }
  std::vector<Line> lines;
  for (const std::vector<std::string>& of_row : cells) {
    std::string text;
    for (std::size_t i = 0; i < of_row.size(); ++i) {
      const std::string blanks(widths[i] - width(of_row[i]), ' ');
      text += (i == 0 ? "" : "  ") + (alignment[i] == 'l' ? of_row[i] + blanks : blanks + of_row[i]);
    }
    text.erase(text.find_last_not_of(' ') + 1);
    lines.push_back({text, lines.empty() ? Emphasis::kHead : rows[lines.size()].emphasis});
  }
  return lines;
}

std::vector<Line> fitted(std::vector<Line> lines, std::size_t columns, std::size_t rows) {
  if (lines.size() > rows && rows > 0) {
    const std::size_t missing = lines.size() - (rows - 1);
    lines.resize(rows - 1);
    lines.push_back({std::to_string(missing) + " more lines: enlarge the terminal", Emphasis::kHead});
  }
  for (Line& line : lines) line.text = first_characters(line.text, columns);
  return lines;
}

std::string ansi(const std::vector<Line>& lines) {
  constexpr char kHome[] = "\x1b[H", kEraseLine[] = "\x1b[K", kEraseBelow[] = "\x1b[J";
  constexpr char kBold[] = "\x1b[1m", kInverse[] = "\x1b[7m", kNormal[] = "\x1b[0m";
  std::string out = kHome;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const Emphasis emphasis = lines[i].emphasis;
    if (i > 0) out += "\n";
    out += emphasis == Emphasis::kHead ? kBold : emphasis == Emphasis::kAlert ? kInverse : "";
    out += lines[i].text + kNormal + kEraseLine;
  }
  return out + kEraseBelow;
}

std::string plain(const std::vector<Line>& lines) {
  std::string out;
  for (const Line& line : lines) out += line.text + '\n';
  return out;
}

}  // namespace tactus::top
