#include "haptics/body_touch.hpp"

namespace tactus::haptics {

BoxSurface::BoxSurface(const Vec3d& half_extents) noexcept {
  std::size_t next = 0;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      const auto corner = [&](double along_u, double along_v) {
        Vec3d point;
        point[axis] = side * half_extents[axis];
        point[u] = along_u * half_extents[u];
        point[v] = along_v * half_extents[v];
        return point;
      };
      // Counter-clockwise seen from outside: u, v, axis is a right-handed frame.
      const Vec3d a = corner(-1, -1), b = corner(side, -side), c = corner(1, 1), d = corner(-side, side);
      triangles_[next++] = {a, b, c};
      triangles_[next++] = {a, c, d};
    }
  }
}

bool BoxSurface::sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept {
  FirstTouch first{from, to, radius};
  for (std::uint32_t i = 0; i < triangles_.size(); ++i) {
    first.add_triangle(triangles_[i][0], triangles_[i][1], triangles_[i][2], 0, i);
  }
  return first.result(hit);
}

bool BoxSurface::closest(const Vec3d& point, double max_distance, SurfaceHit& hit) const noexcept {
  ClosestSide side{point, max_distance};
  for (std::uint32_t i = 0; i < triangles_.size(); ++i) {
    side.add_triangle(triangles_[i][0], triangles_[i][1], triangles_[i][2], 0, i);
  }
  return side.result(hit);
}

void BodyTouch::step(const DeviceState& device, bool grab, const BodyState& body, Surface& shape_body,
                     const ContactImpedance& impedance, double dt) noexcept {
  constexpr double kRamp = 25;  // N/s
  const Vec3d device_body = body.to_body(device.position);
  const ProxyResult& local = proxy_.step(device_body, dt, shape_body, false);
  ramp_body_.advance(kRamp * dt / impedance.stiffness);
  if (local.surface_moved) ramp_body_.set(local.proxy - device_body);
  if (!local.in_contact) ramp_body_ = {};
  const Vec3d anchor_body = local.proxy - ramp_body_.remaining();
  if (!grab) {
    grabbed_ = false;
  } else if (!grabbed_ && local.in_contact) {
    grabbed_ = true;
    anchor_body_ = anchor_body;
  }
  touch_ = local;
  touch_.in_contact = local.in_contact || grabbed_;
  touch_.proxy = body.to_world(local.proxy);
  touch_.anchor = body.to_world(grabbed_ ? anchor_body_ : anchor_body);
  touch_.normal = body.orientation * local.normal;
  relative_ = device;
  relative_.velocity -= body.velocity_at(touch_.anchor);
  spring_ = {touch_.anchor, device.position, device.velocity, 0, 0};
  if (touch_.in_contact) {
    spring_.stiffness = impedance.stiffness;
    spring_.damping = impedance.damping;
  }
}

}  // namespace tactus::haptics
