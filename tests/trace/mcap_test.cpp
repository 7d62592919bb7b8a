#include "trace/mcap.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "tests/support/temporary_folder.hpp"
#include "tests/trace/read_mcap.hpp"

namespace tactus::trace {
namespace {

constexpr unsigned kSeed = 3;

class Mcap : public ::testing::Test {
 protected:
  /// Writes messages of random sizes on two topics, with times that mostly increase, in more than two chunks. Returns
  /// the expected output of the reader.
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
      const std::size_t which = random() % 2;
      time += 1000;
      writer.write(channels[which], time, time - 7, i, {message.data(), message.size()});
      char head[96];
      std::snprintf(head, sizeof head, "%s %u %llu %llu ", names[which], i, static_cast<unsigned long long>(time),
                    static_cast<unsigned long long>(time - 7));
      expected += head;
      for (const std::uint8_t byte : message) {
        std::snprintf(head, sizeof head, "%02x", byte);
        expected += head;
      }
      expected += '\n';
    }
    return expected;
  }

  /// The output in the same format from our reader.
  std::string lines(bool* cut = nullptr) const {
    McapReader reader{file_};
    std::string all;
    McapMessage message;
    while (reader.next(message)) {
      EXPECT_EQ(message.schema, "demo::Blob");
      EXPECT_EQ(*message.schema_text, "struct Blob { octet x; };");
      all += message.topic + ' ' + std::to_string(message.sequence) + ' ' + std::to_string(message.log_time) + ' ' +
             std::to_string(message.publish_time) + ' ';
      for (const std::uint8_t byte : message.bytes) {
        constexpr char kDigits[] = "0123456789abcdef";
        all += kDigits[byte >> 4];
        all += kDigits[byte & 15];
      }
      all += '\n';
    }
    if (cut != nullptr) *cut = reader.is_truncated();
    return all;
  }

  test_support::TemporaryFolder folder_;
  std::string file_ = (folder_.path() / "made.mcap").string();
};

TEST_F(Mcap, TheReferenceReaderFindsEveryMessageByTheIndex) {
  if (const std::string reason = missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  std::string expected;
  {
    McapWriter writer{file_, "test"};
    expected = fill(writer);
    EXPECT_EQ(writer.messages(), 900u);
  }
  EXPECT_EQ(read_mcap("lines '" + file_ + "'"), expected) << "seed " << kSeed;
  EXPECT_EQ(lines(), expected) << "and so does ours, seed " << kSeed;
}

TEST_F(Mcap, ReadsAFileTruncatedAnywhere) {
  std::string expected;
  {
    McapWriter writer{file_, "test"};
    expected = fill(writer);
  }
  const auto size = std::filesystem::file_size(file_);
  for (std::size_t left = size - 1; left > 8; left = left * 3 / 4) {
    std::filesystem::resize_file(file_, left);
    bool cut = false;
    const std::string found = lines(&cut);
    EXPECT_EQ(found, expected.substr(0, found.size())) << left;
    EXPECT_TRUE(cut || found == expected) << left;
  }
}

TEST_F(Mcap, AFlippedByteIsFoundByTheChecksum) {
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

TEST_F(Mcap, ATruncatedFileKeepsFlushedChunks) {
  if (const std::string reason = missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  McapWriter writer{file_, "test"};
  const std::string expected = fill(writer);
  writer.flush();
  EXPECT_EQ(read_mcap("lines stream '" + file_ + "'"), expected) << "seed " << kSeed;
}

TEST_F(Mcap, AnEmptyFileIsValid) {
  if (const std::string reason = missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  { McapWriter writer{file_, "test"}; }
  EXPECT_EQ(read_mcap("lines '" + file_ + "'"), "");
}

TEST_F(Mcap, AFileThatCannotBeWrittenIsNamed) {
  const std::string nowhere = (folder_.path() / "none" / "x.mcap").string();
  try {
    const McapWriter writer{nowhere, "test"};
    FAIL() << "expected an error";
  } catch (const McapError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr(nowhere));
  }
}

TEST_F(Mcap, ReportsAFullDisk) {
  McapWriter writer{"/dev/full", "test"};
  EXPECT_THROW(fill(writer), McapError);
}

}  // namespace
}  // namespace tactus::trace
