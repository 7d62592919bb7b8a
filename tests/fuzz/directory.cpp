/// Pages of a directory, as a host sends them. A page that is accepted is inserted into a grid.
#include "spm/codec/page_codec.hpp"
#include "spm/region_grid.hpp"
#include "tests/fuzz/target.hpp"
#include "tests/support/random_model.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace tactus;
  static const spm::OwnedModel model = test_support::random_model(1, 500, 3);
  const std::span<const std::uint8_t> bytes{data, size};
  spm::RegionGrid grid{model.summary, 8};
  if (const auto decoded = spm::codec::decode_page(bytes, model.summary)) {
    const spm::RegionPage page{*decoded};
    if (!grid.can_insert(page)) return 0;
    grid.insert(page);
    for (const double radius : {0.1, 1.0, 100.0})
      (void)grid.for_each_intersecting(spm::Vec3d::Ones(), radius, [](spm::RegionId, double) {});
    grid.remove(page);
  }
  (void)spm::codec::decode_pages(bytes, model.summary);
  return 0;
}
