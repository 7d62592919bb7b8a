// Device driver for a Haply Inverse3. It uses the public protocol of the Haply Inverse Service 3.5, the simulation
// channel with WebSocket and JSON, and no SDK. The service must run on the machine with the device.
//
//   tactus-hrtc --device ann=tactus-haply.so                        the first Inverse3 of the service on this machine
//   tactus-hrtc --device ann=tactus-haply.so,localhost:10001/049D   the Inverse3 with id 049D
//
//      service -- list of all devices --> driver      when the driver connects
//              <------------- force -----             from a thread of the driver, at most 2 kHz; the first message
//                                                     also sets the profile
//              -- state of all devices -->            one answer to each force
//
// The driver uses only the newest position and the newest force. The haptic thread and the network thread never wait
// for each other. If no force was written for 50 ms, the driver sends zero. The device has failed when the connection
// ends, when the device is removed, and when the service is silent for a second or sends more than 100 invalid messages
// in a row. In these cases the driver prints a line for the operator, and the service ends the force because it gets no
// commands. The driver reads position and velocity of the tip, but not the orientation and buttons of a grip.
//
// Written from docs.haply.co, version 3.5.x: "WebSocket Protocol", "Simulation Channel" and "Control Commands" (metres,
// newton, right-handed). Tested against a simulated service, not with a real device.
#include <algorithm>
#include <array>
#include <atomic>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <future>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

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

constexpr auto kConnectTimeout = 3s;  // max time until the service has sent its list of devices
constexpr auto kMaxSilence = 1s;      // time without a message after which the device has failed
constexpr auto kMinPeriod = 500us;    // min time between two messages to the service
constexpr auto kMaxForceAge = 50ms;   // time after the last write after which the driver sends zero force
constexpr auto kCloseTimeout = 300ms;
constexpr int kMaxInvalid = 100;             // max number of invalid messages in a row
constexpr std::size_t kMaxBytes = 1u << 20;  // max size of a message

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
}

/// A mailbox between two threads that never wait: one slot for the writer, one for the reader, one shared.
template <class T>
class Newest {
 public:
  void post(const T& value) noexcept {
    slots_[back_] = value;
    back_ = between_.exchange(back_ | kNew, std::memory_order_acq_rel) & kSlot;
  }
  /// Copies the newest value. Returns false if no value was posted since the last call.
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

/// Reads member `name` of `object` in the form {"x": 1, "y": 2, "z": 3}. Returns false for any other form.
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

/// Returns the id of an entry of the list `inverse3`. Empty if the entry has none.
std::string id_of(const Json& device) {
  if (!device.is_object()) return "";
  const auto id = device.find("device_id");
  return id != device.end() && id->is_string() ? id->get<std::string>() : "";
}

/// Connection to the service, with a thread of its own. This thread runs each function whose comment names no other.
class Service {
 public:
  /// Called by another thread. Waits for the list of devices. Throws std::runtime_error, which names the value found
  /// and the value expected.
  Service(std::vector<asio::ip::tcp::endpoint> endpoints, std::string address, std::string wanted)
      : endpoints_{std::move(endpoints)}, address_{std::move(address)}, id_{std::move(wanted)} {
    std::future<std::string> ready = ready_.get_future();
    std::future<void> ended = ended_.get_future();
    thread_ = std::thread{[this] {
      connect();
      context_.run();
      ended_.set_value();
    }};
    ended_future_ = std::move(ended);
    const std::string problem = ready.wait_for(kConnectTimeout) == std::future_status::ready
                                    ? ready.get()
                                    : "it sent no list of devices within 3 s";
    if (problem.empty()) return;
    stop();
    throw std::runtime_error("Haply Inverse Service at " + address_ + ": " + problem);
  }
  ~Service() { stop(); }
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  // Called by the haptic thread.
  Newest<Pose>& poses() noexcept { return poses_; }
  Newest<Force>& forces() noexcept { return forces_; }
  [[nodiscard]] bool failed() const noexcept { return failed_.load(std::memory_order_acquire); }

 private:
  /// Called by other threads: commands zero force, then closes the connection.
  void stop() {
    closing_ = true;
    if (ended_future_.valid() && ended_future_.wait_for(kCloseTimeout) != std::future_status::ready) context_.stop();
    if (thread_.joinable()) thread_.join();
  }

  /// Ends the connection. Before the device is found, reports `why` to the constructor. Later, the device has failed.
  void fail(const std::string& why) {
    if (!has_device_) return report(why);
    if (!failed_.exchange(true, std::memory_order_acq_rel) && !closing_)
      std::fprintf(stderr, "tactus-haply: %s, device %s: %s\n", address_.c_str(), id_.c_str(), why.c_str());
    end();
  }
  /// Passes the result to the constructor. Empty `problem`: the device was found. Ignores all calls after the first.
  void report(const std::string& problem) {
    if (reported_) return;
    reported_ = true;
    ready_.set_value(problem);
    if (!problem.empty()) end();
  }
  void end() {
    beast::get_lowest_layer(socket_).close();
    context_.stop();
  }

  void connect() {
    beast::get_lowest_layer(socket_).expires_after(kConnectTimeout);
    beast::get_lowest_layer(socket_).async_connect(endpoints_, [this](Error failed, const auto&) {
      if (failed) return report(failed.message() + "; is the service running?");
      beast::get_lowest_layer(socket_).socket().set_option(asio::ip::tcp::no_delay{true}, failed);
      beast::get_lowest_layer(socket_).expires_never();
      websocket::stream_base::timeout limits{};
      limits.handshake_timeout = kConnectTimeout;
      limits.idle_timeout = kMaxSilence;
      limits.keep_alive_pings = false;
      socket_.set_option(limits);
      socket_.read_message_max(kMaxBytes);
      socket_.async_handshake(address_, "/", [this](Error refused) {
        if (refused) return report("no WebSocket: " + refused.message());
        read();
      });
    });
  }

