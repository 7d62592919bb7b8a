#include "trace/mcap.hpp"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace tactus::trace {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::array<std::uint8_t, 8> kMagic{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};

enum Opcode : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F
};

/// Encodes the fields of an MCAP record, little-endian.
class Encoder {
 public:
  template <class Number>
  Encoder& number(Number value) {
    for (std::size_t i = 0; i < sizeof(Number); ++i)
      bytes_.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i)));
    return *this;
  }
  Encoder& raw(const void* from, std::size_t size) {
    const auto* const begin = static_cast<const std::uint8_t*>(from);
    bytes_.insert(bytes_.end(), begin, begin + size);
    return *this;
  }
  Encoder& text(const std::string& value) {
    return number(static_cast<std::uint32_t>(value.size())).raw(value.data(), value.size());
  }
  /// Appends a map or an array: the number of its bytes, and the bytes that `append` appends.
  template <class Append>
  Encoder& sized(Append&& append) {
    const std::size_t at = bytes_.size();
    number(std::uint32_t{0});
    append(*this);
    const auto size = static_cast<std::uint32_t>(bytes_.size() - at - sizeof(std::uint32_t));
    for (std::size_t i = 0; i < sizeof size; ++i) bytes_[at + i] = static_cast<std::uint8_t>(size >> (8 * i));
    return *this;
  }
  /// Returns a record with this opcode and the encoded fields.
  [[nodiscard]] Bytes record(Opcode opcode) const {
    Encoder whole;
    whole.number(static_cast<std::uint8_t>(opcode)).number(static_cast<std::uint64_t>(bytes_.size()));
    whole.raw(bytes_.data(), bytes_.size());
    return std::move(whole.bytes_);
  }

 private:
  Bytes bytes_;
};

std::uint32_t crc_of(const Bytes& bytes, std::uint32_t before = 0) {
  return static_cast<std::uint32_t>(crc32(before, bytes.data(), static_cast<uInt>(bytes.size())));
}

}  // namespace

McapWriter::McapWriter(std::filesystem::path file, const std::string& library) : name_{std::move(file)}, file_{name_} {
  if (file_.get() == nullptr) fail();
  put({kMagic.begin(), kMagic.end()});
  put(Encoder{}.text("").text(library).record(kHeader));
  if (!file_.commit()) fail();
}

McapWriter::~McapWriter() {
  try {
    close();
  } catch (const McapError&) {  // documented in the header
  }
}

/// Throws after a failed write. A part of a record may be in the file, so that no other record may follow.
void McapWriter::fail() {
  is_closed_ = true;
  throw McapError("cannot write " + name_.string() + ": " + std::strerror(errno));
}

void McapWriter::put(const Bytes& bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) != bytes.size()) fail();
  offset_ += bytes.size();
}

void McapWriter::write_buffer() {
  if (std::fflush(file_.get()) != 0) fail();
}

McapWriter::Schema McapWriter::add_schema(const std::string& name, const std::string& encoding,
                                          const std::string& text) {
  const auto id = static_cast<std::uint16_t>(schemas_.size() + 1);
  schemas_.push_back(Encoder{}.number(id).text(name).text(encoding).text(text).record(kSchema));
  return Schema{id};
}

McapWriter::Channel McapWriter::add_channel(Schema schema, const std::string& topic,
                                            const std::string& message_encoding,
                                            const std::map<std::string, std::string>& metadata) {
  const auto id = static_cast<std::uint16_t>(channels_.size() + 1);
  const auto of = static_cast<std::uint16_t>(schema);
  channels_.push_back(Encoder{}
                          .number(id)
                          .number(of)
                          .text(topic)
                          .text(message_encoding)
                          .sized([&](Encoder& map) {
                            for (const auto& [key, value] : metadata) map.text(key).text(value);
                          })
                          .record(kChannel));
  schema_of_.push_back(of);
  counts_.push_back(0);
  is_written_.push_back(false);
  return Channel{id};
}

