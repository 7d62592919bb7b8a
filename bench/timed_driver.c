/* A driver without a device. Its poses show the newest command: x is the time of the write, CLOCK_MONOTONIC in s, y the
 * force along y, and z the time of the newest write of zero force. */
#include <stdlib.h>
#include <time.h>

#include "haptics/device_plugin.h"

struct tactus_device {
  double written, force, zero; /* s, N, s */
};

static double now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (double)time.tv_sec + (double)time.tv_nsec * 1e-9;
}

static struct tactus_device* open_device(const char* config, char* error, size_t error_size) {
  (void)config, (void)error, (void)error_size;
  return calloc(1, sizeof(struct tactus_device));
}
static void close_device(struct tactus_device* device) { free(device); }
static void spec_of_device(struct tactus_device* device, struct tactus_device_spec* spec) {
  (void)device;
  spec->max_force = 1e9; /* above the numbers of cycles, which the benchmark sends as forces */
  spec->flags = TACTUS_DEVICE_HAS_VELOCITY;
}
static int read_device(struct tactus_device* device, int64_t now_ns, struct tactus_device_pose* pose) {
  (void)now_ns;
  pose->position[0] = device->written;
  pose->position[1] = device->force;
  pose->position[2] = device->zero;
  return TACTUS_DEVICE_POSE;
}
static int write_device(struct tactus_device* device, const double force[3]) {
  device->written = now();
  if (force[1] == 0 && device->force != 0) device->zero = device->written;
  device->force = force[1];
  return 0;
}

const struct tactus_device_driver* tactus_device_entry(void) {
  static const struct tactus_device_driver driver = {TACTUS_DEVICE_ABI, "timed",     open_device,  close_device,
                                                     spec_of_device,    read_device, write_device, NULL};
  return &driver;
}
