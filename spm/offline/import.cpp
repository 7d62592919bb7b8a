#include "spm/offline/import.hpp"

#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <limits>
#include <new>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/import_channel.hpp"
#include "spm/offline/model_file.hpp"

namespace tactus::spm::offline {
namespace {

namespace channel = import_channel;

constexpr int kMaxRequests = 1000;  // for files
/// How often the parent looks at the time: while the child can request files, and after that.
constexpr int kPollMs = 100, kEndPollMs = 5;

class Descriptor {
 public:
  explicit Descriptor(int value = -1) : value_{value} {}
  Descriptor(Descriptor&& other) noexcept : value_{std::exchange(other.value_, -1)} {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(value_, other.value_);
    return *this;
  }
  ~Descriptor() { close(); }
  [[nodiscard]] int get() const noexcept { return value_; }
  void close() noexcept {
    if (value_ >= 0) ::close(value_);
    value_ = -1;
  }

 private:
  int value_;
};

void check_readable(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found) fail(path, "no such file, expected a model");
  if (error) fail(path, "cannot be read: " + error.message());
  if (status.type() != std::filesystem::file_type::regular) fail(path, "is no regular file, expected a model");
  if (std::filesystem::file_size(path, error) == 0) fail(path, "found 0 bytes, expected a model");
  if (is_model_file(path)) fail(path, "is an SPM model already, expected a model of another format");
}

/// Finds the program tactus-import: TACTUS_IMPORT, or else near this code, or where `cmake --install` has put it.
std::filesystem::path importer_program() {
  if (const char* named = std::getenv("TACTUS_IMPORT"); named != nullptr && *named != '\0') return named;
  std::vector<std::filesystem::path> folders;
  std::vector<std::filesystem::path> binaries{"/proc/self/exe"};
  Dl_info library{};  // that contains this code, such as a module of Python
  if (dladdr(reinterpret_cast<const void*>(&importer_program), &library) != 0) binaries.emplace_back(library.dli_fname);
  for (const std::filesystem::path& binary : binaries) {
    std::error_code error;
    const std::filesystem::path folder = std::filesystem::canonical(binary, error).parent_path();
    for (const char* near : {".", "../bin", "../../bin", "../libexec/tactus"})
      if (!error) folders.push_back(folder / near);
  }
  folders.emplace_back(TACTUS_IMPORT_FOLDER);
  for (const std::filesystem::path& folder : folders)
    if (access((folder / "tactus-import").c_str(), X_OK) == 0) return folder / "tactus-import";
  throw ModelError{"found no program tactus-import, expected it in " TACTUS_IMPORT_FOLDER
                   "; the variable TACTUS_IMPORT can name it"};
}

/// Returns the smallest limit of memory of this process's control group and of those around it, such as that of a
/// service or of a container.
std::uint64_t memory_of_control_group() {
  std::uint64_t min_limit = std::numeric_limits<std::uint64_t>::max();
  std::ifstream groups{"/proc/self/cgroup"};
  for (std::string line; std::getline(groups, line);) {
    if (line.rfind("0::/", 0) != 0) continue;
    const std::filesystem::path root{"/sys/fs/cgroup"};
    for (std::filesystem::path group = root / line.substr(4);; group = group.parent_path()) {
      std::ifstream limit{group / "memory.max"};  // a number, or "max"
      if (std::uint64_t bytes = 0; limit >> bytes) min_limit = std::min(min_limit, bytes);
      if (group == root || group == group.parent_path()) break;
    }
  }
  return min_limit;
}

/// A message must not command the terminal.
void replace_control_characters(std::string& text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto code = static_cast<unsigned char>(text[i]);
    // The bytes 0xc2 0x80 to 0xc2 0x9f are the control characters U+0080 to U+009F.
    const bool is_second = i > 0 && static_cast<unsigned char>(text[i - 1]) == 0xc2 && code >= 0x80 && code < 0xa0;
    if (is_second) text[i - 1] = ' ';
    if (is_second || code < ' ' || code == 0x7f) text[i] = ' ';
  }
}

/// Lets this process wait for its children, even if it ignores SIGCHLD, until the end of the object. Such a process must
/// not import two models at the same time.
class WaitableChildren {
 public:
  WaitableChildren() {
    struct sigaction waitable {};
    waitable.sa_handler = SIG_DFL;
    if (sigaction(SIGCHLD, nullptr, &before_) != 0) return;
    is_ignored_ = before_.sa_handler == SIG_IGN || (before_.sa_flags & SA_NOCLDWAIT) != 0;
    if (is_ignored_) sigaction(SIGCHLD, &waitable, nullptr);
  }
  ~WaitableChildren() {
    if (is_ignored_) sigaction(SIGCHLD, &before_, nullptr);
  }
  WaitableChildren(const WaitableChildren&) = delete;
  WaitableChildren& operator=(const WaitableChildren&) = delete;

