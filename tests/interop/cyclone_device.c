/* A user of another DDS: built from idl/tactus.idl with Cyclone DDS alone, no source of Tactus.
 *
 *     cyclone-device SESSION DOMAIN HRTC OBJECT
 *
 * Joins as client "cyclone" with user "carl", whose device it is: a tip that waits above OBJECT until its HRTC answers
 * its poses and shows the object, comes down on its top at 5 cm/s, stops where a force of 0.5 N pushes it up, and stays
 * until the session ends. Prints what it receives, one line each. Exit status 0 when the session ended after the force was
 * felt, 1 otherwise. docs/reference/topics.md is all that it had to know.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <xxhash.h>

#include "dds/dds.h"
#include "tactus.h"

static const char kName[] = "cyclone", kUser[] = "carl";
static volatile sig_atomic_t stopped = 0;

static void stop(int signal) {
  (void)signal;
  stopped = 1;
}

static uint64_t id_of(const char* name) { return XXH3_64bits(name, strlen(name)); }

static int64_t now_ns(clockid_t clock) {
  struct timespec t;
  clock_gettime(clock, &t);
  return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static dds_entity_t checked(const char* what, dds_entity_t made) {
  if (made >= 0) return made;
  fprintf(stderr, "%s: %s\n", what, dds_strretcode(-made));
  exit(2);
}

/* An end of a topic in a partition. State topics are reliable and kept for who joins later, the others best effort; so
   is a reader of the roster, which would otherwise hold back ten beats behind one that was lost. */
enum End { kReader, kWriter };
static dds_entity_t end_of(enum End kind, dds_entity_t participant, const dds_topic_descriptor_t* type,
                           const char* topic, const char* partition, bool state) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_partition1(qos, partition);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1);
  dds_qset_reliability(qos, state ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, DDS_MSECS(10));
  dds_qset_durability(qos, state ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  const dds_entity_t on = checked(topic, dds_create_topic(participant, type, topic, NULL, NULL));
  dds_entity_t group, end;
  if (kind == kReader) {
    group = checked(topic, dds_create_subscriber(participant, qos, NULL));
    end = dds_create_reader(group, on, qos, NULL);
  } else {
    group = checked(topic, dds_create_publisher(participant, qos, NULL));
    end = dds_create_writer(group, on, qos, NULL);
  }
  dds_delete_qos(qos);
  return checked(topic, end);
}

/* The next sample with data, or false. */
static bool take(dds_entity_t reader, void* sample) {
  dds_sample_info_t info;
  while (dds_take(reader, &sample, &info, 1, 1) == 1)
    if (info.valid_data) return true;
  return false;
}

/* Whether an id is met for the first time, of the first few. */
static bool is_new(uint64_t id) {
  static uint64_t known[16];
  for (int i = 0; i < 16; ++i) {
    if (known[i] == id) return false;
    if (known[i] == 0) return known[i] = id, true;
  }
  return false;
}

static tactus_idl_OriginStamp stamp(uint64_t session, int64_t incarnation) {
  const tactus_idl_OriginStamp made = {session, (uint64_t)incarnation, now_ns(CLOCK_MONOTONIC)};
  return made;
}

