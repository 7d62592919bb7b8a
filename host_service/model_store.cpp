#include "host_service/model_store.hpp"

#include <xxhash.h>

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <regex>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "spm/offline/build.hpp"
#include "spm/offline/import.hpp"

namespace tactus::host_service {
namespace {

using spm::offline::MappedModel;
using spm::offline::ModelError;

/// Raise this number when the builder makes another model from the same input. The host then rebuilds cached models.
constexpr std::uint32_t kBuilderVersion = 1;

class Hasher {
 public:
  void add(const void* data, std::size_t size) { XXH3_64bits_update(state_.get(), data, size); }
  void add_file(const std::filesystem::path& path) {
    std::ifstream file{path, std::ios::binary};
    if (!file) throw ModelError{path.string() + ": cannot be read"};
    std::array<char, 1 << 16> block{};
    while (file.read(block.data(), block.size()), file.gcount() > 0) {
      add(block.data(), static_cast<std::size_t>(file.gcount()));
    }
  }
  [[nodiscard]] std::uint64_t digest() const { return XXH3_64bits_digest(state_.get()); }

 private:
  struct Free {
    void operator()(XXH3_state_t* state) const { XXH3_freeState(state); }
  };
  std::unique_ptr<XXH3_state_t, Free> state_ = [] {
    std::unique_ptr<XXH3_state_t, Free> state{XXH3_createState()};
    XXH3_64bits_reset(state.get());
    return state;
  }();
};

/// Returns a hash of the file and, for a glTF file, of the buffers that it names.
std::uint64_t content_hash(const std::filesystem::path& model) {
  Hasher hasher;
  hasher.add(&kBuilderVersion, sizeof kBuilderVersion);
  hasher.add(&spm::offline::kModelFileVersion, sizeof spm::offline::kModelFileVersion);
  hasher.add_file(model);
  if (model.extension() == ".gltf") {
    std::ifstream file{model, std::ios::binary};
    const std::string text{std::istreambuf_iterator<char>{file}, {}};
    static const std::regex uri{"\"uri\"\\s*:\\s*\"([^\"]{1,255})\""};
    for (std::sregex_iterator at{text.begin(), text.end(), uri}, end; at != end; ++at) {
      const std::filesystem::path buffer = model.parent_path() / (*at)[1].str();
      if (std::filesystem::is_regular_file(buffer)) hasher.add_file(buffer);
    }
  }
  return hasher.digest();
}

/// Passes log lines and the end of the work from a worker thread to the thread that waits for it.
class LogLines {
 public:
  void add(std::string line) {
    const std::lock_guard lock{mutex_};
    lines_.push_back(std::move(line));
  }
  /// Throws Stopped if the waiting thread waits no more.
  void expect_open() const {
    if (closed_) throw Stopped{};
  }
  [[nodiscard]] std::vector<std::string> take() {
    const std::lock_guard lock{mutex_};
    return std::exchange(lines_, {});
  }
  void close() { closed_ = true; }
  void finish() {
    const std::lock_guard lock{mutex_};
    finished_ = true;
    finishing_.notify_all();
  }
  /// Waits at most `limit` for the end of the work. Returns whether the work has ended.
  [[nodiscard]] bool wait_finished(std::chrono::milliseconds limit) {
    std::unique_lock lock{mutex_};
    return finishing_.wait_for(lock, limit, [this] { return finished_; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable finishing_;
  bool finished_ = false;
  std::vector<std::string> lines_;
  std::atomic<bool> closed_{false};
};

/// Runs `work(lines)` in a thread of its own, and returns its result or throws its exception. If `stop` is set before
/// the end of the work, throws Stopped. The thread then continues detached, so `work` must own all data that it uses.
template <class Work>
auto unless_stopped(const std::atomic<bool>& stop, const ModelStore::Log& log, Work work) {
  constexpr std::chrono::milliseconds kPatience{20};
  const auto lines = std::make_shared<LogLines>();
  using Task = std::packaged_task<std::invoke_result_t<Work, LogLines&>()>;
  Task task{[lines, work = std::move(work)]() mutable { return work(*lines); }};
  auto result = task.get_future();
  std::thread{[lines, task = std::move(task)]() mutable {
    task();
    task = Task{};  // before `finish`, so that only the waiting thread owns an exception
    lines->finish();
  }}.detach();
  for (bool done = false; !done;) {
    done = lines->wait_finished(kPatience);
    for (const std::string& line : lines->take()) log(line);
    if (!stop) continue;
    lines->close();
    throw Stopped{};
  }
  return result.get();
}

std::optional<MappedModel> open_cached(const std::filesystem::path& path, LogLines& lines) {
  if (!std::filesystem::exists(path)) return std::nullopt;
  try {
    MappedModel model{path};
    model.check_checksums();
    return model;
  } catch (const ModelError& error) {
    lines.add(std::string{"the cached model is invalid and will be built again: "} + error.what());
    return std::nullopt;
  }
}

spm::offline::BuiltModel build(const std::filesystem::path& model, LogLines& lines) {
  lines.add(model.string() + ": building");
  std::string last_stage;
  return spm::offline::build_model_file(model, {}, [&](std::string_view stage, double) {
    lines.expect_open();
    if (stage == last_stage) return;
    last_stage = stage;
    lines.add(model.string() + ": " + last_stage);
  });
}

}  // namespace

std::filesystem::path default_cache_directory() {
  if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache != nullptr && *cache == '/') {
    return std::filesystem::path{cache} / "tactus";
  }
  if (const char* home = std::getenv("HOME"); home != nullptr && *home == '/') {
    return std::filesystem::path{home} / ".cache" / "tactus";
  }
  return std::filesystem::temp_directory_path() / "tactus-cache";
}

ModelStore::ModelStore(std::filesystem::path cache, Log log, const std::atomic<bool>& stop)
    : cache_{std::move(cache)}, log_{std::move(log)}, stop_{stop} {}

MappedModel ModelStore::open(const std::filesystem::path& model) const {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(model, error);
  if (std::filesystem::is_directory(status)) spm::offline::fail(model, "is a folder, expected a model file");
  if (!std::filesystem::is_regular_file(status))
    spm::offline::fail(model, "no such model file" + (error ? ": " + error.message() : std::string{}));
  const auto open_file = [this](const std::filesystem::path& file) {
    return unless_stopped(stop_, log_, [file](LogLines&) { return MappedModel{file}; });
  };
  if (spm::offline::is_model_file(model) || model.extension() == ".spm") return open_file(model);

  std::array<char, 32> name{};
  const std::uint64_t content = unless_stopped(stop_, log_, [model](LogLines&) { return content_hash(model); });
  std::snprintf(name.data(), name.size(), "%016llx.spm", static_cast<unsigned long long>(content));
  const std::filesystem::path cached = cache_ / name.data();
  std::optional<MappedModel> ready =
      unless_stopped(stop_, log_, [cached](LogLines& lines) { return open_cached(cached, lines); });
  if (ready) {
    log_(model.string() + ": opened from the cache, " + cached.string());
    return std::move(*ready);
  }
  std::error_code failed;
  std::filesystem::create_directories(cache_, failed);
  if (failed) throw ModelError{cache_.string() + ": cannot make this folder for built models: " + failed.message()};
  const spm::offline::BuiltModel built =
      unless_stopped(stop_, log_, [model](LogLines& lines) { return build(model, lines); });
  // Written in this thread, so that Stopped leaves either the complete file or none.
  spm::offline::write_model(cached, built.model(), {model.filename().string(), built.cleaned});
  log_(model.string() + ": built and stored in " + cached.string());
  return open_file(cached);
}

}  // namespace tactus::host_service
