/* A node of ROS 2 as its middleware would make it, on Cyclone DDS and without ROS. It is built from idl/ros2.idl and
 * uses no source of Tactus.
 *
 *     cyclone-ros2 DOMAIN USER               subscribes to all topics about USER with the default QoS of ROS
 *     cyclone-ros2 DOMAIN USER FRAME X Y Z   also publishes target poses of USER, every 10 ms: first 5 cm above
 *                                            (X, Y, Z), and down to it at 5 cm/s after the first pose of the device
 *
 * Prints each writer of a ROS topic with topic, type, USER_DATA and QoS. Prints samples: every 25th of a topic of the
 * user, and each of the others. Runs until a signal ends it. The exit status is 0, or 2 for wrong arguments or an error
 * of DDS.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "dds/dds.h"
#include "ros2.h"

static volatile sig_atomic_t stopped = 0;

static void stop(int signal) {
  (void)signal;
  stopped = 1;
}

static dds_entity_t checked(const char* what, dds_entity_t made) {
  if (made >= 0) return made;
  fprintf(stderr, "%s: %s\n", what, dds_strretcode(-made));
  exit(2);
}

/* The default QoS of ROS: reliable, volatile, keep last 10. */
static dds_qos_t* ros_qos(void) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(qos, DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  return qos;
}

static dds_entity_t topic_of(dds_entity_t participant, const dds_topic_descriptor_t* type, const char* name) {
  return checked(name, dds_create_topic(participant, type, name, NULL, NULL));
}

static dds_entity_t reader_of(dds_entity_t participant, const dds_topic_descriptor_t* type, const char* name) {
  dds_qos_t* qos = ros_qos();
  const dds_entity_t made = checked(name, dds_create_reader(participant, topic_of(participant, type, name), qos, NULL));
  dds_delete_qos(qos);
  return made;
}

static dds_entity_t writer_of(dds_entity_t participant, const dds_topic_descriptor_t* type, const char* name) {
  dds_qos_t* qos = ros_qos();
  const dds_entity_t made = checked(name, dds_create_writer(participant, topic_of(participant, type, name), qos, NULL));
  dds_delete_qos(qos);
  return made;
}

/* Takes the next sample with data. False if there is none. */
static bool take(dds_entity_t reader, void* sample) {
  dds_sample_info_t info;
  while (dds_take(reader, &sample, &info, 1, 1) == 1)
    if (info.valid_data) return true;
  return false;
}

/* Prints the new writers of topics that begin with rt/. */
static void take_writers(dds_entity_t reader) {
  void* samples[1] = {NULL};
  dds_sample_info_t info;
  while (dds_take(reader, samples, &info, 1, 1) == 1) {
    const dds_builtintopic_endpoint_t* writer = samples[0];
    if (info.valid_data && info.instance_state == DDS_ALIVE_INSTANCE_STATE &&
        strncmp(writer->topic_name, "rt/", 3) == 0) {
      void* data = NULL;
      size_t size = 0;
      dds_reliability_kind_t reliability = DDS_RELIABILITY_BEST_EFFORT;
      dds_durability_kind_t durability = DDS_DURABILITY_PERSISTENT;
      dds_qget_userdata(writer->qos, &data, &size);
      dds_qget_reliability(writer->qos, &reliability, NULL);
      dds_qget_durability(writer->qos, &durability);
      printf("writer: %s %s %.*s %s %s\n", writer->topic_name, writer->type_name, (int)size, data ? (char*)data : "",
             reliability == DDS_RELIABILITY_RELIABLE ? "reliable" : "best-effort",
             durability == DDS_DURABILITY_VOLATILE ? "volatile" : "durable");
      dds_free(data);
    }
    dds_return_loan(reader, samples, 1);
  }
}

static void print_header(const char* topic, const std_msgs_msg_dds__Header_* header) {
  printf("%s: %d.%09u %s", topic, header->stamp.sec, header->stamp.nanosec, header->frame_id);
}

static void print_vector(double x, double y, double z) { printf(" %.6f %.6f %.6f", x, y, z); }

static void print_pose(const char* topic, const geometry_msgs_msg_dds__PoseStamped_* sample) {
  const geometry_msgs_msg_dds__Quaternion_* q = &sample->pose.orientation;
  print_header(topic, &sample->header);
  print_vector(sample->pose.position.x, sample->pose.position.y, sample->pose.position.z);
  printf(" %.6f %.6f %.6f %.6f\n", q->x, q->y, q->z, q->w);
}

/* True for the first of 25 samples. */
static bool is_shown(unsigned* count) { return (*count)++ % 25 == 0; }

/* Returns whether a pose of the device has arrived. */
static bool take_user(dds_entity_t wrench_in, dds_entity_t pose_in, dds_entity_t proxy_in, dds_entity_t twist_in) {
  static unsigned wrenches = 0, poses = 0, proxies = 0, twists = 0;
  static geometry_msgs_msg_dds__WrenchStamped_ wrench; /* static, thus zero: Cyclone DDS allocates their strings */
  static geometry_msgs_msg_dds__PoseStamped_ pose;
  static geometry_msgs_msg_dds__TwistStamped_ twist;
  while (take(wrench_in, &wrench)) {
    const geometry_msgs_msg_dds__Wrench_* w = &wrench.wrench;
    if (!is_shown(&wrenches)) continue;
    print_header("wrench", &wrench.header);
    print_vector(w->force.x, w->force.y, w->force.z);
    print_vector(w->torque.x, w->torque.y, w->torque.z);
    printf("\n");
  }
  while (take(pose_in, &pose))
    if (is_shown(&poses)) print_pose("pose", &pose);
  while (take(proxy_in, &pose))
    if (is_shown(&proxies)) print_pose("proxy", &pose);
  while (take(twist_in, &twist)) {
    const geometry_msgs_msg_dds__Twist_* t = &twist.twist;
    if (!is_shown(&twists)) continue;
    print_header("twist", &twist.header);
    print_vector(t->linear.x, t->linear.y, t->linear.z);
    print_vector(t->angular.x, t->angular.y, t->angular.z);
    printf("\n");
  }
  return poses > 0;
}

