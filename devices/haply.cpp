// A Haply Inverse3 as a device, by the public protocol of the Haply Inverse Service 3.5 (WebSocket and JSON, its
// simulation channel), which has to run where the device is plugged in. No SDK.
//
//   tactus-hrtc --device ann=tactus-haply.so                        the first Inverse3 of the service on this machine
//   tactus-hrtc --device ann=tactus-haply.so,localhost:10001/049D   that one
//
//      service -- all devices there are -->                      on connection
//              <-- force, once with a profile --                 a thread of the driver's own, at most 2 kHz
//              -- state of all devices -->                       one answer to each message
//
// The newest position and the newest force win; nothing waits for the haptic thread, nor that for the network. A force
// that nobody has renewed for 50 ms is sent as zero. A connection that ends, a device that is gone, a service that is
// silent for a second and one that talks nonsense have failed: the operator is told, and the service lets go by itself
// when no commands come. The tip only: a grip's orientation and buttons are not read.
//
// Written by docs.haply.co, version 3.5.x: "WebSocket Protocol", "Simulation Channel" and "Control Commands" (metres,
// newton, right-handed). Tested against a peer of our own, not with a real device.
#include <algorithm>
#include <array>
#include <atomic>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <future>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "haptics/device_plugin.h"

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using Clock = std::chrono::steady_clock;  // CLOCK_MONOTONIC
using Error = beast::error_code;
using Json = nlohmann::json;
using Vector = std::array<double, 3>;
using namespace std::chrono_literals;

constexpr auto kPatience = 3s;      // until a service has told of its devices
constexpr auto kSilence = 1s;       // after which it has failed
constexpr auto kPeriod = 500us;     // between two messages, at least
constexpr auto kForceHolds = 50ms;  // without being written again
constexpr auto kFarewell = 300ms;
constexpr int kMaxNonsense = 100;  // messages in a row
constexpr std::size_t kMaxBytes = 1u << 20;

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
}

/// One thread shows another its newest value; neither waits. Three slots: one the writer's, one the reader's, one
/// between.
template <class T>
class Newest {
 public:
  void post(const T& value) noexcept {
    slots_[back_] = value;
    back_ = between_.exchange(back_ | kNew, std::memory_order_acq_rel) & kSlot;
  }
  /// False when there is none since the last.
  bool take(T& value) noexcept {
    if ((between_.load(std::memory_order_relaxed) & kNew) == 0) return false;
    front_ = between_.exchange(front_, std::memory_order_acq_rel) & kSlot;
    value = slots_[front_];
    return true;
  }

 private:
  static constexpr unsigned kSlot = 3, kNew = 4;
  std::array<T, 3> slots_{};
  unsigned back_ = 0, front_ = 2;
  std::atomic<unsigned> between_{1};
};

struct Pose {
  Vector position{}, velocity{};
  std::int64_t time_ns = 0;
};
struct Force {
  Vector value{};
  std::int64_t time_ns = 0;
};

/// {"x": 1, "y": 2, "z": 3}; false for anything else.
bool vector_of(const Json& object, const char* name, Vector& value) {
  const auto found = object.find(name);
  if (found == object.end() || !found->is_object()) return false;
  constexpr const char* kAxes[] = {"x", "y", "z"};
  for (std::size_t i = 0; i < value.size(); ++i) {
    const auto axis = found->find(kAxes[i]);
    if (axis == found->end() || !axis->is_number()) return false;
    value[i] = axis->get<double>();
    if (!std::isfinite(value[i])) return false;
  }
  return true;
}

/// The id of an entry of `inverse3`; empty when it has none.
std::string id_of(const Json& device) {
  if (!device.is_object()) return "";
  const auto id = device.find("device_id");
  return id != device.end() && id->is_string() ? id->get<std::string>() : "";
}

/// The conversation with the service. Its thread runs everything but what is marked otherwise.
class Service {
 public:
  /// Waits until the service has told of its devices. Throws std::runtime_error saying what, found, expected.
  Service(std::string host, std::string port, std::string wanted)
      : host_{std::move(host)}, port_{std::move(port)}, id_{std::move(wanted)} {
    std::future<std::string> published = ready_.get_future();
    std::future<void> ended = ended_.get_future();
    thread_ = std::thread{[this] {
      connect();
      context_.run();
      ended_.set_value();
    }};
    has_ended_ = std::move(ended);
    const std::string trouble = published.wait_for(kPatience) == std::future_status::ready
                                    ? published.get()
                                    : "it did not tell of its devices within 3 s";
    if (trouble.empty()) return;
    stop();
    throw std::runtime_error("Haply Inverse Service at " + host_ + ":" + port_ + ": " + trouble);
  }
  ~Service() { stop(); }
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  // The haptic thread's.
  Newest<Pose>& poses() noexcept { return poses_; }
  Newest<Force>& forces() noexcept { return forces_; }
  [[nodiscard]] bool failed() const noexcept { return failed_.load(std::memory_order_acquire); }

