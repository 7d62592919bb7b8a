#include "tools/scene/scene.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>

#include "trace/glb.hpp"

namespace tactus::scene {
namespace {

using trace::foxglove::Arrow;
using trace::foxglove::Color;
using trace::foxglove::FrameTransforms;
using trace::foxglove::Line;
using trace::foxglove::LogLevel;
using trace::foxglove::Model;
using trace::foxglove::Pose;
using trace::foxglove::SceneEntity;
using trace::foxglove::SceneEntityDeletion;
using trace::foxglove::SceneUpdate;
using trace::foxglove::Solid;
using trace::foxglove::Text;
using trace::foxglove::Time;

constexpr char kWorld[] = "world";
constexpr std::array<float, 3> kMeshColor{0.78f, 0.66f, 0.58f};
constexpr Color kBoxColor{0.78, 0.66, 0.58, 0.3};
constexpr Color kForceColor{1, 0.55, 0.1, 1};
constexpr Color kStoppedColor{1, 0.2, 0.2, 1};
constexpr std::array<Color, 6> kUserColors{{{0.2, 0.6, 1, 1},
                                            {0.3, 0.85, 0.4, 1},
                                            {0.85, 0.4, 0.9, 1},
                                            {0.95, 0.85, 0.3, 1},
                                            {0.3, 0.85, 0.85, 1},
                                            {1, 0.5, 0.6, 1}}};
constexpr double kDeviceOpacity = 0.35;
constexpr double kMinForce = 1e-3;  // N; smaller forces have no arrow
constexpr double kHeadShare = 0.3;  // of the length of an arrow

Pose pose_of(const session::Pose& pose) { return {pose.position, pose.orientation}; }

std::string frame_of(const session::CatalogueEntry& entry) { return "object/" + entry.object; }

Arrow force_arrow(const session::ProbeState& state, double newton) {
  const Eigen::Vector3d force{state.force[0], state.force[1], state.force[2]};
  const Eigen::Quaterniond turned = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitX(), force);
  const double length = newton * Scene::kMetresPerNewton;
  Arrow arrow;
  arrow.pose = {state.proxy, {turned.x(), turned.y(), turned.z(), turned.w()}};
  arrow.shaft_length = (1 - kHeadShare) * length;
  arrow.head_length = kHeadShare * length;
  arrow.shaft_diameter = state.radius / 2;
  arrow.head_diameter = state.radius;
  arrow.color = kForceColor;
  return arrow;
}

/// Returns the deletions of the entities in `drawn` that `entities` lacks, and makes `drawn` the ids of `entities`.
std::vector<SceneEntityDeletion> deletions(std::set<std::string>& drawn, const std::vector<SceneEntity>& entities,
                                           Time now) {
  std::set<std::string> ids;
  for (const SceneEntity& entity : entities) ids.insert(entity.id);
  std::vector<SceneEntityDeletion> result;
  for (const std::string& id : drawn)
    if (ids.count(id) == 0) result.push_back({now, SceneEntityDeletion::Type::kMatchingId, id});
  drawn = std::move(ids);
  return result;
}

}  // namespace

Scene::Scene(const session::Origin& self, std::size_t max_mesh_bytes)
    : roster_{self, {}}, stops_{self}, max_mesh_bytes_{max_mesh_bytes} {}

void Scene::log(LogLevel level, std::string text, const session::Origin& sender, Moment now) {
  const session::RosterEntry* const known = roster_.find(sender.participant);
  events_.push_back(
      {Time::from_ns(now.since_1970_ns), level, std::move(text), known == nullptr ? "" : known->name, "", 0});
}

void Scene::process(const session::RosterEvent& event, Moment now) {
  using session::RosterChange;
  const session::RosterEntry& entry = event.entry;
  if (event.change == RosterChange::kChanged) {
    probes_changed_ = true;  // a user may have a name now
    return;
  }
  const bool is_normal = event.change == RosterChange::kJoined || event.change == RosterChange::kLeft ||
                         event.change == RosterChange::kRecovered;
  log(is_normal ? LogLevel::kInfo : LogLevel::kWarning, session::text(event), entry.origin, now);
  // A host that is gone still has its objects in the HRTCs. A host that left has withdrawn them.
  if (event.change == RosterChange::kLeft && entry.role == session::Role::kHost) {
    std::vector<std::uint64_t> objects;
    for (const auto& [id, object] : objects_) objects.push_back(id);
    for (const std::uint64_t id : objects) remove_host(id, entry.origin.participant, now);
  }
}

void Scene::add(const session::RosterEntry& entry, Moment now) {
  if (stops_.on_roster(entry))
    log(LogLevel::kError, "emergency stop, relayed by " + session::text(entry), entry.origin, now);
  for (const session::RosterEvent& event : roster_.on_entry(entry, now.monotonic_ns)) process(event, now);
}

