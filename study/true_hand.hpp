/// What a hand would feel where everything is at hand: the ground truth of forces, one process and all of the surface.
///
/// The same hand, cycle by cycle: it is told where the hand is, and nothing of what the session shows there.
#pragma once

#include "haptics/body_touch.hpp"
#include "hrtc_service/tool_touch.hpp"
#include "session/messages.hpp"
#include "spm/finest_tree.hpp"

namespace tactus::study {

class TrueHand {
 public:
  virtual ~TrueHand() = default;
  /// One millisecond later. `anew`: the session's mesh has changed, so that a tool there looks anew for what is near.
  /// To do so in the same cycles leaves the mesh as the only difference: what is found is rounded by where it was
  /// sought.
  [[nodiscard]] virtual haptics::Wrench at(const haptics::DeviceState& device, bool anew) = 0;
};

/// A ball that follows the hand over a surface, with a proxy of its own.
class TrueSphere final : public TrueHand {
 public:
  /// `surface` must outlive it.
  TrueSphere(haptics::Surface& surface, double radius, const session::Material& material,
             const haptics::ForceSettings& settings);
  [[nodiscard]] haptics::Wrench at(const haptics::DeviceState& device, bool anew) override;

 private:
  haptics::Surface& surface_;
  haptics::Feel feel_;
  haptics::Proxy proxy_;
  haptics::ForceRenderer renderer_;
};

/// A tool on all faces of the finest mesh, in one tree that never changes.
class TrueTool final : public TrueHand {
 public:
  /// `mesh` stands at the origin in `scale` metres a unit; it and `probe` must outlive this.
  TrueTool(const spm::FinestTree& mesh, double scale, const spm::MeshProbe& probe, const session::Material& material,
           const haptics::ForceSettings& settings, const haptics::DeviceSpec& spec);
  [[nodiscard]] haptics::Wrench at(const haptics::DeviceState& device, bool anew) override;
  [[nodiscard]] const haptics::ToolResult& last() const noexcept { return tool_.last(); }

 private:
  haptics::ToolObject object_;
  haptics::Feel feel_;
  haptics::Tool tool_;
  haptics::ForceRenderer renderer_;
};

}  // namespace tactus::study
