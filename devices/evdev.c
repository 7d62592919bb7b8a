/* Device driver for a mouse or a gamepad. Linux input events move the tip. A gamepad with a rumble motor rumbles with
 * the force.
 *
 *   tactus-hrtc --device ann=tactus-evdev.so,mouse:/dev/input/event3
 *   tactus-hrtc --device bob=tactus-evdev.so,gamepad:/dev/input/event7
 *
 *                  mouse                              gamepad
 *   x and y        motion, 0.1 mm for each count      left stick, at most 0.15 m/s
 *   z              wheel, 2 mm for each notch         right stick, at most 0.15 m/s
 *   clutch         left button                        south button
 *   grab           right button                       east button
 *
 * The tip stays in a cube with edges of 0.4 m. Neither device exerts a force, so the driver reports a low stiffness.
 * The rumble of a gamepad is proportional to the norm of the force. The device has failed when it is unplugged. If the
 * kernel drops events, the driver reads the state of buttons and sticks; only the motion of a mouse is lost. The
 * driver needs neither an SDK nor a desktop. The user must be a member of the group `input`, which may read /dev/input.
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/input.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "haptics/device_plugin.h"

enum { kAxes = 3, kEvents = 32, kReads = 4 };

static const double kHalfEdge = 0.2;       /* m, of the cube */
static const double kCountLength = 1e-4;   /* m, path of the tip for each count of a mouse */
static const double kNotchLength = 2e-3;   /* m, path of the tip for each notch of a wheel */
static const double kStickSpeed = 0.15;    /* m/s, at full deflection */
static const double kMaxTipSpeed = 0.5;    /* m/s for each axis, so that a fast mouse does not exceed the speed limit */
static const double kDeadZone = 0.1;       /* of a stick, share of its range */
static const double kMaxForce = 5;         /* N, at full rumble */
static const double kRumbleStep = 0.05;    /* min change that is sent, as a share of full rumble */
static const int64_t kRumbleNs = 20000000; /* min time between two rumble commands, because each is a system call */

struct axis {
  double middle, half_range; /* of the raw values */
  double value;              /* -1..1 */
};

struct tactus_device {
  int fd;
  int is_mouse, can_rumble, effect;
  double target[kAxes], position[kAxes]; /* m; the tip moves to the target at kMaxTipSpeed */
  struct axis sticks[kAxes];
  uint32_t buttons;
  uint32_t stop;                /* the stop button, until a pose has reported it, however short the press was */
  int has_dropped;              /* the kernel has dropped events, and the packet with the gap has not ended yet */
  double rumble, target_rumble; /* shares of full rumble: last sent, and of the newest force */
  int64_t time_ns, rumbled_ns;
};

static const unsigned kStickCodes[kAxes] = {ABS_X, ABS_Y, ABS_RY};

static void find_axes(struct tactus_device* device) {
  for (int i = 0; i < kAxes; ++i) {
    struct input_absinfo info;
    device->sticks[i].middle = 0;
    device->sticks[i].half_range = 32767;
    if (ioctl(device->fd, EVIOCGABS(kStickCodes[i]), &info) < 0 || info.maximum <= info.minimum) continue;
    device->sticks[i].middle = (info.maximum + (double)info.minimum) / 2;
    device->sticks[i].half_range = (info.maximum - (double)info.minimum) / 2;
  }
}

static void find_rumble(struct tactus_device* device) {
  unsigned char bits[FF_MAX / 8 + 1] = {0};
  device->can_rumble =
      ioctl(device->fd, EVIOCGBIT(EV_FF, sizeof bits), bits) >= 0 && (bits[FF_RUMBLE / 8] >> (FF_RUMBLE % 8) & 1) != 0;
}

static void set_button(struct tactus_device* device, uint32_t button, int down) {
  device->buttons = down ? device->buttons | button : device->buttons & ~button;
}

static void set_stick(struct axis* stick, int axis, int raw) {
  const double value = (raw - stick->middle) / stick->half_range;
  const double clipped = value > 1 ? 1 : value < -1 ? -1 : value;
  const double beyond = fabs(clipped) < kDeadZone ? 0 : (fabs(clipped) - kDeadZone) / (1 - kDeadZone);
  stick->value = copysign(beyond, axis == 0 ? clipped : -clipped); /* for sticks, up is negative */
}

