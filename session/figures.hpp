/// Names of the figures on the metrics topic: what writes them and what reports them agree here.
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
inline constexpr char kHostControllers[] = "host.controllers";
inline constexpr char kHostImplausible[] =
    "host.implausible";                                      ///< samples dropped: a number or a time outside its window
inline constexpr char kHostBodySteps[] = "host.body_steps";  ///< of 1 ms, of objects that moved by themselves

// An HRTC: cycles.
inline constexpr char kCycles[] = "hrtc.cycles";
inline constexpr char kRate[] = "hrtc.rate_hz";  ///< achieved, since the start
// Late cycles by cause (hrtc_service/late_cycles.hpp).
inline constexpr char kOverruns[] = "hrtc.overruns";
inline constexpr char kPreempted[] = "hrtc.preempted";
inline constexpr char kLateUnknown[] = "hrtc.late_unknown";
inline constexpr char kSkipped[] = "hrtc.skipped";
inline constexpr char kWakeP50[] = "hrtc.wake_us.p50";
inline constexpr char kWakeP99[] = "hrtc.wake_us.p99";
inline constexpr char kWakeMax[] = "hrtc.wake_us.max";
inline constexpr char kTimerP50[] = "hrtc.timer_us.p50";  ///< a bare timer of the same priority, beside it
inline constexpr char kTimerP99[] = "hrtc.timer_us.p99";
inline constexpr char kTimerMax[] = "hrtc.timer_us.max";
inline constexpr char kTimerOverruns[] = "hrtc.timer_overruns";  ///< of that timer, with 30 us of work in a cycle
/// Followed by .p50, .p99, .p999 or .max.
inline constexpr char kLoadTime[] = "hrtc.t_l_us";
inline constexpr char kRefineTime[] = "hrtc.t_r_us";
inline constexpr char kRefitTime[] = "hrtc.t_b_us";
inline constexpr char kQueryTime[] = "hrtc.t_q_us";
inline constexpr char kForceTime[] = "hrtc.t_f_us";
inline constexpr char kCycleTime[] = "hrtc.cycle_us";

// An HRTC: contacts, summed over its probes and cycles.
inline constexpr char kContactCycles[] = "hrtc.contact_cycles";
inline constexpr char kExactCycles[] = "hrtc.exact_cycles";

// An HRTC: what it holds.
inline constexpr char kPoolUsed[] = "hrtc.pool_used";
inline constexpr char kPoolPeak[] = "hrtc.pool_peak";
inline constexpr char kPoolLimit[] = "hrtc.pool_limit";
inline constexpr char kCompressedUsed[] = "hrtc.coded_used";
inline constexpr char kCompressedPeak[] = "hrtc.coded_peak";
inline constexpr char kCompressedLimit[] = "hrtc.coded_limit";
inline constexpr char kRegionsHeld[] = "hrtc.regions_held";
inline constexpr char kRegionsCoarsened[] = "hrtc.regions_coarsened";
inline constexpr char kRegionsReceived[] = "hrtc.regions_received";
inline constexpr char kEvictions[] = "hrtc.evictions";
inline constexpr char kReloads[] = "hrtc.reloads";
inline constexpr char kRefusedFull[] = "hrtc.refused_full";
inline constexpr char kObjectsRefused[] = "hrtc.objects_refused";
inline constexpr char kRecordsReceived[] = "hrtc.records_received";
inline constexpr char kRecordsReturned[] = "hrtc.records_returned";
inline constexpr char kRecordsRepeated[] = "hrtc.records_repeated";  ///< received although they were here
inline constexpr char kRecordsPublished[] = "hrtc.records_told";     ///< of these, in regions that hosts are told of
inline constexpr char kBytesReceived[] = "hrtc.bytes_received";
inline constexpr char kLoadLatency[] = "hrtc.load_latency_us";
inline constexpr char kFalseAlarms[] = "hrtc.false_alarms";  ///< hosts that were given up and answered after all
inline constexpr char kHostChanges[] = "hrtc.host_changes";
// From the first catalogue entry to the first base mesh held, and to the first exact contact; payload until then.
inline constexpr char kFirstBase[] = "hrtc.first_base_us";
inline constexpr char kFirstExact[] = "hrtc.first_exact_us";
inline constexpr char kFirstExactBytes[] = "hrtc.first_exact_bytes";

