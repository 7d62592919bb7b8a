/// Lays out lines of text for a terminal.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace tactus::top {

enum class Emphasis {
  kNone,
  kHead,  ///< head of a table
  kAlert  ///< something that a person has to see: a stop, a fault, a participant that fell silent
};

struct Line {
  std::string text;  ///< UTF-8 without control characters
  Emphasis emphasis = Emphasis::kNone;
};

struct Row {
  std::vector<std::string> cells;
  Emphasis emphasis = Emphasis::kNone;
};

/// Aligns the cells of all rows in columns. The first row is the head. Column i is aligned to the left if `alignment[i]`
/// is 'l', and to the right if it is 'r'. Replaces control characters.
[[nodiscard]] std::vector<Line> table(const std::vector<Row>& rows, const std::string& alignment);

/// Cuts the lines to a terminal of this size. If there are too many lines, the last one states how many are missing.
[[nodiscard]] std::vector<Line> fitted(std::vector<Line> lines, std::size_t columns, std::size_t rows);

/// Returns what a terminal needs to replace the screen by these lines: text with ANSI escape sequences. The cursor ends
/// below the last line.
[[nodiscard]] std::string ansi(const std::vector<Line>& lines);
/// Returns the lines without escape sequences.
[[nodiscard]] std::string plain(const std::vector<Line>& lines);

}  // namespace tactus::top
