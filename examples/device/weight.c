/* A device driver without a device: a weight of 100 g that sinks through oil until a force stops it.
 *
 *   cc -shared -fPIC -o weight.so weight.c -I DIRECTORY-OF-TACTUS-HEADERS
 *   tactus-hrtc --device ann=./weight.so,0.3
 *
 * The text behind the comma is the height at which the weight starts, m. At rest the weight presses on the surface with
 * 0.981 N. docs/tutorials/first-device.md explains the driver. */
#include <stdio.h>
#include <stdlib.h>

#include "haptics/device_plugin.h"

struct tactus_device {
  double height, speed; /* m, m/s; upwards */
  double force;         /* N, upwards; newest force that Tactus wrote */
  int64_t time_ns;
};

static const double kMass = 0.1;     /* kg */
static const double kGravity = 9.81; /* m/s^2 */
static const double kOil = 5;        /* N s/m */

static struct tactus_device* open_weight(const char* config, char* error, size_t error_size) {
  char* end = NULL;
  const double height = *config == '\0' ? 0.3 : strtod(config, &end);
  if (end != NULL && (end == config || *end != '\0')) {
    snprintf(error, error_size, "found '%s', expected a height in metres", config);
    return NULL;
  }
  struct tactus_device* weight = calloc(1, sizeof *weight);
  if (weight == NULL) {
    snprintf(error, error_size, "out of memory");
    return NULL;
  }
  weight->height = height;
  return weight;
}

static void close_weight(struct tactus_device* weight) { free(weight); }

static void spec_of_weight(struct tactus_device* weight, struct tactus_device_spec* spec) {
  (void)weight;
  spec->max_force = 5;
  spec->max_stiffness = 3000;
  spec->damping = kOil;
  spec->workspace_radius = 0.5;
  spec->flags = TACTUS_DEVICE_HAS_VELOCITY;
}

static int read_weight(struct tactus_device* weight, int64_t now_ns, struct tactus_device_pose* pose) {
  double dt = weight->time_ns == 0 ? 0 : (double)(now_ns - weight->time_ns) * 1e-9;
  if (dt > 0.01) dt = 0.01;
  weight->time_ns = now_ns;
  /* Implicit in the drag: stable for a step of any length. */
  weight->speed = (weight->speed + dt * (weight->force / kMass - kGravity)) / (1 + dt * kOil / kMass);
  weight->height += dt * weight->speed;
  pose->position[2] = weight->height;
  pose->velocity[2] = weight->speed;
  return TACTUS_DEVICE_POSE;
}

static int write_weight(struct tactus_device* weight, const double force[3]) {
  weight->force = force[2];
  return 0;
}

const struct tactus_device_driver* tactus_device_entry(void) {
  static const struct tactus_device_driver driver = {TACTUS_DEVICE_ABI, "weight in oil", open_weight,  close_weight,
                                                     spec_of_weight,    read_weight,     write_weight, NULL};
  return &driver;
}
