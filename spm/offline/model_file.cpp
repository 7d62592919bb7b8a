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

#include "spm/offline/digest.hpp"
#include "spm/offline/pending_file.hpp"

namespace tactus::spm::offline {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the file has the bytes of values in memory");

constexpr std::array<char, 8> kMagic{'t', 'a', 'c', 't', 'S', 'P', 'M', '\n'};
constexpr std::size_t kAlignment = 64;

enum class SectionKind : std::uint32_t { kBase = 1, kCodes, kLists, kSizes, kStatistics };
constexpr std::uint32_t kSections = 5;
constexpr std::array<const char*, kSections> kSectionNames{"base mesh", "codes", "lists", "sizes", "statistics"};

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

void check_section(const SectionEntry& section, std::uint32_t i, const unsigned char* file, std::size_t size,
                   const std::filesystem::path& path) {
  const std::string name = std::string{"section "} + kSectionNames[i];
  if (static_cast<std::uint32_t>(section.kind) != i + 1)
    fail(path, name + ": found section kind " + std::to_string(static_cast<std::uint32_t>(section.kind)) +
                   ", expected " + std::to_string(i + 1));
  if (section.offset % kAlignment != 0 || section.offset > size || section.size > size - section.offset) {
    fail(path, name + ": found offset " + std::to_string(section.offset) + " and " + std::to_string(section.size) +
                   " bytes, expected a multiple of 64 and an end within the " + std::to_string(size) +
                   " bytes of the file");
  }
  if (XXH3_64bits(file + section.offset, section.size) != section.checksum) {
    fail(path, name + ": checksum does not match, the file is damaged");
  }
}

}  // namespace

void write_model(const std::filesystem::path& path, const Model& model, const Provenance& provenance) {
  const std::string statistics = to_json(provenance);
  const codec::EncodedModel encoded{model};
  const codec::ModelSpans& bytes = encoded.compressed().spans();
  const std::array<std::pair<const void*, std::size_t>, kSections> contents{{{bytes.base.data(), bytes.base.size()},
                                                                             {bytes.codes.data(), bytes.codes.size()},
                                                                             {bytes.lists.data(), bytes.lists.size()},
                                                                             {bytes.sizes.data(), bytes.sizes.size()},
                                                                             {statistics.data(), statistics.size()}}};

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
  void* data;
  std::size_t size;
};

MappedModel::MappedModel(MappedModel&&) noexcept = default;
MappedModel& MappedModel::operator=(MappedModel&&) noexcept = default;
MappedModel::~MappedModel() = default;

MappedModel::MappedModel(const std::filesystem::path& path, OwnedModel* arrays) {
  const File file{path};
  if (file.fd < 0) fail(path, "cannot be read: " + std::string{std::strerror(errno)});
  struct stat status {};
  if (::fstat(file.fd, &status) != 0 || !S_ISREG(status.st_mode)) fail(path, "is no regular file");
  const auto size = static_cast<std::size_t>(status.st_size);
  if (size < sizeof(Header) + sizeof(Table)) {
    fail(path, "found " + std::to_string(size) + " bytes, expected at least " +
                   std::to_string(sizeof(Header) + sizeof(Table)));
  }
  mapping_ = std::make_unique<const Mapping>(file.fd, size);
  if (mapping_->data == MAP_FAILED) fail(path, "cannot be mapped: " + std::string{std::strerror(errno)});

  const auto* bytes = static_cast<const unsigned char*>(mapping_->data);
  Header header;
  Table table;
  std::memcpy(&header, bytes, sizeof header);
  std::memcpy(&table, bytes + sizeof header, sizeof table);
  check_header(header, size, path);
  if (checksum_of(header, table) != header.checksum) fail(path, "header checksum does not match, the file is damaged");
  for (std::uint32_t i = 0; i < kSections; ++i) check_section(table[i], i, bytes, size, path);

  const auto section = [&](SectionKind kind) {
    const SectionEntry& entry = table[static_cast<std::uint32_t>(kind) - 1];
    return std::span<const std::uint8_t>{bytes + entry.offset, static_cast<std::size_t>(entry.size)};
  };
  auto compressed = codec::CompressedModel::open({section(SectionKind::kBase), section(SectionKind::kCodes),
                                                  section(SectionKind::kLists), section(SectionKind::kSizes)});
  if (!compressed) fail(path, compressed.error().text);
  compressed_ = std::move(*compressed);
  auto decoded = codec::decode_model(compressed_);
  if (!decoded) fail(path, decoded.error().text);
  const std::vector<std::string> broken = violations(decoded->model());
  if (!broken.empty()) fail(path, broken.front());
  if (digest_of(decoded->model()) != summary().digest) fail(path, "digest does not match its contents");
  if (arrays != nullptr) *arrays = std::move(*decoded);
  try {
    const std::span<const std::uint8_t> statistics = section(SectionKind::kStatistics);
    provenance_ = from_json(reinterpret_cast<const char*>(statistics.data()), statistics.size());
  } catch (const nlohmann::json::exception& e) {
    fail(path, std::string{"section statistics: "} + e.what());
  }
}

}  // namespace tactus::spm::offline
