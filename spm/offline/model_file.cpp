#include "spm/offline/model_file.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "spm/codec/block_checksums.hpp"
#include "spm/codec/bytes.hpp"
#include "spm/offline/digest.hpp"
#include "spm/offline/pending_file.hpp"

namespace tactus::spm::offline {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the file has the bytes of values in memory");

constexpr std::array<char, 8> kMagic{'t', 'a', 'c', 't', 'S', 'P', 'M', '\n'};
constexpr std::size_t kAlignment = 64;

enum class SectionKind : std::uint32_t { kBase = 1, kRegions, kCodes, kLists, kSizes, kStatistics, kChecksums };
constexpr std::uint32_t kSections = 7;
constexpr std::array<const char*, kSections> kSectionNames{"base mesh", "regions",    "codes",    "lists",
                                                           "sizes",     "statistics", "checksums"};

struct Header {
  std::array<char, 8> magic;
  std::uint32_t version;
  std::uint32_t sections;
  std::uint64_t file_size;
  std::uint64_t checksum;  // of this header, with checksum 0, and of the table
  std::array<std::uint64_t, 4> reserved;
};
static_assert(sizeof(Header) == 64);

struct SectionEntry {
  SectionKind kind;
  std::uint32_t reserved;
  std::uint64_t offset, size;
  std::uint64_t checksum;
};
static_assert(sizeof(SectionEntry) == 32);
using Table = std::array<SectionEntry, kSections>;
static_assert(sizeof(ModelSummary) == 120, "no padding, so that its bytes can be hashed");

std::uint64_t checksum_of(Header header, const Table& table) {
  header.checksum = 0;
  std::array<unsigned char, sizeof(Header) + sizeof(Table)> bytes;
  std::memcpy(bytes.data(), &header, sizeof header);
  std::memcpy(bytes.data() + sizeof header, &table, sizeof table);
  return XXH3_64bits(bytes.data(), bytes.size());
}

std::string to_json(const Provenance& p) {
  const CleanReport& c = p.cleaned;
  return nlohmann::ordered_json{{"source", p.source},
                                {"dropped",
                                 {{"welded_vertices", c.welded_vertices},
                                  {"non_finite_faces", c.non_finite_faces},
                                  {"repeated_corner_faces", c.repeated_corner_faces},
                                  {"zero_area_faces", c.zero_area_faces},
                                  {"duplicate_faces", c.duplicate_faces},
                                  {"unreferenced_vertices", c.unreferenced_vertices}}}}
      .dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Provenance from_json(const char* text, std::size_t size) {
  const auto json = nlohmann::json::parse(text, text + size);
  const auto& dropped = json.at("dropped");
  Provenance p;
  p.source = json.at("source").get<std::string>();
  p.cleaned.welded_vertices = dropped.at("welded_vertices");
  p.cleaned.non_finite_faces = dropped.at("non_finite_faces");
  p.cleaned.repeated_corner_faces = dropped.at("repeated_corner_faces");
  p.cleaned.zero_area_faces = dropped.at("zero_area_faces");
  p.cleaned.duplicate_faces = dropped.at("duplicate_faces");
  p.cleaned.unreferenced_vertices = dropped.at("unreferenced_vertices");
  return p;
}

struct File {
  explicit File(const std::filesystem::path& path) : fd{::open(path.c_str(), O_RDONLY | O_CLOEXEC)} {}
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  ~File() {
    if (fd >= 0) ::close(fd);
  }
  int fd;
};

void check_header(const Header& header, std::size_t size, const std::filesystem::path& path) {
  if (header.magic != kMagic) fail(path, "not an .spm file: it does not begin with \"tactSPM\"");
  if (header.version != kModelFileVersion) {
    fail(path, std::string{"format version "} + std::to_string(header.version) + ", this program reads version " +
                   std::to_string(kModelFileVersion) +
                   (header.version > kModelFileVersion ? "; it was written by a later release, or is damaged"
                                                       : "; it was written by an earlier release, or is damaged"));
  }
  if (header.sections != kSections) {
    fail(path, "found " + std::to_string(header.sections) + " sections, expected " + std::to_string(kSections));
  }
  if (header.file_size != size) {
    fail(path, "found " + std::to_string(size) + " bytes, its header declares " + std::to_string(header.file_size) +
                   (size < header.file_size ? " (truncated)" : ""));
  }
}

std::string name_of(std::uint32_t section) { return std::string{"section "} + kSectionNames[section]; }

void check_place(const SectionEntry& section, std::uint32_t i, std::size_t size, const std::filesystem::path& path) {
  const std::string name = name_of(i);
  if (static_cast<std::uint32_t>(section.kind) != i + 1)
    fail(path, name + ": found section kind " + std::to_string(static_cast<std::uint32_t>(section.kind)) +
                   ", expected " + std::to_string(i + 1));
  if (section.offset % kAlignment != 0 || section.offset > size || section.size > size - section.offset) {
    fail(path, name + ": found offset " + std::to_string(section.offset) + " and " + std::to_string(section.size) +
                   " bytes, expected a multiple of 64 and an end within the " + std::to_string(size) +
                   " bytes of the file");
  }
}

void check_checksum(const SectionEntry& section, std::uint32_t i, const unsigned char* file,
                    const std::filesystem::path& path) {
  if (XXH3_64bits(file + section.offset, section.size) != section.checksum)
    fail(path, name_of(i) + ": checksum does not match, the file is damaged");
}

constexpr bool is_checked_by_block(std::uint32_t section) noexcept {
  return section + 1 == static_cast<std::uint32_t>(SectionKind::kCodes) ||
         section + 1 == static_cast<std::uint32_t>(SectionKind::kLists);
}

codec::Bytes block_checksums(const codec::ModelSpans& bytes) {
  codec::ByteWriter out;
  for (const std::span<const std::uint8_t> section : {bytes.codes, bytes.lists})
    for (const std::uint64_t checksum : codec::BlockChecksums::of(section)) out.raw(checksum);
  return out.take();
}

}  // namespace

void write_model(const std::filesystem::path& path, const Model& model, const Provenance& provenance) {
  std::vector<std::string> broken = violations(base_mesh_of(model));
  if (broken.empty()) broken = violations(model.summary, model.regions);
  if (!broken.empty()) fail(path, "cannot be written: " + broken.front());
  const std::string statistics = to_json(provenance);
  const codec::EncodedModel encoded{model};
  const codec::ModelSpans& bytes = encoded.compressed().spans();
  const codec::Bytes checksums = block_checksums(bytes);
  const std::array<std::pair<const void*, std::size_t>, kSections> contents{
      {{bytes.base.data(), bytes.base.size()},
       {bytes.regions.data(), bytes.regions.size()},
       {bytes.codes.data(), bytes.codes.size()},
       {bytes.lists.data(), bytes.lists.size()},
       {bytes.sizes.data(), bytes.sizes.size()},
       {statistics.data(), statistics.size()},
       {checksums.data(), checksums.size()}}};

  Table table{};
  std::size_t end = sizeof(Header) + sizeof(Table);
  for (std::uint32_t i = 0; i < kSections; ++i) {
    const std::size_t offset = (end + kAlignment - 1) / kAlignment * kAlignment;
    table[i] = {static_cast<SectionKind>(i + 1), 0, offset, contents[i].second,
                XXH3_64bits(contents[i].first, contents[i].second)};
    end = offset + contents[i].second;
  }
  Header header{kMagic, kModelFileVersion, kSections, end, 0, {}};
  header.checksum = checksum_of(header, table);

  const std::array<char, kAlignment> zeros{};
  PendingFile file{path};
  file.write(&header, sizeof header);
  file.write(&table, sizeof table);
  for (std::uint32_t i = 0; i < kSections; ++i) {
    file.write(zeros.data(), table[i].offset - file.written());
    file.write(contents[i].first, contents[i].second);
  }
  file.commit();
}

bool is_model_file(const std::filesystem::path& path) {
  const File file{path};
  std::array<char, 8> magic{};
  return file.fd >= 0 && ::read(file.fd, magic.data(), magic.size()) == ssize_t{8} && magic == kMagic;
}

struct MappedModel::Mapping {
  Mapping(int fd, std::size_t bytes) : data{::mmap(nullptr, bytes, PROT_READ, MAP_PRIVATE, fd, 0)}, size{bytes} {}
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;
  ~Mapping() {
    if (data != MAP_FAILED) ::munmap(data, size);
  }
  [[nodiscard]] const unsigned char* bytes() const noexcept { return static_cast<const unsigned char*>(data); }
  [[nodiscard]] std::span<const std::uint8_t> section(SectionKind kind) const noexcept {
    const SectionEntry& entry = table[static_cast<std::uint32_t>(kind) - 1];
    return {bytes() + entry.offset, static_cast<std::size_t>(entry.size)};
  }

