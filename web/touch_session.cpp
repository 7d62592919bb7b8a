#include "web/touch_session.hpp"

#include <algorithm>
#include <utility>

#include "spm/tree_faces.hpp"
#include "study/subject.hpp"

namespace tactus::web {
namespace {

using spm::Vec3d;

constexpr double kTipRadius = 0.003;  // m

client_sim::Scenario scenario_of(const std::string& object) {
  client_sim::Scenario scenario;
  scenario.name = "touch-page";
  client_sim::User you, ann;
  you.name = "you";
  ann.name = "ann";
  you.radius = ann.radius = kTipRadius;
  ann.repeats_script = true;
  client_sim::Action approach, follow, retreat;
  approach.kind = client_sim::ActionKind::kApproach;
  approach.object = object;
  approach.direction = Vec3d{-0.6, -0.6, 0.5}.normalized();
  approach.force = 0.8;
  follow.kind = client_sim::ActionKind::kFollow;
  follow.pattern = client_sim::Pattern::kAround;
  follow.speed = 0.05;
  follow.force = 1.2;
  follow.seconds = 12;
  retreat.kind = client_sim::ActionKind::kRetreat;
  ann.script = {approach, follow, retreat};
  scenario.users = {you, ann};
  return scenario;
}

netem::LinkSettings link_settings(const TouchLink& link) {
  netem::LinkProfile profile;
  profile.delay_ms = link.delay_ms;
  profile.jitter_ms = std::min(link.jitter_ms, link.delay_ms);
  profile.loss = link.loss_percent / 100;
  profile.rate_mbit = link.rate_mbit;
  netem::LinkSettings settings;
  settings.a_to_b = settings.b_to_a = profile;
  netem::check(settings);
  return settings;
}

study::SessionSettings session_settings(std::uint64_t seed) {
  study::SessionSettings settings;
  settings.link = link_settings({});
  settings.seed = seed;
  return settings;
}

}  // namespace

TouchSession::TouchSession(std::string name, spm::offline::TriangleMesh mesh, double size, std::uint64_t seed)
    : subject_{study::make_subject(name, name, std::move(mesh), size, 1)},
      session_{std::make_unique<study::VirtualSession>(subject_, scenario_of(name), session_settings(seed))},
      start_ns_{session_->now_ns()} {
  const spm::ModelSummary& summary = subject_.model.summary;
  metres_per_unit_ = summary.metres_per_unit;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    bounds_[axis] = metres_per_unit_ * summary.bounds_min[axis];
    bounds_[3 + axis] = metres_per_unit_ * summary.bounds_max[axis];
  }
  figures_.all_records = summary.records;
  figures_.all_faces = summary.faces;
  session_->start_users();
}

void TouchSession::set_link(const TouchLink& link) { session_->set_link(link_settings(link)); }

void TouchSession::move_hand(const std::array<double, 3>& target) {
  session_->move_hand(0, hand_.move_to({target, {0, 0, 0, 1}}, session_->now_ns()));
}

void TouchSession::step() {
  session_->step();
  update_users();
  update_figures();
}

void TouchSession::update_users() {
  const hrtc_service::Servo::Outputs& outputs = session_->hrtc().servo().outputs();
  for (std::size_t i = 0; i < kUsers; ++i) {
    const hrtc_service::ProbeOutput& output = outputs[i];
    UserView& user = users_[i];
    user.has_probe = output.active ? 1 : 0;
    user.device = output.device;
    user.proxy = output.proxy;
    user.force = output.force;
    user.error_bound = output.error_bound;
    user.in_contact = (output.status & session::kInContact) != 0 ? 1 : 0;
    user.exact = (output.status & session::kExact) != 0 ? 1 : 0;
  }
}

void TouchSession::update_figures() {
  figures_.time_ms = 1e-6 * static_cast<double>(session_->now_ns() - start_ns_);
  if (users_[0].in_contact != 0) {
    ++figures_.contact_ms;
    if (users_[0].exact != 0) {
      ++figures_.exact_ms;
      if (figures_.first_exact_ms == 0) figures_.first_exact_ms = figures_.time_ms;
    }
  }
  figures_.payload_bytes = static_cast<double>(session_->bytes_received());
  figures_.records = static_cast<double>(session_->records_received());
  figures_.round_trip_ms = 1e-6 * static_cast<double>(session_->hrtc().gateway().loader().round_trip_ns());
}

bool TouchSession::update_mesh() {
  const std::vector<hrtc_service::TouchObject*>& objects = session_->hrtc().servo().cycle().objects();
  if (objects.empty()) return false;
  const spm::Forest& forest = *objects.front()->forest;
  if (forest.mesh_hash() == mesh_hash_ && forest.base_faces_shown() == base_faces_shown_) return false;
  mesh_hash_ = forest.mesh_hash();
  base_faces_shown_ = forest.base_faces_shown();

  // Reads the leaves of the tree in their order in memory. The next haptic cycle waits for the end of this.
  std::uint32_t fine_faces = 0;
  mesh_.corners.clear();
  mesh_.fine.clear();
  spm::for_each_face(forest.tree(), [&](spm::LeafLane at, const spm::TreeNode& node) {
    const unsigned lane = at.lane();
    const std::uint8_t finest = node.is_finest(lane) ? 1 : 0;
    fine_faces += finest;
    mesh_.fine.push_back(finest);
    std::array<float, spm::lanes::kTriangleRows> corners;
    for (std::size_t i = 0; i < corners.size(); ++i) corners[i] = node.lanes[i][lane];
    mesh_.corners.insert(mesh_.corners.end(), corners.begin(), corners.end());
  });
  figures_.faces = static_cast<double>(mesh_.fine.size());
  figures_.fine_faces = fine_faces;
  return true;
}

}  // namespace tactus::web
