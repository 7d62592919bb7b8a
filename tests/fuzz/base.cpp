/// Base mesh of a model, as a host sends it.
#include "spm/codec/base_codec.hpp"
#include "tests/fuzz/target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)tactus::spm::codec::decode_base({data, size});
  return 0;
}