void McapWriter::write(Channel channel, std::uint64_t log_time, std::uint64_t publish_time, std::uint32_t sequence,
                       std::span<const std::uint8_t> message) {
  const auto id = static_cast<std::uint16_t>(channel);
  const auto append = [&](const Bytes& record) { chunk_.insert(chunk_.end(), record.begin(), record.end()); };
  if (!is_written_[id - 1u]) {  // a stream reader needs schema and channel before the first message
    append(schemas_[schema_of_[id - 1u] - 1u]);
    append(channels_[id - 1u]);
    is_written_[id - 1u] = true;
  }
  if (chunk_messages_.empty()) chunk_first_ = chunk_last_ = log_time;
  chunk_first_ = std::min(chunk_first_, log_time);
  chunk_last_ = std::max(chunk_last_, log_time);
  chunk_messages_[id].push_back({log_time, chunk_.size()});
  append(Encoder{}
             .number(id)
             .number(sequence)
             .number(log_time)
             .number(publish_time)
             .raw(message.data(), message.size())
             .record(kMessage));
  ++counts_[id - 1u];
  ++messages_;
  if (chunk_.size() >= kChunkBytes) flush();
}

void McapWriter::flush() {
  if (!chunk_messages_.empty()) {
    ChunkIndex index{chunk_first_, chunk_last_, offset_, 0, 0, chunk_.size(), {}};
    if (chunks_.empty()) first_ = chunk_first_;
    first_ = std::min(first_, chunk_first_);
    last_ = std::max(last_, chunk_last_);
    put(Encoder{}
            .number(chunk_first_)
            .number(chunk_last_)
            .number(static_cast<std::uint64_t>(chunk_.size()))
            .number(crc_of(chunk_))
            .text("")
            .number(static_cast<std::uint64_t>(chunk_.size()))
            .raw(chunk_.data(), chunk_.size())
            .record(kChunk));
    index.length = offset_ - index.start;
    const std::uint64_t indices = offset_;
    for (const auto& [channel, messages] : chunk_messages_) {
      index.message_indices[channel] = offset_;
      put(Encoder{}
              .number(channel)
              .sized([&messages = messages](Encoder& array) {
                for (const MessageIndex& message : messages) array.number(message.time).number(message.offset);
              })
              .record(kMessageIndex));
    }
    index.index_length = offset_ - indices;
    chunks_.push_back(std::move(index));
    chunk_.clear();
    chunk_messages_.clear();
  }
  write_buffer();
}

void McapWriter::close() {
  if (is_closed_) return;
  is_closed_ = true;
  flush();
  put(Encoder{}.number(std::uint32_t{0}).record(kDataEnd));

  Bytes summary;
  struct Group {
    Opcode opcode;
    std::uint64_t start, length;
  };
  std::vector<Group> groups;
  const std::uint64_t start = offset_;
  const auto group = [&](Opcode opcode, const std::vector<Bytes>& records) {
    const std::uint64_t at = start + summary.size();
    for (const Bytes& record : records) summary.insert(summary.end(), record.begin(), record.end());
    if (!records.empty()) groups.push_back({opcode, at, start + summary.size() - at});
  };
  group(kSchema, schemas_);
  group(kChannel, channels_);
  group(kStatistics, {Encoder{}
                          .number(messages_)
                          .number(static_cast<std::uint16_t>(schemas_.size()))
                          .number(static_cast<std::uint32_t>(channels_.size()))
                          .number(std::uint32_t{0})
                          .number(std::uint32_t{0})
                          .number(static_cast<std::uint32_t>(chunks_.size()))
                          .number(first_)
                          .number(last_)
                          .sized([&](Encoder& map) {
                            for (std::size_t i = 0; i < counts_.size(); ++i)
                              map.number(static_cast<std::uint16_t>(i + 1)).number(counts_[i]);
                          })
                          .record(kStatistics)});
  std::vector<Bytes> indices;
  for (const ChunkIndex& chunk : chunks_)
    indices.push_back(Encoder{}
                          .number(chunk.first_time)
                          .number(chunk.last_time)
                          .number(chunk.start)
                          .number(chunk.length)
                          .sized([&](Encoder& map) {
                            for (const auto& [channel, at] : chunk.message_indices) map.number(channel).number(at);
                          })
                          .number(chunk.index_length)
                          .text("")
                          .number(chunk.size)
                          .number(chunk.size)
                          .record(kChunkIndex));
  group(kChunkIndex, indices);

  const std::uint64_t offsets = start + summary.size();
  for (const Group& of : groups) {
    const Bytes record = Encoder{}
                             .number(static_cast<std::uint8_t>(of.opcode))
                             .number(of.start)
                             .number(of.length)
                             .record(kSummaryOffset);
    summary.insert(summary.end(), record.begin(), record.end());
  }
  // The checksum also covers the footer up to the checksum itself.
  Bytes footer = Encoder{}.number(start).number(offsets).number(std::uint32_t{0}).record(kFooter);
  const Bytes covered{footer.begin(), footer.end() - sizeof(std::uint32_t)};
  const std::uint32_t crc = crc_of(covered, crc_of(summary));
  for (std::size_t i = 0; i < sizeof crc; ++i) footer[covered.size() + i] = static_cast<std::uint8_t>(crc >> (8 * i));
  put(summary);
  put(footer);
  put({kMagic.begin(), kMagic.end()});
  write_buffer();
}

