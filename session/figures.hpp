/// Names of the figures on topic metrics, for the programs that publish figures and those that report them.
/// docs/reference/metrics.md describes each figure.
///
/// Counters count since the start of the program. Times are in microseconds, as their names say.
#pragma once

namespace tactus::session::figures {

// A VE host.
inline constexpr char kHostObjects[] = "host.objects";
inline constexpr char kHostChunks[] = "host.chunks";
inline constexpr char kHostBytes[] = "host.bytes";
inline constexpr char kHostRegions[] = "host.regions";
inline constexpr char kHostRecords[] = "host.records";
inline constexpr char kHostHrtcs[] = "host.hrtcs";
inline constexpr char kHostImplausible[] =
    "host.implausible";  ///< samples dropped because number or time was outside its window
inline constexpr char kHostDemandsRefused[] =
    "host.demands_refused";  ///< demands dropped because they list regions that a model does not have
inline constexpr char kHostClaimsRefused[] =
    "host.claims_refused";  ///< claims of further HRTCs beside kMaxTouchers that simulate the object
inline constexpr char kHostBodySteps[] =
    "host.body_steps";  ///< steps of 1 ms, over all objects that the host simulated

// An HRTC: cycles.
inline constexpr char kCycles[] = "hrtc.cycles";
inline constexpr char kRate[] = "hrtc.rate_hz";  ///< mean since the start
// Late cycles by cause (hrtc_service/servo/late_cycles.hpp).
inline constexpr char kOverruns[] = "hrtc.overruns";
inline constexpr char kPreempted[] = "hrtc.preempted";
inline constexpr char kLateUnknown[] = "hrtc.late_unknown";
inline constexpr char kSkipped[] = "hrtc.skipped";
inline constexpr char kWakeP50[] = "hrtc.wake_us.p50";
inline constexpr char kWakeP99[] = "hrtc.wake_us.p99";
inline constexpr char kWakeMax[] = "hrtc.wake_us.max";
inline constexpr char kTimerP50[] =
    "hrtc.timer_us.p50";  ///< wake-up delay of a thread of the same priority that only waits
inline constexpr char kTimerP99[] = "hrtc.timer_us.p99";
inline constexpr char kTimerMax[] = "hrtc.timer_us.max";
inline constexpr char kTimerOverruns[] =
    "hrtc.timer_overruns";  ///< overruns of that timer with 30 us of work per cycle
// Times of a cycle; the name is followed by .p50, .p99, .p999 or .max.
inline constexpr char kLoadTime[] = "hrtc.t_l_us";
inline constexpr char kRefineTime[] = "hrtc.t_r_us";
inline constexpr char kRefitTime[] = "hrtc.t_b_us";
inline constexpr char kQueryTime[] = "hrtc.t_q_us";
inline constexpr char kForceTime[] = "hrtc.t_f_us";
inline constexpr char kCycleTime[] = "hrtc.cycle_us";
inline constexpr char kRecentCycleP99[] =
    "hrtc.recent_cycle_us.p99";  ///< as kCycleTime, of the cycles since the sample before

// An HRTC: contacts, summed over its probes and cycles.
inline constexpr char kContactCycles[] = "hrtc.contact_cycles";
inline constexpr char kExactCycles[] = "hrtc.exact_cycles";

// An HRTC: memory and delivery.
inline constexpr char kPoolUsed[] = "hrtc.pool_used";
inline constexpr char kPoolPeak[] = "hrtc.pool_peak";
inline constexpr char kPoolLimit[] = "hrtc.pool_limit";
inline constexpr char kCompressedUsed[] = "hrtc.compressed_used";
inline constexpr char kCompressedPeak[] = "hrtc.compressed_peak";
inline constexpr char kCompressedLimit[] = "hrtc.compressed_limit";
inline constexpr char kRegionsHeld[] = "hrtc.regions_held";
inline constexpr char kRegionsCoarsened[] = "hrtc.regions_coarsened";
inline constexpr char kRegionsReceived[] = "hrtc.regions_received";
inline constexpr char kEvictions[] = "hrtc.evictions";
inline constexpr char kReloads[] = "hrtc.reloads";
inline constexpr char kRegionsRefused[] = "hrtc.regions_refused";
inline constexpr char kObjectsRefused[] = "hrtc.objects_refused";
inline constexpr char kRecordsReceived[] = "hrtc.records_received";
inline constexpr char kRecordsReceivedAgain[] =
    "hrtc.records_received_again";                                   ///< records received again after an eviction
inline constexpr char kRecordsRepeated[] = "hrtc.records_repeated";  ///< records received although they were held
inline constexpr char kRecordsRepeatedUnretired[] =
    "hrtc.records_repeated_unretired";  ///< of the repeated records, those in the list of a region that is not retired
inline constexpr char kBytesReceived[] = "hrtc.bytes_received";
inline constexpr char kLoadLatency[] = "hrtc.load_latency_us";
inline constexpr char kFalseAlarms[] = "hrtc.false_alarms";  ///< suspected hosts that answered later
inline constexpr char kHostChanges[] = "hrtc.host_changes";
// Time from the first catalogue entry to the first base mesh held, and to the first exact contact. Payload bytes
// received until the first exact contact.
inline constexpr char kFirstBase[] = "hrtc.first_base_us";
inline constexpr char kFirstExact[] = "hrtc.first_exact_us";
inline constexpr char kFirstExactBytes[] = "hrtc.first_exact_bytes";

// An HRTC: probe states, its own and those of others.
inline constexpr char kStatesDeadbandCoded[] = "hrtc.states_deadband_coded";  ///< sent to the session
inline constexpr char kStatesFullRate[] = "hrtc.states_full_rate";            ///< sent to a group
inline constexpr char kCollaborating[] = "hrtc.collaborating";  ///< number of its users that collaborate now
inline constexpr char kRemoteProbes[] = "hrtc.remote_probes";
/// Samples of any topic that were dropped because a number or a time was outside its window.
inline constexpr char kImplausible[] = "hrtc.implausible";
inline constexpr char kPlayout[] = "hrtc.playout_us";  ///< max playout delay of the remote probes
/// Followed by an HRTC's id, 16 hexadecimal digits: the share of its deadband-coded states that were lost.
inline constexpr char kLostOf[] = "lost.";
/// After kLostOf and the id: the share of its full-rate states that were lost or late, if the link is too slow for them.
inline constexpr char kOfFullRate[] = ".full_rate";

// An HRTC: remote devices of its users.
inline constexpr char kRemoteDevices[] = "hrtc.remote_devices";
inline constexpr char kDeviceRoundTrip[] =
    "hrtc.device_round_trip_us";  ///< max round trip to a remote device now, as used for the stiffness cut
/// Cycles in which an object had more regions to refine than option --targets of an HRTC allows.
inline constexpr char kTargetsDropped[] = "hrtc.targets_dropped";
inline constexpr char kStaleCycles[] = "hrtc.stale_cycles";  ///< cycles with a stale pose, summed over all probes

// An HRTC with movable objects; energies in uJ, distances in um (docs/explanation/shared-objects.md).
inline constexpr char kBodiesTouched[] = "hrtc.bodies_touched";
inline constexpr char kBodiesCoupled[] =
    "hrtc.bodies_coupled";                                 ///< of these, bodies that users of other HRTCs touch too
inline constexpr char kCopyGroups[] = "hrtc.copy_groups";  ///< groups in which the HRTC has had a copy
inline constexpr char kCopiesApart[] =
    "hrtc.copies_apart_um";  ///< max distance of the centre of a copy from that of a peer's copy
inline constexpr char kCopyGiven[] = "hrtc.copy_given_uj";        ///< net energy from couplings to its copies
inline constexpr char kCopyReceived[] = "hrtc.copy_received_uj";  ///< energy of its couplings from peers and allowance
inline constexpr char kCopyTank[] = "hrtc.copy_tank_uj";          ///< energy in the tanks of its couplings
inline constexpr char kGrabs[] = "hrtc.grabs";                    ///< times that a hand began to hold an object
inline constexpr char kGrabsRefused[] = "hrtc.grabs_refused";  ///< times that a hand could not hold the touched object
inline constexpr char kPortEnergy[] =
    "hrtc.port_energy_uj";  ///< energy at the ports of its users' hands on bodies, summed
inline constexpr char kPortLowest[] = "hrtc.port_lowest_uj";      ///< lowest energy that any of these ports has had
inline constexpr char kPortWithheld[] = "hrtc.port_withheld_uj";  ///< energy that the passivity controller withheld

// An HRTC: how often each safety limit became active, over all its probes; in the order of haptics::ForceBit.
inline constexpr const char* kInterventions[] = {"safety.saturated",   "safety.slew_limited",  "safety.soft_starts",
                                                 "safety.stale_poses", "safety.surface_ramps", "safety.stiffness_cuts",
                                                 "safety.faults"};

}  // namespace tactus::session::figures
