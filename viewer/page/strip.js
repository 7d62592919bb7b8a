// A strip of the newest values of a figure.
const kValues = 60;

export class Strip {
  /// `top`: the value at the upper edge, unless a value is larger.
  constructor(label, unit, top) {
    Object.assign(this, { label, unit, top });
    this.canvas = document.createElement("canvas");
    this.canvas.width = 276;
    this.canvas.height = 68;
    this.values = [];
  }

  /// An undefined value leaves a gap.
  add(value) {
    this.values.push(value);
    if (this.values.length > kValues) this.values.shift();
  }

  draw() {
    const { width, height } = this.canvas, context = this.canvas.getContext("2d");
    const known = this.values.filter((value) => value !== undefined);
    const largest = Math.max(this.top, ...known), newest = known.at(-1);
    context.clearRect(0, 0, width, height);
    context.fillStyle = "#93a1b0";
    context.font = "18px system-ui, sans-serif";
    context.fillText(`${this.label} ${newest === undefined ? "-" : newest.toFixed(newest < 10 ? 1 : 0)} ${this.unit}`, 4, 18);
    context.strokeStyle = "#6fc3ff";
    context.lineWidth = 2;
    context.beginPath();
    let draws = false;
    this.values.forEach((value, i) => {
      const isKnown = value !== undefined;
      const x = width - 2 - (this.values.length - 1 - i) * width / kValues, y = height - 3 - (height - 28) * value / largest;
      if (isKnown) draws ? context.lineTo(x, y) : context.moveTo(x, y);
      draws = isKnown;
    });
    context.stroke();
  }
}
