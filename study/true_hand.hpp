/// The ground truth of forces: the force on a hand with the whole surface in the same process.
///
/// It receives the device state of each cycle, and nothing that the session computes.
#pragma once

#include "haptics/body_touch.hpp"
#include "hrtc_service/tool_touch.hpp"
#include "session/messages.hpp"
#include "spm/finest_tree.hpp"

namespace tactus::study {

class TrueHand {
 public:
  virtual ~TrueHand() = default;
  /// Advances by one millisecond. `mesh_changed`: the session's mesh has changed, so a tool there gathers its pairs
  /// again. Doing so in the same cycles leaves the mesh as the only difference, because rounding depends on the pose of
  /// the gather.
  [[nodiscard]] virtual haptics::Wrench at(const haptics::DeviceState& device, bool mesh_changed) = 0;
};

/// A sphere that follows the hand over a surface, with a proxy of its own.
class TrueSphere final : public TrueHand {
 public:
  /// `surface` must outlive it.
  TrueSphere(haptics::Surface& surface, double radius, const session::Material& material,
             const haptics::ForceSettings& settings);
  [[nodiscard]] haptics::Wrench at(const haptics::DeviceState& device, bool mesh_changed) override;

 private:
  haptics::Surface& surface_;
  haptics::Feel feel_;
  haptics::Proxy proxy_;
  haptics::ForceRenderer renderer_;
};

/// A tool on all faces of the finest mesh, in one static tree.
class TrueTool final : public TrueHand {
 public:
  /// `mesh` is at the origin with `scale` metres per unit; it and `probe` must outlive this.
  TrueTool(const spm::FinestTree& mesh, double scale, const spm::MeshProbe& probe, const session::Material& material,
           const haptics::ForceSettings& settings, const haptics::DeviceSpec& spec);
  [[nodiscard]] haptics::Wrench at(const haptics::DeviceState& device, bool mesh_changed) override;
  [[nodiscard]] const haptics::ToolResult& last() const noexcept { return tool_.last(); }

 private:
  haptics::ToolObject object_;
  haptics::Feel feel_;
  haptics::Tool tool_;
  haptics::ForceRenderer renderer_;
};

}  // namespace tactus::study
