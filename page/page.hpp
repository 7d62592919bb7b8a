/// HTML pages of figures: one file without external parts, in the light or dark colour scheme of the browser.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace tactus::page {

/// Escapes text for use between tags or in an attribute.
[[nodiscard]] std::string escaped(const std::string& text);

/// A complete page; `body` is HTML, `title` is text.
[[nodiscard]] std::string page(const std::string& title, const std::string& body);

/// Colour of the i-th curve; colours repeat after the last.
[[nodiscard]] const char* colour(std::size_t i) noexcept;

/// Legend: the names of the curves in order, with their colours.
[[nodiscard]] std::string key(const std::vector<std::string>& names);

/// An HTML table; entries are plain text. The first row is the head. A wide table scrolls horizontally.
[[nodiscard]] std::string table(const std::vector<std::vector<std::string>>& rows);

}  // namespace tactus::page