 private:
  /// From outside: lets go of the device, then of the service.
  void stop() {
    closing_ = true;
    if (has_ended_.valid() && has_ended_.wait_for(kFarewell) != std::future_status::ready) context_.stop();
    if (thread_.joinable()) thread_.join();
  }

  void fail(const std::string& why) {
    if (!inventory_) return tell(why);
    if (!failed_.exchange(true, std::memory_order_acq_rel) && !closing_)
      std::fprintf(stderr, "tactus-haply: %s:%s, device %s: %s\n", host_.c_str(), port_.c_str(), id_.c_str(),
                   why.c_str());
    end();
  }
  void tell(const std::string& trouble) {
    if (published_) return;
    published_ = true;
    ready_.set_value(trouble);
    if (!trouble.empty()) end();
  }
  void end() {
    beast::get_lowest_layer(socket_).close();
    context_.stop();
  }

  void connect() {
    Error error;
    asio::ip::tcp::resolver resolver{context_};
    const auto places = resolver.resolve(host_, port_, error);
    if (error) return tell(error.message() + "; is the service running?");
    beast::get_lowest_layer(socket_).expires_after(kPatience);
    beast::get_lowest_layer(socket_).async_connect(places, [this](Error failed, const auto&) {
      if (failed) return tell(failed.message() + "; is the service running?");
      beast::get_lowest_layer(socket_).socket().set_option(asio::ip::tcp::no_delay{true}, failed);
      beast::get_lowest_layer(socket_).expires_never();
      websocket::stream_base::timeout limits{};
      limits.handshake_timeout = kPatience;
      limits.idle_timeout = kSilence;
      limits.keep_alive_pings = false;
      socket_.set_option(limits);
      socket_.read_message_max(kMaxBytes);
      socket_.async_handshake(host_ + ":" + port_, "/", [this](Error refused) {
        if (refused) return tell("no WebSocket: " + refused.message());
        read();
      });
    });
  }

  void read() {
    socket_.async_read(buffer_, [this](Error error, std::size_t) {
      if (error) return fail(error == beast::error::timeout ? "silent for a second" : error.message());
      const std::int64_t time_ns = now_ns();
      const Json message =
          Json::parse(static_cast<const char*>(buffer_.data().data()),
                      static_cast<const char*>(buffer_.data().data()) + buffer_.size(), nullptr, false);
      buffer_.consume(buffer_.size());
      const bool is_sense = inventory_ ? take_state(message, time_ns) : take_inventory(message);
      if (!is_sense && ++nonsense_ > kMaxNonsense) return fail("its messages are not what version 3.5 says");
      if (is_sense) nonsense_ = 0;
      if (failed_ || (published_ && !inventory_)) return;
      if (inventory_) return pace();
      read();
    });
  }

  static const Json* devices_in(const Json& message) {
    if (!message.is_object()) return nullptr;
    const auto found = message.find("inverse3");
    return found != message.end() && found->is_array() ? &*found : nullptr;
  }

  bool take_inventory(const Json& message) {
    const Json* const devices = devices_in(message);
    if (devices == nullptr) return false;
    std::string found;
    for (const Json& device : *devices) {
      const std::string id = id_of(device);
      if (id.empty()) continue;
      found += (found.empty() ? "" : ", ") + id;
      if (!id_.empty() && id != id_) continue;
      id_ = id;
      inventory_ = true;
      tell("");
      return true;
    }
    tell("found " + (found.empty() ? "no Inverse3" : "Inverse3 " + found) + ", expected " +
         (id_.empty() ? "one" : id_));
    return true;
  }

  bool take_state(const Json& message, std::int64_t time_ns) {
    const Json* const devices = devices_in(message);
    if (devices == nullptr) return false;
    for (const Json& device : *devices) {
      if (id_of(device) != id_) continue;
      const auto state = device.find("state");
      Pose pose;
      pose.time_ns = time_ns;
      if (state == device.end() || !state->is_object() || !vector_of(*state, "cursor_position", pose.position) ||
          !vector_of(*state, "cursor_velocity", pose.velocity))
        return false;
      poses_.post(pose);
      return true;
    }
    fail("the device is gone");
    return true;
  }

