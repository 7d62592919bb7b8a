/// Messages of regions, one after the other, as a gateway stores them in its compressed cache. The input is a sequence
/// of operations: one byte for the operation, one for the region, two for the size of the message, and the message.
#include <cstdlib>
#include <vector>

#include "spm/codec/compressed_cache.hpp"
#include "spm/codec/model_codec.hpp"
#include "tests/fuzz/target.hpp"
#include "tests/support/random_model.hpp"

namespace {

using namespace tactus;
using spm::codec::CompressedCache;
using Status = CompressedCache::PutResult::Status;

constexpr spm::ObjectIndex kObject{0};

struct RegionState {
  bool held = false, loaded = false, retired = false;
};

void put(CompressedCache& cache, spm::RegionId region, RegionState& state, std::span<const std::uint8_t> message) {
  const CompressedCache::PutResult result = cache.put(kObject, region, message);
  if (result.status == Status::kStored) state = {.held = true};
  if (cache.holds(kObject, region) != state.held) std::abort();
}

/// Changes the state of a held region.
void change(CompressedCache& cache, spm::RegionId region, RegionState& state, int operation) {
  switch (operation) {
    case 1:
      if (!state.loaded) cache.mark_loaded(kObject, region);
      state.loaded = true;
      break;
    case 2:
      if (state.loaded) cache.mark_unloaded(kObject, region);
      state.loaded = false;
      break;
    case 3:
      if (!state.retired) cache.retire(kObject, region);
      state.retired = true;
      break;
    case 4:
      if (state.retired) cache.reinstate(kObject, region);
      state.retired = false;
      break;
    default:
      if (!state.retired) break;
      if (state.loaded) cache.mark_unloaded(kObject, region);
      cache.evict(kObject, region);
      state = {};
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const spm::OwnedModel model = test_support::random_model(1, 500, 3);
  static const spm::codec::EncodedModel encoded{model.model()};
  const spm::codec::CompressedModel& compressed = encoded.compressed();
  constexpr std::uint32_t kBlocks = 4096;
  constexpr std::size_t kHead = 4;
  CompressedCache cache{kBlocks};
  cache.admit(kObject, compressed.summary(), compressed.tables());
  std::vector<RegionState> states(compressed.summary().regions);
  for (std::span<const std::uint8_t> left{data, size}; left.size() >= kHead;) {
    const int operation = left[0] % 6;
    const spm::RegionId region{left[1] % compressed.summary().regions};
    const std::size_t stated = left[2] | left[3] << 8u;
    left = left.subspan(kHead);
    RegionState& state = states[index(region)];
    if (operation == 0) {
      const std::size_t bytes = std::min(stated, left.size());
      put(cache, region, state, left.subspan(0, bytes));
      left = left.subspan(bytes);
    } else if (state.held) {
      change(cache, region, state, operation);
    }
    if (state.held && cache.get(kObject, region) == nullptr) std::abort();  // `put` has checked all records
  }
  if (!cache.violations().empty()) std::abort();
  return 0;
}
