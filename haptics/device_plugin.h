/* Interface of a haptic device driver: a shared library with one function, tactus_device_entry, in plain C.
 *
 *   tactus-hrtc --device ann=./mydevice.so,CONFIG
 *
 * The driver is loaded at run time. Tactus builds without an SDK, and a driver builds with this header alone.
 * docs/how-to/own-device.md describes a complete driver. Units: metres, newton, seconds, radians, in the device's own
 * frame, which --device-scale and --device-offset map into the world. Tactus limits forces, ramps them up and turns
 * them off when poses grow old. A driver writes the forces that it receives, and does not switch off the protection
 * that the device itself has.
 *
 * Each device has a process of its own, tactus-device, in which one thread calls all functions. If a driver crashes,
 * other devices go on, and its own device keeps its last force until its own watchdog acts. read and write are called
 * once per cycle, by default at 1 kHz, and together must take less than a cycle. Their time adds to the delay of the
 * force loop, and so lowers the largest stiffness. If the SDK takes long, the driver reads in a thread of its own,
 * and read returns the newest pose with its time. A call of read or write that does not return within half a second
 * ends the process. */
#ifndef TACTUS_HAPTICS_DEVICE_PLUGIN_H
#define TACTUS_HAPTICS_DEVICE_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Increases when this interface changes. In a driver of ABI 1 the structs end at "ABI 1 ends here"; Tactus still loads
 * such a driver. */
#define TACTUS_DEVICE_ABI 2u

/* Results of read. */
#define TACTUS_DEVICE_POSE 0    /* a pose */
#define TACTUS_DEVICE_NO_NEWS 1 /* no new pose; the last one grows old, and the force fades after 10 ms */
#define TACTUS_DEVICE_FAILED -1 /* permanent; the force is off, with a status bit, until the HRTC starts again */

/* tactus_device_spec.flags */
#define TACTUS_DEVICE_HAS_VELOCITY 1u /* poses have velocities; otherwise Tactus derives them from positions */

/* One open device; the driver defines it. */
struct tactus_device;

/* Limits of the device. Before the call of `spec` Tactus sets the defaults; the driver writes the members it knows. */
struct tactus_device_spec {
  double max_force;        /* N */
  double max_stiffness;    /* N/m, the vendor's limit */
  double damping;          /* N s/m, min physical damping; limits the stiffness that a surface has without vibration */
  double workspace_radius; /* m */
  uint32_t flags;
  /* ABI 1 ends here. */
  double max_torque;               /* N m; default 0: forces only */
  double max_rotational_stiffness; /* N m/rad, the vendor's limit */
};

/* State of the device. Before the call of `read` Tactus sets zeros, no rotation, and `now_ns` as the time. */
struct tactus_device_pose {
  double position[3];    /* of the tip, m */
  double velocity[3];    /* m/s */
  double orientation[4]; /* x, y, z, w, of unit length */
  int64_t time_ns;       /* time of the measurement, CLOCK_MONOTONIC; a pose with the same time as the one before is as
                          * old, and a time more than 0.5 s in the future is a failure */
  uint32_t buttons;      /* bit 0: the clutch: the device moves and the tip does not;
                          * bit 1: the grab: the hand holds a movable object that it touches;
                          * bit 2: an emergency stop: forces are off until it is released and a reset follows */
};

struct tactus_device_driver {
  uint32_t abi;     /* TACTUS_DEVICE_ABI */
  const char* name; /* for logs */
  /* Opens a device. `config` is the text after the comma, or empty. Returns NULL on failure, with the reason in `error`
   * (at most `error_size` bytes with the final zero): what, where, found, expected. May take up to 60 s. */
  struct tactus_device* (*open)(const char* config, char* error, size_t error_size);
  /* Closes the device. The last write before it was zero force; there was no write if Tactus has refused the limits
   * of the device. */
  void (*close)(struct tactus_device* device);
  void (*spec)(struct tactus_device* device, struct tactus_device_spec* spec);
  /* Returns TACTUS_DEVICE_POSE, _NO_NEWS or _FAILED. `now_ns`: CLOCK_MONOTONIC at the call, shortly before a cycle. */
  int (*read)(struct tactus_device* device, int64_t now_ns, struct tactus_device_pose* pose);
  /* Sets the force on the user's hand, N, until the next write. Called after read, once per cycle with a command, and
   * with zero while commands are missing. Returns 0, or a different value after a permanent failure. */
  int (*write)(struct tactus_device* device, const double force[3]);
  /* ABI 1 ends here. */
  /* Sets force and torque about the tip, N m; called instead of write. NULL: forces only. */
  int (*write_wrench)(struct tactus_device* device, const double force[3], const double torque[3]);
};

/* The only function of a driver. It always returns the same pointer, valid while the library is loaded. */
const struct tactus_device_driver* tactus_device_entry(void);

#ifdef __cplusplus
}
#endif

#endif