 private:
  struct sigaction before_ {};
  bool is_ignored_ = false;
};

/// The child process that reads a model.
class ImportProcess {
 public:
  ImportProcess(const std::filesystem::path& model, LossPolicy losses, FileNames* requested)
      : model_{model}, requested_{requested} {
    std::array<int, 2> sockets{};
    require(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, sockets.data()) == 0, "socketpair");
    socket_ = Descriptor{sockets[0]};
    const Descriptor child_socket = above_result(Descriptor{sockets[1]});
    result_ = Descriptor{memfd_create("tactus-import", MFD_CLOEXEC)};
    require(result_.get() >= 0, "memfd_create");
    result_ = above_result(result_);
    start(child_socket, losses);
  }
  ~ImportProcess() {
    if (child_ <= 0) return;
    kill(child_, SIGKILL);
    int status = 0;
    waitpid(child_, &status, 0);
  }
  ImportProcess(const ImportProcess&) = delete;
  ImportProcess& operator=(const ImportProcess&) = delete;

  [[nodiscard]] TriangleMesh mesh() {
    check_end(serve_until_end());
    return read_result();
  }

 private:
  /// Throws if `error`, a number of errno, is not 0.
  void require_no_error(int error, const std::string& what) const {
    if (error != 0) fail(model_, "cannot be imported: " + what + ": " + std::generic_category().message(error));
  }
  /// Throws with errno if `succeeded` is false.
  void require(bool succeeded, const char* what) const {
    if (!succeeded) require_no_error(errno, what);
  }

  /// Returns a descriptor of the same file, above those of the child, which would replace it.
  [[nodiscard]] Descriptor above_result(const Descriptor& file) const {
    Descriptor copy{fcntl(file.get(), F_DUPFD_CLOEXEC, channel::kResult + 1)};
    require(copy.get() >= 0, "fcntl(F_DUPFD_CLOEXEC)");
    return copy;
  }

  void start(const Descriptor& child_socket, LossPolicy losses) {
    const std::string program = importer_program(), model = model_.string();
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, 1, "/dev/null", O_WRONLY, 0);
#ifndef TACTUS_SANITIZED  // sanitizers report there
    posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
