// Measures how long a host takes to open a model file that is not in memory, and its anonymous memory while it serves
// the model to several HRTCs. A host also checks the checksums of a file of up to 256 MiB. For comparison, all of the
// file is decoded, as `tactus mesh verify` does.
//
// A child process opens the file, so that the memory of the builder does not count. It also runs the clients of the
// HRTCs, so their memory counts too.
#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "session/delivery_client.hpp"
#include "session/delivery_server.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

struct Settings {
  std::string model;
  std::uint32_t faces = 2'000'000;
  std::uint32_t hrtcs = 8;
  std::uint32_t regions = 2'000;  // that each HRTC requests
};

constexpr char kChild[] = "--child";  // first argument of the child process; file, HRTCs and regions follow
constexpr std::int64_t kMs = 1'000'000;

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Returns the anonymous resident memory of this process, MiB.
double anonymous_memory() {
  std::ifstream status{"/proc/self/status"};
  for (std::string line; std::getline(status, line);)
    if (line.rfind("RssAnon:", 0) == 0) return std::stod(line.substr(8)) / 1024;
  throw std::runtime_error("/proc/self/status has no RssAnon");
}

/// Removes a file from the memory of the system.
void evict(const std::string& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) throw std::runtime_error(file + ": cannot be opened");
  const bool is_done = ::fsync(descriptor) == 0 && ::posix_fadvise(descriptor, 0, 0, POSIX_FADV_DONTNEED) == 0;
  ::close(descriptor);
  if (!is_done) throw std::runtime_error(file + ": cannot be removed from memory");
}

/// Serves a model to several clients, which request runs of regions at random places.
class Service {
 public:
  Service(const spm::codec::CompressedModel& model, const Settings& settings) : settings_{settings}, server_{kHost} {
    server_.add(kObject, model);
    session::CatalogueEntry entry;
    entry.origin = kHost;
    entry.object_id = kObject;
    entry.summary = model.summary();
    for (std::uint32_t i = 0; i < settings.hrtcs; ++i) {
      clients_.push_back(
          std::make_unique<session::DeliveryClient>(session::Origin{1, 20 + i, 1, 0}, session::DeliverySettings{}));
      clients_.back()->on_catalogue(entry);
      clients_.back()->open(kObject, entry.summary.digest);
      const std::uint32_t count = std::min(settings.regions, entry.summary.regions);
      first_region_.push_back(static_cast<std::uint32_t>(random_() % (entry.summary.regions - count + 1)));
    }
  }

  /// Runs the service until all clients have all their regions. Returns the number of received regions.
  std::uint64_t run() {
    std::uint64_t received = 0;
    const std::uint64_t expected = std::uint64_t{settings_.hrtcs} * settings_.regions;
    for (std::int64_t now = 1'000 * kMs; received < expected && now < 600'000 * kMs; now += kMs) {
      for (const auto& client : clients_) {
        client->on_host_heartbeat(kHost.participant, kHost.incarnation, now);
        while (const auto demand = client->demand(now)) server_.on_demand(*demand, now);
      }
      while (const auto out = server_.next(now)) received += deliver(*out, now);
    }
    return received;
  }

 private:
  static constexpr session::Origin kHost{1, 10, 1, 0};
  static constexpr std::uint64_t kObject = 1;

  std::uint64_t deliver(const session::Outgoing& out, std::int64_t now) {
    std::uint64_t received = 0;
    const std::size_t number = out.hrtc - 20;
    session::DeliveryClient& client = *clients_[number];
    for (const session::DeliveryClient::Message& message : client.on_chunk(out.chunk, now)) {
      if (message.kind == session::BulkKind::kBase) {
        client.answer_base_stored(kObject);
        std::vector<session::Wanted> wanted;
        for (std::uint32_t i = 0; i < settings_.regions; ++i) wanted.push_back({first_region_[number] + i, i});
        client.set_wanted(kObject, wanted);
      } else {
        client.answer_stored(kObject, message.region);
        ++received;
      }
    }
    return received;
  }

  Settings settings_;
  std::mt19937 random_{1};
  session::DeliveryServer server_;
  std::vector<std::unique_ptr<session::DeliveryClient>> clients_;
  std::vector<std::uint32_t> first_region_;  // by client
};

