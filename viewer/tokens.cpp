#include "viewer/tokens.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <random>
#include <stdexcept>
#include <string_view>
#include <system_error>

namespace tactus::viewer {
namespace {

constexpr std::string_view kHexDigits = "0123456789abcdef";
constexpr std::size_t kTokenDigits = 32;
constexpr std::size_t kMaxFileBytes = 256;

std::string make_token() {
  std::random_device random;
  std::string token;
  for (std::size_t i = 0; i < kTokenDigits; ++i) token += kHexDigits[random() % kHexDigits.size()];
  return token;
}

/// A file that closes at destruction.
struct OpenFile {
  explicit OpenFile(int descriptor) : fd{descriptor} {}
  ~OpenFile() {
    if (fd >= 0) close(fd);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  int fd;
};

[[noreturn]] void throw_system_error(const std::filesystem::path& file, const char* what) {
  throw std::system_error(errno, std::generic_category(), file.string() + ": " + what);
}

/// Writes a file beside `file` first, because a viewer that is killed here must not leave half a file.
void write_tokens(const std::filesystem::path& file, const Tokens& tokens) {
  const std::string text = "control " + tokens.control + "\nobserver " + tokens.observer + "\n";
  const std::filesystem::path part = file.string() + ".part";
  {
    const OpenFile out{open(part.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0600)};
    if (out.fd < 0 || fchmod(out.fd, 0600) != 0 ||
        write(out.fd, text.data(), text.size()) != static_cast<ssize_t>(text.size()))
      throw_system_error(file, "cannot write the tokens of the page");
  }
  if (rename(part.c_str(), file.c_str()) != 0) throw_system_error(file, "cannot write the tokens of the page");
}

/// Takes the line `NAME TOKEN` from the start of `text`. Returns an empty token if `text` begins otherwise.
std::string take_token(std::string_view& text, std::string_view name) {
  const std::size_t length = name.size() + 1 + kTokenDigits;
  if (text.size() <= length || text.substr(0, name.size()) != name || text[name.size()] != ' ' || text[length] != '\n')
    return {};
  const std::string_view token = text.substr(name.size() + 1, kTokenDigits);
  if (token.find_first_not_of(kHexDigits) != std::string_view::npos) return {};
  text.remove_prefix(length + 1);
  return std::string{token};
}

}  // namespace

Tokens make_tokens() { return {make_token(), make_token()}; }

Tokens kept_tokens(const std::filesystem::path& file) {
  const OpenFile in{open(file.c_str(), O_RDONLY | O_CLOEXEC)};
  if (in.fd < 0) {
    if (errno != ENOENT) throw_system_error(file, "cannot read the tokens of the page");
    const Tokens made = make_tokens();
    write_tokens(file, made);
    return made;
  }
  struct stat status {};
  std::array<char, kMaxFileBytes> bytes{};
  const ssize_t size = read(in.fd, bytes.data(), bytes.size());
  if (size < 0 || fstat(in.fd, &status) != 0) throw_system_error(file, "cannot read the tokens of the page");
  if ((status.st_mode & 077) != 0)
    throw std::runtime_error{file.string() + ": others can read the tokens of the page, expected mode 0600"};
  std::string_view text{bytes.data(), static_cast<std::size_t>(size)};
  Tokens kept;
  kept.control = take_token(text, "control");
  kept.observer = take_token(text, "observer");
  if (kept.control.empty() || kept.observer.empty() || !text.empty() || kept.control == kept.observer)
    throw std::runtime_error{
        file.string() + ": expected two lines, 'control TOKEN' and 'observer TOKEN', with two tokens of " +
        std::to_string(kTokenDigits) + " hexadecimal digits; without the file, the viewer makes new ones"};
  return kept;
}

}  // namespace tactus::viewer
