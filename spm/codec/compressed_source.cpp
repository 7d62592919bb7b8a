#include "spm/codec/compressed_source.hpp"

#include <stdexcept>
#include <string>
#include <utility>

#include "spm/codec/region_codec.hpp"

namespace tactus::spm::codec {

RegionData CompressedSource::region(RegionId region) {
  const Result<Bytes> bytes = encode_region(model_, region, model_.intervals_of(region));
  if (!bytes) throw std::runtime_error("region " + std::to_string(index(region)) + ": " + bytes.error().text);
  Result<RegionData> data = decode_region(*bytes, model_.summary(), model_.tables());
  if (!data) throw std::runtime_error(data.error().text);
  return std::move(*data);
}

}  // namespace tactus::spm::codec
