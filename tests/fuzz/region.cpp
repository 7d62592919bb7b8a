/// Region of a model, as a host sends it: vertex-split records.
#include "spm/codec/model_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "tests/fuzz/target.hpp"
#include "tests/support/random_model.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace tactus;
  static const spm::OwnedModel model = test_support::random_model(1, 500, 3);
  static const spm::codec::EncodedModel encoded{model.model()};
  (void)spm::codec::decode_region({data, size}, encoded.compressed().summary(), encoded.compressed().tables());
  return 0;
}