void Scene::remove_host(std::uint64_t object, std::uint64_t host, Moment now) {
  const auto found = objects_.find(object);
  if (found == objects_.end() || found->second.hosts.erase(host) == 0 || !found->second.hosts.empty()) return;
  log(LogLevel::kInfo, "object " + found->second.entry.object + " is withdrawn", found->second.entry.origin, now);
  objects_.erase(found);
  objects_changed_ = true;
}

void Scene::add(const session::CatalogueEntry& entry, Moment now) {
  if (entry.withdrawn) return remove_host(entry.object_id, entry.origin.participant, now);
  const auto [found, is_new] = objects_.try_emplace(entry.object_id);
  Object& object = found->second;
  object.hosts.insert(entry.origin.participant);
  if (!is_new && object.entry.summary.digest == entry.summary.digest) return;
  object.entry = entry;
  objects_changed_ = poses_changed_ = true;
  if (!is_new) return;
  object.pose = entry.pose;
  log(LogLevel::kInfo, "object " + entry.object + " found at host " + entry.host, entry.origin, now);
  events_.back().name = entry.host;  // the roster may not have the host yet
}

void Scene::add(const session::BulkChunk& chunk, Moment) {
  const std::optional<spm::BaseMesh> base = base_meshes_.add(chunk);
  if (!base || mesh_bytes_ >= max_mesh_bytes_) return;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  triangles.reserve(base->faces.size());
  for (const spm::BaseFace& face : base->faces)
    triangles.push_back({index(face.corners[0]), index(face.corners[1]), index(face.corners[2])});
  std::vector<std::uint8_t> glb = trace::to_glb(base->positions, triangles, kMeshColor);
  if (glb.size() > max_mesh_bytes_ - mesh_bytes_) return;
  mesh_bytes_ += glb.size();
  glbs_[base->summary.digest] = std::make_shared<const std::vector<std::uint8_t>>(std::move(glb));
  objects_changed_ = true;
}

void Scene::add(const session::ProbeState& state, Moment now) {
  const auto [found, is_new] = probes_.try_emplace(state.user_id);
  const session::ProbeState& known = found->second.state;
  // An HRTC that takes over a user starts its sequence anew.
  const bool is_same_writer = !is_new && known.origin.participant == state.origin.participant &&
                              known.origin.incarnation == state.origin.incarnation;
  if (is_same_writer && static_cast<std::int32_t>(state.sequence - known.sequence) <= 0) return;
  if ((state.status & session::kFault) != 0 && (!is_same_writer || (known.status & session::kFault) == 0))
    log(LogLevel::kError, user_name(state.user_id) + ": forces are off: " + session::fault_reason(state.status),
        state.origin, now);
  found->second = {state, now.monotonic_ns};
  probes_changed_ = true;
}

void Scene::add(const session::ObjectPose& pose, Moment now) {
  const auto found = objects_.find(pose.object_id);
  if (found == objects_.end() || !found->second.admission.accept(pose, now.monotonic_ns)) return;
  found->second.pose = pose.pose;
  poses_changed_ = true;
}

void Scene::add(const session::EmergencyStop& stop, Moment now) {
  if (stops_.on_stop(stop.name())) log(LogLevel::kError, "emergency stop: " + stop.text, stop.origin, now);
}

void Scene::add(const session::ForceReset& reset, Moment now) {
  if (stops_.on_reset(reset)) log(LogLevel::kWarning, "forces are reset: " + reset.text, reset.origin, now);
}

void Scene::add(const session::Control& control, Moment now) {
  const std::pair number{control.origin.incarnation, control.sequence};
  const auto [found, is_new] = controls_.try_emplace(control.origin.participant, number);
  if (!is_new && number <= found->second) return;
  found->second = number;
  log(LogLevel::kInfo, (control.kind == session::ControlKind::kStart ? "start: " : "mode: ") + control.text,
      control.origin, now);
}

void Scene::add(const session::SessionEnd& end, Moment now) {
  if (!ends_.insert({end.origin.participant, end.origin.incarnation}).second) return;
  log(LogLevel::kInfo, "the session ends" + (end.text.empty() ? std::string{} : ": " + end.text), end.origin, now);
}

std::string Scene::user_name(std::uint64_t user) const {
  std::string name;
  roster_.for_each([&](const session::RosterEntry& entry) {
    for (const std::string& each : entry.users)
      if (session::id_of(each) == user) name = each;
    for (const session::UserProbe& each : entry.served_users)
      if (session::id_of(each.user) == user) name = each.user;
  });
  if (!name.empty()) return name;
  std::array<char, 24> text{};
  std::snprintf(text.data(), text.size(), "user %016llx", static_cast<unsigned long long>(user));
  return text.data();
}

