// Takes the place of tactus-import: confined as it is, but as if a hostile file had taken it over. The name of the
// model says what it does.
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <new>
#include <string>
#include <vector>

#include "spm/importer/confine.hpp"
#include "spm/offline/import_channel.hpp"

#ifdef __SANITIZE_ADDRESS__
/// A search for leaks needs system calls that this process has not, and a crash has to end it as without a sanitizer.
extern "C" const char* __asan_default_options() { return "detect_leaks=0:handle_segv=0:handle_abort=0"; }
#endif
#ifdef __SANITIZE_THREAD__
extern "C" const char* __tsan_default_options() { return "handle_segv=0:handle_abort=0"; }
#endif

namespace {

namespace channel = tactus::spm::offline::import_channel;

void put(const void* data, std::size_t bytes) {
  if (write(channel::kResult, data, bytes) != static_cast<ssize_t>(bytes)) _exit(9);
}

void put_header(std::uint64_t message_bytes, std::uint64_t vertices, std::uint64_t faces) {
  const channel::ResultHeader header{message_bytes, vertices, faces};
  put(&header, sizeof header);
}

void put_message(const std::string& message) {
  put_header(message.size(), 0, 0);
  put(message.data(), message.size());
}

/// Asks for a file. The answer is lost, and its descriptor is closed by the kernel.
void ask_for(const std::string& name) {
  if (send(channel::kSocket, name.data(), name.size(), MSG_NOSIGNAL) < 0) _exit(9);
  char answer = 0;
  if (recv(channel::kSocket, &answer, 1, 0) != 1) _exit(9);
}

[[noreturn]] void compute() {
  std::signal(SIGXCPU, SIG_IGN);
  for (;;) std::atomic_signal_fence(std::memory_order_seq_cst);
}

}  // namespace

int main(int, char** argv) {
  const std::filesystem::path model{argv[1]};
  const std::string behavior = model.stem().string();
  tactus::spm::importer::confine();
  ask_for(model.filename().string());
  const std::array<float, 9> triangle{0, 0, 0, 1, 0, 0, 0, 1, 0};
  if (behavior == "crash") {
    raise(SIGSEGV);
  } else if (behavior == "abort") {
    std::abort();
  } else if (behavior == "allocate") {
    std::vector<std::vector<char>> blocks;
    try {
      for (;;) blocks.emplace_back(100 << 20);
    } catch (const std::bad_alloc&) {
      return channel::kOutOfMemory;
    }
  } else if (behavior == "reserve") {  // address space, without writing to it
    std::uint64_t mib = 0;
    while (mmap(nullptr, 1 << 20, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) != MAP_FAILED) ++mib;
    put_message("reserved " + std::to_string(mib));
  } else if (behavior == "compute") {
    compute();
  } else if (behavior == "close") {
    close(channel::kSocket);
    compute();
  } else if (behavior == "empty_request") {
    (void)send(channel::kSocket, "", 0, MSG_NOSIGNAL);
    compute();
  } else if (behavior == "no_answers") {
    while (send(channel::kSocket, "x", 1, MSG_NOSIGNAL | MSG_DONTWAIT) == 1) {
    }
    compute();
  } else if (behavior == "flood") {
    const std::vector<char> block(1 << 20);
    while (write(channel::kResult, block.data(), block.size()) > 0) {
    }
  } else if (behavior == "ask") {
    for (;;) ask_for("other.bin");
  } else if (behavior == "status") {
    return 7;
  } else if (behavior == "short") {
    put("abc", 3);
  } else if (behavior == "huge") {
    put_header(0, UINT64_MAX / 12, UINT64_MAX / 12);
  } else if (behavior == "overflow") {  // the size would be right modulo 2^64
    put_header(0, (UINT64_MAX / 12) + 1, 0);
  } else if (behavior == "index") {
    const std::array<std::uint32_t, 3> face{0, 1, 3};
    put_header(0, 3, 1);
    put(triangle.data(), sizeof triangle);
    put(face.data(), sizeof face);
  } else if (behavior == "message") {
    put_message("\033[2Jall\x7f is \xc2\x9bwell\n");
  } else if (behavior == "killed") {
    raise(SIGKILL);
  } else if (behavior == "only_name") {
    put_message(model.string() + ": ");
  } else if (behavior == "only_spaces") {
    put_message(" \n");
  } else if (behavior == "long_message") {
    put_header(UINT64_MAX, 0, 0);
  }
  return 0;
}
