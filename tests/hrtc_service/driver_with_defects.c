/* A driver without a device. Its configuration is "DEFECT:FILE". It appends a line to FILE for each write, with the time
 * in ns and the force, and the line "closed" at its end. The defect shows in the first read after a force of 3 N,
 * except that "opens slowly" and "slow" show in each such call. "taps" is no defect: the stop button is pressed in one
 * read, when the force is zero again. */
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "haptics/device_plugin.h"

struct tactus_device {
  char defect[32];
  FILE* file;
  double force;     /* newest, N */
  int64_t time_ns;  /* of a pose that is repeated, or 0 */
  int is_triggered; /* the defect has shown */
};

static int64_t ns_of(clockid_t clock) {
  struct timespec now;
  clock_gettime(clock, &now);
  return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static void sleep_ms(long ms) {
  const struct timespec time = {ms / 1000, ms % 1000 * 1000000};
  nanosleep(&time, NULL);
}

static struct tactus_device* open_device(const char* config, char* error, size_t error_size) {
  struct tactus_device* device = calloc(1, sizeof *device);
  const char* colon = strchr(config, ':');
  if (device == NULL || colon == NULL || (size_t)(colon - config) >= sizeof device->defect) {
    snprintf(error, error_size, "found '%s', expected DEFECT:FILE", config);
    free(device);
    return NULL;
  }
  memcpy(device->defect, config, (size_t)(colon - config));
  device->file = fopen(colon + 1, "a");
  if (device->file == NULL) {
    snprintf(error, error_size, "found no writable file %s", colon + 1);
    free(device);
    return NULL;
  }
  if (strcmp(device->defect, "killed while it opens") == 0) raise(SIGKILL);
  if (strcmp(device->defect, "opens slowly") == 0) sleep_ms(500);
  return device;
}

static void close_device(struct tactus_device* device) {
  fprintf(device->file, "closed\n");
  fclose(device->file);
  free(device);
}

static void spec_of_device(struct tactus_device* device, struct tactus_device_spec* spec) {
  (void)device;
  spec->max_force = 5;
}

/* Writes wrong values, again and again, into the memory that the process shares with the HRTC. */
static void* damage_shared_memory(void* unused) {
  (void)unused;
  FILE* maps = fopen("/proc/self/maps", "r");
  char line[512];
  while (maps != NULL && fgets(line, sizeof line, maps) != NULL) {
    unsigned long begin = 0, end = 0;
    if (strstr(line, "memfd:tactus-device") != NULL && sscanf(line, "%lx-%lx", &begin, &end) == 2)
      for (int i = 0; i < 1000; ++i) memset((void*)begin, i % 2 == 0 ? 0xFF : 0x7E, end - begin);
  }
  if (maps != NULL) fclose(maps);
  return NULL;
}

static int read_device(struct tactus_device* device, int64_t now_ns, struct tactus_device_pose* pose) {
  pose->position[2] = 0.001 * device->force; /* shows the written force to the test */
  if (strcmp(device->defect, "slow") == 0) sleep_ms(3);
  if (strcmp(device->defect, "taps") == 0 && device->is_triggered == 1 && device->force == 0) {
    pose->buttons = 4; /* the stop button, in this read only */
    device->is_triggered = 2;
    fprintf(device->file, "tapped\n");
    fflush(device->file);
  }
  if (device->force != 3) return TACTUS_DEVICE_POSE;
  if (strcmp(device->defect, "killed") == 0) raise(SIGKILL);
  if (strcmp(device->defect, "exits") == 0) exit(0);
  if (strcmp(device->defect, "hangs") == 0)
    for (;;) pause();
  if (strcmp(device->defect, "fails") == 0) return TACTUS_DEVICE_FAILED;
  if (strcmp(device->defect, "far") == 0) pose->velocity[0] = pose->position[0] = 1e300;
  if (strcmp(device->defect, "without orientation") == 0) memset(pose->orientation, 0, sizeof pose->orientation);
  if (strcmp(device->defect, "from the future") == 0) {
    if (device->time_ns == 0) device->time_ns = now_ns + 100000000;
    pose->time_ns = device->time_ns;
  }
  if (strcmp(device->defect, "wall clock") == 0) {
    if (device->time_ns == 0) device->time_ns = ns_of(CLOCK_REALTIME);
    pose->time_ns = device->time_ns;
  }
  pthread_t thread;
  if (strcmp(device->defect, "damages") == 0 && !device->is_triggered &&
      pthread_create(&thread, NULL, damage_shared_memory, NULL) == 0)
    pthread_detach(thread);
  device->is_triggered = 1;
  return TACTUS_DEVICE_POSE;
}

static int write_device(struct tactus_device* device, const double force[3]) {
  device->force = force[2];
  fprintf(device->file, "%lld %g\n", (long long)ns_of(CLOCK_MONOTONIC), force[2]);
  fflush(device->file);
  if (strcmp(device->defect, "slow") == 0) sleep_ms(5);
  return 0;
}

const struct tactus_device_driver* tactus_device_entry(void) {
  static const struct tactus_device_driver driver = {
      TACTUS_DEVICE_ABI, "device with a defect", open_device, close_device, spec_of_device,
      read_device,       write_device,           NULL};
  return &driver;
}
