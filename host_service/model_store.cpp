#include "host_service/model_store.hpp"

#include <sys/stat.h>
#include <xxhash.h>

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <future>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "spm/offline/build.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/pending_file.hpp"

namespace tactus::host_service {
namespace {

using spm::offline::FileNames;
using spm::offline::MappedModel;
using spm::offline::ModelError;

/// Raise this number when the builder makes another model from the same input. The host then rebuilds cached models.
constexpr std::uint32_t kBuilderVersion = 1;

class Hasher {
 public:
  void add(const void* data, std::size_t size) { XXH3_64bits_update(state_.get(), data, size); }
  void add(std::uint64_t number) { add(&number, sizeof number); }
  void add(const std::string& text) {
    add(text.size());
    add(text.data(), text.size());
  }
  /// Adds the rest of an open file. Returns false if it cannot be read.
  [[nodiscard]] bool add_file(std::FILE& file) {
    std::array<char, 1 << 16> block{};
    std::uint64_t size = 0;
    while (const std::size_t got = std::fread(block.data(), 1, block.size(), &file)) {
      add(block.data(), got);
      size += got;
    }
    add(size);
    return std::ferror(&file) == 0;
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

double seconds(const timespec& time) {
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Returns a time between those of all changes of files before and after this call, s since 1970. The system marks a
/// change with the time of its last tick, which may be some ms ago, so the call takes twice as long.
double file_time() {
  constexpr std::chrono::milliseconds kMaxTick{10};
  timespec called{};
  ::clock_gettime(CLOCK_REALTIME, &called);
  std::this_thread::sleep_for(2 * kMaxTick);
  return seconds(called) + std::chrono::duration<double>{kMaxTick}.count();
}

/// Returns a hash of a model and of the files that its reader requests. Reads each file once, and none that the reader
/// would not get. Throws ModelError if one of them has changed since `read_from` (file_time), from which on the reader
/// has read them: the hash would be that of another content.
std::uint64_t content_hash(const std::filesystem::path& model, const FileNames& requested, double read_from) {
  Hasher hasher;
  hasher.add(kBuilderVersion);
  hasher.add(spm::offline::kModelFileVersion);
  std::map<std::pair<dev_t, ino_t>, std::uint64_t> numbers;  // of the files read, from 1
  /// Returns the number of the file; 0: there is none of this name.
  const auto add_file = [&](const std::string& name) -> std::uint64_t {
    const int descriptor = spm::offline::open_requested(model, name);
    if (descriptor < 0) return 0;
    const std::unique_ptr<std::FILE, decltype(&std::fclose)> file{::fdopen(descriptor, "rb"), &std::fclose};
    struct stat status {};
    if (!file || ::fstat(descriptor, &status) != 0) throw ModelError{model.string() + ": cannot read the file " + name};
    if (seconds(status.st_ctim) >= read_from)
      throw ModelError{model.string() + ": the file " + name +
                       " changed while it was read; start again when it is whole"};
    const auto [found, is_new] = numbers.try_emplace({status.st_dev, status.st_ino}, numbers.size() + 1);
    if (is_new && !hasher.add_file(*file)) throw ModelError{model.string() + ": cannot read the file " + name};
    return found->second;
  };
  if (add_file(model.filename().string()) == 0) throw ModelError{model.string() + ": cannot be read"};
  for (const std::string& name : requested) {
    hasher.add(name);
    hasher.add(add_file(name));
  }
  return hasher.digest();
}

std::filesystem::path entry(const std::filesystem::path& cache, std::uint64_t content, const char* extension) {
  std::array<char, 32> name{};
  std::snprintf(name.data(), name.size(), "%016llx%s", static_cast<unsigned long long>(content), extension);
  return cache / name.data();
}

/// The files of the cache for a model. If the reader of the model requests other files, `names` has their names, each
/// with a zero at its end, because the hash of the model alone does not determine the result.
struct CacheEntry {
  std::filesystem::path names, built;
};

CacheEntry cache_entry(const std::filesystem::path& cache, const std::filesystem::path& model,
                       const FileNames& requested, double read_from) {
  const std::uint64_t content = content_hash(model, {}, read_from);
  return {entry(cache, content, ".files"),
          entry(cache, requested.empty() ? content : content_hash(model, requested, read_from), ".spm")};
}

/// Returns the entry for the names that the cache has for this model.
CacheEntry find_entry(const std::filesystem::path& cache, const std::filesystem::path& model) {
  constexpr double kNever = std::numeric_limits<double>::infinity();  // no reader has read them yet
  const CacheEntry alone = cache_entry(cache, model, {}, kNever);
  std::ifstream file{alone.names, std::ios::binary};
  FileNames requested;
  for (std::string name; std::getline(file, name, '\0');) requested.insert(name);
  return requested.empty() ? alone : cache_entry(cache, model, requested, kNever);
}

void write_names(const std::filesystem::path& path, const FileNames& requested) {
  if (requested.empty()) {
    std::error_code ignored;  // usually there is none
    std::filesystem::remove(path, ignored);
    return;
  }
  spm::offline::PendingFile file{path};
  for (const std::string& name : requested) file.write(name.c_str(), name.size() + 1);
  file.commit();
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

/// Opens an .spm file. Also checks the checksums of all of it, unless it is so large that this would take long.
MappedModel open_model(const std::filesystem::path& path) {
  constexpr std::uintmax_t kMaxChecked = 256u << 20;
  MappedModel model{path};
  if (std::filesystem::file_size(path) <= kMaxChecked) model.check_checksums();
  return model;
}

std::optional<MappedModel> open_cached(const std::filesystem::path& path, LogLines& lines) {
  if (!std::filesystem::exists(path)) return std::nullopt;
  try {
    return open_model(path);
  } catch (const ModelError& error) {
    lines.add(std::string{"the cached model is invalid and will be built again: "} + error.what());
    return std::nullopt;
  }
}

struct Built {
  spm::offline::BuiltModel model;
  FileNames requested;
  CacheEntry entry;
};

Built build(const std::filesystem::path& cache, const std::filesystem::path& model, LogLines& lines) {
  lines.add(model.string() + ": building");
  std::string last_stage;
  const double read_from = file_time();
  Built built;
  built.model = spm::offline::build_model_file(
      model, {},
      [&](std::string_view stage, double) {
        lines.expect_open();
        if (stage == last_stage) return;
        last_stage = stage;
        lines.add(model.string() + ": " + last_stage);
      },
      [&](const FileNames& requested) {
        built.requested = requested;
        built.entry = cache_entry(cache, model, requested, read_from);  // before the files change during a long build
      });
  return built;
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
    return unless_stopped(stop_, log_, [file](LogLines&) { return open_model(file); });
  };
  if (spm::offline::is_model_file(model) || model.extension() == ".spm") return open_file(model);

  const std::filesystem::path cached =
      unless_stopped(stop_, log_, [model, cache = cache_](LogLines&) { return find_entry(cache, model).built; });
  std::optional<MappedModel> ready =
      unless_stopped(stop_, log_, [cached](LogLines& lines) { return open_cached(cached, lines); });
  if (ready) {
    log_(model.string() + ": opened from the cache, " + cached.string());
    return std::move(*ready);
  }
  std::error_code failed;
  std::filesystem::create_directories(cache_, failed);
  if (failed) throw ModelError{cache_.string() + ": cannot make this folder for built models: " + failed.message()};
  const Built built =
      unless_stopped(stop_, log_, [model, cache = cache_](LogLines& lines) { return build(cache, model, lines); });
  // Written in this thread, so that Stopped leaves either the complete files or none.
  write_names(built.entry.names, built.requested);
  spm::offline::write_model(built.entry.built, built.model.model(), {model.filename().string(), built.model.cleaned});
  log_(model.string() + ": built and stored in " + built.entry.built.string());
  return open_file(built.entry.built);
}

}  // namespace tactus::host_service