  void pace() {
    timer_.expires_at(std::max(Clock::now(), sent_ + kPeriod));
    timer_.async_wait([this](Error error) {
      if (!error) send();
    });
  }

  void send() {
    sent_ = Clock::now();
    (void)forces_.take(force_);
    const bool holds = !closing_ && now_ns() - force_.time_ns <= std::chrono::nanoseconds{kForceHolds}.count();
    const Vector force = holds ? force_.value : Vector{};
    Json device;
    device["device_id"] = id_;
    Json& vector = device["commands"]["set_cursor_force"]["vector"];
    vector["x"] = force[0];
    vector["y"] = force[1];
    vector["z"] = force[2];
    Json message;
    message["inverse3"].push_back(std::move(device));
    if (!introduced_) message["session"]["configure"]["profile"]["name"] = "tactus:hrtc";
    introduced_ = true;
    text_ = message.dump();
    const bool last = closing_;
    socket_.text(true);
    socket_.async_write(asio::buffer(text_), [this, last](Error error, std::size_t) {
      if (error) return fail(error.message());
      if (!last) return read();
      socket_.async_close(websocket::close_code::normal, [](Error) {});
    });
  }

  std::string host_, port_, id_;
  asio::io_context context_{1};
  websocket::stream<beast::tcp_stream> socket_{context_};
  asio::steady_timer timer_{context_};
  beast::flat_buffer buffer_;
  std::string text_;
  std::promise<std::string> ready_;
  std::promise<void> ended_;
  std::future<void> has_ended_;
  bool published_ = false, inventory_ = false, introduced_ = false;
  int nonsense_ = 0;
  Clock::time_point sent_{};
  Force force_;
  Newest<Pose> poses_;
  Newest<Force> forces_;
  std::atomic<bool> failed_{false}, closing_{false};
  std::thread thread_;
};

}  // namespace

struct tactus_device {
  std::unique_ptr<Service> service;
};

namespace {

/// HOST:PORT/DEVICE, of which any part may be left out from the end.
tactus_device* open_haply(const char* config, char* error, std::size_t error_size) {
  std::string place = config, id;
  if (const std::size_t slash = place.find('/'); slash != std::string::npos) {
    id = place.substr(slash + 1);
    place.resize(slash);
  }
  if (place.empty()) place = "localhost:10001";
  const std::size_t colon = place.rfind(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == place.size()) {
    std::snprintf(error, error_size, "found '%s', expected HOST:PORT or HOST:PORT/DEVICE", config);
    return nullptr;
  }
  try {
    auto device = std::make_unique<tactus_device>();
    device->service = std::make_unique<Service>(place.substr(0, colon), place.substr(colon + 1), id);
    return device.release();
  } catch (const std::exception& failure) {
    std::snprintf(error, error_size, "%s", failure.what());
    return nullptr;
  }
}

void close_haply(tactus_device* device) { delete device; }

/// Carefully: the service says none of these, and another millisecond passes on the way there and back.
void spec_of_haply(tactus_device*, tactus_device_spec* spec) {
  spec->max_force = 5;
  spec->max_stiffness = 800;
  spec->damping = 1;
  spec->workspace_radius = 0.15;
  spec->flags = TACTUS_DEVICE_HAS_VELOCITY;
}

int read_haply(tactus_device* device, std::int64_t, tactus_device_pose* pose) {
  if (device->service->failed()) return TACTUS_DEVICE_FAILED;
  Pose newest;
  if (!device->service->poses().take(newest)) return TACTUS_DEVICE_NO_NEWS;
  std::copy(newest.position.begin(), newest.position.end(), pose->position);
  std::copy(newest.velocity.begin(), newest.velocity.end(), pose->velocity);
  pose->time_ns = newest.time_ns;
  return TACTUS_DEVICE_POSE;
}

int write_haply(tactus_device* device, const double force[3]) {
  device->service->forces().post({{force[0], force[1], force[2]}, now_ns()});
  return device->service->failed() ? -1 : 0;
}

}  // namespace

extern "C" const tactus_device_driver* tactus_device_entry() {
  static const tactus_device_driver driver{TACTUS_DEVICE_ABI, "Haply Inverse3", open_haply,  close_haply,
                                           spec_of_haply,     read_haply,       write_haply, nullptr};
  return &driver;
}
