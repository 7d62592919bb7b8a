/* A member of a secured session on another implementation of DDS, with security plugins of its own. It sends stops in
 * its own name, and others in the name of another member.
 *
 *     cyclone-liar SESSION DOMAIN KEYS IDENTITY NAME VICTIM
 *
 * KEYS is the folder of the member, IDENTITY the text that it announces, NAME its name in the session, and VICTIM that
 * of the other member. It sends until a signal ends it.
 */
#include "cyclone_program.h"
#include "tactus.h"

static void set_plugin(dds_qos_t* qos, const char* kind, const char* library, const char* functions) {
  char property[64], function[64];
  snprintf(property, sizeof property, "dds.sec.%s.library.path", kind);
  dds_qset_prop(qos, property, library);
  snprintf(property, sizeof property, "dds.sec.%s.library.init", kind);
  snprintf(function, sizeof function, "init_%s", functions);
  dds_qset_prop(qos, property, function);
  snprintf(property, sizeof property, "dds.sec.%s.library.finalize", kind);
  snprintf(function, sizeof function, "finalize_%s", functions);
  dds_qset_prop(qos, property, function);
}

static void set_file(dds_qos_t* qos, const char* property, const char* folder, const char* name) {
  char value[4096];
  snprintf(value, sizeof value, "file:%s/%s", folder, name);
  dds_qset_prop(qos, property, value);
}

static dds_entity_t join(dds_domainid_t domain, const char* keys, const char* identity) {
  /* The messages of the handshake must not be divided: Tactus drops unencrypted fragments. */
  checked("domain", dds_create_domain(domain,
                                      "<General><MaxMessageSize>14000B</MaxMessageSize>"
                                      "<FragmentSize>12000B</FragmentSize></General>"
                                      "<Discovery><LeaseDuration>2s</LeaseDuration></Discovery>"));
  dds_qos_t* qos = dds_create_qos();
  dds_qset_userdata(qos, identity, strlen(identity));
  set_plugin(qos, "auth", CYCLONE_AUTH, "authentication");
  set_plugin(qos, "crypto", CYCLONE_CRYPTO, "crypto");
  set_plugin(qos, "access", CYCLONE_ACCESS, "access_control");
  set_file(qos, "dds.sec.auth.identity_ca", keys, "identity-ca.pem");
  set_file(qos, "dds.sec.auth.identity_certificate", keys, "certificate.pem");
  set_file(qos, "dds.sec.auth.private_key", keys, "private-key.pem");
  set_file(qos, "dds.sec.access.permissions_ca", keys, "permissions-ca.pem");
  set_file(qos, "dds.sec.access.governance", keys, "governance.p7s");
  set_file(qos, "dds.sec.access.permissions", keys, "permissions.p7s");
  const dds_entity_t made = checked("participant", dds_create_participant(domain, qos, NULL));
  dds_delete_qos(qos);
  return made;
}

int main(int argc, char** argv) {
  if (argc != 7) {
    fprintf(stderr, "Usage: cyclone-liar SESSION DOMAIN KEYS IDENTITY NAME VICTIM\n");
    return 2;
  }
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  const dds_entity_t participant = join((dds_domainid_t)atoi(argv[2]), argv[3], argv[4]);
  dds_qos_t* qos = dds_create_qos();
  dds_qset_partition1(qos, argv[1]);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1);
  dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
  const dds_entity_t topic =
      checked("topic", dds_create_topic(participant, &tactus_idl_EmergencyStop_desc, "tactus_stop", NULL, NULL));
  const dds_entity_t publisher = checked("publisher", dds_create_publisher(participant, qos, NULL));
  const dds_entity_t writer = checked("writer", dds_create_writer(publisher, topic, qos, NULL));
  dds_delete_qos(qos);

  tactus_idl_EmergencyStop sample = {.stamp = {id_of(argv[1]), (uint64_t)now_ns(CLOCK_REALTIME), 0}};
  while (!stopped) {
    for (int is_lie = 0; is_lie < 2; ++is_lie) {
      sample.participant = id_of(argv[is_lie ? 6 : 5]);
      sample.stamp.time_ns = now_ns(CLOCK_MONOTONIC);
      ++sample.stop_number;
      strcpy(sample.text, is_lie ? "a lie" : "the truth");
      dds_write(writer, &sample);
    }
    const struct timespec pause = {0, 20000000};
    nanosleep(&pause, NULL);
  }
  dds_delete(DDS_CYCLONEDDS_HANDLE);
  return 0;
}
