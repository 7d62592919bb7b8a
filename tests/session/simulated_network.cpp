#include "tests/session/simulated_network.hpp"

#include <algorithm>
#include <limits>

namespace tactus::test_support {
namespace {

using namespace session;

/// A reliable writer retransmits a lost sample after kRetransmitNs to 2 * kRetransmitNs.
constexpr std::int64_t kRetransmitNs = 25'000'000;

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
                       " to host " + std::to_string(demand.serving_host) + ": holds";
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

/// Key of the state that a newer sample replaces in its writer's history; 0: the sample is not a state.
std::uint64_t state_key_of(const Sample& sample) {
  if (std::holds_alternative<RosterEntry>(sample)) return 1;
  if (const auto* offer = std::get_if<CatalogueEntry>(&sample)) return offer->object_id << 2 | 2;
  if (const auto* demand = std::get_if<Demand>(&sample)) return demand->object_id << 2 | 3;
  return 0;
}

}  // namespace

std::string text(const Sample& sample) { return std::visit(Text{}, sample); }

SimulatedNetwork::SimulatedNetwork(std::uint64_t seed, std::int64_t delay_ns, const NetworkFaults& faults)
    : random_{seed}, delay_ns_{delay_ns}, faults_{faults} {}

bool SimulatedNetwork::chance(double probability) {
  return probability > 0 && static_cast<double>(random_() >> 11) * 0x1p-53 < probability;
}

std::int64_t SimulatedNetwork::random_below(std::int64_t bound) {
  return bound <= 0 ? 0 : static_cast<std::int64_t>(random_() % static_cast<std::uint64_t>(bound));
}

bool SimulatedNetwork::is_cut(const Direction& direction, std::int64_t at_ns) const {
  const auto cut = cuts_.find(direction);
  return cut != cuts_.end() && at_ns < cut->second;
}

void SimulatedNetwork::record_fault(FaultKind kind, const Direction& direction, std::int64_t at_ns) {
  ++fault_counts_[static_cast<std::size_t>(kind)];
  last_fault_ns_[std::minmax(direction.first, direction.second)] = at_ns;
}

std::int64_t SimulatedNetwork::last_fault_ns(std::uint64_t a, std::uint64_t b) const {
  const auto fault = last_fault_ns_.find(std::minmax(a, b));
  return fault == last_fault_ns_.end() ? std::numeric_limits<std::int64_t>::min() : fault->second;
}

void SimulatedNetwork::enqueue(std::int64_t arrival_ns, const Direction& direction,
                               std::shared_ptr<const Sample> sample, std::uint64_t state_key) {
  in_flight_.push({arrival_ns, ++order_, direction.first, direction.second, std::move(sample), state_key});
}

void SimulatedNetwork::send(std::int64_t now_ns, std::uint64_t from, std::uint64_t to,
                            std::shared_ptr<const Sample> sample, Reliability reliability) {
  ++sent_;
  const char* const fate = reliability == Reliability::kReliable ? send_reliably(now_ns, {from, to}, sample)
                                                                 : send_best_effort(now_ns, {from, to}, sample);
  if (trace) trace(now_ns, std::to_string(from) + " -> " + std::to_string(to) + ' ' + text(*sample) + fate);
}

const char* SimulatedNetwork::send_reliably(std::int64_t now_ns, const Direction& direction,
                                            std::shared_ptr<const Sample> sample) {
  std::int64_t arrival_ns = now_ns + delay_ns_;
  bool retransmitted = false;
  while (is_cut(direction, arrival_ns) || chance(faults_.loss)) {
    const bool cut = is_cut(direction, arrival_ns);
    record_fault(cut ? FaultKind::kPartition : FaultKind::kLoss, direction, now_ns);
    arrival_ns = std::max(arrival_ns, cut ? cuts_.at(direction) : 0) + kRetransmitNs + random_below(kRetransmitNs);
    retransmitted = true;
  }
  const std::uint64_t state_key = state_key_of(*sample);
  if (state_key != 0) {
    newest_order_[{direction, state_key}] = order_ + 1;
  } else {
    std::int64_t& last_ns = last_reliable_ns_[direction];
    arrival_ns = last_ns = std::max(arrival_ns, last_ns + 1);
  }
  enqueue(arrival_ns, direction, std::move(sample), retransmitted ? state_key : 0);
  return retransmitted ? " [retransmitted]" : "";
}

const char* SimulatedNetwork::send_best_effort(std::int64_t now_ns, const Direction& direction,
                                               std::shared_ptr<const Sample> sample) {
  if (is_cut(direction, now_ns)) {
    record_fault(FaultKind::kPartition, direction, now_ns);
    return " [cut off]";
  }
  if (chance(faults_.loss)) {
    record_fault(FaultKind::kLoss, direction, now_ns);
    return " [lost]";
  }
  const char* fate = "";
  const auto* chunk = std::get_if<BulkChunk>(sample.get());
  if (chunk != nullptr && !chunk->pieces.empty() && chance(faults_.corruption)) {
    sample = corrupted(*chunk);
    record_fault(FaultKind::kCorruption, direction, now_ns);
    fate = " [corrupted]";
  }
  const bool duplicated = chance(faults_.duplication);
  if (duplicated) ++fault_counts_[static_cast<std::size_t>(FaultKind::kDuplication)];
  for (int copies = duplicated ? 2 : 1; copies > 0; --copies) {
    std::int64_t arrival_ns = now_ns + delay_ns_;
    if (chance(faults_.reordering)) {
      const std::int64_t extra_ns = random_below(faults_.reorder_ns);
      arrival_ns += extra_ns;
      // Until this time, messages that rely on the sample may overtake it and be refused.
      record_fault(FaultKind::kReordering, direction, now_ns + extra_ns);
      fate = " [delayed]";
    }
    enqueue(arrival_ns, direction, sample, 0);
  }
  return fate;
}

std::shared_ptr<const Sample> SimulatedNetwork::corrupted(const BulkChunk& chunk) {
  BulkChunk copy = chunk;
  std::vector<std::uint8_t>& payload = copy.pieces[random_() % copy.pieces.size()].payload;
  payload[random_() % payload.size()] ^= static_cast<std::uint8_t>(1 + random_below(255));
  return std::make_shared<Sample>(std::move(copy));
}

std::int64_t SimulatedNetwork::next_ns() const noexcept {
  return in_flight_.empty() ? std::numeric_limits<std::int64_t>::max() : in_flight_.top().arrival_ns;
}

std::optional<SimulatedNetwork::Packet> SimulatedNetwork::take() {
  Packet packet = in_flight_.top();
  in_flight_.pop();
  if (packet.state_key != 0 && newest_order_.at({{packet.from, packet.to}, packet.state_key}) != packet.order)
    return std::nullopt;
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
