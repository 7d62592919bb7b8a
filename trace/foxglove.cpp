#include "trace/foxglove.hpp"

#include "trace/foxglove_idl.hpp"

namespace tactus::trace::foxglove {

const char* idl() noexcept { return kIdl; }

}  // namespace tactus::trace::foxglove
