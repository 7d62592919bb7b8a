/// A host, controllers and users of one crate in virtual time, without DDS: the parts of the services that share an
/// object, as the services run them, over a network that delays.
///
///     Operator --> SimulatedDevice --> Bodies, Cycle | Holdings, Loader  ~~ delay ~~  Keeper, DeliveryServer
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "client_sim/operator.hpp"
#include "haptics/simulated_device.hpp"
#include "host_service/keeper.hpp"
#include "hrtc_service/bodies.hpp"
#include "hrtc_service/holdings.hpp"
#include "hrtc_service/loader.hpp"
#include "session/delivery_server.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"

namespace tactus::test_support {

class SharedSession {
 public:
  static constexpr std::int64_t kMs = 1'000'000;
  static constexpr std::uint64_t kSession = 1, kHost = 100, kObject = 5;
  static constexpr double kHalf = 0.05;  // m, of the crate's edges

  struct Settings {
    std::int64_t delay_ms = 2;  ///< each way, of everything
    double mass = 0.8;          ///< kg
  };

  explicit SharedSession(const Settings& settings)
      : settings_{settings},
        built_{spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kBox, 1200))},
        encoded_{built_.model()} {
    entry_.origin = origin_of(kHost, 1000);
    entry_.host = "host";
    entry_.object = "crate";
    entry_.object_id = kObject;
    entry_.summary = built_.summary;
    entry_.pose.position = {0, 0, kHalf};
    entry_.material = {1000, 3, 0.9, 0.8};
    entry_.body = {settings.mass, sharing::inertia_of_bounds(entry_.summary, 1, settings.mass), 0.6, 0};
    entry_.scale = 1;
    start_host(1000);
  }

  /// The host starts, anew if it did before.
  void start_host(std::uint64_t incarnation) {
    keeper_ = std::make_unique<host_service::Keeper>(origin_of(kHost, incarnation));
    keeper_->add(entry_, now_);
    server_ = std::make_unique<session::DeliveryServer>(origin_of(kHost, incarnation));
    server_->add(kObject, encoded_.coded());
    entry_.base_bytes = server_->base_bytes(kObject);
    ++host_life_;
  }
  void stop_host() {
    keeper_.reset();
    server_.reset();
    ++host_life_;
  }

  std::size_t add_controller() {
    const std::size_t i = controllers_.size();
    controllers_.push_back(std::make_unique<Controller>(origin_of(i + 1, 1)));
    Controller& controller = *controllers_.back();
    controller.loader.on_object = [&controller](const hrtc_service::TouchObject& object) {
      controller.index = object.index;
      (void)controller.holdings.add(object.index, object.id, *object.body);
    };
    controller.loader.on_host_seen(kHost, 1000, now_);
    controller.loader.on_catalogue(entry_);
    return i;
  }
  /// It says nothing and hears nothing any more.
  void kill_controller(std::size_t i) { controllers_[i]->dead = true; }

  /// A user at a controller; without a script its hand goes where `move_hand` says.
  std::size_t add_user(std::size_t controller, const spm::Vec3d& start,
                       const std::vector<client_sim::Action>& script = {}) {
    User user;
    user.controller = controller;
    user.probe = controllers_[controller]->probes++;
    haptics::HandSettings hand;
    hand.start = start;
    hand.seed = static_cast<std::uint32_t>(users_.size() + 1);
    user.device = std::make_unique<haptics::SimulatedDevice>(hand);
    client_sim::User person;
    person.name = "user" + std::to_string(users_.size());
    person.script = script;
    user.id = session::id_of(person.name);
    if (!script.empty()) user.mind = std::make_unique<client_sim::Operator>(person, client_sim::OperatorSettings{});
    users_.push_back(std::move(user));
    return users_.size() - 1;
  }
  void move_hand(std::size_t user, const spm::Vec3d& to) {
    haptics::HandPath path;
    path.count = 1;
    path.waypoints[0] = {now_, {to.x(), to.y(), to.z()}};
    users_[user].device->wishes().post(path);
  }

  void run(
      double seconds, const std::function<void()>& each_ms = [] {}) {
    for (int ms = 0; ms < static_cast<int>(seconds * 1000); ++ms) {
      step();
      each_ms();
    }
  }

  [[nodiscard]] std::int64_t now() const { return now_; }
  /// As the last haptic cycle of a controller left it.
  [[nodiscard]] const hrtc_service::BodyReport& body(std::size_t controller) const {
    return controllers_[controller]->reports.bodies[0];
  }
  [[nodiscard]] const haptics::PassivityController::Ledger& port(std::size_t user) const {
    return controllers_[users_[user].controller]->reports.ports[users_[user].probe];
  }
  [[nodiscard]] const hrtc_service::ProbeOutput& probe(std::size_t user) const {
    return controllers_[users_[user].controller]->outputs[users_[user].probe];
  }
  [[nodiscard]] session::Holder::Role role(std::size_t controller) const {
    return controllers_[controller]->holdings.role(controllers_[controller]->index, now_);
  }
  [[nodiscard]] const client_sim::Operator& mind(std::size_t user) const { return *users_[user].mind; }
  [[nodiscard]] host_service::Keeper& keeper() { return *keeper_; }
  [[nodiscard]] double figure(std::size_t controller, const std::string& name) const {
    std::vector<session::Figure> figures;
    controllers_[controller]->holdings.write(figures);
    for (const session::Figure& figure : figures)
      if (figure.name == name) return figure.value;
    return 0;
  }
  /// The newest pose that a viewer has accepted.
  [[nodiscard]] const session::ObjectPose& seen() const { return seen_; }
  [[nodiscard]] std::uint64_t poses_refused() const { return refused_; }

 private:
  struct Controller {
    explicit Controller(const session::Origin& self)
        : origin{self},
          pool{spm::PoolSettings::for_slots(1 << 13)},
          nodes{pool.settings.tree_nodes},
          loader{pool, nodes, self, {}, arrivals, departures},
          cycle{cycle_settings(), {}, departures, nullptr},
          bodies{cycle_settings()},
          holdings{self, bodies.orders()} {}

    static hrtc_service::CycleSettings cycle_settings() {
      hrtc_service::CycleSettings settings;
      settings.force.soft_start = 0.01;
      return settings;
    }

    session::Origin origin;
    spm::Pool pool;
    spm::NodePool nodes;
    hrtc_service::ArrivalRing arrivals{1024};
    hrtc_service::DepartureRing departures{1024};
    hrtc_service::Loader loader;
    hrtc_service::Cycle cycle;
    hrtc_service::Bodies bodies;
    hrtc_service::Holdings holdings;
    std::array<hrtc_service::NearObjects, hrtc_service::kMaxProbes> near{};
    std::array<hrtc_service::ProbeInput, hrtc_service::kMaxProbes> inputs{};
    std::array<hrtc_service::ProbeOutput, hrtc_service::kMaxProbes> outputs{};
    hrtc_service::BodyReports reports;
    std::uint32_t probes = 0, index = 0;
    std::uint32_t pose_sequence = 0;
    std::int64_t posed_ns = 0;
    bool dead = false;
  };
  struct User {
    std::size_t controller = 0;
    std::uint32_t probe = 0;
    std::uint64_t id = 0;
    std::unique_ptr<haptics::SimulatedDevice> device;
    std::unique_ptr<client_sim::Operator> mind;
  };

  static session::Origin origin_of(std::uint64_t participant, std::uint64_t incarnation) {
    session::Origin origin;
    origin.session = kSession;
    origin.participant = participant;
    origin.incarnation = incarnation;
    return origin;
  }

  void send(std::function<void()> arrive) { under_way_.emplace(now_ + settings_.delay_ms * kMs, std::move(arrive)); }
  void to_host(std::function<void()> arrive) {
    send([this, life = host_life_, arrive = std::move(arrive)] {
      if (keeper_ != nullptr && life == host_life_) arrive();
    });
  }
  void to_controller(std::size_t i, std::function<void(Controller&)> arrive) {
    send([this, i, arrive = std::move(arrive)] {
      if (!controllers_[i]->dead) arrive(*controllers_[i]);
    });
  }

  void publish(const session::ObjectPose& pose) {
    to_host([this, pose] { keeper_->on_pose(pose, now_); });
    for (std::size_t i = 0; i < controllers_.size(); ++i)
      to_controller(i, [pose](Controller& controller) { controller.holdings.on_pose(pose); });
    send([this, pose] {
      if (!gate_.accept(pose)) {
        ++refused_;
        return;
      }
      seen_ = pose;
      session::CatalogueEntry moved = entry_;
      moved.pose = pose.pose;
      view_["crate"] = client_sim::view_of(moved);
    });
  }

  void haptic_cycle(std::size_t i) {
    Controller& c = *controllers_[i];
    std::array<hrtc_service::Arrival, 64> arrived;
    const auto count = static_cast<std::uint32_t>(c.arrivals.pop(arrived.data(), arrived.size()));
    for (User& user : users_) {
      if (user.controller != i) continue;
      hrtc_service::ProbeInput& input = c.inputs[user.probe];
      input.active = true;
      input.device = user.device->read(now_);
      input.near = c.near[user.probe];
    }
    c.bodies.place(c.cycle, now_);
    c.outputs = c.cycle.touch(c.inputs, now_, arrived.data(), count).probes;
    c.bodies.limit(c.cycle, c.inputs, c.outputs);
    for (User& user : users_)
      if (user.controller == i) user.device->write(hrtc_service::vec(c.outputs[user.probe].force));
    c.bodies.step(c.cycle, now_);
    c.cycle.refine(spm::Budget{1u << 20});
    if (hrtc_service::BodyReports reports; c.bodies.reports_for_sender().take(reports)) c.reports = reports;
    if (c.reports.count == 0) return;
    const hrtc_service::BodyReport& body = c.reports.bodies[0];
    if (body.copies > 0)
      for (std::size_t to = 0; to < controllers_.size(); ++to) {
        if (to == i) continue;
        session::ObjectCopy copy;
        sharing::put_sample(body.sample, body.copies, copy);
        to_controller(to, [this, place = body.place, group = body.group, copy](Controller& peer) {
          (void)peer.bodies.copies().push({peer.index, place, group, sharing::sample_of(copy)});
          peer.holdings.on_peer_heard(peer.index, now_);
        });
      }
    if (body.publish == 0 || now_ - c.posed_ns < 4 * kMs) return;
    c.posed_ns = now_;
    session::ObjectPose pose;
    pose.origin = c.origin;
    pose.object_id = kObject;
    pose.sequence = ++c.pose_sequence;
    pose.fencing = body.publish;
    pose.session_time_ns = now_;
    sharing::put_state(body.state, sharing::body_of(entry_).centre, pose);
    publish(pose);
  }

  void serve(std::size_t i) {
    Controller& c = *controllers_[i];
    if (hrtc_service::BodyReports reports; c.bodies.reports_for_service().take(reports)) c.holdings.on_reports(reports);
    for (const auto& body : c.holdings.bodies())
      c.loader.on_moved(body.object, hrtc_service::Placement{body.pose, entry_.scale});
    std::array<hrtc_service::ProbeSight, hrtc_service::kMaxProbes> sights;
    for (std::uint32_t p = 0; p < c.probes; ++p)
      sights[p] = {true, (c.outputs[p].status & session::kInContact) != 0, now_, hrtc_service::vec(c.outputs[p].device),
                   hrtc_service::vec(c.outputs[p].proxy)};
    if (keeper_ != nullptr) c.loader.on_host_seen(kHost, 1000, now_);
    c.loader.tick(now_, sights, c.near);
    while (auto demand = c.loader.demand(now_)) to_host([this, demand = *demand] { server_->on_demand(demand, now_); });
    c.holdings.set_one_way((settings_.delay_ms + 2) * kMs);
    for (const session::ObjectClaim& claim : c.holdings.tick(now_, session::ClockMap{}))
      to_host([this, claim] { keeper_->on_claim(claim, now_); });
  }

  void act() {
    for (User& user : users_) {
      if (user.mind == nullptr) continue;
      const hrtc_service::ProbeOutput& output = controllers_[user.controller]->outputs[user.probe];
      session::ProbeState state;
      state.user_id = user.id;
      state.session_time_ns = now_;
      state.device.position = output.device;
      state.proxy = output.proxy;
      state.force = output.force;
      state.status = output.status;
      state.object_id = output.object != spm::kNone ? kObject : 0;
      user.mind->on_probe_state(state);
      send([this, state] {
        for (User& other : users_)
          if (other.mind != nullptr) other.mind->on_other(state);
      });
      if (const auto intent = user.mind->tick(now_, view_)) {
        haptics::HandPath path;
        for (const session::Waypoint& waypoint : intent->path)
          path.waypoints[path.count++] = {waypoint.session_time_ns, waypoint.position};
        user.device->wishes().post(path);
      }
    }
  }

  void step() {
    now_ += kMs;
    while (!under_way_.empty() && under_way_.begin()->first <= now_) {
      const std::function<void()> arrive = std::move(under_way_.begin()->second);
      under_way_.erase(under_way_.begin());
      arrive();
    }
    for (std::size_t i = 0; i < controllers_.size(); ++i) {
      if (controllers_[i]->dead) continue;
      haptic_cycle(i);
      if (now_ / kMs % 2 == 0) serve(i);
    }
    if (now_ / kMs % 2 == 0) act();
    if (keeper_ == nullptr) return;
    const host_service::Keeper::Messages& messages = keeper_->tick(now_, now_);
    for (const session::ObjectGrant& grant : messages.grants)
      for (std::size_t i = 0; i < controllers_.size(); ++i)
        to_controller(i, [this, grant](Controller& controller) { controller.holdings.on_grant(grant, now_); });
    for (const session::ObjectPose& pose : messages.poses) publish(pose);
    while (auto chunk = server_->next(now_)) {
      const std::uint64_t hrtc = chunk->hrtc;
      if (hrtc >= 1 && hrtc <= controllers_.size())
        to_controller(hrtc - 1, [this, chunk = chunk->chunk](Controller& controller) {
          controller.loader.on_chunk(chunk, now_);
        });
    }
  }

  Settings settings_;
  spm::offline::BuiltModel built_;
  spm::codec::EncodedModel encoded_;
  session::CatalogueEntry entry_;
  std::unique_ptr<host_service::Keeper> keeper_;
  std::unique_ptr<session::DeliveryServer> server_;
  std::uint64_t host_life_ = 0;
  std::vector<std::unique_ptr<Controller>> controllers_;
  std::vector<User> users_;
  std::multimap<std::int64_t, std::function<void()>> under_way_;
  client_sim::Objects view_{
      {"crate",
       client_sim::ObjectView{kObject, {0, 0, kHalf}, spm::Vec3d::Constant(kHalf), Eigen::Matrix3d::Identity()}}};
  session::PoseGate gate_;
  session::ObjectPose seen_;
  std::uint64_t refused_ = 0;
  std::int64_t now_ = 10'000 * kMs;
};

}  // namespace tactus::test_support