namespace {

/// Reads the fields of a record in order. Sets `broken` if a field is longer than the record.
class Fields {
 public:
  Fields(std::span<const std::uint8_t> bytes, bool& broken) : bytes_{bytes}, broken_{broken} {}

  template <class Number>
  [[nodiscard]] Number number() {
    std::uint64_t value = 0;
    if (!has(sizeof(Number))) return {};
    for (std::size_t i = 0; i < sizeof(Number); ++i) value |= std::uint64_t{bytes_[at_ + i]} << (8 * i);
    at_ += sizeof(Number);
    return static_cast<Number>(value);
  }
  [[nodiscard]] std::string text() {
    const auto size = number<std::uint32_t>();
    if (!has(size)) return {};
    std::string value;
    for (std::uint32_t i = 0; i < size; ++i) value += static_cast<char>(bytes_[at_ + i]);
    at_ += size;
    return value;
  }
  [[nodiscard]] Bytes rest() {
    Bytes value{bytes_.begin() + at_, bytes_.end()};
    at_ = bytes_.size();
    return value;
  }

 private:
  bool has(std::size_t size) {
    if (broken_ || size > bytes_.size() - at_) broken_ = true;
    return !broken_;
  }
  std::span<const std::uint8_t> bytes_;
  bool& broken_;
  std::size_t at_ = 0;
};

constexpr std::size_t kRecordHead = 9;  // bytes of opcode and length

}  // namespace

McapReader::McapReader(std::filesystem::path file)
    : name_{std::move(file)}, file_{std::fopen(name_.c_str(), "rb"), &std::fclose} {
  if (!file_) throw McapError("cannot read " + name_.string() + ": " + std::strerror(errno));
  std::array<std::uint8_t, kMagic.size()> magic{};
  offset_ = std::fread(magic.data(), 1, magic.size(), file_.get());
  if (magic != kMagic) throw McapError(name_.string() + ": expected an MCAP file, found other first bytes");
}

void McapReader::fail(const std::string& what) const {
  throw McapError(name_.string() + ", at byte " + std::to_string(offset_) + ": " + what);
}

