/* What a haptic device brings to Tactus: a shared library with one function, tactus_device_entry, in plain C.
 *
 *   tactus-hrtc --device ann=./mydevice.so,CONFIG
 *
 * Loaded at run time, so that no SDK is needed to build Tactus and no Tactus library to build a driver: this header is
 * all. `docs/how-to/own-device.md` goes through a whole one. Metres, newton, seconds, radians; the device's own frame,
 * which --device-scale and --device-offset put into the world. Tactus limits forces, starts them softly and ends them
 * when poses grow old; a driver writes what it is given, and its device's own protection stays on.
 *
 * read and write are called once each cycle, 1 kHz unless said otherwise, in the haptic thread: they must not wait. A
 * device whose SDK blocks is read in a thread of the driver's own, and read gives the newest pose with its time. */
#ifndef TACTUS_HAPTICS_DEVICE_PLUGIN_H
#define TACTUS_HAPTICS_DEVICE_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Grows with this header. Drivers of ABI 1, which end where it says so below, are loaded as they are. */
#define TACTUS_DEVICE_ABI 2u

/* What read returns. */
#define TACTUS_DEVICE_POSE 0    /* a pose */
#define TACTUS_DEVICE_NO_NEWS 1 /* none since the last: it grows old, and the force fades after 10 ms */
#define TACTUS_DEVICE_FAILED -1 /* for good: the force is off and says so, until the operator resets it */

/* tactus_device_spec.flags */
#define TACTUS_DEVICE_HAS_VELOCITY 1u /* poses come with velocities; else they are made of positions */

/* One open device; the driver's own. */
struct tactus_device;

/* What the device can do. Filled with defaults before `spec` is called; write what you know. */
struct tactus_device_spec {
  double max_force;        /* N */
  double max_stiffness;    /* N/m that the maker vouches for */
  double damping;          /* N s/m, physical, at the least: sets how stiff a surface can be without trembling */
  double workspace_radius; /* m */
  uint32_t flags;
  /* ABI 1 ends here. */
  double max_torque;               /* N m; 0, as filled: it bears forces only */
  double max_rotational_stiffness; /* N m/rad that the maker vouches for */
};

/* Where it is. Filled with zeros, no rotation and the time of the call before `read` is called. */
struct tactus_device_pose {
  double position[3];    /* of the tip, m */
  double velocity[3];    /* m/s */
  double orientation[4]; /* x, y, z, w, of unit length */
  int64_t time_ns;       /* when it was so, CLOCK_MONOTONIC */
  uint32_t buttons;      /* bit 0: the clutch: the device moves and the tip does not;
                          * bit 1: the grab: the hand holds on to what it touches, if that can move */
};

struct tactus_device_driver {
  uint32_t abi;     /* TACTUS_DEVICE_ABI */
  const char* name; /* for logs */
  /* `config` is what follows the comma, empty without one. NULL when it cannot be opened, with the reason in `error`,
   * at most `error_size` bytes with their zero: what, where, found, expected. Not in the haptic thread. */
  struct tactus_device* (*open)(const char* config, char* error, size_t error_size);
  /* After the last write, which was zero force. Not in the haptic thread. */
  void (*close)(struct tactus_device* device);
  void (*spec)(struct tactus_device* device, struct tactus_device_spec* spec);
  /* TACTUS_DEVICE_POSE, _NO_NEWS or _FAILED. `now_ns`: CLOCK_MONOTONIC at the cycle's begin. */
  int (*read)(struct tactus_device* device, int64_t now_ns, struct tactus_device_pose* pose);
  /* The force on the user's hand, N, until the next write; once each cycle, after read. 0, or not when it failed for
   * good. */
  int (*write)(struct tactus_device* device, const double force[3]);
  /* ABI 1 ends here. */
  /* The same with a torque about the tip, N m; called in place of write. NULL: forces only. */
  int (*write_wrench)(struct tactus_device* device, const double force[3], const double torque[3]);
};

/* The one function that a driver has. The same at each call, and valid as long as the library is loaded. */
const struct tactus_device_driver* tactus_device_entry(void);

#ifdef __cplusplus
}
#endif

#endif
