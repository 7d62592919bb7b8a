/// Computes the ground truth of forces: the force on a hand that touches the complete finest surface without delay.
///
/// Its only inputs from the session are the device state of each cycle and the cycles in which the mesh changed.
#pragma once

#include "haptics/body_touch.hpp"
#include "hrtc_service/servo/tool_touch.hpp"
#include "session/messages.hpp"
#include "spm/finest_tree.hpp"

namespace tactus::study {

class TrueHand {
 public:
  virtual ~TrueHand() = default;
  /// Advances by one millisecond and returns the true wrench. `mesh_changed`: the mesh of the session has changed, so
  /// that the session's tool gathers its pairs of triangles again (haptics/tool.hpp). The true tool then gathers too,
  /// because its rounding depends on the pose at which it gathered.
  [[nodiscard]] virtual haptics::Wrench at(const haptics::DeviceState& device, bool mesh_changed) = 0;
};

/// A sphere with a proxy of its own.
class TrueSphere final : public TrueHand {
 public:
  /// `surface` must outlive this.
  TrueSphere(haptics::Surface& surface, double radius, const session::Material& material,
             const haptics::ForceSettings& settings);
  [[nodiscard]] haptics::Wrench at(const haptics::DeviceState& device, bool mesh_changed) override;

 private:
  haptics::Surface& surface_;
  haptics::ContactImpedance impedance_;
  haptics::Proxy proxy_;
  haptics::ForceRenderer renderer_;
};

/// A tool on the finest mesh in one static tree.
class TrueTool final : public TrueHand {
 public:
  /// `mesh` is at the origin with `scale` metres per unit. `mesh` and `probe` must outlive this.
  TrueTool(const spm::FinestTree& mesh, double scale, const spm::MeshProbe& probe, const session::Material& material,
           const haptics::ForceSettings& settings, const haptics::DeviceSpec& spec);
  [[nodiscard]] haptics::Wrench at(const haptics::DeviceState& device, bool mesh_changed) override;
  [[nodiscard]] const haptics::ToolResult& last() const noexcept { return tool_.last(); }

 private:
  haptics::ToolObject object_;
  haptics::ContactImpedance impedance_;
  haptics::Tool tool_;
  haptics::ForceRenderer renderer_;
};

}  // namespace tactus::study
