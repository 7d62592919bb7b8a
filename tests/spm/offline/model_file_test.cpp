#include "spm/offline/model_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <cstring>
#include <fstream>
#include <utility>
#include <vector>

#include "spm/codec/region_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/digest.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::read_bytes;
using test_support::TemporaryFolder;
using test_support::write_bytes;
using ::testing::HasSubstr;

/// Returns the error message of `action`, or an empty string if it succeeds.
template <class Action>
std::string error_of(Action action) {
  try {
    action();
  } catch (const ModelError& e) {
    return e.what();
  }
  return {};
}
std::string open_error(const std::filesystem::path& path) {
  return error_of([&] { const MappedModel model{path}; });
}
std::string decode_error(const std::filesystem::path& path) {
  return error_of([&] { static_cast<void>(MappedModel{path}.decode()); });
}

class ModelFile : public ::testing::Test {
 protected:
  ModelFile() : built_{build_model(generate(Shape::kOrgan, 2000))}, path_{folder_.path() / "organ.spm"} {
    CleanReport cleaned;
    cleaned.duplicate_faces = 7;
    write_model(path_, built_.model(), {"organ.obj", cleaned});
    bytes_ = read_bytes(path_);
  }

  /// Writes the file with a flipped bit in a section.
  void damage_section(std::size_t section) const {
    std::uint64_t offset = 0;
    std::memcpy(&offset, bytes_.data() + 64 + 32 * section + 8, sizeof offset);
    std::string damaged = bytes_;
    damaged[offset + 5] = static_cast<char>(damaged[offset + 5] ^ 16);
    write_bytes(path_, damaged);
  }

  TemporaryFolder folder_;
  BuiltModel built_;
  std::filesystem::path path_;
  std::string bytes_;
};

TEST_F(ModelFile, RestoresTheWrittenModel) {
  const MappedModel mapped{path_};
  const OwnedModel model = mapped.decode();
  const auto same = [](const auto& a, const auto& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0;
  };
  EXPECT_EQ(std::memcmp(&model.summary, &built_.summary, sizeof model.summary), 0);
  EXPECT_TRUE(same(model.positions, built_.positions));
  EXPECT_TRUE(same(model.base_radii, built_.base_radii));
  EXPECT_TRUE(same(model.base_faces, built_.base_faces));
  EXPECT_TRUE(same(model.parts, built_.parts));
  EXPECT_TRUE(same(model.regions, built_.regions));
  EXPECT_TRUE(same(model.intervals, built_.intervals));
  EXPECT_EQ(mapped.provenance().source, "organ.obj");
  EXPECT_EQ(mapped.provenance().cleaned.duplicate_faces, 7u);
}

TEST_F(ModelFile, IsRecognizedByItsFirstBytes) {
  EXPECT_TRUE(is_model_file(path_));
  write_bytes(folder_.path() / "other", "solid nothing");
  EXPECT_FALSE(is_model_file(folder_.path() / "other"));
  EXPECT_FALSE(is_model_file(folder_.path() / "missing"));
}

TEST_F(ModelFile, RefusesAnyFlippedBitExceptInThePadding) {
  // Every byte of the header and of the section table, and samples of the sections.
  for (std::size_t i = 0; i < bytes_.size(); i += i < 512 ? 1 : 997) {
    std::string damaged = bytes_;
    damaged[i] = static_cast<char>(damaged[i] ^ 1 << i % 8);
    write_bytes(path_, damaged);
    const std::string message = decode_error(path_);
    if (message.empty()) {
      ASSERT_EQ(bytes_[i], 0) << "byte " << i << " is no padding";
      ASSERT_EQ(MappedModel{path_}.summary().digest, built_.summary.digest) << "byte " << i;
    } else {
      ASSERT_THAT(message, HasSubstr("organ.spm"));
    }
  }
}

TEST_F(ModelFile, TheErrorOfAFlippedBitNamesTheSection) {
  const char* names[] = {"base mesh", "regions", "codes", "lists", "sizes", "statistics", "checksums"};
  for (std::size_t i = 0; i < 7; ++i) {
    damage_section(i);
    const std::string message = decode_error(path_);
    EXPECT_THAT(message, HasSubstr(std::string{"section "} + names[i] + ": ")) << names[i];
    EXPECT_THAT(message, HasSubstr("does not match, the file is damaged")) << names[i];
  }
}

