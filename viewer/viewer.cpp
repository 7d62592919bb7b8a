#include "viewer/viewer.hpp"

#include <algorithm>
#include <chrono>
#include <optional>
#include <thread>
#include <utility>
#include <variant>

#include "realtime/process.hpp"
#include "viewer/playback.hpp"
#include "viewer/viewer_participant.hpp"

namespace tactus::viewer {
namespace {

using realtime::monotonic_ns;

constexpr std::chrono::milliseconds kTick{4};
constexpr std::int64_t kMaxAdvanceNs = 100'000'000;  // of a recording; after a delay, playback is late and not faster

}  // namespace

struct Viewer::Impl {
  explicit Impl(const ViewerOptions& options)
      : participant{{.address = options.address,
                     .settings = {.pool = options.pool, .faces = options.faces},
                     .source = "page"}},
        server{options.server, core} {
    core.on_event = options.log;
    participant.load_meshes();
    server.on_request = [this](PageId page, const PageRequest& request) {
      std::visit([&](const auto& each) { process(page, each); }, request);
    };
    server.on_page_closed = [this](PageId page) {
      users.on_release(page);
      core.forget_camera(page);
    };
    users.on_refused = [this](PageId page, const std::string& reason) {
      server.notify(page, reason);
      core.add_page_event("page " + server.name_of(page) + " has no probe: " + reason, monotonic_ns());
    };
    server.on_event = [this](const std::string& text) { core.add_page_event(text, monotonic_ns()); };
  }

  static void process(PageId, const TokenRequest&) {}
  static void process(PageId, const SeenRequest&) {}
  void process(PageId page, const CameraRequest& request) { core.set_camera(page, request.camera); }
  static void process(PageId, const PlayRequest&) {}
  static void process(PageId, const SeekRequest&) {}
  void process(PageId page, const StopRequest& request) {
    core.stop_forces(request.reason + " (page " + server.name_of(page) + ")", monotonic_ns());
  }
  void process(PageId page, const TouchRequest& request) { users.on_touch(page, request, monotonic_ns()); }
  void process(PageId page, const HandRequest& request) { users.on_hand(page, request, monotonic_ns()); }
  void process(PageId, const ShowRequest& request) { core.show_meshes_of(request.hrtc); }
  void process(PageId page, const ReleaseRequest&) { users.on_release(page); }

  ViewerParticipant participant;
  ViewerCore& core = participant.core();
  PointedUsers& users = participant.users();
  PageServer server;
};

Viewer::Viewer(ViewerOptions options) : impl_{std::make_unique<Impl>(options)} {}
Viewer::~Viewer() = default;

std::uint16_t Viewer::port() const { return impl_->server.port(); }

int Viewer::run(const std::atomic<bool>& stop) {
  Impl& viewer = *impl_;
  while (!stop && !viewer.core.is_name_taken()) {
    viewer.participant.step(kTick);
    viewer.server.poll(monotonic_ns());
    viewer.core.set_watched(viewer.server.has_reader());
  }
  viewer.participant.leave();
  return viewer.core.is_name_taken() ? 2 : 0;
}

int play(const PlaybackOptions& options, const std::function<void(std::uint16_t port)>& on_open,
         const std::atomic<bool>& stop) {
  Playback playback{options.file, options.pool, options.faces};
  PageServer server{options.server, playback.core(), &playback.status()};
  std::optional<double> seek_to;  // the last one counts, because a step back plays from the beginning
  server.on_event = options.log;
  server.on_page_closed = [&](PageId page) { playback.core().forget_camera(page); };
  server.on_request = [&](PageId page, const PageRequest& request) {
    if (const auto* const play = std::get_if<PlayRequest>(&request)) return playback.play(play->plays);
    if (const auto* const seek = std::get_if<SeekRequest>(&request)) return void(seek_to = seek->seconds);
    if (const auto* const show = std::get_if<ShowRequest>(&request)) return playback.core().show_meshes_of(show->hrtc);
    if (const auto* const view = std::get_if<CameraRequest>(&request))
      return playback.core().set_camera(page, view->camera);
    server.notify(page, "a recording cannot be touched or stopped");
  };
  on_open(server.port());
  for (std::int64_t last_ns = monotonic_ns(); !stop;) {
    const std::int64_t now_ns = monotonic_ns();
    if (seek_to) playback.seek(*std::exchange(seek_to, std::nullopt));
    playback.advance(std::min(now_ns - last_ns, kMaxAdvanceNs));
    last_ns = now_ns;
    server.poll(now_ns);
    std::this_thread::sleep_for(kTick);  // a recording has no samples that wake this thread
  }
  return 0;
}

}  // namespace tactus::viewer
