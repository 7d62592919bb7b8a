#include "study/results.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

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
    run.figures.push_back({figure.at("name"), figure.at("unit"),
                           figure.at("value").is_number() ? figure.at("value").get<double>() : std::nan("")});
  return run;
}

/// Makes the folder, and returns it. A folder that cannot be made shows when its first file is opened.
std::filesystem::path made(const std::filesystem::path& folder) {
  std::error_code ignored;
  std::filesystem::create_directories(folder, ignored);
  return folder;
}

}  // namespace

FileLock::FileLock(const std::filesystem::path& file)
    : descriptor_{::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666)} {
  if (descriptor_ < 0) throw std::runtime_error("cannot write " + file.string());
  // Some file systems have no locks. A study runs there too, without this protection.
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK) return;
  ::close(descriptor_);
  throw std::runtime_error(file.string() + ": another running study writes it; expected a folder of its own (--out)");
}

FileLock::~FileLock() { ::close(descriptor_); }

RunLog::RunLog(const std::filesystem::path& folder, const std::string& study)
    : file_{made(folder) / "runs.jsonl"}, lock_{file_} {
  std::error_code error;
  std::ifstream in{file_};
  std::string line;
  std::uint64_t complete = 0;  // bytes of complete lines; the rest of the file is cut off
  if (in && std::getline(in, line)) {
    const bool is_incomplete = in.eof() && study.starts_with(line);
    if (line != study && !is_incomplete) {
      throw std::runtime_error(file_.string() + ": has runs of another study, program or model; expected none, or '" +
                               study + "'");
    }
    if (!is_incomplete) complete = line.size() + 1;
    while (std::getline(in, line) && !in.eof()) {
      const ordered_json parsed = ordered_json::parse(line, nullptr, false);
      if (parsed.is_discarded()) break;
      (void)append(run_from(parsed));
      complete += line.size() + 1;
    }
    in.close();
    std::filesystem::resize_file(file_, complete, error);
    if (error) throw std::runtime_error(file_.string() + ": cannot cut off an incomplete line: " + error.message());
  }
  out_.open(file_, std::ios::app);
  if (complete == 0) out_ << study << std::endl;
  if (!out_) throw std::runtime_error("cannot write " + file_.string());
}

bool RunLog::has(const std::string& scenario, const std::string& profile, std::uint64_t seed) const {
  return keys_.count({scenario, profile, seed}) > 0;
}

bool RunLog::append(Run run) {
  if (!keys_.emplace(run.scenario, run.profile, run.seed).second) return false;
  runs_.push_back(std::move(run));
  return true;
}

void RunLog::add(const Run& run) {
  if (!append(run)) return;
  out_ << to_json(run).dump() << std::endl;
  if (!out_) throw std::runtime_error("cannot write " + file_.string());
}

std::vector<LinkResult> results_by_link(const std::vector<Run>& runs, const std::vector<Experiment>& experiments) {
  std::vector<LinkResult> results;
  for (const Experiment& experiment : experiments) {
    const std::string& scenario = experiment.name;
    for (const std::string& profile : experiment.profiles) {
      LinkResult result{scenario, profile, experiment.section, {}};
      std::vector<std::vector<double>> values, differences;
      for (const Run& run : runs) {
        if (run.scenario != scenario || run.profile != profile) continue;
        const auto base = std::find_if(runs.begin(), runs.end(), [&](const Run& other) {
          return other.scenario == scenario && other.profile == kBaseline && other.seed == run.seed;
        });
        for (std::size_t i = 0; i < run.figures.size(); ++i) {
          if (i == result.figures.size()) {
            result.figures.push_back({run.figures[i].name, run.figures[i].unit, {}, {}});
            values.emplace_back();
            differences.emplace_back();
          }
          if (std::isnan(run.figures[i].value)) continue;
          values[i].push_back(run.figures[i].value);
          if (base != runs.end() && profile != kBaseline && i < base->figures.size() &&
              !std::isnan(base->figures[i].value))
            differences[i].push_back(run.figures[i].value - base->figures[i].value);
        }
      }
      for (std::size_t i = 0; i < result.figures.size(); ++i) {
        result.figures[i].value = estimate(values[i]);
        result.figures[i].difference = estimate(differences[i]);
      }
      if (!result.figures.empty()) results.push_back(std::move(result));
    }
  }
  return results;
}

std::string trace_file_name(const Run& run, std::size_t user) {
  const auto encoded = [](const std::string& name) {
    std::string text;
    for (const char c : name) {
      const bool is_safe = (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '.' ||
                           c == '_' || c == '-';
      char code[16];
      std::snprintf(code, sizeof code, "%%%02X", static_cast<unsigned>(static_cast<unsigned char>(c)));
      text += is_safe ? std::string(1, c) : code;
    }
    return text;
  };
  return encoded(run.scenario) + "-" + encoded(run.profile) + "-" + std::to_string(run.seed) + "-" +
         std::to_string(user + 1) + ".csv";
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
