#include "netem/profile.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>
#include <utility>

namespace tactus::netem {
namespace {

constexpr double kAToBShare = 0.7;  // asymmetric variant: share of the round trip's delay and jitter from a to b

/// `note`: text after the range: the reason for the upper limit, or a further valid value.
void check_range(const std::string& link, const char* what, double value, double low, double high,
                 const char* note = "") {
  if (value >= low && value <= high) return;
  char text[160];
  std::snprintf(text, sizeof text, "%s is %g; expected %g to %g%s", what, value, low, high, note);
  throw LinkError("link " + link + ": " + text);
}

void check_direction(const std::string& link, const LinkProfile& direction) {
  check_range(link, "delay, ms,", direction.delay_ms, 0, 10'000);
  check_range(link, "jitter, ms,", direction.jitter_ms, 0, direction.delay_ms, ", the delay");
  check_range(link, "loss", direction.loss, 0, 1);
  check_range(link, "probability of the start of bursts", direction.burst_start, 0, 1);
  check_range(link, "probability of the end of bursts", direction.burst_end, 1e-6, 1);
  check_range(link, "share of repeated frames", direction.repeat, 0, 1);
  if (direction.rate_mbit != 0)
    check_range(link, "rate, Mbit/s,", direction.rate_mbit, 0.001, 100'000, ", or 0 for no limit");
  if (direction.rate_mbit > 0) check_range(link, "queue, bytes,", direction.queue_bytes, 1514, 1e9);
}

bool limits_rate_only(const LinkProfile& direction) {
  return direction.delay_ms == 0 && direction.jitter_ms == 0 && !direction.reorder && direction.mean_loss() == 0 &&
         direction.repeat == 0;
}

LinkSettings named_link(const std::string& name) {
  std::string expected;
  for (const NamedLink& link : kNamedLinks) {
    expected += std::string{expected.empty() ? "" : ", "} + link.name;
    const bool asymmetric = link.medium == Medium::kRelay && name == std::string{link.name} + "a";
    if (name != link.name && !asymmetric) continue;
    LinkSettings settings{name, link.medium, link.each_direction, link.each_direction};
    if (asymmetric) {
      for (auto [direction, share] : {std::pair{&settings.a_to_b, kAToBShare}, {&settings.b_to_a, 1 - kAToBShare}}) {
        direction->delay_ms *= 2 * share;
        direction->jitter_ms *= 2 * share;
      }
    }
    return settings;
  }
  throw LinkError("no link '" + name + "'; expected " + expected +
                  ", or P0a to P8a (70 % of the round trip's delay and jitter from a to b)");
}

/// Applies `setting`, "KEY=VALUE" or "reorder", to a direction. `link`: the text of the whole link, for errors.
void apply_setting(LinkProfile& direction, const std::string& link, const std::string& setting) {
  const std::size_t equals = setting.find('=');
  const std::string key = setting.substr(0, equals);
  const std::string text = equals == std::string::npos ? "" : setting.substr(equals + 1);
  if (key == "reorder" && equals == std::string::npos) {
    direction.reorder = true;
    return;
  }
  const auto number = [&](const std::string& value_text) {
    std::size_t parsed = 0;
    double value = NAN;
    try {
      value = std::stod(value_text, &parsed);
    } catch (const std::logic_error&) {  // reported below
    }
    if (std::isnan(value) || parsed != value_text.size())
      throw LinkError("link " + link + ": " + key + " is '" + value_text + "'; expected a number");
    return value;
  };
  if (key == "delay")
    direction.delay_ms = number(text);
  else if (key == "jitter")
    direction.jitter_ms = number(text);
  else if (key == "loss")
    direction.loss = number(text) / 100;
  else if (key == "repeat")
    direction.repeat = number(text) / 100;
  else if (key == "rate")
    direction.rate_mbit = number(text);
  else if (key == "queue")
    direction.queue_bytes = static_cast<std::uint32_t>(std::clamp(number(text), 0.0, 4e9));
  else if (key == "burst" && text.find('/') != std::string::npos) {
    direction.burst_start = number(text.substr(0, text.find('/')));
    direction.burst_end = number(text.substr(text.find('/') + 1));
  } else {
    throw LinkError("link " + link + ": no setting '" + setting +
                    "'; expected delay=MS, jitter=MS, reorder, loss=PERCENT, burst=P/R, repeat=PERCENT, rate=MBIT or "
                    "queue=BYTES");
  }
}

}  // namespace

LinkSettings parse_link(const std::string& text) {
  std::istringstream parts{text};
  std::string part;
  std::getline(parts, part, ':');
  LinkSettings settings = named_link(part);
  settings.name = text;
  while (std::getline(parts, part, ':'))
    for (LinkProfile* direction : {&settings.a_to_b, &settings.b_to_a}) apply_setting(*direction, text, part);
  check(settings);
  return settings;
}

void check(const LinkSettings& settings) {
  check_direction(settings.name, settings.a_to_b);
  check_direction(settings.name, settings.b_to_a);
  if (settings.medium == Medium::kVeth && !(limits_rate_only(settings.a_to_b) && limits_rate_only(settings.b_to_a)))
    throw LinkError("link veth supports rate and queue only; for other settings use P0 with them");
}

std::string describe(const LinkProfile& profile) {
  char part[96];
  std::snprintf(part, sizeof part, "%g ms", profile.delay_ms);
  std::string text = part;
  if (profile.jitter_ms > 0) {
    std::snprintf(part, sizeof part, " +- %g%s", profile.jitter_ms, profile.reorder ? " out of order" : "");
    text += part;
  }
  if (profile.mean_loss() > 0) {
    std::snprintf(part, sizeof part, ", loss %.4g %%", 100 * profile.mean_loss());
    text += part;
  }
  if (profile.burst_start > 0) {
    std::snprintf(part, sizeof part, " in bursts of %.3g", 1 / profile.burst_end);
    text += part;
  }
  if (profile.repeat > 0) {
    std::snprintf(part, sizeof part, ", %.4g %% twice", 100 * profile.repeat);
    text += part;
  }
  if (profile.rate_mbit > 0) {
    std::snprintf(part, sizeof part, ", %g Mbit/s with %.4g kB of queue", profile.rate_mbit,
                  profile.queue_bytes * 1e-3);
    text += part;
  }
  return text;
}

}  // namespace tactus::netem