/// Reads MCAP records up to the next chunk, and the chunk. A schema, channel or message outside of chunks counts as a
/// chunk of one record. Returns false at the end of the file.
bool McapReader::read_chunk() {
  while (!has_ended_) {
    std::array<std::uint8_t, kRecordHead> head{};
    const std::size_t got = std::fread(head.data(), 1, head.size(), file_.get());
    is_truncated_ = got < head.size();
    if (is_truncated_) return false;
    bool broken = false;
    Fields fields{{head.data() + 1, head.size() - 1}, broken};
    const auto length = fields.number<std::uint64_t>();
    // Limits the length, so that a damaged length cannot allocate all memory.
    constexpr std::uint64_t kMax = 1u << 30;
    if (length > kMax) fail("found a record of " + std::to_string(length) + " bytes, expected at most 2^30");
    Bytes content;
    while (content.size() < length && !is_truncated_) {  // in pieces, because the file may be shorter
      constexpr std::uint64_t kPieceBytes = 1u << 20;
      const std::size_t had = content.size();
      content.resize(std::min(length, had + kPieceBytes));
      is_truncated_ = std::fread(content.data() + had, 1, content.size() - had, file_.get()) < content.size() - had;
    }
    if (is_truncated_) return false;
    offset_ += head.size() + length;
    has_ended_ = head[0] == kDataEnd;
    if (head[0] == kSchema || head[0] == kChannel || head[0] == kMessage) {
      chunk_.assign(head.begin(), head.end());
      chunk_.insert(chunk_.end(), content.begin(), content.end());
      in_chunk_ = 0;
      return true;
    }
    if (head[0] != kChunk) continue;
    Fields chunk{{content.data(), content.size()}, broken};
    (void)chunk.number<std::uint64_t>();  // first time
    (void)chunk.number<std::uint64_t>();  // last time
    const auto size = chunk.number<std::uint64_t>();
    const auto crc = chunk.number<std::uint32_t>();
    const std::string compression = chunk.text();
    if (!broken && !compression.empty()) fail("found a chunk compressed by " + compression + ", expected none");
    (void)chunk.number<std::uint64_t>();
    chunk_ = chunk.rest();
    in_chunk_ = 0;
    if (broken || chunk_.size() != size || (crc != 0 && crc_of(chunk_) != crc)) fail("found a broken chunk");
    return true;
  }
  return false;
}

bool McapReader::next(McapMessage& message) {
  for (;;) {
    if (in_chunk_ == chunk_.size() && !read_chunk()) return false;
    bool broken = chunk_.size() - in_chunk_ < kRecordHead;
    Fields fields{{chunk_.data() + in_chunk_, chunk_.size() - in_chunk_}, broken};
    const auto opcode = fields.number<std::uint8_t>();
    const auto length = fields.number<std::uint64_t>();
    if (broken || length > chunk_.size() - in_chunk_ - kRecordHead) fail("found a broken record in a chunk");
    const std::uint8_t* const content = chunk_.data() + in_chunk_ + kRecordHead;
    in_chunk_ += kRecordHead + length;
    if (read_record(opcode, {content, length}, message)) return true;
  }
}

/// Reads a record of a chunk. Returns true if it is a message.
bool McapReader::read_record(std::uint8_t opcode, std::span<const std::uint8_t> content, McapMessage& message) {
  bool broken = false;
  Fields fields{content, broken};
  if (opcode == kSchema) {
    Schema& schema = schemas_[fields.number<std::uint16_t>()];
    schema.name = fields.text();
    schema.encoding = fields.text();
    schema.text = fields.text();
  } else if (opcode == kChannel) {
    Channel& channel = channels_[fields.number<std::uint16_t>()];
    channel.schema = fields.number<std::uint16_t>();
    channel.topic = fields.text();
  } else if (opcode == kMessage) {
    message.channel = fields.number<std::uint16_t>();
    message.sequence = fields.number<std::uint32_t>();
    message.log_time = fields.number<std::uint64_t>();
    message.publish_time = fields.number<std::uint64_t>();
    if (!broken) message.bytes = fields.rest();
    const auto channel = channels_.find(message.channel);
    const auto schema = channel == channels_.end() ? schemas_.end() : schemas_.find(channel->second.schema);
    if (schema == schemas_.end()) fail("found a message before its channel and schema");
    message.topic = channel->second.topic;
    message.schema = schema->second.name;
    message.schema_encoding = schema->second.encoding;
    message.schema_text = &schema->second.text;
  }
  if (broken) fail("found a record that is too short");
  return opcode == kMessage;
}

std::map<std::uint16_t, std::string> channel_names(const std::map<std::uint16_t, std::string>& topics) {
  std::map<std::uint16_t, std::string> names;
  std::map<std::string, int> counts;  // of the channels so far, by topic
  for (const auto& [channel, topic] : topics) {
    const int number = ++counts[topic];
    names[channel] = topic + (number > 1 ? "-" + std::to_string(number) : "");
  }
  return names;
}

}  // namespace tactus::trace