static unsigned clutch_code(const struct tactus_device* device) { return device->is_mouse ? BTN_LEFT : BTN_SOUTH; }
static unsigned grab_code(const struct tactus_device* device) { return device->is_mouse ? BTN_RIGHT : BTN_EAST; }
static unsigned stop_code(const struct tactus_device* device) { return device->is_mouse ? BTN_EXTRA : BTN_SELECT; }

/* Reads which buttons are pressed and how far the sticks are deflected, because events report only changes. If the
 * device does not answer, its buttons count as released and its sticks as centred. */
static void read_state(struct tactus_device* device) {
  unsigned char keys[KEY_MAX / 8 + 1] = {0};
  if (ioctl(device->fd, EVIOCGKEY(sizeof keys), keys) < 0) memset(keys, 0, sizeof keys);
  set_button(device, 1u, keys[clutch_code(device) / 8] >> (clutch_code(device) % 8) & 1);
  set_button(device, 2u, keys[grab_code(device) / 8] >> (grab_code(device) % 8) & 1);
  set_button(device, 4u, keys[stop_code(device) / 8] >> (stop_code(device) % 8) & 1);
  for (int i = 0; i < kAxes && !device->is_mouse; ++i) {
    struct input_absinfo info;
    if (ioctl(device->fd, EVIOCGABS(kStickCodes[i]), &info) < 0)
      device->sticks[i].value = 0;
    else
      set_stick(&device->sticks[i], i, info.value);
  }
}

static struct tactus_device* open_input(const char* config, char* error, size_t error_size) {
  const int is_mouse = strncmp(config, "mouse:", 6) == 0;
  const int is_gamepad = strncmp(config, "gamepad:", 8) == 0;
  const char* const path = strchr(config, ':') == NULL ? "" : strchr(config, ':') + 1;
  if ((!is_mouse && !is_gamepad) || *path == '\0') {
    snprintf(error, error_size, "found '%s', expected mouse:FILE or gamepad:FILE, FILE as in /dev/input", config);
    return NULL;
  }
  int fd = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC); /* write access is for rumble */
  if (fd < 0 && errno == EACCES) fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) {
    snprintf(error, error_size, "cannot open %s: %s", path, strerror(errno));
    return NULL;
  }
  struct tactus_device* device = calloc(1, sizeof *device);
  if (device == NULL) {
    close(fd);
    snprintf(error, error_size, "out of memory");
    return NULL;
  }
  device->fd = fd;
  device->is_mouse = is_mouse;
  device->effect = -1;
  if (is_gamepad) find_axes(device);
  if (is_gamepad) find_rumble(device);
  read_state(device);
  return device;
}

static void close_input(struct tactus_device* device) {
  if (device->effect >= 0) ioctl(device->fd, EVIOCRMFF, device->effect);
  close(device->fd);
  free(device);
}

static void spec_of_input(struct tactus_device* device, struct tactus_device_spec* spec) {
  (void)device;
  spec->max_force = kMaxForce;
  spec->max_stiffness = 500;
  spec->damping = 2;
  spec->workspace_radius = kHalfEdge;
}

static void take(struct tactus_device* device, const struct input_event* event) {
  if (event->type == EV_SYN && event->code == SYN_DROPPED) device->has_dropped = 1;
  if (device->has_dropped) { /* the rest of the packet is incomplete */
    if (event->type != EV_SYN || event->code != SYN_REPORT) return;
    device->has_dropped = 0;
    read_state(device);
    return;
  }
  if (event->type == EV_KEY && event->code == clutch_code(device)) set_button(device, 1u, event->value);
  if (event->type == EV_KEY && event->code == grab_code(device)) set_button(device, 2u, event->value);
  if (event->type == EV_KEY && event->code == stop_code(device)) {
    set_button(device, 4u, event->value);
    if (event->value) device->stop = 4u;
  }
  if (device->is_mouse && event->type == EV_REL) {
    if (event->code == REL_X) device->target[0] += kCountLength * event->value;
    if (event->code == REL_Y) device->target[1] -= kCountLength * event->value; /* screens count downwards */
    if (event->code == REL_WHEEL) device->target[2] += kNotchLength * event->value;
  }
  if (device->is_mouse || event->type != EV_ABS) return;
  for (int i = 0; i < kAxes; ++i)
    if (event->code == kStickCodes[i]) set_stick(&device->sticks[i], i, event->value);
}