#endif
    posix_spawn_file_actions_adddup2(&actions, child_socket.get(), channel::kSocket);
    posix_spawn_file_actions_adddup2(&actions, result_.get(), channel::kResult);
    posix_spawn_file_actions_addclosefrom_np(&actions, channel::kResult + 1);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setpgroup(&attributes, 0);  // Ctrl-C ends the parent, and with it the child
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    const char* const arguments[] = {"tactus-import", model.c_str(),
                                     losses == LossPolicy::kAllow ? "allow-losses" : "refuse-losses", nullptr};
    std::vector<std::string> variables;
    for (const char* name : {"LD_LIBRARY_PATH", "ASAN_OPTIONS", "TSAN_OPTIONS", "UBSAN_OPTIONS"})
      if (const char* value = std::getenv(name)) variables.push_back(std::string{name} + "=" + value);
    std::vector<char*> environment;
    for (std::string& entry : variables) environment.push_back(entry.data());
    environment.push_back(nullptr);
    const int error = posix_spawn(&child_, program.c_str(), &actions, &attributes, const_cast<char* const*>(arguments),
                                  environment.data());
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    if (error != 0) child_ = -1;
    require_no_error(error, program);
    // If memory is short, the system ends the reader instead of this program.
    std::ofstream{"/proc/" + std::to_string(child_) + "/oom_score_adj"} << 1000;
  }

  /// Opens files for the child until it ends, or until it has exceeded a limit and is killed. Returns its status, as
  /// waitpid() does. The child could ignore the signal of RLIMIT_CPU, so this process measures the time.
  [[nodiscard]] int serve_until_end() {
    clockid_t clock{};
    const int error = clock_getcpuclockid(child_, &clock);
    require_no_error(error, "clock_getcpuclockid");
    const auto began = std::chrono::steady_clock::now();
    int requests = 0;
    for (;;) {
      pollfd request{socket_.get(), POLLIN, 0};  // poll() ignores a closed socket
      if (poll(&request, 1, socket_.get() < 0 ? kEndPollMs : kPollMs) > 0 && serve_request() &&
          ++requests > kMaxRequests)
        end_child("requests more than " + std::to_string(kMaxRequests) + " files");
      int status = 0;
      const pid_t ended = waitpid(child_, &status, WNOHANG);
      require(ended >= 0 || errno == EINTR, "waitpid");
      if (ended > 0) {
        child_ = -1;
        return status;
      }
      timespec used{};
      clock_gettime(clock, &used);
      const channel::Limits limits = channel::limits_for(bytes_);
      if (static_cast<std::uint64_t>(used.tv_sec) >= limits.computing_s)
        end_child("takes more than " + std::to_string(limits.computing_s) + " s of computing time");
      const std::chrono::seconds wall_clock_limit{limits.elapsed_s};
      if (std::chrono::steady_clock::now() - began > wall_clock_limit)
        end_child("takes more than " + std::to_string(wall_clock_limit.count()) + " s");
    }
  }

  /// Throws; the destructor kills the child.
  [[noreturn]] void end_child(const std::string& excess) const { fail(model_, excess + limit_of_size()); }
  [[nodiscard]] std::string limit_of_size() const {
    return ", the limit for a model of " + std::to_string(bytes_) + " bytes";
  }

  /// Answers a request. Returns false if the child has closed its end.
  bool serve_request() {
    std::array<char, channel::kMaxName> name;
    const ssize_t size = recv(socket_.get(), name.data(), name.size(), MSG_DONTWAIT);
    if (size <= 0) {
      socket_.close();
      return false;
    }
    answer(open_file({name.data(), static_cast<std::size_t>(size)}));
    return true;
  }

  [[nodiscard]] Descriptor open_file(std::string_view name) {
    if (name.find('\0') != std::string_view::npos) return Descriptor{};
    if (requested_ != nullptr && name != model_.filename().string()) requested_->emplace(name);
    Descriptor file{open_requested(model_, name)};
    struct stat status {};
    if (file.get() < 0 || fstat(file.get(), &status) != 0) return Descriptor{};
    if (known_files_.emplace(status.st_dev, status.st_ino).second) bytes_ += static_cast<std::uint64_t>(status.st_size);
    set_limits();
    return file;
  }

  void set_limits() const {
    const auto limit = [&](__rlimit_resource resource, std::uint64_t value) {
      rlimit limits{};
      require(prlimit(child_, resource, nullptr, &limits) == 0, "prlimit");
      limits.rlim_cur = std::min<rlim_t>(value, limits.rlim_max);  // the child may not raise it, so rlim_max can stay
      require(prlimit(child_, resource, &limits, nullptr) == 0, "prlimit");
    };
#ifndef TACTUS_SANITIZED  // sanitizers reserve terabytes of addresses
    limit(RLIMIT_AS, memory_limit());
#endif
    limit(RLIMIT_FSIZE, memory_limit() / 2);  // the reader still has the mesh when it writes it
    limit(RLIMIT_NOFILE, 64);
  }
  /// At most the memory of this machine and of the control group, because a file with holes has more bytes than it
  /// takes on the disk.
  [[nodiscard]] std::uint64_t memory_limit() const {
    const auto machine = static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES) * sysconf(_SC_PAGESIZE));
    return std::min({channel::limits_for(bytes_).memory_bytes, machine, memory_of_group_});
  }

  void answer(const Descriptor& file) const {
    channel::Answer answer = file.get() < 0 ? channel::Answer::kRefused : channel::Answer::kOpened;
    iovec data{&answer, sizeof answer};
    alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> control{};
    msghdr message{};
    message.msg_iov = &data;
    message.msg_iovlen = 1;
    if (file.get() >= 0) {
      message.msg_control = control.data();
      message.msg_controllen = control.size();
      cmsghdr* const header = CMSG_FIRSTHDR(&message);
      header->cmsg_level = SOL_SOCKET;
      header->cmsg_type = SCM_RIGHTS;
      header->cmsg_len = CMSG_LEN(sizeof(int));
      const int descriptor = file.get();
      std::memcpy(CMSG_DATA(header), &descriptor, sizeof descriptor);
    }
    (void)sendmsg(socket_.get(), &message, MSG_NOSIGNAL | MSG_DONTWAIT);  // fails if the child reads no answers
  }

  /// Throws unless the child has ended by itself, with a result.
  void check_end(int status) const {
    const std::string memory =
        "needs more than " + std::to_string(memory_limit() >> 20) + " MiB of memory" + limit_of_size();
    if (WIFSIGNALED(status)) {
      const int signal = WTERMSIG(status);
      if (signal == SIGXFSZ) fail(model_, memory);
      if (signal == SIGKILL)
        fail(model_, "the reader was killed, probably because this machine or its container has too little memory");
      fail(model_, std::string{"the reader crashed ("} + strsignal(signal) +
                       "), so the file is damaged or hostile; expected a model");
    }
    if (WEXITSTATUS(status) == channel::kOutOfMemory) fail(model_, memory);
    if (WEXITSTATUS(status) != 0)
      fail(model_, "cannot be imported: tactus-import ended with status " + std::to_string(WEXITSTATUS(status)));
  }

  /// Reads the result. Whatever the child has written, the mesh is valid, and a message is one line of text.
  [[nodiscard]] TriangleMesh read_result() const {
    channel::ResultHeader header;
    const std::uint64_t size = static_cast<std::uint64_t>(std::max<off_t>(lseek(result_.get(), 0, SEEK_END), 0));
    std::uint64_t at = 0;
    const auto read = [&](void* to, std::uint64_t bytes) {
      for (auto* next = static_cast<char*>(to); bytes > 0;) {
        const ssize_t got = pread(result_.get(), next, bytes, static_cast<off_t>(at));
        if (got <= 0) return false;
        next += got, at += static_cast<std::uint64_t>(got), bytes -= static_cast<std::uint64_t>(got);
      }
      return true;
    };
    const auto check = [&](bool valid) {
      if (!valid) fail(model_, "the reader returned no valid mesh, so the file is damaged or hostile");
    };
    check(read(&header, sizeof header));
    if (header.message_bytes > 0) {
      std::string message(std::min<std::uint64_t>(header.message_bytes, channel::kMaxMessage), '\0');
      check(read(message.data(), message.size()));
      replace_control_characters(message);
      if (const std::string name = model_.string() + ": "; message.rfind(name, 0) == 0) message.erase(0, name.size());
      if (message.find_first_not_of(' ') == std::string::npos)
        message = "the reader returned neither a mesh nor a reason, so the file is damaged or hostile";
      fail(model_, message);
    }
    TriangleMesh mesh;
    constexpr std::uint64_t kVertexBytes = sizeof mesh.positions[0], kFaceBytes = sizeof mesh.faces[0];
    check(header.vertices <= size / kVertexBytes && header.faces <= size / kFaceBytes &&
          size == sizeof header + header.vertices * kVertexBytes + header.faces * kFaceBytes);
    mesh.positions.resize(header.vertices);
    mesh.faces.resize(header.faces);
    check(read(mesh.positions.data(), header.vertices * kVertexBytes) &&
          read(mesh.faces.data(), header.faces * kFaceBytes));
    for (const Triangle& face : mesh.faces)
      for (const std::uint32_t vertex : face) check(vertex < header.vertices);
    return mesh;
  }

  const std::filesystem::path& model_;
  FileNames* const requested_;
  Descriptor socket_, result_;
  pid_t child_ = -1;
  std::set<std::pair<dev_t, ino_t>> known_files_;  // that the child has opened
  std::uint64_t bytes_ = 0;                        // their size
  const std::uint64_t memory_of_group_ = memory_of_control_group();
  const WaitableChildren waitable_;
};

}  // namespace

int open_requested(const std::filesystem::path& model, std::string_view name) {
  std::filesystem::path path = model;
  if (name != model.filename().string()) {
    std::error_code error;
    const std::filesystem::path folder =
        std::filesystem::canonical(model.has_parent_path() ? model.parent_path() : std::filesystem::path{"."}, error);
    if (!error) path = std::filesystem::canonical(folder / name, error);
    if (error || std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first != folder.end()) return -1;
  }
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  struct stat status {};
  if (file < 0 || (fstat(file, &status) == 0 && S_ISREG(status.st_mode))) return file;
  close(file);
  return -1;
}

TriangleMesh import_mesh(const std::filesystem::path& path, LossPolicy losses, FileNames* requested) {
  check_readable(path);
  try {
    return ImportProcess{path, losses, requested}.mesh();
  } catch (const std::bad_alloc&) {
    fail(path, "the mesh needs more memory than this program can get");
  }
}

}  // namespace tactus::spm::offline
