/// A host with a sphere and a viewer, which exchange samples without delay, in virtual time and without DDS.
#pragma once

#include <gtest/gtest.h>

#include "host_service/host_core.hpp"
#include "session/units.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/constants.hpp"
#include "viewer/viewer_core.hpp"

namespace tactus::viewer {

class ViewerSession : public testing::Test {
 protected:
  static constexpr std::uint64_t kViewer = 900;

  [[nodiscard]] static ViewerSettings settings() {
    ViewerSettings settings;
    settings.name = "view";
    settings.session = "session";
    settings.pool = spm::PoolSettings::for_slots(8000);
    settings.faces = 2000;
    return settings;
  }

  /// Exchanges samples for `ns`, every 2 ms, while a probe state arrives every millisecond after `place_probe`.
  void run(std::int64_t ns) {
    for (const std::int64_t end_ns = now_ns_ + ns; now_ns_ < end_ns;) {
      now_ns_ += kMs;
      if (state_) {
        ++state_->sequence;
        viewer_.on_probe_state(*state_, now_ns_);
      }
      if (now_ns_ / kMs % 2 == 0) exchange();
      if (after_step) after_step();
    }
  }

  void exchange() {
    const host_service::HostMessages& from_host = host_.tick(now_ns_);
    if (from_host.roster && host_is_connected_) viewer_.on_roster(*from_host.roster, now_ns_);
    if (from_host.catalogue)
      for (session::CatalogueEntry entry : host_.catalogue()) {
        entry.origin = {kSession, kHost, 1, now_ns_};
        viewer_.on_catalogue(entry);
      }
    const ViewerMessages from_viewer = viewer_.tick(now_ns_);
    if (from_viewer.roster) host_.on_roster(*from_viewer.roster, now_ns_);
    for (const session::Demand& demand : from_viewer.demands) host_.on_demand(demand, now_ns_);
    if (from_viewer.stop) {
      ++stops_sent_;
      host_.on_stop(*from_viewer.stop);
    }
    while (auto out = host_.next_chunk(now_ns_))
      if (out->hrtc == kViewer) viewer_.on_chunk(out->chunk, now_ns_);
  }

  /// Places the probe of a user at `position`, m.
  void place_probe(const spm::Vec3d& position) {
    if (!state_) state_.emplace();
    state_->origin = {kSession, kHrtc, 1, now_ns_};
    state_->user_id = session::id_of("ann");
    state_->radius = 0.003;
    for (Eigen::Index axis = 0; axis < 3; ++axis)
      state_->device.position[static_cast<std::size_t>(axis)] = state_->proxy[static_cast<std::size_t>(axis)] =
          position[axis];
  }

  [[nodiscard]] const SeenObject& object() const { return viewer_.objects().at(session::id_of("sphere")); }

  const spm::offline::BuiltModel built_ =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 20000));
  const spm::Model model_ = built_.model();
  const spm::codec::EncodedModel encoded_{model_};
  std::int64_t now_ns_ = 1000 * kMs;
  host_service::HostCore host_{session::Origin{kSession, kHost, 1, 0},
                               host_service::host_of("sphere", encoded_.compressed()), now_ns_};
  ViewerCore viewer_{session::Origin{kSession, kViewer, 1, 0}, settings(), now_ns_};
  std::function<void()> after_step;
  std::optional<session::ProbeState> state_;
  bool host_is_connected_ = true;
  int stops_sent_ = 0;
};

}  // namespace tactus::viewer