// An HRTC: probe states, its own and those of others.
inline constexpr char kStatesDeadbandCoded[] = "hrtc.states_coded";  ///< sent to the session
inline constexpr char kStatesWhole[] = "hrtc.states_whole";          ///< sent to a group
inline constexpr char kTogether[] = "hrtc.together";                 ///< of its users, that collaborate now
inline constexpr char kRemoteProbes[] = "hrtc.remote_probes";
/// Samples of any topic that were dropped because a number or a time was outside its window.
inline constexpr char kImplausible[] = "hrtc.implausible";
inline constexpr char kPlayout[] = "hrtc.playout_us";  ///< the greatest delay at which it shows one of them
/// Followed by a controller's id, 16 hexadecimal digits: the share of its coded states that did not come.
inline constexpr char kLostOf[] = "lost.";

// An HRTC: devices of its users that are not at its machine.
inline constexpr char kRemoteDevices[] = "hrtc.remote_devices";
inline constexpr char kLoopDelay[] = "hrtc.loop_us";  ///< the greatest of theirs now, as stiffness is cut to
/// Cycles that wanted more regions of an object refined than they may (option --targets of an HRTC).
inline constexpr char kTargetsDropped[] = "hrtc.targets_dropped";
inline constexpr char kStaleCycles[] = "hrtc.stale_cycles";  ///< summed over all probes: force ramped for an old pose

// An HRTC: objects that its users can move, where there are any; uJ and um. docs/explanation/shared-objects.md.
inline constexpr char kBodiesHeld[] = "hrtc.bodies_held";
inline constexpr char kBodiesCoupled[] = "hrtc.bodies_coupled";   ///< of these, held elsewhere too
inline constexpr char kCopyGroups[] = "hrtc.copy_groups";         ///< that it has been in
inline constexpr char kCopiesApart[] = "hrtc.copies_apart_um";    ///< at most, of its copies' centres and a peer's
inline constexpr char kCopyGiven[] = "hrtc.copy_given_uj";        ///< by couplings to its copies, less what they took
inline constexpr char kCopyReceived[] = "hrtc.copy_received_uj";  ///< by its couplings, from peers and allowance
inline constexpr char kCopyTank[] = "hrtc.copy_tank_uj";
inline constexpr char kGrabs[] = "hrtc.grabs";                    ///< times that a hand has got hold of something
inline constexpr char kGrabsRefused[] = "hrtc.grabs_refused";     ///< and that it could not have what it touched
inline constexpr char kPortEnergy[] = "hrtc.port_energy_uj";      ///< of its users' hands on bodies, summed
inline constexpr char kPortLowest[] = "hrtc.port_lowest_uj";      ///< of any hand, its torque's included
inline constexpr char kPortWithheld[] = "hrtc.port_withheld_uj";  ///< that forces would have drawn and did not

// An HRTC: how often what keeps forces safe has begun to act, over all its probes; in the order of haptics::ForceBit.
inline constexpr const char* kInterventions[] = {"safety.saturated",   "safety.slew_limited",  "safety.soft_starts",
                                                 "safety.stale_poses", "safety.surface_ramps", "safety.stiffness_cuts",
                                                 "safety.faults"};

/// Followed by the topic's name and .rate, .lost_share, .age_us.p50, .age_us.p99 or .age_us.max: as its reader sees it.
inline constexpr char kTopicPrefix[] = "topic.";

}  // namespace tactus::session::figures