static int read_input(struct tactus_device* device, int64_t now_ns, struct tactus_device_pose* pose) {
  struct input_event events[kEvents];
  for (int round = 0; round < kReads; ++round) {
    const ssize_t got = read(device->fd, events, sizeof events);
    if (got < 0 && errno != EAGAIN && errno != EINTR) return TACTUS_DEVICE_FAILED; /* ENODEV: unplugged */
    if (got <= 0) break;
    for (size_t i = 0; i < (size_t)got / sizeof *events; ++i) take(device, &events[i]);
    if ((size_t)got < sizeof events) break;
  }
  const double dt = device->time_ns == 0 ? 0 : (double)(now_ns - device->time_ns) * 1e-9;
  device->time_ns = now_ns;
  const double passed = dt < 0.01 ? dt : 0.01;
  for (int i = 0; i < kAxes; ++i) {
    device->target[i] += kStickSpeed * device->sticks[i].value * passed;
    if (device->target[i] > kHalfEdge) device->target[i] = kHalfEdge;
    if (device->target[i] < -kHalfEdge) device->target[i] = -kHalfEdge;
    const double left = device->target[i] - device->position[i];
    const double step = fabs(left) < kMaxTipSpeed * passed ? left : copysign(kMaxTipSpeed * passed, left);
    device->position[i] += step;
    pose->position[i] = device->position[i];
  }
  pose->buttons = device->buttons | device->stop;
  device->stop = 0;
  return TACTUS_DEVICE_POSE; /* a device at rest sends no events; its position is still valid */
}

/* An error of the rumble motor is no failure of the device, because rumble is no force. After an error the device never
 * rumbles again. */
static void set_rumble(struct tactus_device* device, double strength) {
  struct ff_effect effect;
  memset(&effect, 0, sizeof effect);
  effect.type = FF_RUMBLE;
  effect.id = (int16_t)device->effect;
  effect.u.rumble.strong_magnitude = (uint16_t)(strength * 0xffff);
  effect.u.rumble.weak_magnitude = effect.u.rumble.strong_magnitude;
  effect.replay.length = 200; /* ms: the rumble ends by itself without new commands */
  if (ioctl(device->fd, EVIOCSFF, &effect) < 0) {
    device->can_rumble = 0;
    return;
  }
  device->effect = effect.id;
  struct input_event play;
  memset(&play, 0, sizeof play);
  play.type = EV_FF;
  play.code = (uint16_t)effect.id;
  play.value = strength > 0;
  if (write(device->fd, &play, sizeof play) != (ssize_t)sizeof play) device->can_rumble = 0;
}

static int write_input(struct tactus_device* device, const double force[3]) {
  const double size = sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]);
  device->target_rumble = size < kMaxForce ? size / kMaxForce : 1;
  if (!device->can_rumble) return 0;
  const int same =
      fabs(device->target_rumble - device->rumble) < kRumbleStep && (device->target_rumble > 0) == (device->rumble > 0);
  const int64_t since = device->time_ns - device->rumbled_ns;
  if (since < kRumbleNs || (same && (device->rumble == 0 || since < 5 * kRumbleNs))) return 0;
  set_rumble(device, device->target_rumble);
  device->rumble = device->target_rumble;
  device->rumbled_ns = device->time_ns;
  return 0;
}

const struct tactus_device_driver* tactus_device_entry(void) {
  static const struct tactus_device_driver driver = {TACTUS_DEVICE_ABI, "input events", open_input,  close_input,
                                                     spec_of_input,     read_input,     write_input, NULL};
  return &driver;
}
