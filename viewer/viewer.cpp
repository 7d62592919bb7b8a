#include "viewer/viewer.hpp"

#include <chrono>
#include <utility>
#include <variant>

#include "viewer/viewer_participant.hpp"
#include "wire/process.hpp"

namespace tactus::viewer {
namespace {

using wire::monotonic_ns;

constexpr std::chrono::milliseconds kTick{2};

}  // namespace

struct Viewer::Impl {
  explicit Impl(const ViewerOptions& options)
      : participant{{.address = options.address, .settings = {.pool = options.pool}, .source = "page"}},
        server{options.server, core} {
    core.on_event = options.log;
    participant.load_meshes();
    server.on_request = [this](PageId page, const PageRequest& request) {
      std::visit([&](const auto& each) { process(page, each); }, request);
    };
    server.on_page_closed = [this](PageId page) { users.on_release(page); };
    users.on_refused = [this](PageId page, const std::string& reason) {
      server.notify(page, reason);
      core.add_event("page " + server.name_of(page) + " has no probe: " + reason, monotonic_ns());
    };
    server.on_event = [this](const std::string& text) { core.add_event(text, monotonic_ns()); };
  }

  static void process(PageId, const TokenRequest&) {}
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
  }
  viewer.participant.leave();
  return viewer.core.is_name_taken() ? 2 : 0;
}

}  // namespace tactus::viewer
