#include "viewer/page_feed.hpp"

#include <array>
#include <bit>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <utility>

#include "session/probe_coding.hpp"
#include "session/units.hpp"

namespace tactus::viewer {
namespace {

static_assert(std::endian::native == std::endian::little, "frames are little endian");

// Min times between two messages of a kind to a page.
constexpr std::int64_t kSceneNs = 100 * kMs, kFiguresNs = 250 * kMs, kProbesNs = 15 * kMs, kMeshNs = 60 * kMs;
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

const char* name_of(session::Role role) {
  switch (role) {
    case session::Role::kHost:
      return "host";
    case session::Role::kHrtc:
      return "hrtc";
    case session::Role::kClient:
      return "client";
    case session::Role::kViewer:
      break;
  }
  return "viewer";
}

}  // namespace

std::optional<PageMessage> PageFeed::next(std::int64_t now_ns) {
  if (scene_number_ != core_.scene_number() && now_ns - scene_ns_ >= kSceneNs) {
    scene_number_ = core_.scene_number();
    scene_ns_ = now_ns;
    return scene(now_ns);
  }
  const bool probes_are_due = now_ns - probes_ns_ >= kProbesNs;
  // On a slow connection both are always due, so they alternate.
  if (probes_are_due && !sent_probes_last_) return probes_next(now_ns);
  sent_probes_last_ = false;
  if (auto frame = mesh(now_ns)) return frame;
  if (probes_are_due) return probes_next(now_ns);
  if (metrics_number_ != core_.metrics_number() && now_ns - figures_ns_ >= kFiguresNs) {
    metrics_number_ = core_.metrics_number();
    figures_ns_ = now_ns;
    return figures();
  }
  return std::nullopt;
}

PageMessage PageFeed::scene(std::int64_t now_ns) {
  nlohmann::json scene{{"type", "scene"},
                       {"participants", nlohmann::json::array()},
                       {"users", nlohmann::json::array()},
                       {"objects", nlohmann::json::array()},
                       {"events", nlohmann::json::array()},
                       {"shownHrtc", core_.shown_hrtc()}};
  const StopProgress& stop = core_.stop_progress();
  scene["stop"] = {{"requested", stop.is_requested}, {"hrtcs", stop.hrtcs}, {"stopped", stop.stopped}};
  core_.roster().for_each([&](const session::RosterEntry& entry) {
    scene["participants"].push_back({{"name", entry.name},
                                     {"role", name_of(entry.role)},
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
        {{"secondsAgo", static_cast<double>(now_ns - event.at_ns) / kNsPerS}, {"text", event.text}});
  return {true, scene.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

PageMessage PageFeed::figures() const {
  nlohmann::json figures{
      {"type", "figures"}, {"participants", nlohmann::json::object()}, {"meshes", nlohmann::json::object()}};
  for (const auto& [participant, values] : core_.metrics()) {
    const session::RosterEntry* const entry = core_.roster().find(participant);
    if (entry == nullptr) continue;
    figures["participants"][entry->name] = values;
    for (const auto& [id, object] : core_.objects())
      if (const auto hash = core_.published_hash(participant, id))
        figures["meshes"][entry->name][object.entry.object] = std::to_string(*hash);
  }
  return {true, figures.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

PageMessage PageFeed::probes_next(std::int64_t now_ns) {
  probes_ns_ = now_ns;
  sent_probes_last_ = true;
  return probes(now_ns);
}

PageMessage PageFeed::probes(std::int64_t now_ns) const {
  PageMessage frame;
  std::string& bytes = frame.bytes;
  append(bytes, static_cast<std::uint32_t>(FrameKind::kProbes));
  append(bytes, static_cast<std::uint32_t>(core_.probes().size()));
  append(bytes, static_cast<std::uint32_t>(core_.objects().size()));
  append(bytes, std::uint32_t{0});
  append(bytes, static_cast<double>(core_.session_time(now_ns)) / kNsPerS);
  for (const auto& [user, probe] : core_.probes()) {
    const session::ProbeState& state = probe.state;
    // An HRTC omits the states that receivers extrapolate closely enough.
    session::ProbeView shown = session::extrapolate(state, core_.session_time(now_ns));
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
    append(bytes, static_cast<float>(static_cast<double>(now_ns - probe.received_ns) / kNsPerS));
  }
  for (const auto& [id, object] : core_.objects()) {
    append(bytes, object.number);
    append_floats(bytes, object.pose.position);
    append_floats(bytes, object.pose.orientation);
  }
  return frame;
}

/// Returns the changed rows of the object whose last frame is the oldest.
std::optional<PageMessage> PageFeed::mesh(std::int64_t now_ns) {
  const SeenObject* next = nullptr;
  SentMesh* sent = nullptr;
  for (const auto& [id, object] : core_.objects()) {
    const auto of_page = meshes_.find(object.number);
    if (of_page == meshes_.end() || object.mesh.change_number() == of_page->second.change_number) continue;
    if (now_ns - of_page->second.at_ns < kMeshNs || (sent != nullptr && of_page->second.at_ns >= sent->at_ns)) continue;
    next = &object;
    sent = &of_page->second;
  }
  if (next == nullptr) return std::nullopt;
  const ShownMesh& mesh = next->mesh;
  const std::vector<std::uint32_t> rows = mesh.changed_since(sent->change_number);
  PageMessage frame;
  std::string& bytes = frame.bytes;
  bytes.reserve(32 + rows.size() * (sizeof(std::uint32_t) + sizeof(ShownMesh::Face::corners)));
  append(bytes, static_cast<std::uint32_t>(FrameKind::kMesh));
  append(bytes, next->number);
  append(bytes, sent->change_number == 0 ? kWhole : 0);
  append(bytes, static_cast<std::uint32_t>(mesh.rows().size()));
  append(bytes, static_cast<std::uint32_t>(rows.size()));
  append(bytes, mesh.faces());
  append(bytes, mesh.mesh_hash());
  for (const std::uint32_t row : rows) append(bytes, mesh.rows()[row].finest ? row | kFinestRow : row);
  for (const std::uint32_t row : rows)
    for (const float coordinate : mesh.rows()[row].corners) append(bytes, coordinate);
  *sent = {mesh.change_number(), now_ns};
  return frame;
}

}  // namespace tactus::viewer
