/* A client with a device, on another implementation of DDS. It is built from idl/tactus.idl with Cyclone DDS and uses
 * no source of Tactus; docs/how-to/own-client.md and docs/reference/topics.md state the rules that it follows.
 *
 *     cyclone-device SESSION DOMAIN HRTC OBJECT
 *
 * Joins as client "cyclone" and simulates the device of user "carl". The tip waits above OBJECT until the HRTC answers
 * the poses and shows the object. Then the tip moves down at 5 cm/s, stops when a force of more than 0.5 N pushes it
 * up, and stays until the session ends. Prints a line at the first receipt of each kind of sample. The exit status is 0
 * if the session ended after a command and a probe state with this force had arrived, 2 for wrong arguments or an error
 * of DDS, otherwise 1.
 */
#include "cyclone_program.h"
#include "tactus.h"

static const char kName[] = "cyclone", kUser[] = "carl";

/* A reader or writer of a topic in a partition. A state topic is reliable and transient local, another topic best
   effort and volatile. A reader of the roster is best effort too: a reliable one would delay all heartbeats after a
   lost one. */
enum EndpointKind { kReader, kWriter };
static dds_entity_t endpoint(enum EndpointKind kind, dds_entity_t participant, const dds_topic_descriptor_t* type,
                             const char* name, const char* partition, bool is_state) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_partition1(qos, partition);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1);
  dds_qset_reliability(qos, is_state ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, DDS_MSECS(10));
  dds_qset_durability(qos, is_state ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  const dds_entity_t topic = checked(name, dds_create_topic(participant, type, name, NULL, NULL));
  dds_entity_t made;
  if (kind == kReader)
    made = dds_create_reader(checked(name, dds_create_subscriber(participant, qos, NULL)), topic, qos, NULL);
  else
    made = dds_create_writer(checked(name, dds_create_publisher(participant, qos, NULL)), topic, qos, NULL);
  dds_delete_qos(qos);
  return checked(name, made);
}

/* Takes the next sample with data. False if there is none. */
static bool take(dds_entity_t reader, void* sample) {
  dds_sample_info_t info;
  while (dds_take(reader, &sample, &info, 1, 1) == 1)
    if (info.valid_data) return true;
  return false;
}

/* True at the first call with this id, for at most 16 ids. */
static bool is_new(uint64_t id) {
  static uint64_t known[16];
  for (int i = 0; i < 16; ++i) {
    if (known[i] == id) return false;
    if (known[i] == 0) return known[i] = id, true;
  }
  return false;
}

struct Client {
  const char *session, *hrtc, *object;
  uint64_t session_id, self, user, hrtc_id;
  int64_t incarnation;
  dds_entity_t roster_in, roster_out, catalogue_in, end_in, metrics_in; /* domain of the session topics */
  dds_entity_t clock_in, clock_out, states_in, poses_out, commands_in;  /* domain of the probe topics */
  tactus_idl_UserName users[1];
  tactus_idl_RosterEntry presence;
  tactus_idl_ClockSample request; /* its peer is the time reference of the session */
  tactus_idl_DevicePose pose;
  int64_t offset_ns, best_round_trip_ns; /* offset: session time minus the monotonic clock */
  bool has_probe, has_object, has_time, shown, answered, felt, seen;
};

static void create_endpoints(struct Client* client, dds_domainid_t domain) {
  const char* session = client->session;
  char own_partition[160];
  snprintf(own_partition, sizeof own_partition, "%s/u/%s", session, kUser);
  const dds_entity_t on_session = checked("session domain", dds_create_participant(domain, NULL, NULL));
  const dds_entity_t on_probe = checked("probe domain", dds_create_participant(domain + 1, NULL, NULL));
  client->roster_in = endpoint(kReader, on_session, &tactus_idl_RosterEntry_desc, "tactus_roster", session, false);
  client->roster_out = endpoint(kWriter, on_session, &tactus_idl_RosterEntry_desc, "tactus_roster", session, true);
  client->catalogue_in =
      endpoint(kReader, on_session, &tactus_idl_CatalogueEntry_desc, "tactus_catalogue", session, true);
  client->end_in = endpoint(kReader, on_session, &tactus_idl_SessionEnd_desc, "tactus_end", session, true);
  client->metrics_in = endpoint(kReader, on_session, &tactus_idl_Metrics_desc, "tactus_metrics", session, false);
  client->clock_in = endpoint(kReader, on_probe, &tactus_idl_ClockSample_desc, "tactus_clock", session, false);
  client->clock_out = endpoint(kWriter, on_probe, &tactus_idl_ClockSample_desc, "tactus_clock", session, false);
  client->states_in = endpoint(kReader, on_probe, &tactus_idl_ProbeState_desc, "tactus_probe_state", session, false);
  client->poses_out =
      endpoint(kWriter, on_probe, &tactus_idl_DevicePose_desc, "tactus_device_pose", own_partition, false);
  client->commands_in =
      endpoint(kReader, on_probe, &tactus_idl_DeviceCommand_desc, "tactus_device_command", own_partition, false);
}

