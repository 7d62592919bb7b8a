#include "trace/mcap.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "tests/support/file_size_limit.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/trace/read_mcap.hpp"

namespace tactus::trace {
namespace {

constexpr unsigned kSeed = 3;

class Mcap : public ::testing::Test {
 protected:
  /// Writes messages of random sizes on two topics, in more than two chunks. Returns what read_mcap("lines ...") must
  /// print: a line for each message.
  std::string fill(McapWriter& writer) {
    const McapWriter::Schema schema = writer.add_schema("demo::Blob", "omgidl", "struct Blob { octet x; };");
    const McapWriter::Channel channels[] = {writer.add_channel(schema, "a", "cdr", {{"key", "value"}}),
                                            writer.add_channel(schema, "b", "cdr")};
    const char* const names[] = {"a", "b"};
    std::mt19937 random{kSeed};
    std::string expected;
    std::uint64_t time = 1'700'000'000'000'000'000;
    for (std::uint32_t i = 0; i < 900; ++i) {
      std::vector<std::uint8_t> message(random() % 6000);
      for (std::uint8_t& byte : message) byte = static_cast<std::uint8_t>(random());
      const std::size_t topic = random() % 2;
      time += 1000;
      writer.write(channels[topic], time, time - 7, i, {message.data(), message.size()});
      char text[96];
      std::snprintf(text, sizeof text, "%s %u %llu %llu ", names[topic], i, static_cast<unsigned long long>(time),
                    static_cast<unsigned long long>(time - 7));
      expected += text;
      for (const std::uint8_t byte : message) {
        std::snprintf(text, sizeof text, "%02x", byte);
        expected += text;
      }
      expected += '\n';
    }
    return expected;
  }

  /// Reads the file with our reader and returns the messages in the format of `fill`. Sets `truncated` to whether the
  /// reader found the file truncated.
  std::string lines(bool* truncated = nullptr) const {
    McapReader reader{file_};
    std::string output;
    McapMessage message;
    while (reader.next(message)) {
      EXPECT_EQ(message.schema, "demo::Blob");
      EXPECT_EQ(*message.schema_text, "struct Blob { octet x; };");
      output += message.topic + ' ' + std::to_string(message.sequence) + ' ' + std::to_string(message.log_time) + ' ' +
                std::to_string(message.publish_time) + ' ';
      for (const std::uint8_t byte : message.bytes) {
        constexpr char kDigits[] = "0123456789abcdef";
        output += kDigits[byte >> 4];
        output += kDigits[byte & 15];
      }
      output += '\n';
    }
    if (truncated != nullptr) *truncated = reader.is_truncated();
    return output;
  }

