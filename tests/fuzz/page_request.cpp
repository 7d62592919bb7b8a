/// A frame that a page sends to the viewer.
#include "viewer/page_request.hpp"

#include <string>

#include "tests/fuzz/target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)tactus::viewer::parse_request(std::string{reinterpret_cast<const char*>(data), size});
  return 0;
}
