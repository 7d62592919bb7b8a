// A strip of the newest values of a figure, in microseconds.
const kValues = 120;

export class Strip {
  constructor(canvas) {
    this.canvas = canvas;
    canvas.width = 568;
    canvas.height = 68;
    this.values = [];
  }

  add(value) {
    this.values.push(value);
    if (this.values.length > kValues) this.values.shift();
  }

  draw() {
    const { width, height } = this.canvas, context = this.canvas.getContext("2d");
    const largest = Math.max(50, ...this.values);
    context.clearRect(0, 0, width, height);
    context.fillStyle = "#93a1b0";
    context.font = "18px system-ui, sans-serif";
    context.fillText(`${largest.toFixed(0)} us`, 4, 20);
    context.strokeStyle = "#6fc3ff";
    context.lineWidth = 2;
    context.beginPath();
    this.values.forEach((value, i) => {
      const x = width - (this.values.length - 1 - i) * width / kValues, y = height - 4 - (height - 8) * value / largest;
      i === 0 ? context.moveTo(x, y) : context.lineTo(x, y);
    });
    context.stroke();
  }
}
