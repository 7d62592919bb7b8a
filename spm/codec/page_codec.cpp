#include "spm/codec/page_codec.hpp"

#include <array>
#include <string>
#include <utility>

#include "spm/region_grid.hpp"

namespace tactus::spm::codec {
namespace {

constexpr std::size_t kMinRegionBytes = 19;

using Cell = std::array<std::uint32_t, 3>;

/// Returns the first cell of depth 0 in a page.
Cell first_cell(PageId page) noexcept {
  Cell cell{};
  for (std::uint32_t bit = 0; bit < 30; ++bit) cell[bit % 3] |= (index(page) >> bit & 1u) << bit / 3;
  for (std::uint32_t& coordinate : cell) coordinate *= kPageSide;
  return cell;
}

/// `origin`: cell of depth 0 to which the cell is relative.
void put_region(ByteWriter& out, const Region& region, const Cell& origin) {
  for (std::size_t axis = 0; axis < 3; ++axis) out.varint(region.cell[axis] - (origin[axis] << region.depth));
  out.varint(region.depth);
  out.raw(region.occupied);
  out.varint(region.record_count);
  out.varint(region.part_count - region.record_count);
  out.varint(region.face_count);
  out.raw(region.checksum);
}

/// Reads regions until one is wrong, and returns a description of it; an empty string if there is none. violations()
/// checks the rest.
std::string get_regions(ByteReader& in, std::uint32_t count, const Cell& origin, std::vector<Region>& regions) {
  if (in.remaining() / kMinRegionBytes < count)
    return std::to_string(count) + " regions do not fit into the remaining " + std::to_string(in.remaining()) +
           " bytes";
  regions.resize(count);
  for (Region& region : regions) {
    std::array<std::uint32_t, 4> small{};
    for (std::uint32_t& value : small) value = in.varint32();
    if (small[3] > kMaxCellDepth)
      return "found depth " + std::to_string(small[3]) + ", expected at most " + std::to_string(kMaxCellDepth);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::uint64_t coordinate = std::uint64_t{small[axis]} + (std::uint64_t{origin[axis]} << small[3]);
      if (coordinate > 0xffffu)
        return "found cell coordinate " + std::to_string(coordinate) + ", expected at most 65535";
      region.cell[axis] = static_cast<std::uint16_t>(coordinate);
    }
    region.depth = static_cast<std::uint16_t>(small[3]);
    region.occupied = in.raw<std::array<std::uint32_t, 2>>();
    region.first_interval = region.interval_count = 0;
    region.record_count = in.varint32();
    region.part_count = region.record_count + in.varint32();
    region.face_count = in.varint32();
    region.checksum = in.raw<std::uint32_t>();
  }
  return in.ok() ? "" : "truncated or damaged";
}

}  // namespace

Bytes encode_regions(std::span<const Region> regions) {
  ByteWriter out;
  for (const Region& region : regions) put_region(out, region, {});
  return out.take();
}

Result<std::vector<Region>> decode_regions(std::span<const std::uint8_t> bytes, const ModelSummary& summary) {
  ByteReader in{bytes};
  std::vector<Region> regions;
  std::string error = get_regions(in, summary.regions, {}, regions);
  if (error.empty() && in.remaining() != 0) error = std::to_string(in.remaining()) + " bytes too many";
  if (error.empty())
    if (const std::vector<std::string> broken = violations(summary, regions); !broken.empty()) error = broken.front();
  if (!error.empty()) return DecodeError{"regions: " + error};
  return regions;
}

Bytes encode_page(const Page& page) {
  ByteWriter out;
  out.varint(index(page.id));
  out.varint(page.first);
  out.varint(page.regions.size());
  for (const Region& region : page.regions) put_region(out, region, first_cell(page.id));
  return out.take();
}

Result<Page> decode_page(std::span<const std::uint8_t> bytes, const ModelSummary& summary) {
  ByteReader in{bytes};
  Page page;
  page.id = PageId{in.varint32()};
  page.first = in.varint32();
  const std::uint32_t count = in.varint32();
  if (index(page.id) >= kPageIds)
    return DecodeError{"page: found number " + std::to_string(index(page.id)) + ", expected below " +
                       std::to_string(kPageIds)};
  std::string error = get_regions(in, count, first_cell(page.id), page.regions);
  if (error.empty() && in.remaining() != 0) error = std::to_string(in.remaining()) + " bytes too many";
  if (error.empty())
    if (const std::vector<std::string> broken = violations(summary, page); !broken.empty()) error = broken.front();
  if (!error.empty()) return DecodeError{"page " + std::to_string(index(page.id)) + ": " + error};
  return page;
}

Bytes encode_pages(std::span<const Region> regions) {
  ByteWriter out;
  for (std::size_t first = 0; first < regions.size();) {
    const Bytes page = encode_page(page_with_id(regions, page_of(regions[first])));
    out.varint(page.size());
    for (const std::uint8_t byte : page) out.raw(byte);
    first += RegionPage::leading(regions.subspan(first));
  }
  return out.take();
}

Result<std::vector<Page>> decode_pages(std::span<const std::uint8_t> bytes, const ModelSummary& summary) {
  ByteReader in{bytes};
  std::vector<Page> pages;
  while (in.ok() && in.remaining() > 0) {
    const std::uint64_t size = in.varint();
    if (!in.ok() || in.remaining() < size) return DecodeError{"pages: truncated or damaged"};
    Result<Page> page = decode_page(in.remaining_bytes().first(size), summary);
    if (!page) return page.error();
    in.skip(size);
    pages.push_back(std::move(*page));
  }
  return pages;
}

}  // namespace tactus::spm::codec
