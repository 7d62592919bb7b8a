/// Writes MCAP files: timed messages of any encoding, with the schemas to read them (https://mcap.dev/spec, version 0).
///
///   header | chunk, its message indices | chunk ... | data end | schemas, channels, statistics, chunk indices | footer
///
/// A chunk is written when it is full or at flush(), so the file of a killed writer has all earlier chunks, and a
/// stream reader can read them. Chunks are not compressed. One thread at a time; not for a haptic thread.
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace tactus::trace {

class McapError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class McapWriter {
 public:
  enum class Schema : std::uint16_t {};
  enum class Channel : std::uint16_t {};
  static constexpr std::size_t kChunkBytes = 1 << 20;

  /// Replaces the file. Throws McapError naming it.
  McapWriter(std::filesystem::path file, const std::string& library);
  /// Closes the file; write errors are ignored.
  ~McapWriter();
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;

  /// `encoding` as registered by MCAP, e.g. omgidl; `name`: of the type in `text`.
  [[nodiscard]] Schema add_schema(const std::string& name, const std::string& encoding, const std::string& text);
  [[nodiscard]] Channel add_channel(Schema schema, const std::string& topic, const std::string& message_encoding,
                                    const std::map<std::string, std::string>& metadata = {});

  /// Times in ns since 1970. Throws McapError when the file cannot be written.
  void write(Channel channel, std::uint64_t log_time, std::uint64_t publish_time, std::uint32_t sequence,
             std::span<const std::uint8_t> message);
  /// Ends the chunk, so that all messages so far are in the file.
  void flush();
  /// Writes summary and footer; nothing may be written afterwards. Throws McapError.
  void close();

  [[nodiscard]] std::uint64_t messages() const noexcept { return messages_; }
  [[nodiscard]] std::uint64_t bytes() const noexcept { return offset_; }

 private:
  using Bytes = std::vector<std::uint8_t>;
  struct Index {
    std::uint64_t time, offset;
  };
  struct ChunkIndex {
    std::uint64_t first_time, last_time, start, length, index_length, size;
    std::map<std::uint16_t, std::uint64_t> message_indices;  // positions in the file, by channel
  };

  void put(const Bytes& bytes);

  std::filesystem::path name_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  std::uint64_t offset_ = 0;
  std::uint64_t messages_ = 0;
  std::vector<Bytes> schemas_, channels_;  // as records
  std::vector<std::uint64_t> counts_;      // by channel - 1
  std::vector<bool> written_;              // by channel - 1: in the file already
  Bytes chunk_;
  std::uint64_t chunk_first_ = 0, chunk_last_ = 0;
  std::uint64_t first_ = 0, last_ = 0;
  std::map<std::uint16_t, std::vector<Index>> chunk_messages_;
  std::vector<ChunkIndex> chunks_;
  std::vector<std::uint16_t> schema_of_;  // by channel - 1
  bool closed_ = false;
};

struct McapMessage {
  std::string topic;
  std::uint16_t channel = 0;
  std::string schema, schema_encoding;       ///< name and encoding
  const std::string* schema_text = nullptr;  ///< valid while the reader exists
  std::uint32_t sequence = 0;
  std::uint64_t log_time = 0, publish_time = 0;  ///< ns since 1970
  std::vector<std::uint8_t> bytes;
};

/// Reads MCAP files from front to end, including truncated files of killed writers. Chunks must not be compressed. One
/// thread at a time.
class McapReader {
 public:
  /// Throws McapError naming a file that cannot be read or is not an MCAP file.
  explicit McapReader(std::filesystem::path file);

  /// False at the end. Throws McapError with the position for a broken file.
  [[nodiscard]] bool next(McapMessage& message);
  /// True when the file is truncated.
  [[nodiscard]] bool is_cut() const noexcept { return cut_; }

 private:
  struct Schema {
    std::string name, encoding, text;
  };
  struct Channel {
    std::uint16_t schema = 0;
    std::string topic;
  };

  [[nodiscard]] bool fill();
  [[nodiscard]] bool take(std::uint8_t opcode, std::span<const std::uint8_t> content, McapMessage& message);
  [[noreturn]] void fail(const std::string& what) const;

  std::filesystem::path name_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  std::uint64_t offset_ = 0;
  std::map<std::uint16_t, Schema> schemas_;
  std::map<std::uint16_t, Channel> channels_;
  std::vector<std::uint8_t> chunk_;
  std::size_t in_chunk_ = 0;
  bool cut_ = false, ended_ = false;
};

}  // namespace tactus::trace