int main(int argc, char** argv) {
  if (argc != 5) {
    fprintf(stderr, "Usage: cyclone-device SESSION DOMAIN HRTC OBJECT\n");
    return 2;
  }
  const char *session = argv[1], *hrtc = argv[3], *object = argv[4];
  const dds_domainid_t domain = (dds_domainid_t)atoi(argv[2]);
  const uint64_t session_id = id_of(session), self = id_of(kName), user = id_of(kUser), hrtc_id = id_of(hrtc);
  const int64_t incarnation = now_ns(CLOCK_REALTIME);
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  setvbuf(stdout, NULL, _IOLBF, 0);

  char own_part[160];
  snprintf(own_part, sizeof own_part, "%s/u/%s", session, kUser);
  const dds_entity_t slow = checked("session domain", dds_create_participant(domain, NULL, NULL));
  const dds_entity_t fast = checked("probe domain", dds_create_participant(domain + 1, NULL, NULL));
  const dds_entity_t roster_in = end_of(kReader, slow, &tactus_idl_RosterEntry_desc, "tactus_roster", session, false);
  const dds_entity_t roster_out = end_of(kWriter, slow, &tactus_idl_RosterEntry_desc, "tactus_roster", session, true);
  const dds_entity_t catalogue_in =
      end_of(kReader, slow, &tactus_idl_CatalogueEntry_desc, "tactus_catalogue", session, true);
  const dds_entity_t end_in = end_of(kReader, slow, &tactus_idl_SessionEnd_desc, "tactus_end", session, true);
  const dds_entity_t metrics_in = end_of(kReader, slow, &tactus_idl_Metrics_desc, "tactus_metrics", session, false);
  const dds_entity_t clock_in = end_of(kReader, fast, &tactus_idl_ClockSample_desc, "tactus_clock", session, false);
  const dds_entity_t clock_out = end_of(kWriter, fast, &tactus_idl_ClockSample_desc, "tactus_clock", session, false);
  const dds_entity_t states_in =
      end_of(kReader, fast, &tactus_idl_ProbeState_desc, "tactus_probe_state", session, false);
  const dds_entity_t poses_out =
      end_of(kWriter, fast, &tactus_idl_DevicePose_desc, "tactus_device_pose", own_part, false);
  const dds_entity_t commands_in =
      end_of(kReader, fast, &tactus_idl_DeviceCommand_desc, "tactus_device_command", own_part, false);

  static tactus_idl_RosterEntry other;
  tactus_idl_UserName users[1];
  tactus_idl_RosterEntry presence = {.participant = self,
                                     .protocol = tactus_idl_kProtocolVersion,
                                     .participant_role = tactus_idl_kRoleClient,
                                     .joined_ns = INT64_MAX};
  strcpy(users[0].user, kUser);
  strcpy(presence.name, kName);
  strncpy(presence.session, session, tactus_idl_kMaxName);
  strncpy(presence.requested_hrtc, hrtc, tactus_idl_kMaxName);
  presence.users._length = presence.users._maximum = 1;
  presence.users._buffer = users;

  tactus_idl_ClockSample question = {.participant = self};
  tactus_idl_DevicePose pose = {
      .user_id = user, .participant = self, .radius = 0.003, .device = {.orientation = {0, 0, 0, 1}}};
  bool has_slot = false, has_object = false, has_time = false, shown = false, answered = false;
  bool felt = false, seen = false, ended = false;
  int64_t offset_ns = 0, best_round_ns = INT64_MAX; /* session time less ours */

  for (long tick = 0; !stopped && !ended; ++tick) {
    const int64_t now = now_ns(CLOCK_MONOTONIC);
    if (tick % 50 == 0) { /* presence, every 50 ms */
      presence.stamp = stamp(session_id, incarnation);
      ++presence.heartbeat;
      dds_write(roster_out, &presence);
    }
    while (take(roster_in, &other)) {
      if (other.participant == self || other.protocol != tactus_idl_kProtocolVersion) continue;
      if (is_new(other.participant)) printf("here: %s\n", other.name);
      /* The session's time is that of the host or HRTC which says that it follows itself. */
      if (other.reference == other.participant && question.peer != other.participant) {
        question.peer = other.participant;
        best_round_ns = INT64_MAX;
      }
      for (uint32_t i = 0; i < other.slots._length; ++i) {
        if (other.participant != hrtc_id || has_slot || strcmp(other.slots._buffer[i].user, kUser) != 0) continue;
        pose.probe = other.slots._buffer[i].slot_number;
        has_slot = true;
        printf("slot: %u of %s\n", pose.probe, other.name);
      }
    }
    static tactus_idl_CatalogueEntry entry; /* zero at first: a sequence without memory of its own */
    while (take(catalogue_in, &entry)) {
      if (has_object || strcmp(entry.object_name, object) != 0) continue;
      const tactus_idl_ModelSummaryValue* model = &entry.summary;
      for (int axis = 0; axis < 3; ++axis) {
        const double from = model->bounds_min[axis], to = model->bounds_max[axis];
        pose.device.position[axis] = entry.placement.position[axis] + entry.scale * (axis == 2 ? to : (from + to) / 2);
      }
      pose.device.position[2] += 0.02; /* above the top; objects of this test are not turned */
      has_object = true;
      printf("object: %s of %s, %u faces\n", entry.object_name, entry.host, model->faces);
    }
    if (question.peer != 0 && tick % 20 == 0) { /* the session's time, from the exchange with the shortest way */
      question.stamp = stamp(session_id, incarnation);
      ++question.sequence_number;
      question.t0_ns = now;
      dds_write(clock_out, &question);
    }
    tactus_idl_ClockSample answer;
    while (take(clock_in, &answer)) {
      if (!answer.answer || answer.peer != self || answer.participant != question.peer) continue;
      const int64_t arrived = now_ns(CLOCK_MONOTONIC),
                    round_ns = arrived - answer.t0_ns - (answer.t2_ns - answer.t1_ns);
      if (round_ns > best_round_ns) continue;
      best_round_ns = round_ns;
      offset_ns = (answer.t1_ns - answer.t0_ns + answer.t2_ns - arrived) / 2;
      if (!has_time) printf("time: known, on a way of %lld us\n", (long long)round_ns / 2000);
      has_time = true;
    }
    static tactus_idl_Metrics metrics;
    while (!shown && take(metrics_in, &metrics)) {
      if (metrics.participant != hrtc_id) continue;
      for (uint32_t i = 0; i < metrics.meshes._length; ++i)
        shown |= metrics.meshes._buffer[i].object_id == id_of(object);
      if (shown) printf("shown: %s by %s\n", object, hrtc);
    }
    tactus_idl_DeviceCommand command;
    double up = 0;
    while (take(commands_in, &command)) {
      if (command.participant != hrtc_id) continue;
      pose.command_felt = command.sequence_number;
      answered = true;
      up = command.force[2];
      if (!felt && up > 0.5) printf("felt: %.2f N upwards, answering pose %u\n", up, command.pose_answered);
      felt |= up > 0.5;
    }
    tactus_idl_ProbeState state;
    while (take(states_in, &state)) {
      if (seen || state.user_id != user || state.force[2] <= 0.5) continue;
      seen = true;
      printf("seen: probe %u at z = %.4f with %.2f N\n", state.probe, state.proxy[2], state.force[2]);
    }
    if (has_slot && has_object && has_time) {
      pose.stamp = stamp(session_id, incarnation);
      ++pose.sequence_number;
      pose.session_time_ns = now + offset_ns;
      pose.velocity[2] = felt || !answered || !shown ? 0 : -0.05;
      pose.device.position[2] += pose.velocity[2] * 0.001;
      dds_write(poses_out, &pose);
    }
    tactus_idl_SessionEnd end;
    while (take(end_in, &end)) ended = true;
    const struct timespec until = {(now + 1000000) / 1000000000, (now + 1000000) % 1000000000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
  }
  presence.stamp = stamp(session_id, incarnation);
  ++presence.heartbeat;
  presence.leaving = true;
  dds_write(roster_out, &presence);
  dds_delete(DDS_CYCLONEDDS_HANDLE);
  return ended && felt && seen ? 0 : 1;
}