  void* data;
  std::size_t size;
  Table table{};
};

MappedModel::MappedModel(MappedModel&&) noexcept = default;
MappedModel& MappedModel::operator=(MappedModel&&) noexcept = default;
MappedModel::~MappedModel() = default;

MappedModel::MappedModel(const std::filesystem::path& path) : path_{path} {
  const File file{path};
  if (file.fd < 0) fail(path, "cannot be read: " + std::string{std::strerror(errno)});
  struct stat status {};
  if (::fstat(file.fd, &status) != 0 || !S_ISREG(status.st_mode)) fail(path, "is no regular file");
  const auto size = static_cast<std::size_t>(status.st_size);
  if (size < sizeof(Header) + sizeof(Table)) {
    fail(path, "found " + std::to_string(size) + " bytes, expected at least " +
                   std::to_string(sizeof(Header) + sizeof(Table)));
  }
  auto mapping = std::make_unique<Mapping>(file.fd, size);
  if (mapping->data == MAP_FAILED) fail(path, "cannot be mapped: " + std::string{std::strerror(errno)});

  Header header;
  Table& table = mapping->table;
  std::memcpy(&header, mapping->bytes(), sizeof header);
  std::memcpy(&table, mapping->bytes() + sizeof header, sizeof table);
  check_header(header, size, path);
  if (checksum_of(header, table) != header.checksum) fail(path, "header checksum does not match, the file is damaged");
  for (std::uint32_t i = 0; i < kSections; ++i) {
    check_place(table[i], i, size, path);
    if (!is_checked_by_block(i)) check_checksum(table[i], i, mapping->bytes(), path);
  }
  mapping_ = std::move(mapping);

  const auto section = [this](SectionKind kind) { return mapping_->section(kind); };
  auto compressed = codec::CompressedModel::open({section(SectionKind::kBase), section(SectionKind::kRegions),
                                                  section(SectionKind::kCodes), section(SectionKind::kLists),
                                                  section(SectionKind::kSizes)});
  if (!compressed) fail(path, compressed.error().text);
  compressed_ = std::move(*compressed);
  set_checksums();
  try {
    const std::span<const std::uint8_t> statistics = section(SectionKind::kStatistics);
    provenance_ = from_json(reinterpret_cast<const char*>(statistics.data()), statistics.size());
  } catch (const nlohmann::json::exception& e) {
    fail(path, std::string{"section statistics: "} + e.what());
  }
}

/// Gives the compressed model the checksums of the blocks of codes and lists.
void MappedModel::set_checksums() {
  using codec::BlockChecksums;
  const std::span<const std::uint8_t> checksums = mapping_->section(SectionKind::kChecksums);
  std::size_t blocks = 0;
  for (const SectionKind kind : {SectionKind::kCodes, SectionKind::kLists})
    blocks += BlockChecksums::blocks_in(mapping_->section(kind).size());
  if (checksums.size() != blocks * sizeof(std::uint64_t))
    fail(path_, "section checksums: found " + std::to_string(checksums.size()) + " bytes, expected " +
                    std::to_string(blocks * sizeof(std::uint64_t)));
  codec::ByteReader in{checksums};
  const auto read = [&](SectionKind kind) {
    const std::span<const std::uint8_t> bytes = mapping_->section(kind);
    std::vector<std::uint64_t> each(BlockChecksums::blocks_in(bytes.size()));
    for (std::uint64_t& checksum : each) checksum = in.raw<std::uint64_t>();
    return std::make_shared<const BlockChecksums>(path_.string() + ": " + name_of(static_cast<std::uint32_t>(kind) - 1),
                                                  bytes, std::move(each));
  };
  auto codes = read(SectionKind::kCodes);
  compressed_.set_checksums(std::move(codes), read(SectionKind::kLists));
}

void MappedModel::check_checksums() const {
  if (const std::string damage = compressed_.damage(); !damage.empty()) throw ModelError{damage};
}

OwnedModel MappedModel::decode() const {
  check_checksums();
  for (std::uint32_t i = 0; i < kSections; ++i)
    if (is_checked_by_block(i)) check_checksum(mapping_->table[i], i, mapping_->bytes(), path_);
  auto decoded = codec::decode_model(compressed_);
  if (!decoded) fail(path_, decoded.error().text);
  const std::vector<std::string> broken = violations(decoded->model());
  if (!broken.empty()) fail(path_, broken.front());
  if (digest_of(decoded->model()) != summary().digest) fail(path_, "digest does not match its contents");
  return std::move(*decoded);
}

}  // namespace tactus::spm::offline