static void fill_samples(struct Client* client) {
  client->presence = (tactus_idl_RosterEntry){.participant = client->self,
                                              .protocol = tactus_idl_kProtocolVersion,
                                              .participant_role = tactus_idl_kRoleClient,
                                              .joined_ns = INT64_MAX};
  strcpy(client->users[0].user, kUser);
  strcpy(client->presence.name, kName);
  strncpy(client->presence.session, client->session, tactus_idl_kMaxName);
  strncpy(client->presence.requested_hrtc, client->hrtc, tactus_idl_kMaxName);
  client->presence.users._length = client->presence.users._maximum = 1;
  client->presence.users._buffer = client->users;
  client->request = (tactus_idl_ClockSample){.participant = client->self};
  client->pose = (tactus_idl_DevicePose){
      .user_id = client->user, .participant = client->self, .radius = 0.003, .device = {.orientation = {0, 0, 0, 1}}};
}

static tactus_idl_OriginStamp stamp(const struct Client* client) {
  const tactus_idl_OriginStamp made = {client->session_id, (uint64_t)client->incarnation, now_ns(CLOCK_MONOTONIC)};
  return made;
}

static void send_presence(struct Client* client) {
  client->presence.stamp = stamp(client);
  ++client->presence.heartbeat;
  dds_write(client->roster_out, &client->presence);
}

static void take_roster(struct Client* client) {
  static tactus_idl_RosterEntry entry; /* static, thus zero: Cyclone DDS allocates the memory of its sequences */
  while (take(client->roster_in, &entry)) {
    if (entry.participant == client->self || entry.protocol != tactus_idl_kProtocolVersion) continue;
    if (is_new(entry.participant)) printf("participant: %s\n", entry.name);
    /* The time reference is the host or HRTC that names itself as its reference. */
    if (entry.reference == entry.participant && client->request.peer != entry.participant) {
      client->request.peer = entry.participant;
      client->best_round_trip_ns = INT64_MAX;
    }
    for (uint32_t i = 0; i < entry.served_users._length; ++i) {
      if (entry.participant != client->hrtc_id || client->has_probe ||
          strcmp(entry.served_users._buffer[i].user, kUser) != 0)
        continue;
      client->pose.probe = entry.served_users._buffer[i].probe_number;
      client->has_probe = true;
      printf("probe: %u of %s\n", client->pose.probe, entry.name);
    }
  }
}

/* Puts the tip above the middle of the object. The objects of this test are not rotated. */
static void take_catalogue(struct Client* client) {
  static tactus_idl_CatalogueEntry entry;
  while (take(client->catalogue_in, &entry)) {
    if (client->has_object || strcmp(entry.object_name, client->object) != 0) continue;
    const tactus_idl_ModelSummaryValue* model = &entry.summary;
    double* position = client->pose.device.position;
    for (int axis = 0; axis < 3; ++axis) {
      const double min = model->bounds_min[axis], max = model->bounds_max[axis];
      position[axis] = entry.placement.position[axis] + entry.scale * (axis == 2 ? max : (min + max) / 2);
    }
    position[2] += 0.02;
    client->has_object = true;
    printf("object: %s of %s, %u faces\n", entry.object_name, entry.host, model->faces);
  }
}

static void send_clock_request(struct Client* client, int64_t now) {
  client->request.stamp = stamp(client);
  ++client->request.sequence_number;
  client->request.t0_ns = now;
  dds_write(client->clock_out, &client->request);
}

