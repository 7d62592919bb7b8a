#include "viewer/page_feed.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <utility>

#include "session/probe_coding.hpp"
#include "session/units.hpp"

namespace tactus::viewer {
namespace {

static_assert(std::endian::native == std::endian::little, "frames are little endian");

// Min times between two messages of a kind to a page.
constexpr std::int64_t kSceneNs = 100 * kMs, kFiguresNs = 250 * kMs, kProbesNs = 15 * kMs, kMeshNs = 60 * kMs,
                       kRegionsNs = 200 * kMs, kPlaybackNs = 200 * kMs;
constexpr std::uint32_t kWhole = 1;             // flag of a mesh frame: the page drops the rows that it has
constexpr std::uint32_t kFinestRow = 1u << 31;  // of a row number in a mesh frame

template <class Number>
void append(std::string& bytes, Number number) {
  static_assert(std::is_arithmetic_v<Number>);
  bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
}

template <std::size_t kSize>
void append_floats(std::string& bytes, const std::array<double, kSize>& numbers) {
  for (const double number : numbers) append(bytes, static_cast<float>(number));
}

/// Time since the last message of a kind, as a multiple of the min time between two.
double overdue(std::int64_t now_ns, std::int64_t last_ns, std::int64_t min_ns) {
  return static_cast<double>(now_ns - last_ns) / static_cast<double>(min_ns);
}

}  // namespace

std::optional<PageMessage> PageFeed::next(std::int64_t now_ns) {
  if (auto message = playback(now_ns)) return message;
  if (scene_number_ != core_.scene_number() && now_ns - scene_ns_ >= kSceneNs) {
    scene_number_ = core_.scene_number();
    scene_ns_ = now_ns;
    return scene();
  }
  // The most overdue message goes first. So a slow page gets messages of all kinds, each less often.
  const double probes_overdue = overdue(now_ns, probes_ns_, kProbesNs);
  const Changed mesh = changed_mesh(now_ns), regions = changed_regions(now_ns);
  const double figures_overdue =
      metrics_number_ == core_.metrics_number() ? 0 : overdue(now_ns, figures_ns_, kFiguresNs);
  const double most = std::max({probes_overdue, mesh.overdue, regions.overdue, figures_overdue});
  if (most < 1) return std::nullopt;
  if (most == probes_overdue) {
    probes_ns_ = now_ns;
    return probes();
  }
  if (most == mesh.overdue) {
    mesh.sent->at_ns = now_ns;
    return mesh_frame(*mesh.object, *mesh.sent);
  }
  if (most == regions.overdue) {
    regions.sent->regions_ns = now_ns;
    return regions_frame(*regions.object, *regions.sent);
  }
  metrics_number_ = core_.metrics_number();
  figures_ns_ = now_ns;
  return figures();
}

/// When the core has begun anew, all that the page has received is void.
std::optional<PageMessage> PageFeed::playback(std::int64_t now_ns) {
  if (playback_ == nullptr) return std::nullopt;
  const bool has_restarted = playback_->restarts != sent_playback_.restarts;
  const bool has_changed = playback_->at != sent_playback_.at || playback_->is_playing != sent_playback_.is_playing;
  if (!has_restarted && (!has_changed || now_ns - playback_ns_ < kPlaybackNs)) return std::nullopt;
  if (has_restarted) {
    meshes_.clear();
    scene_number_ = metrics_number_ = 0;
    scene_ns_ = figures_ns_ = 0;
  }
  sent_playback_ = *playback_;
  playback_ns_ = now_ns;
  const nlohmann::json message{{"type", "playback"},
                               {"file", playback_->file},
                               {"began", playback_->began},
                               {"seconds", playback_->seconds},
                               {"at", playback_->at},
                               {"isPlaying", playback_->is_playing},
                               {"restarts", playback_->restarts}};
  return PageMessage{true, message.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

PageMessage PageFeed::scene() {
  nlohmann::json scene{{"type", "scene"},
                       {"participants", nlohmann::json::array()},
                       {"users", nlohmann::json::array()},
                       {"objects", nlohmann::json::array()},
                       {"events", nlohmann::json::array()},
                       {"shownHrtc", core_.shown_hrtc()}};
  const StopProgress& stop = core_.stop_progress();
  scene["stop"] = {
      {"requested", stop.is_requested}, {"hrtcs", stop.hrtcs}, {"stopped", stop.stopped}, {"missing", stop.missing}};
  core_.roster().for_each([&](const session::RosterEntry& entry) {
    scene["participants"].push_back({{"name", entry.name},
                                     {"role", session::role_name(entry.role)},
                                     {"late", core_.roster().is_late(entry.origin.participant)}});
    for (const session::UserProbe& user : entry.served_users)
      scene["users"].push_back(
          {{"name", user.user}, {"id", std::to_string(session::id_of(user.user))}, {"hrtc", entry.name}});
  });
  const std::map<std::uint32_t, SentMesh> before = std::exchange(meshes_, {});
  for (const auto& [id, object] : core_.objects()) {
    const auto sent = before.find(object.number);
    meshes_[object.number] = sent == before.end() ? SentMesh{} : sent->second;
    const session::CatalogueEntry& entry = object.entry;
    scene["objects"].push_back({{"number", object.number},
                                {"name", entry.object},
                                {"host", entry.host},
                                {"scale", entry.scale},
                                {"low", entry.summary.bounds_min},
                                {"high", entry.summary.bounds_max},
                                {"faces", entry.summary.faces},
                                {"stiffness", entry.material.stiffness},
                                {"movable", entry.body.mass > 0},
                                {"position", object.pose.position},
                                {"orientation", object.pose.orientation}});
  }
  for (const Event& event : core_.events())
    scene["events"].push_back(
        {{"secondsAgo", static_cast<double>(core_.now_ns() - event.at_ns) / kNsPerS}, {"text", event.text}});
  return {true, scene.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

PageMessage PageFeed::figures() const {
  nlohmann::json figures{{"type", "figures"},
                         {"participants", nlohmann::json::object()},
                         {"meshes", nlohmann::json::object()},
                         {"losses", nlohmann::json::object()},
                         {"fronts", nlohmann::json::object()}};
  for (const auto& [participant, values] : core_.metrics()) {
    const session::RosterEntry* const entry = core_.roster().find(participant);
    if (entry == nullptr) continue;
    figures["participants"][entry->name] = values;
    if (entry->role == session::Role::kHrtc) figures["losses"][entry->name] = core_.lost_share(participant);
    for (const auto& [id, object] : core_.objects())
      if (const auto hash = core_.published_hash(participant, id))
        figures["meshes"][entry->name][object.entry.object] = std::to_string(*hash);
  }
  const auto percent = [](const std::vector<double>& shares) {
    std::vector<int> rounded(shares.size());
    std::transform(shares.begin(), shares.end(), rounded.begin(),
                   [](double share) { return static_cast<int>(std::lround(100 * share)); });
    return rounded;
  };
  for (const auto& [id, object] : core_.objects()) {
    const Fronts fronts = core_.fronts(id);
    figures["fronts"][object.entry.object] = {{"refined", percent(fronts.refined)}, {"loaded", percent(fronts.loaded)}};
  }
  return {true, figures.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

PageMessage PageFeed::probes() const {
  PageMessage frame;
  std::string& bytes = frame.bytes;
  append(bytes, static_cast<std::uint32_t>(FrameKind::kProbes));
  append(bytes, static_cast<std::uint32_t>(core_.probes().size()));
  append(bytes, static_cast<std::uint32_t>(core_.objects().size()));
  append(bytes, std::uint32_t{0});
  append(bytes, static_cast<double>(core_.session_time(core_.now_ns())) / kNsPerS);
  for (const auto& [user, probe] : core_.probes()) {
    const session::ProbeState& state = probe.state;
    // An HRTC omits the states that receivers extrapolate closely enough.
    session::ProbeView shown = session::extrapolate(state, core_.session_time(core_.now_ns()));
    if (state.force == std::array<double, 3>{}) shown.force = state.force;  // the force may be switched off
    const auto object = core_.objects().find(state.object_id);
    append(bytes, user);
    append(bytes, state.status);
    append(bytes, object == core_.objects().end() ? kNoObject : object->second.number);
    append_floats(bytes, shown.device);
    append_floats(bytes, state.device.orientation);
    append_floats(bytes, shown.proxy);
    append_floats(bytes, shown.force);
    append(bytes, static_cast<float>(state.radius));
    append(bytes, state.error_bound);
    append(bytes, static_cast<float>(static_cast<double>(core_.now_ns() - probe.received_ns) / kNsPerS));
  }
  for (const auto& [id, object] : core_.objects()) {
    append(bytes, object.number);
    append_floats(bytes, object.pose.position);
    append_floats(bytes, object.pose.orientation);
  }
  return frame;
}

/// Returns the most overdue object whose mesh has changed.
PageFeed::Changed PageFeed::changed_mesh(std::int64_t now_ns) {
  Changed most;
  for (const auto& [id, object] : core_.objects()) {
    const auto sent = meshes_.find(object.number);
    if (sent == meshes_.end() || object.mesh.change_number() == sent->second.change_number) continue;
    const double by = overdue(now_ns, sent->second.at_ns, kMeshNs);
    if (by > most.overdue) most = {&object, &sent->second, by};
  }
  return most;
}

/// Returns the most overdue object whose marked regions have changed.
PageFeed::Changed PageFeed::changed_regions(std::int64_t now_ns) {
  Changed most;
  for (const auto& [id, object] : core_.objects()) {
    const auto sent = meshes_.find(object.number);
    if (sent == meshes_.end() || object.regions_number == sent->second.regions_number) continue;
    const double by = overdue(now_ns, sent->second.regions_ns, kRegionsNs);
    if (by > most.overdue) most = {&object, &sent->second, by};
  }
  return most;
}

PageMessage PageFeed::mesh_frame(const SeenObject& object, SentMesh& sent) {
  const ShownMesh& mesh = object.mesh;
  const std::vector<std::uint32_t> rows = mesh.changed_since(sent.change_number);
  PageMessage frame;
  std::string& bytes = frame.bytes;
  bytes.reserve(32 + rows.size() * (sizeof(std::uint32_t) + sizeof(ShownMesh::Face::corners)));
  append(bytes, static_cast<std::uint32_t>(FrameKind::kMesh));
  append(bytes, object.number);
  append(bytes, sent.change_number == 0 ? kWhole : 0);
  append(bytes, static_cast<std::uint32_t>(mesh.rows().size()));
  append(bytes, static_cast<std::uint32_t>(rows.size()));
  append(bytes, mesh.faces());
  append(bytes, mesh.mesh_hash());
  for (const std::uint32_t row : rows) append(bytes, mesh.rows()[row].finest ? row | kFinestRow : row);
  for (const std::uint32_t row : rows)
    for (const float coordinate : mesh.rows()[row].corners) append(bytes, coordinate);
  sent.change_number = mesh.change_number();
  return frame;
}

PageMessage PageFeed::regions_frame(const SeenObject& object, SentMesh& sent) {
  sent.regions_number = object.regions_number;
  PageMessage frame;
  append(frame.bytes, static_cast<std::uint32_t>(FrameKind::kRegions));
  append(frame.bytes, object.number);
  append(frame.bytes, static_cast<std::uint32_t>(object.regions.size()));
  append(frame.bytes, std::uint32_t{0});
  for (const MarkedRegion& region : object.regions) {
    append(frame.bytes, static_cast<std::uint32_t>(region.mark));
    for (const float coordinate : region.low) append(frame.bytes, coordinate);
    append(frame.bytes, region.edge);
  }
  return frame;
}

}  // namespace tactus::viewer
