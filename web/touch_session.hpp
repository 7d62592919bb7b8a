/// The session of the page "Touch it now": a virtual session with two users, whose first user's hand follows the mouse.
///
/// Runs without threads, sockets, files and clocks, natively and as WebAssembly (web/wasm). World frame, metres; times
/// are virtual. One thread at a time.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sharing/pointed_hand.hpp"
#include "spm/offline/triangle_mesh.hpp"
#include "study/virtual_session.hpp"

namespace tactus::web {

/// One direction of the link; both are equal.
struct TouchLink {
  double delay_ms = 10, jitter_ms = 1;
  double loss_percent = 0;
  double rate_mbit = 20;
};

/// A user as the page draws it.
struct UserView {
  std::array<double, 3> device{}, proxy{};
  std::array<double, 3> force{};     ///< on the hand, N
  double error_bound = 0;            ///< m; max distance between the touched and the finest surface
  double has_probe = 0;              ///< 0 or 1
  double in_contact = 0, exact = 0;  ///< 0 or 1
};

struct TouchFigures {
  double time_ms = 0;                               ///< virtual time since the start
  double contact_ms = 0, exact_ms = 0;              ///< how long the first user was in contact, and in exact contact
  double first_exact_ms = 0;                        ///< when the first exact contact began; 0: not yet
  double payload_bytes = 0;                         ///< received by the HRTC
  double records = 0, all_records = 0;              ///< vertex-split records received; of the model
  double faces = 0, fine_faces = 0, all_faces = 0;  ///< shown; shown at full resolution; of the finest mesh
  double round_trip_ms = 0;                         ///< measured by the HRTC; 0: not yet
};

/// The shown mesh, as buffers of WebGL: no index, each face has corners of its own.
struct MeshView {
  std::vector<float> corners;      ///< x y z of three corners of each face, model frame, file units
  std::vector<std::uint8_t> fine;  ///< by face: 1 if it is at full resolution
};

class TouchSession {
 public:
  static constexpr std::uint32_t kUsers = 2;

  /// Builds the model and starts host, link, HRTC and users. `size`: longest side of the object, m. Throws
  /// spm::offline::ModelError. Takes about 3 us a face.
  TouchSession(std::string name, spm::offline::TriangleMesh mesh, double size, std::uint64_t seed);

  /// Throws netem::LinkError for an impossible link.
  void set_link(const TouchLink& link);
  /// Moves the first user's hand towards `target`, at most at 0.5 m/s. The first call places the hand there.
  void move_hand(const std::array<double, 3>& target);
  /// Advances by one millisecond.
  void step();

  [[nodiscard]] const std::array<UserView, kUsers>& users() const noexcept { return users_; }
  [[nodiscard]] const TouchFigures& figures() const noexcept { return figures_; }
  /// Updates the mesh view. Returns whether it has changed since the last call. O(shown faces), allocates.
  [[nodiscard]] bool update_mesh();
  [[nodiscard]] const MeshView& mesh() const noexcept { return mesh_; }
  /// Scale from file units to metres. The origin of the model is at the origin of the world.
  [[nodiscard]] double metres_per_unit() const noexcept { return metres_per_unit_; }
  /// Bounds in the world frame: low x y z, high x y z.
  [[nodiscard]] const std::array<double, 6>& bounds() const noexcept { return bounds_; }

 private:
  void update_users();
  void update_figures();

  double metres_per_unit_ = 1;
  std::array<double, 6> bounds_{};
  study::Subject subject_;
  std::unique_ptr<study::VirtualSession> session_;
  std::array<UserView, kUsers> users_;
  TouchFigures figures_;
  MeshView mesh_;
  std::uint64_t mesh_hash_ = 0, base_faces_shown_ = 0;
  sharing::PointedHand hand_;
  std::int64_t start_ns_ = 0;
};

}  // namespace tactus::web
