// tactus-import: reads a model for import_mesh() (spm/offline/import.hpp), which starts it. It parses foreign files, so
// it works without rights: it gets open files from its parent, and returns the mesh through a file in memory.
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <ext/stdio_filebuf.h>
#include <new>
#include <span>
#include <string>
#include <string_view>
#include <system_error>

#include "spm/importer/confine.hpp"
#include "spm/importer/read_mesh.hpp"
#include "spm/offline/import_channel.hpp"

namespace tactus::spm::importer {
namespace {

namespace channel = offline::import_channel;

/// An open file.
class DescriptorStream : public std::istream {
 public:
  explicit DescriptorStream(int descriptor)
      : std::istream{nullptr}, buffer_{descriptor, std::ios::in | std::ios::binary, kBufferBytes} {
    if (!buffer_.is_open()) throw std::system_error{errno, std::generic_category(), "cannot read an open file"};
    rdbuf(&buffer_);
  }

 private:
  static constexpr std::size_t kBufferBytes = 65536;
  __gnu_cxx::stdio_filebuf<char> buffer_;  // closes the descriptor
};

/// Files that the parent opens.
class ParentFiles : public ModelFiles {
 public:
  std::unique_ptr<std::istream> open(const std::string& name) override {
    if (name.empty() || name.size() > channel::kMaxName) return nullptr;
    if (send(channel::kSocket, name.data(), name.size(), MSG_NOSIGNAL) < 0)
      throw std::system_error{errno, std::generic_category(), "cannot request a file"};
    const int descriptor = receive_descriptor();
    return descriptor < 0 ? nullptr : std::make_unique<DescriptorStream>(descriptor);
  }

 private:
  static int receive_descriptor() {
    channel::Answer answer = channel::Answer::kRefused;
    iovec data{&answer, sizeof answer};
    alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> control{};
    msghdr message{};
    message.msg_iov = &data;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    if (recvmsg(channel::kSocket, &message, MSG_CMSG_CLOEXEC) != sizeof answer)
      throw std::system_error{errno, std::generic_category(), "the parent does not answer"};
    const cmsghdr* const header = CMSG_FIRSTHDR(&message);
    if (answer != channel::Answer::kOpened || header == nullptr) return -1;
    int descriptor = -1;
    std::memcpy(&descriptor, CMSG_DATA(header), sizeof descriptor);
    return descriptor;
  }
};

void write_all(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(channel::kResult, bytes.data(), bytes.size());
    if (written < 0) throw std::system_error{errno, std::generic_category(), "the mesh is too large"};
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

void write_mesh(const offline::TriangleMesh& mesh) {
  const channel::ResultHeader header{0, mesh.positions.size(), mesh.faces.size()};
  write_all(std::as_bytes(std::span{&header, 1}));
  write_all(std::as_bytes(std::span{mesh.positions}));
  write_all(std::as_bytes(std::span{mesh.faces}));
}

void write_message(std::string_view message) {
  message = message.substr(0, channel::kMaxMessage);
  const channel::ResultHeader header{message.size(), 0, 0};
  if (lseek(channel::kResult, 0, SEEK_SET) != 0) throw std::system_error{errno, std::generic_category(), "lseek"};
  write_all(std::as_bytes(std::span{&header, 1}));
  write_all(std::as_bytes(std::span{message}));
}

}  // namespace
}  // namespace tactus::spm::importer

int main(int argc, char** argv) {
  using namespace tactus::spm;
  const std::string_view losses = argc == 3 ? argv[2] : "";
  if (losses != "refuse-losses" && losses != "allow-losses") {
    std::fputs("tactus-import reads a model for other programs of Tactus. See tactus mesh --help.\n", stderr);
    return 2;
  }
  try {
    importer::confine();
    importer::ParentFiles files;
    importer::write_mesh(importer::read_mesh(
        argv[1], files, losses == "allow-losses" ? offline::LossPolicy::kAllow : offline::LossPolicy::kRefuse));
  } catch (const std::bad_alloc&) {
    _exit(offline::import_channel::kOutOfMemory);
  } catch (const std::exception& error) {
    importer::write_message(error.what());
  }
  _exit(0);  // without the destructors of libraries, which may need rights
}
