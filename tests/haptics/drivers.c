/* Drivers with one defect each, selected at compile time. */
#include <math.h>
#include <stdio.h>

#include "haptics/device_plugin.h"

struct tactus_device {
  int reads;
  double force;
};
static struct tactus_device only_device;

static struct tactus_device* open_device(const char* config, char* error, size_t error_size) {
  if (*config == '!') {
    snprintf(error, error_size, "found '%s', expected no exclamation mark", config);
    return NULL;
  }
  only_device.reads = 0;
  only_device.force = 0;
  return &only_device;
}
static void close_device(struct tactus_device* device) { (void)device; }
static void spec_of(struct tactus_device* device, struct tactus_device_spec* spec) {
  (void)device;
#ifdef DRIVER_BAD_SPEC
  spec->max_force = -1;
#else
  spec->max_torque = 0.25;
#endif
}
static int read_device(struct tactus_device* device, int64_t now_ns, struct tactus_device_pose* pose) {
  (void)now_ns;
  ++device->reads;
#ifdef DRIVER_REPEATS
  pose->time_ns = 100000000; /* after the first calls of the test */
  pose->buttons = (uint32_t)device->reads;
#endif
#ifdef DRIVER_AHEAD
  pose->time_ns = now_ns + 100000000;
#endif
#ifdef DRIVER_WALL_CLOCK
  if (device->reads > 3) pose->time_ns = 1700000000000000000;
#endif
  pose->position[0] = 0.001 * device->reads; /* 1 m/s at 1 kHz */
  pose->position[1] = device->force;         /* shows the written force to the test */
#ifdef DRIVER_NOT_A_NUMBER
  if (device->reads == 4) pose->position[2] = NAN;
#endif
#ifdef DRIVER_FAILS
  if (device->reads > 3) return TACTUS_DEVICE_FAILED;
#endif
#ifdef DRIVER_STALE
  if (device->reads > 3) return TACTUS_DEVICE_NO_NEWS;
#endif
  return TACTUS_DEVICE_POSE;
}
static int write_device(struct tactus_device* device, const double force[3]) {
  device->force = force[0];
  return 0;
}

static int write_wrench(struct tactus_device* device, const double force[3], const double torque[3]) {
  device->force = force[0] + torque[2];
  return 0;
}

#ifndef DRIVER_NO_ENTRY
const struct tactus_device_driver* tactus_device_entry(void) {
  static const struct tactus_device_driver driver = {
#if defined(DRIVER_OLD_ABI)
    1,
#elif defined(DRIVER_NEW_ABI)
    TACTUS_DEVICE_ABI + 1,
#else
    TACTUS_DEVICE_ABI,
#endif
    "test",
    open_device,
    close_device,
    spec_of,
#ifdef DRIVER_NO_READ
    NULL,
#else
    read_device,
#endif
    write_device,
    write_wrench
  };
#ifdef DRIVER_NO_DRIVER
  return NULL;
#else
  return &driver;
#endif
}
#endif

/* Uses every function in every variant, so that the compiler reports no unused function. */
void* tactus_test_driver_functions[] = {(void*)open_device, (void*)close_device, (void*)spec_of,
                                        (void*)read_device, (void*)write_device, (void*)write_wrench};
