// The hand of a user who points with a mouse, a finger or a gamepad.
const kHover = 0.012;       // m, distance of the hand from the surface while nothing is pressed
const kPress = 0.012;       // m, depth of the hand below the surface while the button is pressed
const kWheel = 0.01 / 100;  // m per unit of the wheel, about 1 cm per notch
const kDeadZone = 0.15;     // of a gamepad's sticks
const kTriggerDeadZone = 0.05;
const kStickSpeed = 500;    // pixels/s
const kStickDepth = 0.1;    // m/s
const kRumbleMs = 100, kRumbleEveryMs = 50;
const kRumbleNewtons = 5;   // force of the strongest rumble

/// Follows the primary pointer over the canvas. The hand is on the pointer's ray: above the surface, or below it while
/// the button is pressed. The wheel then changes the depth; otherwise it zooms. If the ray meets no object, the hand stays
/// above the last hit.
export class PointedHand {
  /// `pick`: returns the ray of a pointer event, {origin, direction, hit: its first point of an object or null}.
  constructor(canvas, pick) {
    this.canvas = canvas;
    this.pick = pick;
    this.clear();
    for (const name of ["pointerdown", "pointermove", "pointerup", "pointercancel"])
      canvas.addEventListener(name, (event) => this.onPointer(name, event));
    canvas.addEventListener("wheel", (event) => this.onWheel(event), { capture: true, passive: false });
    window.addEventListener("blur", () => { this.isPressed = false; });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  clear() {
    this.pointer = null;         // the newest event of the primary pointer
    this.isPressed = false;
    this.isPlaced = false;       // a proxy that starts inside the object touches nothing, so the hand starts above it
    this.isGrabbing = false;     // the hand then keeps its distance from the eye, because the object moves with it
    this.rayDistance = null;     // m, from the eye to the last hit
    this.depth = 0;              // m, added to that of the pressed button
    this.padPress = 0;           // 0 to 1, of a gamepad's trigger
    this.padMs = null;           // time of the last call of readGamepad with a gamepad
    this.rumbleMs = 0;
    this.wasTouching = false;
  }

  onPointer(name, event) {
    if (!event.isPrimary) {  // a second finger turns and zooms the view
      this.isPressed = false;
      return;
    }
    this.pointer = event;
    if (name === "pointerdown" && event.button === 0) this.canvas.setPointerCapture(event.pointerId);
    const isDown = name !== "pointercancel" && (event.buttons & 1) !== 0;
    this.isPressed = isDown && (this.isPressed || name === "pointerdown");
  }

  onWheel(event) {
    if (!this.isPressed && !this.isGrabbing) return;
    event.preventDefault();
    event.stopImmediatePropagation();  // the view does not zoom
    this.depth -= kWheel * event.deltaY;
  }

  /// Moves the pointer by the left stick, the depth by the right one. The right trigger presses; the button A, returned,
  /// grabs.
  readGamepad(nowMs) {
    const pad = navigator.getGamepads?.().find((each) => each?.connected);
    if (!pad || !document.hasFocus()) {  // a gamepad that is gone presses no longer
      this.padPress = 0;
      this.padMs = null;
      return false;
    }
    const seconds = this.padMs === null ? 0 : Math.min(0.1, 1e-3 * (nowMs - this.padMs));
    this.padMs = nowMs;
    const [x, y, , depth] = [0, 1, 2, 3].map((i) => (Math.abs(pad.axes[i] ?? 0) > kDeadZone ? pad.axes[i] : 0));
    const trigger = pad.buttons[7]?.value ?? 0;
    this.padPress = trigger > kTriggerDeadZone ? trigger : 0;
    if (x !== 0 || y !== 0 || (this.padPress > 0 && !this.pointer)) {
      const area = this.canvas.getBoundingClientRect();
      const { clientX = area.left + area.width / 2, clientY = area.top + area.height / 2 } = this.pointer ?? {};
      const within = (value, low, high) => Math.min(Math.max(value, low), high);
      this.pointer = { clientX: within(clientX + seconds * kStickSpeed * x, area.left, area.right),
                       clientY: within(clientY + seconds * kStickSpeed * y, area.top, area.bottom) };
    }
    this.depth -= seconds * kStickDepth * depth;
    return pad.buttons[0]?.pressed ?? false;
  }

  /// Lets a gamepad rumble with the force, N, and more when a contact begins.
  rumble(newtons, isTouching, nowMs) {
    const begins = isTouching && !this.wasTouching;
    this.wasTouching = isTouching;
    if (!isTouching || (nowMs - this.rumbleMs < kRumbleEveryMs && !begins)) return;
    this.rumbleMs = nowMs;
    const actuator = navigator.getGamepads?.().find((each) => each?.connected)?.vibrationActuator;
    actuator?.playEffect?.("dual-rumble", { duration: kRumbleMs, strongMagnitude: begins ? 0.8 : 0,
                                            weakMagnitude: Math.min(1, newtons / kRumbleNewtons) });
  }

  /// Returns the target of the hand, x y z in metres, or null if the pointer has not hit an object yet.
  target() {
    if (!this.pointer) return null;
    const { origin, direction, hit } = this.pick(this.pointer);
    if (hit && !this.isGrabbing) this.rayDistance = hit.distanceTo(origin);
    if (this.rayDistance === null) return null;
    const press = Math.max(this.isPressed ? 1 : 0, this.padPress);
    const isPressing = press > 0 && this.isPlaced && (hit || this.isGrabbing);
    if (press === 0 && !this.isGrabbing) this.depth = 0;
    this.isPlaced = true;
    const offset = isPressing ? press * kPress : -kHover;
    return origin.addScaledVector(direction, this.rayDistance + offset + this.depth).toArray();
  }
}