SceneUpdate Scene::objects_message(Moment now) {
  SceneUpdate update;
  std::size_t mesh_bytes = 0;
  for (const auto& [id, object] : objects_) {
    const session::CatalogueEntry& catalogue = object.entry;
    SceneEntity entity;
    entity.timestamp = Time::from_ns(now.since_1970_ns);
    entity.frame_id = frame_of(catalogue);
    entity.id = catalogue.object;
    entity.metadata = {{"host", catalogue.host},
                       {"vertices", std::to_string(catalogue.summary.vertices)},
                       {"faces", std::to_string(catalogue.summary.faces)}};
    const auto glb = glbs_.find(catalogue.summary.digest);
    if (glb != glbs_.end() && glb->second->size() <= max_mesh_bytes_ - mesh_bytes) {
      mesh_bytes += glb->second->size();  // an object with the same model has its mesh again
      Model model;
      model.scale = {catalogue.scale, catalogue.scale, catalogue.scale};
      model.data = *glb->second;
      entity.models.push_back(std::move(model));
    } else {
      Solid box;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double low = catalogue.summary.bounds_min[axis], high = catalogue.summary.bounds_max[axis];
        box.pose.position[axis] = (low + high) / 2 * catalogue.scale;
        box.size[axis] = (high - low) * catalogue.scale;
      }
      box.color = kBoxColor;
      entity.cubes.push_back(box);
    }
    update.entities.push_back(std::move(entity));
  }
  update.deletions = deletions(drawn_objects_, update.entities, Time::from_ns(now.since_1970_ns));
  return update;
}

SceneUpdate Scene::probes_message(Moment now) {
  SceneUpdate update;
  for (const auto& [user, probe] : probes_) {
    const session::ProbeState& state = probe.state;
    const Color color = kUserColors[user % kUserColors.size()];
    const double diameter = 2 * state.radius;
    SceneEntity entity;
    entity.timestamp = Time::from_ns(now.since_1970_ns);
    entity.frame_id = kWorld;
    entity.id = user_name(user);
    Solid device{{state.device.position, {0, 0, 0, 1}}, {diameter, diameter, diameter}, color};
    device.color[3] = kDeviceOpacity;
    Solid proxy{{state.proxy, {0, 0, 0, 1}}, {diameter, diameter, diameter}, color};
    if ((state.status & session::kFault) != 0) proxy.color = kStoppedColor;
    entity.spheres = {device, proxy};
    Line line;
    line.points = {state.device.position, state.proxy};
    line.color = color;
    entity.lines.push_back(std::move(line));
    const double newton = Eigen::Vector3d{state.force[0], state.force[1], state.force[2]}.norm();
    if (newton >= kMinForce) entity.arrows.push_back(force_arrow(state, newton));
    Text label;
    label.pose.position = state.device.position;
    label.pose.position[2] += 3 * state.radius;
    label.text = entity.id;
    label.color = color;
    entity.texts.push_back(std::move(label));
    update.entities.push_back(std::move(entity));
  }
  update.deletions = deletions(drawn_probes_, update.entities, Time::from_ns(now.since_1970_ns));
  return update;
}

FrameTransforms Scene::transforms_message(Moment now) const {
  FrameTransforms message;
  for (const auto& [id, object] : objects_)
    message.transforms.push_back(
        {Time::from_ns(now.since_1970_ns), kWorld, frame_of(object.entry), pose_of(object.pose)});
  return message;
}

Frame Scene::frame(Moment now) {
  const auto is_due = [&](const std::optional<std::int64_t>& written_ns, std::int64_t period_ns) {
    return !written_ns || now.monotonic_ns - *written_ns >= period_ns;
  };
  for (const session::RosterEvent& event : roster_.tick(now.monotonic_ns)) process(event, now);
  const auto old = std::erase_if(
      probes_, [&](const auto& probe) { return now.monotonic_ns - probe.second.received_ns > kMaxStateAgeNs; });
  Frame frame;
  frame.events = std::exchange(events_, {});
  if (objects_changed_ && is_due(objects_written_ns_, kObjectsPeriodNs)) {
    frame.objects = objects_message(now);
    objects_written_ns_ = now.monotonic_ns;
    objects_changed_ = false;
  }
  if (probes_changed_ || old > 0) {
    frame.probes = probes_message(now);
    probes_changed_ = false;
  }
  if (!objects_.empty() && (poses_changed_ || is_due(transforms_written_ns_, kTransformsPeriodNs))) {
    frame.transforms = transforms_message(now);
    transforms_written_ns_ = now.monotonic_ns;
    poses_changed_ = false;
  }
  return frame;
}

}  // namespace tactus::scene
