/// What one page receives: texts in JSON and binary frames (docs/reference/viewer-frames.md).
///
/// A page has no queue. When it can take a message, it gets the newest state that it lacks. So a slow page gets fewer
/// messages, and the next one contains all changes since the last.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "viewer/viewer_core.hpp"

namespace tactus::viewer {

struct PageMessage {
  bool is_text = false;  ///< JSON; otherwise a binary frame
  std::string bytes;
};

/// First number of a binary frame.
enum class FrameKind : std::uint32_t { kMesh = 1, kProbes = 2, kRegions = 3 };
/// Number of an object in a frame if there is none.
inline constexpr std::uint32_t kNoObject = ~0u;

/// What a page shows of the playback of a recording.
struct PlaybackStatus {
  std::string file;
  double began = 0;    ///< time of the begin, s since 1970
  double seconds = 0;  ///< length
  double at = 0;       ///< shown time, s after the begin
  bool is_playing = false;
  std::uint32_t restarts = 0;  ///< grows when the core begins anew, so that pages need the whole state again
};

class PageFeed {
 public:
  /// Both must outlive the feed. `playback`: null in a live session.
  explicit PageFeed(const ViewerCore& core, const PlaybackStatus* playback = nullptr)
      : core_{core}, playback_{playback} {}

  /// Returns the next message for the page, or none if nothing is due. First playback and scene, then the most overdue
  /// of probes, meshes, regions and figures. A frame names only objects that a scene for the page has described.
  [[nodiscard]] std::optional<PageMessage> next(std::int64_t now_ns);

 private:
  [[nodiscard]] std::optional<PageMessage> playback(std::int64_t now_ns);
  [[nodiscard]] PageMessage scene();
  [[nodiscard]] PageMessage figures() const;
  [[nodiscard]] PageMessage probes() const;
  struct SentMesh {
    std::uint32_t change_number = 0;  // ShownMesh::change_number of the last frame; 0: none
    std::int64_t at_ns = 0;
    std::uint32_t regions_number = 0;  // SeenObject::regions_number of the last frame
    std::int64_t regions_ns = 0;
  };
  /// An object with a change that the page lacks. overdue < 1: nothing is due.
  struct Changed {
    const SeenObject* object = nullptr;
    SentMesh* sent = nullptr;
    double overdue = 0;  // time since the last frame of this kind, as a multiple of the min time between two
  };
  [[nodiscard]] Changed changed_mesh(std::int64_t now_ns);
  [[nodiscard]] Changed changed_regions(std::int64_t now_ns);
  [[nodiscard]] static PageMessage mesh_frame(const SeenObject& object, SentMesh& sent);
  [[nodiscard]] static PageMessage regions_frame(const SeenObject& object, SentMesh& sent);

  const ViewerCore& core_;
  const PlaybackStatus* playback_;
  PlaybackStatus sent_playback_;                         // of the last message
  std::int64_t playback_ns_ = 0;                         // of the last message
  std::uint32_t scene_number_ = 0, metrics_number_ = 0;  // of the last message
  std::int64_t scene_ns_ = 0, figures_ns_ = 0, probes_ns_ = 0;
  std::map<std::uint32_t, SentMesh> meshes_;  // by number of the objects of the last scene
};

}  // namespace tactus::viewer
