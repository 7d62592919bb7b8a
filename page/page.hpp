/// Pages of figures for a browser: one file that needs nothing from elsewhere, light or dark as the reader has it.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace tactus::page {

/// As text between tags or in an attribute.
[[nodiscard]] std::string escaped(const std::string& text);

/// `body` is HTML, `title` text.
[[nodiscard]] std::string page(const std::string& title, const std::string& body);

/// For what is drawn i-th; they come again after the last.
[[nodiscard]] const char* colour(std::size_t i) noexcept;

/// What is drawn in which colour: text of each curve, in order.
[[nodiscard]] std::string key(const std::vector<std::string>& names);

/// The first row is the head, the first column text; cells are text. Scrolls sideways where it is too wide.
[[nodiscard]] std::string table(const std::vector<std::vector<std::string>>& rows);

}  // namespace tactus::page