/// The child process: prints the time to open the file, the memory after it, the time to check its checksums, the
/// number of regions of a client, the number of received regions, the memory after that, and the time to decode the
/// whole file.
void serve(const std::string& file, Settings settings) {
  const double before = anonymous_memory();
  auto begin = std::chrono::steady_clock::now();
  const spm::offline::MappedModel model{file};
  const double opened = seconds_since(begin), after_opening = anonymous_memory() - before;
  begin = std::chrono::steady_clock::now();
  model.check_checksums();
  const double checked = seconds_since(begin);
  settings.regions = std::min(settings.regions, model.summary().regions);
  Service service{model.compressed(), settings};
  const std::uint64_t received = service.run();
  const double after_serving = anonymous_memory() - before;
  begin = std::chrono::steady_clock::now();
  static_cast<void>(model.decode());
  std::printf("%.9g %.9g %.9g %u %llu %.9g %.9g\n", opened, after_opening, checked, settings.regions,
              static_cast<unsigned long long>(received), after_serving, seconds_since(begin));
}

/// Returns the output of a command.
std::string output_of(const std::string& command) {
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe{::popen(command.c_str(), "r"), &::pclose};
  if (!pipe) throw std::runtime_error("cannot start " + command);
  std::string output;
  std::array<char, 256> part{};
  while (std::fgets(part.data(), part.size(), pipe.get()) != nullptr) output += part.data();
  return output;
}

Report run(const Settings& settings) {
  const test_support::TemporaryFolder folder;
  const std::string file = (folder.path() / "model.spm").string();
  spm::ModelSummary summary{};
  {
    const spm::offline::BuiltModel built =
        build_model(settings.model.empty() ? generate(spm::offline::Shape::kOrgan, settings.faces, 1)
                                           : spm::offline::import_mesh(settings.model));
    summary = built.summary;
    spm::offline::write_model(file, built.model(), {});
  }
  Report report{{settings.model.empty() ? "organ, seed 1" : settings.model, summary.digest, summary.faces,
                 std::to_string(settings.hrtcs) + " HRTCs"}};
  evict(file);
  std::istringstream out{output_of(std::filesystem::read_symlink("/proc/self/exe").string() + " " + kChild + " " +
                                   file + " " + std::to_string(settings.hrtcs) + " " +
                                   std::to_string(settings.regions))};
  double opened = 0, after_opening = 0, checked = 0, after_serving = 0, decoded = 0;
  std::uint64_t regions = 0, received = 0;
  if (!(out >> opened >> after_opening >> checked >> regions >> received >> after_serving >> decoded))
    throw std::runtime_error("the child process printed no results");
  report.add_value("size of the file", {"file", 1}, "MB", static_cast<double>(std::filesystem::file_size(file)) / 1e6);
  report.add_at_most("time to open the file, not in memory", {"file", 1}, "s", opened, 1);
  report.add_value("time to read it and check its checksums", {"file", 1}, "s", checked);
  report.add_value("time to check and decode the whole file", {"file", 1}, "s", decoded);
  report.add_value("anonymous memory of the opened model", {"file", 1}, "MiB", after_opening);
  report.add_at_most("anonymous memory of the host and its HRTCs", {"served HRTCs", settings.hrtcs}, "MiB",
                     after_serving, 64);
  report.add_at_least("received regions", {"requested regions", settings.hrtcs * regions}, "regions",
                      static_cast<double>(received), static_cast<double>(settings.hrtcs * regions));
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  if (argc == 5 && argv[1] == std::string{tactus::bench::kChild}) {
    settings.hrtcs = static_cast<std::uint32_t>(std::stoul(argv[3]));
    settings.regions = static_cast<std::uint32_t>(std::stoul(argv[4]));
    tactus::bench::serve(argv[2], settings);
    return 0;
  }
  tactus::bench::App app{"serve", "Measures how fast a host opens a model file, and its memory while it serves it",
                         "a smaller generated organ, for CI"};
  app.add_option("--model", settings.model, "mesh file of any kind (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")
      ->check(CLI::Range(1000u, 200'000'000u))
      ->capture_default_str();
  app.add_option("--hrtcs", settings.hrtcs, "number of HRTCs")->check(CLI::Range(1u, 64u))->capture_default_str();
  app.add_option("--regions", settings.regions, "regions that each HRTC requests")
      ->check(CLI::Range(1u, 100'000u))
      ->capture_default_str();
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.faces = 200'000;
    return tactus::bench::run(settings);
  });
}
