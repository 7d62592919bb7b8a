#include "tests/session/simulated_network.hpp"

#include <algorithm>
#include <limits>

namespace tactus::test_support {
namespace {

using namespace session;

/// A reliable carrier detects and repeats a loss within this to twice this time.
constexpr std::int64_t kRepairNs = 25'000'000;

struct Text {
  std::string operator()(const RosterEntry& entry) const {
    return "roster entry " + std::to_string(entry.heartbeat) + " of incarnation " +
           std::to_string(entry.origin.incarnation) + (entry.leaving ? ", leaving" : "");
  }
  std::string operator()(const CatalogueEntry& entry) const {
    return "catalogue entry of object " + std::to_string(entry.object_id);
  }
  std::string operator()(const Demand& demand) const {
    std::string line = "demand " + std::to_string(demand.epoch) + " of object " + std::to_string(demand.object_id) +
                       " to host " + std::to_string(demand.serving_host) + ": has";
    for (const spm::Interval& interval : demand.have) {
      line += ' ' + std::to_string(interval.first);
      if (interval.count > 1) line += '-' + std::to_string(interval.first + interval.count - 1);
    }
    line += demand.need_base ? ", wants the base mesh" : ", wants";
    for (const Wanted& wanted : demand.wanted) line += ' ' + std::to_string(wanted.region);
    line += ", received " + std::to_string(demand.received) + " of " + std::to_string(demand.newest) + ", " +
            std::to_string(demand.gaps.size()) + " gaps";
    return line + ", credit " + std::to_string(demand.credit);
  }
  std::string operator()(const BulkChunk& chunk) const {
    std::string line = "chunk " + std::to_string(chunk.sequence) + " of stream " + std::to_string(chunk.stream) +
                       " under epoch " + std::to_string(chunk.epoch) + ": ";
    if (chunk.kind() == BulkKind::kEcho) return line + "echo";
    for (const BulkPiece& piece : chunk.pieces) {
      if (&piece != chunk.pieces.data()) line += ", ";
      line += piece.region == spm::kNone ? "base mesh" : "region " + std::to_string(piece.region);
      line += " piece " + std::to_string(piece.index + 1) + " of " + std::to_string(piece.count);
    }
    return line;
  }
  std::string operator()(const ClockSample& sample) const {
    return (sample.answer ? "clock answer " : "clock request ") + std::to_string(sample.sequence);
  }
  std::string operator()(const LivenessSample& liveness) const {
    return (liveness.sample.answer ? "liveness answer " : "liveness request ") +
           std::to_string(liveness.sample.sequence);
  }
};

/// Key of the state that a newer sample replaces in its writer's history; 0: no state.
std::uint64_t state_of(const Sample& sample) {
  if (std::holds_alternative<RosterEntry>(sample)) return 1;
  if (const auto* offer = std::get_if<CatalogueEntry>(&sample)) return offer->object_id << 2 | 2;
  if (const auto* demand = std::get_if<Demand>(&sample)) return demand->object_id << 2 | 3;
  return 0;
}

}  // namespace

std::string text(const Sample& sample) { return std::visit(Text{}, sample); }

SimulatedNetwork::SimulatedNetwork(std::uint64_t seed, std::int64_t delay_ns, const NetworkFaults& faults)
    : random_{seed}, delay_ns_{delay_ns}, faults_{faults} {}

bool SimulatedNetwork::chance(double p) { return p > 0 && static_cast<double>(random_() >> 11) * 0x1p-53 < p; }

std::int64_t SimulatedNetwork::below(std::int64_t n) {
  return n <= 0 ? 0 : static_cast<std::int64_t>(random_() % static_cast<std::uint64_t>(n));
}

bool SimulatedNetwork::cut_off(const Direction& direction, std::int64_t at_ns) const {
  const auto cut = cuts_.find(direction);
  return cut != cuts_.end() && at_ns < cut->second;
}

void SimulatedNetwork::harm(const Direction& direction, std::int64_t now_ns) {
  harmed_[std::minmax(direction.first, direction.second)] = now_ns;
}

std::int64_t SimulatedNetwork::last_harm_ns(std::uint64_t a, std::uint64_t b) const {
  const auto at = harmed_.find(std::minmax(a, b));
  return at == harmed_.end() ? std::numeric_limits<std::int64_t>::min() : at->second;
}

void SimulatedNetwork::arrive(std::int64_t at_ns, const Direction& direction, std::shared_ptr<const Sample> sample,
                              std::uint64_t state) {
  in_flight_.push({at_ns, ++order_, direction.first, direction.second, std::move(sample), state});
}

void SimulatedNetwork::send(std::int64_t now_ns, std::uint64_t from, std::uint64_t to,
                            std::shared_ptr<const Sample> sample, Carrier carrier) {
  ++sent_;
  const Direction direction{from, to};
  std::int64_t at_ns = now_ns + delay_ns_;
  const char* fate = "";
  if (carrier == Carrier::kReliable) {
    while (cut_off(direction, at_ns) || chance(faults_.loss)) {
      count(cut_off(direction, at_ns) ? FaultKind::kPartition : FaultKind::kLoss);
      harm(direction, now_ns);
      fate = " [repeated]";
      at_ns = std::max(at_ns, cut_off(direction, at_ns) ? cuts_.at(direction) : 0) + kRepairNs + below(kRepairNs);
      fate = " [repeated]";
    }
    const std::uint64_t state = state_of(*sample);
    if (state != 0) {
      newest_[{direction, state}] = order_ + 1;
    } else {
      std::int64_t& last = last_arrival_[direction];
      at_ns = last = std::max(at_ns, last + 1);
    }
    if (trace) trace(now_ns, std::to_string(from) + " -> " + std::to_string(to) + ' ' + text(*sample) + fate);
    return arrive(at_ns, direction, std::move(sample), *fate == 0 ? 0 : state);
  }
  if (cut_off(direction, now_ns)) {
    count(FaultKind::kPartition);
    harm(direction, now_ns);
    fate = " [cut off]";
  } else if (chance(faults_.loss)) {
    count(FaultKind::kLoss);
    harm(direction, now_ns);
    fate = " [lost]";
  } else {
    const auto* chunk = std::get_if<BulkChunk>(sample.get());
    if (chunk != nullptr && !chunk->pieces.empty() && chance(faults_.corruption)) {
      BulkChunk damaged = *chunk;
      std::vector<std::uint8_t>& payload = damaged.pieces[random_() % damaged.pieces.size()].payload;
      payload[random_() % payload.size()] ^= static_cast<std::uint8_t>(1 + below(255));
      sample = std::make_shared<Sample>(std::move(damaged));
      count(FaultKind::kCorruption);
      harm(direction, now_ns);
      fate = " [corrupted]";
    }
    for (int copies = chance(faults_.duplication) ? 2 : 1; copies > 0; --copies) {
      std::int64_t late_ns = 0;
      if (chance(faults_.reordering)) {
        late_ns = below(faults_.reorder_ns);
        count(FaultKind::kReordering);
        harm(direction, now_ns + late_ns);  // a message that relies on it may overtake it, and is refused
        fate = " [late]";
      }
      if (copies == 2) count(FaultKind::kDuplication);
      arrive(at_ns + late_ns, direction, sample, 0);
    }
  }
  if (trace) trace(now_ns, std::to_string(from) + " -> " + std::to_string(to) + ' ' + text(*sample) + fate);
}

std::int64_t SimulatedNetwork::next_ns() const noexcept {
  return in_flight_.empty() ? std::numeric_limits<std::int64_t>::max() : in_flight_.top().at_ns;
}

std::optional<SimulatedNetwork::Packet> SimulatedNetwork::take() {
  Packet packet = in_flight_.top();
  in_flight_.pop();
  if (packet.state != 0 && newest_.at({{packet.from, packet.to}, packet.state}) != packet.order) return std::nullopt;
  return packet;
}

void SimulatedNetwork::cut(std::uint64_t from, std::uint64_t to, std::int64_t until_ns) {
  std::int64_t& until = cuts_[{from, to}];
  until = std::max(until, until_ns);
}

void SimulatedNetwork::heal() {
  faults_ = NetworkFaults{};
  cuts_.clear();
}

}  // namespace tactus::test_support