TEST_F(ModelFile, OpensWithDamagedCodesAndListsAndNamesTheDamageWhenARegionNeedsThem) {
  for (const auto& [section, name] : {std::pair<std::size_t, const char*>{2, "codes"}, {3, "lists"}}) {
    damage_section(section);
    const MappedModel mapped{path_};
    EXPECT_THAT(error_of([&] { mapped.check_checksums(); }), HasSubstr("organ.spm: section " + std::string{name}));
    const codec::CompressedModel& model = mapped.compressed();
    const std::vector<Interval> list = model.intervals_of(RegionId{0});
    EXPECT_EQ(list.empty(), section == 3);
    const auto message = codec::encode_region(model, RegionId{0}, list);
    ASSERT_FALSE(message) << name;
    EXPECT_THAT(message.error().text,
                HasSubstr("organ.spm: section " + std::string{name} + ": the checksum of bytes 0 to"));
  }
}

TEST_F(ModelFile, RefusesAWrongNumberOfChecksums) {
  std::uint64_t size = 0;
  std::memcpy(&size, bytes_.data() + 64 + 32 * 6 + 16, sizeof size);
  ASSERT_EQ(size, 16u) << "one block of codes and one of lists";
  std::string damaged = bytes_.substr(0, bytes_.size() - 8);
  const auto set = [&damaged](std::size_t at, std::uint64_t number) {
    std::memcpy(damaged.data() + at, &number, sizeof number);
  };
  set(16, damaged.size());
  set(64 + 32 * 6 + 16, 8);
  std::uint64_t offset = 0;
  std::memcpy(&offset, bytes_.data() + 64 + 32 * 6 + 8, sizeof offset);
  set(64 + 32 * 6 + 24, XXH3_64bits(damaged.data() + offset, 8));
  set(24, 0);
  set(24, XXH3_64bits(damaged.data(), 288));
  write_bytes(path_, damaged);
  EXPECT_THAT(open_error(path_), HasSubstr("section checksums: found 8 bytes, expected 16"));
}

TEST_F(ModelFile, RefusesEveryTruncation) {
  for (std::size_t size = 0; size < bytes_.size(); size += size < 512 ? 7 : 4999) {
    write_bytes(path_, bytes_.substr(0, size));
    ASSERT_THAT(open_error(path_), HasSubstr("bytes")) << size;
  }
}

TEST_F(ModelFile, RefusesALaterVersionAndNamesBothVersions) {
  std::string later = bytes_;
  later[8] = 10;
  write_bytes(path_, later);
  EXPECT_THAT(open_error(path_), HasSubstr("version 10"));
  EXPECT_THAT(open_error(path_), HasSubstr("version 9"));
}

TEST_F(ModelFile, RefusesAMissingFileAnEmptyFileAndAFolder) {
  EXPECT_THAT(open_error(folder_.path() / "missing.spm"), HasSubstr("No such file"));
  write_bytes(path_, "");
  EXPECT_THAT(open_error(path_), HasSubstr("found 0 bytes"));
  EXPECT_THAT(open_error(folder_.path()), HasSubstr("no regular file"));
}

TEST_F(ModelFile, RefusesAnInvalidModelWithCorrectChecksums) {
  BuiltModel damaged = built_;
  ++damaged.parts[3].radius;
  write_model(path_, damaged.model(), {});
  EXPECT_THAT(decode_error(path_), HasSubstr("record 3: radius code"));
}

TEST_F(ModelFile, RefusesAPathThatCannotBeWrittenAndLeavesNoFile) {
  EXPECT_THROW(write_model(folder_.path() / "no" / "such" / "folder.spm", built_.model(), {}), ModelError);
  std::filesystem::create_directory(folder_.path() / "taken.spm");
  std::filesystem::create_directory(folder_.path() / "taken.spm" / "inside");
  EXPECT_THROW(write_model(folder_.path() / "taken.spm", built_.model(), {}), ModelError);
  std::size_t entries = 0;
  for (const auto& entry : std::filesystem::directory_iterator{folder_.path()}) {
    static_cast<void>(entry);
    ++entries;
  }
  EXPECT_EQ(entries, 2u);  // organ.spm and taken.spm
}

TEST_F(ModelFile, OverwritingAFileDoesNotChangeTheModelMappedFromIt) {
  const MappedModel mapped{path_};
  const BuiltModel other = build_model(generate(Shape::kSphere, 1000));
  write_model(path_, other.model(), {});
  const auto decoded = codec::decode_model(mapped.compressed());
  ASSERT_TRUE(decoded) << decoded.error().text;
  EXPECT_EQ(digest_of(decoded->model()), built_.summary.digest);
  EXPECT_EQ(MappedModel{path_}.summary().digest, other.summary.digest);
}

TEST_F(ModelFile, TheDigestDependsOnThePositions) {
  EXPECT_EQ(digest_of(built_.model()), built_.summary.digest);
  BuiltModel other = built_;
  other.positions[0][0] += 1;
  EXPECT_NE(digest_of(other.model()), built_.summary.digest);
}

}  // namespace
}  // namespace tactus::spm::offline
