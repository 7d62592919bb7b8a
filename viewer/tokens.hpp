/// Tokens of the viewer's pages. A file can keep them, so that a page reaches the viewer again after a restart.
#pragma once

#include <filesystem>
#include <string>

namespace tactus::viewer {

/// 128 random bits each, as 32 lower-case hexadecimal digits.
struct Tokens {
  std::string control;   ///< of pages that may touch and stop forces
  std::string observer;  ///< of pages that only show the session
};

/// Makes two new tokens. Throws std::runtime_error if the system has no source of random bits.
[[nodiscard]] Tokens make_tokens();

/// Reads the tokens of `file`. If there is no such file, makes new tokens and writes them to it; only its owner can read
/// it then. Throws std::runtime_error, which names the file: it cannot be read or written, others can read it, or it
/// does not have the two lines `control TOKEN` and `observer TOKEN`.
[[nodiscard]] Tokens kept_tokens(const std::filesystem::path& file);

}  // namespace tactus::viewer
