#include "trace/contact_log.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "trace/private_file.hpp"

namespace tactus::trace {
namespace {

constexpr char kLogMagic[8] = {'T', 'A', 'C', 'T', 'L', 'O', 'G', '\0'};
constexpr std::uint32_t kVersion = 1;
constexpr std::uint8_t kObjectTag = 1, kQueryTag = 2, kTotalsTag = 3;
constexpr std::size_t kMaxNameBytes = 4096;

/// The fixed part of a query entry.
struct QueryHead {
  std::int64_t time_ns;
  std::array<double, 3> centre;
  double radius;
  std::uint64_t mesh_hash;
  std::uint32_t object, probe, since_change, contact_count;
  std::uint32_t exact, truncated;
};
static_assert(sizeof(QueryHead) == 72);

struct ContactEntry {
  std::uint64_t triangle;
  float depth;
  std::uint32_t reserved;
};
static_assert(sizeof(ContactEntry) == 16);

struct TotalsEntry {
  std::uint64_t object, records_received, records_received_again, regions_received, regions_released;
};

struct ObjectHead {
  std::uint64_t digest;
  double scale;
  std::uint32_t index, name_bytes;
};

/// Mixes the bits of a hash (finalizer of splitmix64).
std::uint64_t mixed(std::uint64_t z) noexcept {
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ z >> 27) * 0x94d049bb133111ebull;
  return z ^ z >> 31;
}

}  // namespace

std::uint64_t triangle_key(const std::array<float, 9>& corners) noexcept {
  std::array<std::uint64_t, 3> corner{};
  for (int i = 0; i < 3; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const float value = corners[3 * i + axis] + 0.0f;  // -0 becomes 0
      std::uint32_t bits;
      std::memcpy(&bits, &value, sizeof bits);
      corner[i] = mixed(corner[i] * 0x9e3779b97f4a7c15ull + bits + 1);
    }
  }
  const auto first = static_cast<int>(std::min_element(corner.begin(), corner.end()) - corner.begin());
  std::uint64_t key = 0;
  for (int i = 0; i < 3; ++i) key = mixed(key * 0x9e3779b97f4a7c15ull + corner[(first + i) % 3]);
  return key;
}

ContactLogWriter::ContactLogWriter(const std::filesystem::path& path) : file_{open_private(path)} {
  if (file_ == nullptr) throw LogError("cannot write the contact log " + path.string() + ": " + std::strerror(errno));
  put(kLogMagic, sizeof kLogMagic);
  put(&kVersion, sizeof kVersion);
}

ContactLogWriter::~ContactLogWriter() { static_cast<void>(close()); }

bool ContactLogWriter::close() {
  if (file_ != nullptr && std::fclose(file_) != 0) healthy_ = false;
  file_ = nullptr;
  return healthy_;
}

void ContactLogWriter::put(const void* data, std::size_t size) {
  healthy_ = healthy_ && std::fwrite(data, 1, size, file_) == size;
}

void ContactLogWriter::flush() { healthy_ = healthy_ && std::fflush(file_) == 0; }

void ContactLogWriter::write(const LoggedObject& object) {
  const ObjectHead head{object.digest, object.scale, object.index, static_cast<std::uint32_t>(object.name.size())};
  put(&kObjectTag, 1);
  put(&head, sizeof head);
  put(object.name.data(), object.name.size());
}

void ContactLogWriter::write(const LoggedQuery& query) {
  const QueryHead head{
      query.time_ns, query.centre,       query.radius,        query.mesh_hash,       query.object,
      query.probe,   query.since_change, query.contact_count, query.exact ? 1u : 0u, query.truncated ? 1u : 0u};
  put(&kQueryTag, 1);
  put(&head, sizeof head);
  for (std::uint32_t i = 0; i < query.contact_count; ++i) {
    const ContactEntry entry{query.contacts[i].triangle, query.contacts[i].depth, 0};
    put(&entry, sizeof entry);
  }
}

void ContactLogWriter::write(const LoggedTotals& totals) {
  const TotalsEntry entry{totals.object, totals.records_received, totals.records_received_again,
                          totals.regions_received, totals.regions_released};
  put(&kTotalsTag, 1);
  put(&entry, sizeof entry);
}

ContactLogReader::ContactLogReader(const std::filesystem::path& path)
    : file_{std::fopen(path.c_str(), "rb")}, name_{path.string()} {
  if (file_ == nullptr) throw LogError("cannot read the contact log " + name_ + ": " + std::strerror(errno));
  char magic[sizeof kLogMagic];
  std::uint32_t version = 0;
  const bool is_log =
      get(magic, sizeof magic) && std::memcmp(magic, kLogMagic, sizeof magic) == 0 && get(&version, sizeof version);
  if (!is_log || version != kVersion) {
    std::fclose(file_);
    throw LogError(is_log ? name_ + ": found a contact log of version " + std::to_string(version) + ", expected " +
                                std::to_string(kVersion)
                          : name_ + ": not a contact log");
  }
}

ContactLogReader::~ContactLogReader() { std::fclose(file_); }

bool ContactLogReader::get(void* data, std::size_t size) {
  is_truncated_ = std::fread(data, 1, size, file_) != size;
  return !is_truncated_;
}

ContactLogReader::Entry ContactLogReader::next() {
  std::uint8_t tag = 0;
  if (!get(&tag, 1)) {
    is_truncated_ = false;  // no entry had begun
    return Entry::kEnd;
  }
  if (tag == kObjectTag) {
    ObjectHead head;
    if (!get(&head, sizeof head)) return Entry::kEnd;
    if (head.name_bytes > kMaxNameBytes)
      throw LogError(name_ + ": found an object name of " + std::to_string(head.name_bytes) +
                     " bytes, expected at most " + std::to_string(kMaxNameBytes));
    object = {head.index, head.digest, head.scale, std::string(head.name_bytes, '\0')};
    return get(object.name.data(), head.name_bytes) ? Entry::kObject : Entry::kEnd;
  }
  if (tag == kTotalsTag) {
    TotalsEntry entry;
    if (!get(&entry, sizeof entry)) return Entry::kEnd;
    totals = {static_cast<std::uint32_t>(entry.object), entry.records_received, entry.records_received_again,
              entry.regions_received, entry.regions_released};
    return Entry::kTotals;
  }
  if (tag != kQueryTag) throw LogError(name_ + ": found entry tag " + std::to_string(tag) + ", expected 1 to 3");
  QueryHead head;
  if (!get(&head, sizeof head)) return Entry::kEnd;
  if (head.contact_count > LoggedQuery::kMaxContacts)
    throw LogError(name_ + ": found an entry with " + std::to_string(head.contact_count) +
                   " contacts, expected at most " + std::to_string(LoggedQuery::kMaxContacts));
  query.time_ns = head.time_ns;
  query.object = head.object;
  query.probe = head.probe;
  query.centre = head.centre;
  query.radius = head.radius;
  query.mesh_hash = head.mesh_hash;
  query.since_change = head.since_change;
  query.exact = head.exact != 0;
  query.truncated = head.truncated != 0;
  query.contact_count = head.contact_count;
  for (std::uint32_t i = 0; i < head.contact_count; ++i) {
    ContactEntry entry;
    if (!get(&entry, sizeof entry)) return Entry::kEnd;
    query.contacts[i] = {entry.triangle, entry.depth};
  }
  return Entry::kQuery;
}

}  // namespace tactus::trace
