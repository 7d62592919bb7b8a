#include "ros2/publisher.hpp"

#include <utility>

#include "ros2/names.hpp"
#include "session/probe_coding.hpp"
#include "session/units.hpp"

namespace tactus::ros2 {
namespace {

constexpr std::int64_t kAllTransformsNs = 100 * kMs;  // between two messages with the poses of all objects
constexpr std::int64_t kMarkersNs = 200 * kMs;
constexpr std::size_t kMaxPart = 200;  // bytes of a user's part of a topic name; DDS limits the whole name to 255
constexpr Color kFinest{1, 0.6f, 0.2f, 1}, kCoarse{0.4f, 0.6f, 0.9f, 1};
const char* const kStateProfile = "ros2_state_writer";

Pose pose_of(const session::Pose& pose) { return {pose.position, pose.orientation}; }

bool is_equal(const session::Pose& a, const session::Pose& b) {
  return a.position == b.position && a.orientation == b.orientation;
}

}  // namespace

UserMessages messages_of(const session::ProbeState& state, std::int64_t session_time_ns, const Header& header) {
  session::ProbeView view = session::extrapolate(state, session_time_ns);
  if (state.force == std::array<double, 3>{}) view.force = state.force;  // the force may be switched off
  return {{header, view.force, {}},
          {header, {view.device, state.device.orientation}},
          {header, {view.proxy, state.device.orientation}},
          {header, state.velocity, {}}};
}

std::string frame_of(const session::CatalogueEntry& object) { return "tactus/" + ros_name(object.object); }

Marker marker_of(const viewer::SeenObject& object, const std::string& frame) {
  Marker marker;
  marker.header.frame_id = frame;  // without a stamp, a viewer uses the newest pose of the frame
  marker.ns = frame;
  marker.scale.fill(object.entry.scale);
  marker.points.reserve(3 * object.mesh.faces());
  marker.colors.reserve(3 * object.mesh.faces());
  for (const viewer::ShownMesh::Face& face : object.mesh.rows()) {
    if (face == viewer::ShownMesh::Face{}) continue;  // an empty row
    for (std::size_t corner = 0; corner < 9; corner += 3)
      marker.points.push_back({face.corners[corner], face.corners[corner + 1], face.corners[corner + 2]});
    marker.colors.insert(marker.colors.end(), 3, face.finest ? kFinest : kCoarse);
  }
  return marker;
}

Publisher::Publisher(const viewer::ViewerCore& core, wire::RosDomain& domain, std::string frame,
                     std::function<void(const std::string&)> on_event)
    : core_{core},
      domain_{domain},
      frame_{std::move(frame)},
      on_event_{std::move(on_event)},
      transforms_{domain, "/tf", TfMessage::kType, kStateProfile},
      markers_{domain, "/tactus/markers", MarkerArray::kType, "ros2_markers_writer"},
      all_transforms_{kAllTransformsNs},
      markers_due_{kMarkersNs} {}

template <class Message>
void Publisher::send(wire::RosWriter& writer, const Message& message) {
  if (writer.matched() == 0) return;
  encoder_.clear();
  encoder_(message);
  (void)writer.send(encoder_.bytes());
}

void Publisher::update_names() {
  if (std::exchange(scene_number_, core_.scene_number()) == core_.scene_number()) return;
  names_.clear();
  core_.roster().for_each([&](const session::RosterEntry& entry) {
    for (const session::UserProbe& user : entry.served_users) names_[session::id_of(user.user)] = user.user;
  });
}

/// Returns the topics of a user, and makes them if there are none. Null: the user cannot have topics.
Publisher::UserTopics* Publisher::topics_of(std::uint64_t user) {
  if (const auto found = users_.find(user); found != users_.end()) return &found->second;
  const auto name = names_.find(user);
  if (name == names_.end() || refused_.count(user) != 0) return nullptr;
  const std::string part = ros_name(name->second);
  std::string reason;
  if (part.size() > kMaxPart)
    reason =
        "its name takes " + std::to_string(part.size()) + " bytes in ROS; expected at most " + std::to_string(kMaxPart);
  else if (users_.size() >= kMaxUsers)
    reason = std::to_string(kMaxUsers) + " users have topics already";
  else
    try {
      const std::string folder = "/tactus/" + part;
      return &users_
                  .emplace(user, UserTopics{{domain_, folder + "/wrench", WrenchStamped::kType, kStateProfile},
                                            {domain_, folder + "/pose", PoseStamped::kType, kStateProfile},
                                            {domain_, folder + "/proxy", PoseStamped::kType, kStateProfile},
                                            {domain_, folder + "/twist", TwistStamped::kType, kStateProfile}})
                  .first->second;
    } catch (const wire::WireError& error) {
      reason = error.what();
    }
  refused_.insert(user);
  on_event_("user " + name->second + " has no topics: " + reason);
  return nullptr;
}

void Publisher::publish_probes(std::int64_t now_ns, const Header& header) {
  std::erase_if(users_, [&](const auto& user) { return core_.probes().count(user.first) == 0; });
  std::erase_if(refused_, [&](std::uint64_t user) { return core_.probes().count(user) == 0; });
  for (const auto& [user, probe] : core_.probes()) {
    if (now_ns - probe.received_ns > kMaxStateAgeNs) continue;
    UserTopics* const topics = topics_of(user);
    if (topics == nullptr) continue;
    const UserMessages messages = messages_of(probe.state, core_.session_time(now_ns), header);
    send(topics->wrench, messages.wrench);
    send(topics->device, messages.device);
    send(topics->proxy, messages.proxy);
    send(topics->twist, messages.twist);
  }
}

/// Publishes the poses that changed; all, every 100 ms, because a reader may have missed one.
void Publisher::publish_transforms(std::int64_t now_ns, const Header& header) {
  const bool are_all_due = all_transforms_.due(now_ns);
  std::erase_if(sent_poses_, [&](const auto& sent) { return core_.objects().count(sent.first) == 0; });
  TfMessage message;
  for (const auto& [id, object] : core_.objects()) {
    const auto [sent, is_new] = sent_poses_.try_emplace(id);
    if (!are_all_due && !is_new && is_equal(sent->second, object.pose)) continue;
    sent->second = object.pose;
    message.transforms.push_back({header, frame_of(object.entry), pose_of(object.pose)});
  }
  if (!message.transforms.empty()) send(transforms_, message);
}

/// Publishes the meshes that changed; all of them to a new reader.
void Publisher::publish_markers() {
  const int matches = markers_.matches();
  if (matches > marker_matches_)  // a new reader gets all meshes, and the others the deletions that are due
    for (auto& [frame, number] : sent_meshes_) number = 0;
  marker_matches_ = matches;
  if (markers_.matched() == 0) return;
  MarkerArray message;
  std::map<std::string, std::uint32_t> before = std::exchange(sent_meshes_, {});
  for (const auto& [id, object] : core_.objects()) {
    if (object.mesh.change_number() == 0) continue;
    const std::string frame = frame_of(object.entry);
    sent_meshes_[frame] = object.mesh.change_number();
    const auto sent = before.find(frame);
    const bool has_changed = sent == before.end() || sent->second != object.mesh.change_number();
    if (has_changed) message.markers.push_back(marker_of(object, frame));
    if (sent != before.end()) before.erase(sent);
  }
  for (const auto& [frame, number] : before) {
    Marker gone;
    gone.header.frame_id = gone.ns = frame;
    gone.action = Marker::Action::kDelete;
    message.markers.push_back(std::move(gone));
  }
  if (!message.markers.empty()) send(markers_, message);
}

void Publisher::publish(std::int64_t now_ns, std::int64_t since_1970_ns) {
  const Header header{Time::from_ns(since_1970_ns), frame_};
  update_names();
  publish_probes(now_ns, header);
  publish_transforms(now_ns, header);
  if (markers_due_.due(now_ns)) publish_markers();
}

}  // namespace tactus::ros2
