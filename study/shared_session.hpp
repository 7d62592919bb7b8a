/// A host, controllers and users of one object that moves, in virtual time: the parts of the services that share it, as
/// the services run them, on links between all of them.
///
///     Operator --> SimulatedDevice --> Bodies, Cycle | Holdings, Loader  ~~ link ~~  ObjectAuthority, DeliveryServer
///
/// Missing are threads, sockets, discovery and clocks that differ. Times are session time. World frame, SI. Same
/// settings, same calls, same run. One thread.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "client_sim/operator.hpp"
#include "haptics/simulated_device.hpp"
#include "host_service/object_authority.hpp"
#include "hrtc_service/bodies.hpp"
#include "netem/profile.hpp"
#include "session/delivery_server.hpp"
#include "study/subject.hpp"
#include "study/way.hpp"

namespace tactus::study {

/// Is told when a controller's haptic thread would begin with a cycle's bodies and forces, and when it has ended.
class CycleWatch {
 public:
  virtual ~CycleWatch() = default;
  virtual void begins() = 0;
  virtual void ends() = 0;
};

struct SharedSessionSettings {
  CycleWatch* watch = nullptr;  ///< outlives the session; null: nobody
  netem::LinkSettings
      link;  ///< from host to controllers and the viewer and, as each of the two ways, between controllers
  std::uint64_t seed = 1;  ///< of the link's losses and delays and of the hands
  double mass = 0.5;       ///< kg, of the object
  double tremor = 0;       ///< m rms, of the hands
};

class SharedSession {
 public:
  static constexpr std::int64_t kMs = 1'000'000;

  /// The object stands on the ground at the origin. `subject` must outlive it.
  SharedSession(const Subject& subject, const SharedSessionSettings& settings);
  ~SharedSession();

  /// Index of the new controller.
  std::size_t add_hrtc();
  /// Index of the new user, at a controller; who begins where its script does.
  std::size_t add_user(std::size_t controller, const client_sim::User& user);
  /// The same of a user without a mind, whose hand goes where `move_hand` says.
  std::size_t add_hand(std::size_t controller, const spm::Vec3d& start);
  void move_hand(std::size_t user, const spm::Vec3d& to);

  void stop_host();
  /// The host starts anew.
  void start_host();
  /// It says nothing and hears nothing any more.
  void kill_hrtc(std::size_t controller);

  /// A millisecond.
  void step();

  [[nodiscard]] std::int64_t now_ns() const noexcept { return now_ns_; }
  [[nodiscard]] std::size_t controllers() const noexcept { return controllers_.size(); }
  /// What is shared, as controllers simulate it.
  [[nodiscard]] const sharing::SharedBody& shared() const noexcept { return shared_; }
  /// As the last haptic cycle of a controller left it; none before it has the object.
  [[nodiscard]] const hrtc_service::BodyReport* body(std::size_t controller) const;
  [[nodiscard]] session::Holder::Role role(std::size_t controller) const;
  [[nodiscard]] double figure(std::size_t controller, const std::string& name) const;
  [[nodiscard]] const haptics::PassivityController::Ledger& port(std::size_t user) const;
  [[nodiscard]] const hrtc_service::ProbeOutput& probe(std::size_t user) const;
  /// Of a user with a script.
  [[nodiscard]] const client_sim::Operator& op(std::size_t user) const { return *users_[user].mind; }
  /// All scripts have ended.
  [[nodiscard]] bool done() const;
  /// Of a host that runs.
  [[nodiscard]] const host_service::ObjectAuthority& object_authority() const { return *object_authority_; }
  /// The newest pose that a viewer has accepted.
  [[nodiscard]] const session::ObjectPose& seen() const noexcept { return seen_; }

 private:
  struct Controller;
  struct User {
    std::size_t controller = 0;
    std::uint32_t probe = 0;
    std::uint64_t id = 0;
    std::unique_ptr<haptics::SimulatedDevice> device;  // once it is known where it begins
    std::unique_ptr<client_sim::Operator> mind;        // null: a hand alone
    haptics::HandSettings hand;
  };
  using Arrive = std::function<void()>;

  std::size_t join(std::size_t controller, User user);
  void connect(std::size_t place);
  void send(std::size_t from, std::size_t to, std::size_t bytes, Arrive arrive);
  void to_host(std::size_t from, std::size_t bytes, Arrive arrive);
  void to_controller(std::size_t from, std::size_t i, std::size_t bytes, std::function<void(Controller&)> arrive);
  void publish(std::size_t from, const session::ObjectPose& pose);
  void see(const session::ObjectPose& pose);

  void haptic_cycle(std::size_t i);
  void send_reports(std::size_t i);
  void serve(std::size_t i);
  void act(User& user);
  void host_tick();

  const Subject& subject_;
  SharedSessionSettings settings_;
  session::CatalogueEntry entry_;
  sharing::SharedBody shared_;
  std::unique_ptr<host_service::ObjectAuthority> object_authority_;
  std::unique_ptr<session::DeliveryServer> server_;
  std::uint64_t host_life_ = 0;
  std::vector<std::unique_ptr<Controller>> controllers_;
  std::vector<User> users_;
  std::vector<std::vector<Way<Arrive>>> ways_;  // from, to: the host, a viewer, then the controllers
  client_sim::Objects view_;                    // the viewer's
  session::PoseGate gate_;
  session::ObjectPose seen_;
  std::int64_t now_ns_ = 10'000 * kMs;
};

}  // namespace tactus::study
