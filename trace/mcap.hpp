/// Writes and reads MCAP files (https://mcap.dev/spec, version 0): messages with times, in any encoding, and the
/// schemas by which they can be decoded.
///
///   header | chunk, its message indices | chunk ... | data end | schemas, channels, statistics, chunk indices | footer
///
/// The file gets its name when it has the header, and the writer writes a chunk when it is full, or at flush(). So the
/// file of a killed writer has all earlier chunks, which can be read from front to end. Chunks are not compressed. One
/// thread at a time; not for a haptic thread.
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

#include "trace/private_file.hpp"

namespace tactus::trace {

/// Thrown if a file cannot be written or read, or is damaged. The message names the file.
class McapError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class McapWriter {
 public:
  enum class Schema : std::uint16_t {};
  enum class Channel : std::uint16_t {};
  static constexpr std::size_t kChunkBytes = 1 << 20;

  /// Replaces the file. `library`: name of the writing program, for the header. Throws McapError.
  McapWriter(std::filesystem::path file, const std::string& library);
  /// Closes the file and ignores errors. After a failed write, writes nothing more, so that the file ends with a
  /// truncated record.
  ~McapWriter();
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;

  /// Adds a schema. `encoding`: a name that MCAP registers, for example omgidl. `name`: name of the type in `text`.
  [[nodiscard]] Schema add_schema(const std::string& name, const std::string& encoding, const std::string& text);
  [[nodiscard]] Channel add_channel(Schema schema, const std::string& topic, const std::string& message_encoding,
                                    const std::map<std::string, std::string>& metadata = {});

  /// Writes a message. Times are in ns since 1970. Throws McapError if the file cannot be written.
  void write(Channel channel, std::uint64_t log_time, std::uint64_t publish_time, std::uint32_t sequence,
             std::span<const std::uint8_t> message);
  /// Ends the chunk, so that all messages so far are in the file. Throws McapError.
  void flush();
  /// Writes summary and footer. No message may be written afterwards. Throws McapError.
  void close();

  /// Number of messages written.
  [[nodiscard]] std::uint64_t messages() const noexcept { return messages_; }
  /// Number of bytes of the file, without the open chunk.
  [[nodiscard]] std::uint64_t bytes() const noexcept { return offset_; }

 private:
  using Bytes = std::vector<std::uint8_t>;
  struct MessageIndex {
    std::uint64_t time, offset;  // `time`: log time; `offset`: position in the chunk
  };
  struct ChunkIndex {
    std::uint64_t first_time, last_time;                     // of its messages
    std::uint64_t start, length;                             // of the chunk record in the file
    std::uint64_t index_length;                              // of its message indices
    std::uint64_t size;                                      // of the records in the chunk
    std::map<std::uint16_t, std::uint64_t> message_indices;  // positions in the file, by channel
  };

  void put(const Bytes& bytes);
  void write_buffer();
  [[noreturn]] void fail();

  std::filesystem::path name_;
  PrivateFile file_;
  std::uint64_t offset_ = 0;
  std::uint64_t messages_ = 0;
  std::vector<Bytes> schemas_, channels_;           // encoded MCAP records
  std::vector<std::uint64_t> counts_;               // number of messages, by channel - 1
  std::vector<bool> is_written_;                    // by channel - 1: a chunk has the channel and its schema
  Bytes chunk_;                                     // the open chunk
  std::uint64_t chunk_first_ = 0, chunk_last_ = 0;  // first and last log time of its messages
  std::uint64_t first_ = 0, last_ = 0;              // first and last log time of all messages
  std::map<std::uint16_t, std::vector<MessageIndex>> chunk_messages_;  // of the open chunk, by channel
  std::vector<ChunkIndex> chunks_;
  std::vector<std::uint16_t> schema_of_;  // by channel - 1
  bool is_closed_ = false;
};

struct McapMessage {
  std::string topic;
  std::uint16_t channel = 0;
  std::string schema, schema_encoding;       ///< name and encoding of the schema
  const std::string* schema_text = nullptr;  ///< valid while the reader exists
  std::uint32_t sequence = 0;
  std::uint64_t log_time = 0, publish_time = 0;  ///< ns since 1970
  std::vector<std::uint8_t> bytes;
};

/// Reads an MCAP file from front to end. The file may be the truncated file of a killed writer. Messages may be in
/// chunks, which must not be compressed, or outside of them. One thread at a time.
class McapReader {
 public:
  /// Throws McapError if the file cannot be read or is no MCAP file.
  explicit McapReader(std::filesystem::path file);

  /// Reads the next message. Returns false at the end of the file. Throws McapError with the position if the file is
  /// damaged.
  [[nodiscard]] bool next(McapMessage& message);
  /// True if `next` has found the end of a truncated file.
  [[nodiscard]] bool is_truncated() const noexcept { return is_truncated_; }

 private:
  struct Schema {
    std::string name, encoding, text;
  };
  struct Channel {
    std::uint16_t schema = 0;
    std::string topic;
  };

  [[nodiscard]] bool read_chunk();
  [[nodiscard]] bool read_record(std::uint8_t opcode, std::span<const std::uint8_t> content, McapMessage& message);
  [[noreturn]] void fail(const std::string& what) const;

  std::filesystem::path name_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  std::uint64_t offset_ = 0;
  std::map<std::uint16_t, Schema> schemas_;
  std::map<std::uint16_t, Channel> channels_;
  std::vector<std::uint8_t> chunk_;
  std::size_t in_chunk_ = 0;  // position of the next record in `chunk_`
  bool is_truncated_ = false;
  bool has_ended_ = false;  // the record "data end" is read
};

/// Returns a name for each channel: that of its topic. The second channel of a topic has the suffix -2, the third -3.
/// Channels count by their ids, whichever has the first message, so that a recorder that adds its channels in a fixed
/// order gives them fixed names. `topics`: by channel.
[[nodiscard]] std::map<std::uint16_t, std::string> channel_names(const std::map<std::uint16_t, std::string>& topics);

}  // namespace tactus::trace