/* Uses the answer with the shortest round trip, because its offset has the smallest error. */
static void take_clock_answers(struct Client* client) {
  tactus_idl_ClockSample answer;
  while (take(client->clock_in, &answer)) {
    if (!answer.answer || answer.peer != client->self || answer.participant != client->request.peer) continue;
    const int64_t arrived = now_ns(CLOCK_MONOTONIC);
    const int64_t round_trip_ns = arrived - answer.t0_ns - (answer.t2_ns - answer.t1_ns);
    if (round_trip_ns > client->best_round_trip_ns) continue;
    client->best_round_trip_ns = round_trip_ns;
    client->offset_ns = (answer.t1_ns - answer.t0_ns + answer.t2_ns - arrived) / 2;
    if (!client->has_time) printf("clock: synchronised, half round trip %lld us\n", (long long)round_trip_ns / 2000);
    client->has_time = true;
  }
}

static void take_metrics(struct Client* client) {
  static tactus_idl_Metrics metrics;
  while (!client->shown && take(client->metrics_in, &metrics)) {
    if (metrics.participant != client->hrtc_id) continue;
    for (uint32_t i = 0; i < metrics.meshes._length; ++i)
      client->shown |= metrics.meshes._buffer[i].object_id == id_of(client->object);
    if (client->shown) printf("shown: %s by %s\n", client->object, client->hrtc);
  }
}

static void take_commands(struct Client* client) {
  tactus_idl_DeviceCommand command;
  while (take(client->commands_in, &command)) {
    if (command.participant != client->hrtc_id) continue;
    client->pose.command_applied = command.sequence_number;
    client->answered = true;
    const double force_up = command.force[2];
    if (!client->felt && force_up > 0.5)
      printf("received force: %.2f N upwards, answering pose %u\n", force_up, command.pose_answered);
    client->felt |= force_up > 0.5;
  }
}

static void take_states(struct Client* client) {
  tactus_idl_ProbeState state;
  while (take(client->states_in, &state)) {
    if (client->seen || state.user_id != client->user || state.force[2] <= 0.5) continue;
    client->seen = true;
    printf("probe state: probe %u at z = %.4f with %.2f N\n", state.probe, state.proxy[2], state.force[2]);
  }
}

/* Moves the tip by one step of 1 ms and sends its pose. */
static void send_pose(struct Client* client, int64_t now) {
  client->pose.stamp = stamp(client);
  ++client->pose.sequence_number;
  client->pose.session_time_ns = now + client->offset_ns;
  client->pose.velocity[2] = client->felt || !client->answered || !client->shown ? 0 : -0.05;
  client->pose.device.position[2] += client->pose.velocity[2] * 0.001;
  dds_write(client->poses_out, &client->pose);
}

int main(int argc, char** argv) {
  if (argc != 5) {
    fprintf(stderr, "Usage: cyclone-device SESSION DOMAIN HRTC OBJECT\n");
    return 2;
  }
  struct Client made = {.session = argv[1],
                        .hrtc = argv[3],
                        .object = argv[4],
                        .session_id = id_of(argv[1]),
                        .hrtc_id = id_of(argv[3]),
                        .self = id_of(kName),
                        .user = id_of(kUser),
                        .incarnation = now_ns(CLOCK_REALTIME),
                        .best_round_trip_ns = INT64_MAX};
  struct Client* client = &made;
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  setvbuf(stdout, NULL, _IOLBF, 0);
  create_endpoints(client, (dds_domainid_t)atoi(argv[2]));
  fill_samples(client);

  bool ended = false;
  for (long tick = 0; !stopped && !ended; ++tick) { /* one tick is 1 ms */
    const int64_t now = now_ns(CLOCK_MONOTONIC);
    if (tick % 50 == 0) send_presence(client);
    take_roster(client);
    take_catalogue(client);
    if (client->request.peer != 0 && tick % 20 == 0) send_clock_request(client, now);
    take_clock_answers(client);
    take_metrics(client);
    take_commands(client);
    take_states(client);
    if (client->has_probe && client->has_object && client->has_time) send_pose(client, now);
    tactus_idl_SessionEnd end;
    while (take(client->end_in, &end)) ended = true;
    const struct timespec next = {(now + 1000000) / 1000000000, (now + 1000000) % 1000000000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
  }
  client->presence.leaving = true;
  send_presence(client);
  dds_delete(DDS_CYCLONEDDS_HANDLE);
  return ended && client->felt && client->seen ? 0 : 1;
}
