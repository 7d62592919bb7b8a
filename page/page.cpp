#include "page/page.hpp"

namespace tactus::page {
namespace {

constexpr std::array kColours{"#2b6cb0", "#c05621", "#2f855a", "#9b2c2c", "#6b46c1", "#b7791f", "#0987a0", "#97266d"};

constexpr char kStyle[] = R"(
body{font:15px/1.45 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#1a202c;background:#fff}
h1{font-size:1.4rem}h2{font-size:1.1rem;margin-top:2.2rem}code{font-size:.85rem;word-break:break-all}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.82rem;font-variant-numeric:tabular-nums}
th,td{padding:.2rem .5rem;text-align:right;border-bottom:1px solid #cbd5e0;white-space:nowrap}
th:first-child,td:first-child{text-align:left}svg{width:100%;height:auto}svg text{font:12px system-ui,sans-serif;fill:#4a5568}
.key span{display:inline-block;width:1.2rem;height:.2rem;vertical-align:middle;margin-right:.4rem}.key div{font-size:.85rem}
@media (prefers-color-scheme:dark){body{color:#e2e8f0;background:#171c26}svg text{fill:#a0aec0}th,td{border-color:#2d3748}}
)";

}  // namespace

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '&')
      out += "&amp;";
    else if (c == '"')
      out += "&quot;";
    else
      out += c;
  }
  return out;
}

std::string page(const std::string& title, const std::string& body) {
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>" + escaped(title) +
         "</title>\n<style>" + kStyle + "</style></head><body>\n" + body + "</body></html>\n";
}

const char* colour(std::size_t i) noexcept { return kColours[i % kColours.size()]; }

std::string legend(const std::vector<std::string>& names) {
  std::string out = "<div class=\"key\">\n";
  for (std::size_t i = 0; i < names.size(); ++i)
    out += std::string{"<div><span style=\"background:"} + colour(i) + "\"></span>" + escaped(names[i]) + "</div>\n";
  return out + "</div>\n";
}

std::string table(const std::vector<std::vector<std::string>>& rows) {
  std::string out = "<div class=\"wide\"><table>\n";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::string tag = i == 0 ? "th" : "td";
    out += "<tr>";
    for (const std::string& text : rows[i]) out += "<" + tag + ">" + escaped(text) + "</" + tag + ">";
    out += "</tr>\n";
  }
  return out + "</table></div>\n";
}

}  // namespace tactus::page