static void take_transforms(dds_entity_t reader) {
  static tf2_msgs_msg_dds__TFMessage_ message;
  while (take(reader, &message)) {
    for (uint32_t i = 0; i < message.transforms._length; ++i) {
      const geometry_msgs_msg_dds__TransformStamped_* t = &message.transforms._buffer[i];
      print_header("tf", &t->header);
      printf(" %s", t->child_frame_id);
      print_vector(t->transform.translation.x, t->transform.translation.y, t->transform.translation.z);
      printf(" %.6f %.6f %.6f %.6f\n", t->transform.rotation.x, t->transform.rotation.y, t->transform.rotation.z,
             t->transform.rotation.w);
    }
  }
}

/* Prints frame, name, type, action, numbers of points and colours, and the bounds of the scaled points. */
static void take_markers(dds_entity_t reader) {
  static visualization_msgs_msg_dds__MarkerArray_ message;
  while (take(reader, &message)) {
    for (uint32_t i = 0; i < message.markers._length; ++i) {
      const visualization_msgs_msg_dds__Marker_* m = &message.markers._buffer[i];
      double low[3] = {1e9, 1e9, 1e9}, high[3] = {-1e9, -1e9, -1e9};
      for (uint32_t k = 0; k < m->points._length; ++k) {
        const geometry_msgs_msg_dds__Point_* p = &m->points._buffer[k];
        const double at[3] = {p->x * m->scale.x, p->y * m->scale.y, p->z * m->scale.z};
        for (int axis = 0; axis < 3; ++axis) {
          if (at[axis] < low[axis]) low[axis] = at[axis];
          if (at[axis] > high[axis]) high[axis] = at[axis];
        }
      }
      printf("marker: %s %s %d %d %d %u %u", m->header.frame_id, m->ns, m->id, m->type, m->action, m->points._length,
             m->colors._length);
      print_vector(low[0], low[1], low[2]);
      print_vector(high[0], high[1], high[2]);
      printf(" %d %d\n", m->frame_locked, m->mesh_use_embedded_materials);
    }
  }
}

int main(int argc, char** argv) {
  if (argc != 3 && argc != 7) {
    fprintf(stderr, "Usage: cyclone-ros2 DOMAIN USER [FRAME X Y Z]\n");
    return 2;
  }
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  setvbuf(stdout, NULL, _IOLBF, 0);
  const dds_entity_t participant =
      checked("participant", dds_create_participant((dds_domainid_t)atoi(argv[1]), NULL, NULL));
  const dds_entity_t writers =
      checked("writers", dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, NULL, NULL));
  char names[5][256];
  const char* const ends[] = {"wrench", "pose", "proxy", "twist", "target_pose"};
  for (int i = 0; i < 5; ++i) snprintf(names[i], sizeof names[i], "rt/tactus/%s/%s", argv[2], ends[i]);
  const dds_entity_t wrench = reader_of(participant, &geometry_msgs_msg_dds__WrenchStamped__desc, names[0]);
  const dds_entity_t pose = reader_of(participant, &geometry_msgs_msg_dds__PoseStamped__desc, names[1]);
  const dds_entity_t proxy = reader_of(participant, &geometry_msgs_msg_dds__PoseStamped__desc, names[2]);
  const dds_entity_t twist = reader_of(participant, &geometry_msgs_msg_dds__TwistStamped__desc, names[3]);
  const dds_entity_t transforms = reader_of(participant, &tf2_msgs_msg_dds__TFMessage__desc, "rt/tf");
  const dds_entity_t markers =
      reader_of(participant, &visualization_msgs_msg_dds__MarkerArray__desc, "rt/tactus/markers");
  dds_entity_t targets = 0;
  geometry_msgs_msg_dds__PoseStamped_ target = {0};
  if (argc == 7) {
    targets = writer_of(participant, &geometry_msgs_msg_dds__PoseStamped__desc, names[4]);
    target.header.frame_id = argv[3];
    target.pose.position.x = atof(argv[4]);
    target.pose.position.y = atof(argv[5]);
    target.pose.position.z = atof(argv[6]) + 0.05;
    target.pose.orientation.z = 0.6; /* rotated about z */
    target.pose.orientation.w = 0.8;
  }
  while (!stopped) {
    take_writers(writers);
    const bool has_pose = take_user(wrench, pose, proxy, twist);
    take_transforms(transforms);
    take_markers(markers);
    if (targets != 0) {
      if (has_pose && target.pose.position.z > atof(argv[6])) target.pose.position.z -= 0.0005;
      dds_write(targets, &target);
    }
    dds_sleepfor(DDS_MSECS(10));
  }
  dds_delete(participant);
  return 0;
}
