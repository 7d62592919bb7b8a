/// Makes HTML pages with text, tables and plots. A page is one file without references to other files. It follows the
/// light or dark colour scheme of the browser.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace tactus::page {

/// Escapes text, so that it can stand between tags or in an attribute.
[[nodiscard]] std::string escaped(const std::string& text);

/// Returns a complete page. `title` is text, `body` is HTML.
[[nodiscard]] std::string page(const std::string& title, const std::string& body);

/// Returns the colour of curve i, as HTML. There are eight colours, which repeat.
[[nodiscard]] const char* colour(std::size_t i) noexcept;

/// Returns a legend as HTML: the names of the curves in order, with their colours.
[[nodiscard]] std::string legend(const std::vector<std::string>& names);

/// Returns an HTML table. The entries are text. The first row is the head. A wide table scrolls horizontally.
[[nodiscard]] std::string table(const std::vector<std::vector<std::string>>& rows);

}  // namespace tactus::page
