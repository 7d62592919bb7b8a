// The functions that web/page/worker.js calls. Arrays are in the memory of the module. A function that can fail returns
// false, or -1; tactus_error then returns the message.
#include <emscripten.h>

#include <array>
#include <cstdint>
#include <exception>
#include <memory>
#include <sstream>
#include <string>
#include <utility>

#include "spm/offline/generate.hpp"
#include "spm/offline/ply.hpp"
#include "web/touch_session.hpp"

namespace {

using tactus::web::TouchSession;

// The scripts of the page read these structs as numbers, by position.
static_assert(sizeof(tactus::web::UserView) == 13 * sizeof(double), "change kUserNumbers in web/page");
static_assert(sizeof(tactus::web::TouchFigures) == 11 * sizeof(double), "change kFigures in web/page");

std::unique_ptr<TouchSession> session;
std::string error;
tactus::spm::offline::TriangleMesh input;
std::string file;

template <class Action>
bool attempt(Action&& action) {
  try {
    action();
    return true;
  } catch (const std::exception& thrown) {
    input = {};
    error = thrown.what();
    return false;
  }
}

}  // namespace

extern "C" {

EMSCRIPTEN_KEEPALIVE const char* tactus_error() { return error.c_str(); }

/// Starts a session with a generated organ whose longest side is `size`, m.
EMSCRIPTEN_KEEPALIVE bool tactus_open_organ(unsigned faces, double size, unsigned seed) {
  return attempt([&] {
    using namespace tactus::spm::offline;
    session = nullptr;
    session = std::make_unique<TouchSession>("organ", generate(Shape::kOrgan, faces, seed), size, seed);
  });
}

/// Allocates the arrays of a mesh for tactus_open_mesh.
EMSCRIPTEN_KEEPALIVE bool tactus_allocate_mesh(unsigned vertices, unsigned faces) {
  return attempt([&] {
    input.positions.resize(vertices);
    input.faces.resize(faces);
  });
}
EMSCRIPTEN_KEEPALIVE float* tactus_mesh_positions() { return reinterpret_cast<float*>(input.positions.data()); }
EMSCRIPTEN_KEEPALIVE std::uint32_t* tactus_mesh_faces() { return reinterpret_cast<std::uint32_t*>(input.faces.data()); }
/// Starts a session with the mesh in these arrays.
EMSCRIPTEN_KEEPALIVE bool tactus_open_mesh(double size, unsigned seed) {
  return attempt([&] {
    session = nullptr;
    session = std::make_unique<TouchSession>("model", std::exchange(input, {}), size, seed);
  });
}

/// Allocates the bytes of a PLY file for tactus_read_ply.
EMSCRIPTEN_KEEPALIVE char* tactus_allocate_file(unsigned bytes) {
  attempt([&] { file.resize(bytes); });
  return file.size() == bytes ? file.data() : nullptr;
}
/// Reads this file into the arrays of a mesh. Returns the number of its faces, or -1.
EMSCRIPTEN_KEEPALIVE int tactus_read_ply() {
  using namespace tactus::spm::offline;
  const bool is_read = attempt([&] {
    const std::uint64_t bytes = file.size();
    std::istringstream in{std::exchange(file, {})};
    input = read_ply({"the file", bytes}, in).mesh;
  });
  file = {};
  return is_read ? static_cast<int>(input.faces.size()) : -1;
}

EMSCRIPTEN_KEEPALIVE bool tactus_set_link(double delay_ms, double jitter_ms, double loss_percent, double rate_mbit) {
  return attempt([&] { session->set_link({delay_ms, jitter_ms, loss_percent, rate_mbit}); });
}

EMSCRIPTEN_KEEPALIVE bool tactus_move_hand(double x, double y, double z) {
  return attempt([&] { session->move_hand({x, y, z}); });
}

EMSCRIPTEN_KEEPALIVE bool tactus_step() {
  return attempt([] { session->step(); });
}

/// The numbers of TouchFigures, then those of UserView for each user.
EMSCRIPTEN_KEEPALIVE const double* tactus_figures() { return reinterpret_cast<const double*>(&session->figures()); }
EMSCRIPTEN_KEEPALIVE const double* tactus_users() { return reinterpret_cast<const double*>(session->users().data()); }
EMSCRIPTEN_KEEPALIVE double tactus_metres_per_unit() { return session->metres_per_unit(); }
EMSCRIPTEN_KEEPALIVE const double* tactus_bounds() { return session->bounds().data(); }

/// Updates the buffers of the shown mesh. Returns 1 if it has changed, else 0.
EMSCRIPTEN_KEEPALIVE int tactus_update_mesh() {
  bool changed = false;
  if (!attempt([&] { changed = session->update_mesh(); })) return -1;
  return changed ? 1 : 0;
}
EMSCRIPTEN_KEEPALIVE unsigned tactus_shown_faces() { return static_cast<unsigned>(session->mesh().fine.size()); }
EMSCRIPTEN_KEEPALIVE const float* tactus_corners() { return session->mesh().corners.data(); }
EMSCRIPTEN_KEEPALIVE const std::uint8_t* tactus_fine() { return session->mesh().fine.data(); }

}  // extern "C"