  test_support::TemporaryFolder folder_;
  std::string file_ = (folder_.path() / "made.mcap").string();
};

TEST_F(Mcap, TheReferenceReaderFindsEveryMessageThroughTheIndex) {
  if (const std::string reason = missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  std::string expected;
  {
    McapWriter writer{file_, "test"};
    expected = fill(writer);
    EXPECT_EQ(writer.messages(), 900u);
  }
  EXPECT_EQ(read_mcap("lines '" + file_ + "'"), expected) << "seed " << kSeed;
  EXPECT_EQ(lines(), expected) << "our reader, seed " << kSeed;
}

TEST_F(Mcap, ReadsMessagesOutsideOfChunks) {
  const auto number = [](std::size_t bytes, std::uint64_t value) {
    std::string encoded;
    for (std::size_t i = 0; i < bytes; ++i) encoded += static_cast<char>(value >> (8 * i));
    return encoded;
  };
  const auto text = [&](const std::string& value) { return number(4, value.size()) + value; };
  const auto record = [&](char opcode, const std::string& content) {
    return opcode + number(8, content.size()) + content;
  };
  const std::string magic{"\x89MCAP0\r\n", 8};
  const std::string schema =
      record(0x03, number(2, 1) + text("demo::Blob") + text("omgidl") + text("struct Blob { octet x; };"));
  const std::string channel = record(0x04, number(2, 1) + number(2, 1) + text("a") + text("cdr") + number(4, 0));
  const auto message = [&](std::uint64_t sequence) {
    return record(0x05, number(2, 1) + number(4, sequence) + number(8, 70) + number(8, 60) + "\x05");
  };
  test_support::write_bytes(file_, magic + record(0x01, text("") + text("test")) + schema + channel + message(3) +
                                       message(4) + record(0x0F, number(4, 0)) +
                                       record(0x02, number(8, 0) + number(8, 0) + number(4, 0)) + magic);
  EXPECT_EQ(lines(), "a 3 70 60 05\na 4 70 60 05\n");
}

TEST_F(Mcap, ReadsTheMessagesBeforeATruncationAndReportsIt) {
  std::string expected;
  {
    McapWriter writer{file_, "test"};
    expected = fill(writer);
  }
  const auto size = std::filesystem::file_size(file_);
  for (std::size_t kept_bytes = size - 1; kept_bytes > 8; kept_bytes = kept_bytes * 3 / 4) {
    std::filesystem::resize_file(file_, kept_bytes);
    bool truncated = false;
    const std::string found = lines(&truncated);
    EXPECT_EQ(found, expected.substr(0, found.size())) << kept_bytes;
    EXPECT_TRUE(truncated || found == expected) << kept_bytes;
  }
}

TEST_F(Mcap, TheChecksumDetectsAFlippedBit) {
  {
    McapWriter writer{file_, "test"};
    (void)fill(writer);
  }
  std::FILE* const file = std::fopen(file_.c_str(), "r+b");
  std::fseek(file, 100'000, SEEK_SET);
  const int byte = std::fgetc(file);
  std::fseek(file, 100'000, SEEK_SET);
  std::fputc(byte ^ 1, file);
  std::fclose(file);
  EXPECT_THROW((void)lines(), McapError);
}

TEST_F(Mcap, AFileThatIsNotClosedContainsTheFlushedMessages) {
  if (const std::string reason = missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  McapWriter writer{file_, "test"};
  const std::string expected = fill(writer);
  writer.flush();
  EXPECT_EQ(read_mcap("lines stream '" + file_ + "'"), expected) << "seed " << kSeed;
}

TEST_F(Mcap, AFileWithoutMessagesIsValid) {
  if (const std::string reason = missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  { McapWriter writer{file_, "test"}; }
  EXPECT_EQ(read_mcap("lines '" + file_ + "'"), "");
}

TEST_F(Mcap, AnErrorNamesAFileThatCannotBeWritten) {
  const std::string unwritable_path = (folder_.path() / "none" / "x.mcap").string();
  try {
    const McapWriter writer{unwritable_path, "test"};
    FAIL() << "expected an error";
  } catch (const McapError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr(unwritable_path));
  }
}

TEST_F(Mcap, OnlyItsOwnerCanReadAFile) {
  std::ofstream{file_} << "an earlier file that everybody can read";
  std::filesystem::permissions(file_, std::filesystem::perms{0644});
  { const McapWriter writer{file_, "test"}; }
  EXPECT_EQ(std::filesystem::status(file_).permissions(), std::filesystem::perms{0600});
}

// In a folder that others can write, a link of another user would lead the recording to another file.
TEST_F(Mcap, ALinkInThePlaceOfTheUnfinishedFileIsNotFollowed) {
  const std::filesystem::path other = folder_.path() / "other";
  std::ofstream{other} << "untouched";
  create_symlink(other, file_ + ".part");
  { const McapWriter writer{file_, "test"}; }
  std::string found;
  std::getline(std::ifstream{other}, found);
  EXPECT_EQ(found, "untouched");
  EXPECT_TRUE(is_regular_file(std::filesystem::symlink_status(file_)));
}

TEST_F(Mcap, NothingFollowsAFailedWrite) {
  {
    McapWriter writer{file_, "test"};
    const auto channel = writer.add_channel(writer.add_schema("B", "omgidl", "struct B { octet x; };"), "a", "cdr");
    writer.write(channel, 1, 1, 1, std::vector<std::uint8_t>(10));
    writer.flush();
    writer.write(channel, 2, 2, 2, std::vector<std::uint8_t>(20'000));  // larger than the buffer of the file
    const test_support::FileSizeLimit limit{writer.bytes() + 100};
    EXPECT_THROW(writer.flush(), McapError);
  }  // the limit ends first, so the destructor could write
  McapReader reader{file_};
  McapMessage message;
  EXPECT_TRUE(reader.next(message));
  EXPECT_FALSE(reader.next(message));
  EXPECT_TRUE(reader.is_truncated());
}

TEST_F(Mcap, ReportsAFullDisk) {
  const auto write = [this] {
    McapWriter writer{"/dev/full", "test"};
    (void)fill(writer);
  };
  EXPECT_THROW(write(), McapError);
}

TEST(ChannelNames, TheSecondChannelOfATopicByItsIdHasTheSuffix2) {
  const std::map<std::uint16_t, std::string> topics{{7, "b"}, {2, "a"}, {5, "a"}, {9, "a"}};
  const std::map<std::uint16_t, std::string> names{{2, "a"}, {5, "a-2"}, {7, "b"}, {9, "a-3"}};
  EXPECT_EQ(channel_names(topics), names);
}

}  // namespace
}  // namespace tactus::trace