  void read() {
    socket_.async_read(buffer_, [this](Error error, std::size_t) {
      if (error) return fail(error == beast::error::timeout ? "the service sent nothing for 1 s" : error.message());
      const std::int64_t time_ns = now_ns();
      const Json message =
          Json::parse(static_cast<const char*>(buffer_.data().data()),
                      static_cast<const char*>(buffer_.data().data()) + buffer_.size(), nullptr, false);
      buffer_.consume(buffer_.size());
      const bool is_valid = has_device_ ? take_state(message, time_ns) : take_device_list(message);
      if (!is_valid && ++invalid_ > kMaxInvalid) return fail("its messages do not follow version 3.5");
      if (is_valid) invalid_ = 0;
      if (failed_ || (reported_ && !has_device_)) return;
      if (has_device_) return send_later();
      read();
    });
  }

  static const Json* devices_in(const Json& message) {
    if (!message.is_object()) return nullptr;
    const auto found = message.find("inverse3");
    return found != message.end() && found->is_array() ? &*found : nullptr;
  }

  bool take_device_list(const Json& message) {
    const Json* const devices = devices_in(message);
    if (devices == nullptr) return false;
    std::string found;
    for (const Json& device : *devices) {
      const std::string id = id_of(device);
      if (id.empty()) continue;
      found += (found.empty() ? "" : ", ") + id;
      if (!id_.empty() && id != id_) continue;
      id_ = id;
      has_device_ = true;
      report("");
      return true;
    }
    report("found " + (found.empty() ? "no Inverse3" : "Inverse3 " + found) + ", expected " +
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
    fail("the service no longer lists the device");
    return true;
  }

  /// Sends the next message when it is due.
  void send_later() {
    timer_.expires_at(std::max(Clock::now(), sent_ + kMinPeriod));
    timer_.async_wait([this](Error error) {
      if (!error) send();
    });
  }

  void send() {
    sent_ = Clock::now();
    (void)forces_.take(force_);
    const bool is_recent = !closing_ && now_ns() - force_.time_ns <= std::chrono::nanoseconds{kMaxForceAge}.count();
    const Vector force = is_recent ? force_.value : Vector{};
    Json device;
    device["device_id"] = id_;
    Json& vector = device["commands"]["set_cursor_force"]["vector"];
    vector["x"] = force[0];
    vector["y"] = force[1];
    vector["z"] = force[2];
    Json message;
    message["inverse3"].push_back(std::move(device));
    if (!profile_sent_) message["session"]["configure"]["profile"]["name"] = "tactus:hrtc";
    profile_sent_ = true;
    text_ = message.dump();
    const bool last = closing_;
    socket_.text(true);
    socket_.async_write(asio::buffer(text_), [this, last](Error error, std::size_t) {
      if (error) return fail(error.message());
      if (!last) return read();
      socket_.async_close(websocket::close_code::normal, [](Error) {});
    });
  }

  std::vector<asio::ip::tcp::endpoint> endpoints_;
  std::string address_, id_;
  asio::io_context context_{1};
  websocket::stream<beast::tcp_stream> socket_{context_};
  asio::steady_timer timer_{context_};
  beast::flat_buffer buffer_;
  std::string text_;
  std::promise<std::string> ready_;
  std::promise<void> ended_;
  std::future<void> ended_future_;
  bool reported_ = false, has_device_ = false, profile_sent_ = false;
  int invalid_ = 0;
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

/// Returns the endpoints of HOST:PORT; none if it is malformed. HOST is localhost or an IP address, because the look-up
/// of a name can block longer than kConnectTimeout.
std::vector<asio::ip::tcp::endpoint> endpoints_of(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  if (colon == std::string::npos) return {};
  const char* const end = address.data() + address.size();
  std::uint16_t port = 0;
  if (const auto [at, error] = std::from_chars(address.data() + colon + 1, end, port);
      error != std::errc{} || at != end || port == 0)
    return {};
  const std::string host = address.substr(0, colon);
  if (host == "localhost") return {{asio::ip::address_v4::loopback(), port}, {asio::ip::address_v6::loopback(), port}};
  Error error;
  const asio::ip::address ip = asio::ip::make_address(host, error);
  if (error) return {};
  return {{ip, port}};
}

/// `config`: HOST:PORT/DEVICE, HOST:PORT or empty.
tactus_device* open_haply(const char* config, char* error, std::size_t error_size) {
  std::string address = config, id;
  if (const std::size_t slash = address.find('/'); slash != std::string::npos) {
    id = address.substr(slash + 1);
    address.resize(slash);
  }
  if (address.empty()) address = "localhost:10001";
  const std::vector<asio::ip::tcp::endpoint> endpoints = endpoints_of(address);
  if (endpoints.empty()) {
    std::snprintf(error, error_size,
                  "found '%s', expected HOST:PORT or HOST:PORT/DEVICE, HOST localhost or an IP address", config);
    return nullptr;
  }
  try {
    auto device = std::make_unique<tactus_device>();
    device->service = std::make_unique<Service>(endpoints, address, id);
    return device.release();
  } catch (const std::exception& failure) {
    std::snprintf(error, error_size, "%s", failure.what());
    return nullptr;
  }
}

void close_haply(tactus_device* device) { delete device; }

/// Sets conservative limits, because the service reports none, and its round trip adds a delay of a millisecond.
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
