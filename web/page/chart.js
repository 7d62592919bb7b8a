// A strip chart of the forces of the last seconds.
const kSeconds = 6, kMaxForce = 8;  // s, N

export class Chart {
  constructor(canvas, colours) {
    this.canvas = canvas;
    this.colours = colours;
    this.samples = [];
  }

  /// Adds {seconds, forces: N by user}.
  add(sample) {
    this.samples.push(sample);
    while (this.samples[0].seconds < sample.seconds - kSeconds) this.samples.shift();
  }

  clear() { this.samples = []; }

  draw() {
    const { width, height } = this.canvas, context = this.canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    const y = (force) => height - 6 - (height - 12) * Math.min(force / kMaxForce, 1);
    context.strokeStyle = "#2c3540";
    context.fillStyle = "#93a1b0";
    context.font = "20px system-ui, sans-serif";
    for (const force of [0, 4, 8]) {
      context.beginPath();
      context.moveTo(44, y(force));
      context.lineTo(width, y(force));
      context.stroke();
      context.fillText(`${force} N`, 2, Math.max(y(force) + 7, 18));
    }
    if (this.samples.length < 2) return;
    const end = this.samples.at(-1).seconds;
    context.lineWidth = 2.5;
    this.colours.forEach((colour, user) => {
      context.strokeStyle = colour;
      context.beginPath();
      this.samples.forEach(({ seconds, forces }, i) => {
        const x = width - (width - 44) * (end - seconds) / kSeconds;
        i === 0 ? context.moveTo(x, y(forces[user])) : context.lineTo(x, y(forces[user]));
      });
      context.stroke();
    });
  }
}
