// The fronts in the vertex forest of an object, as in figure 5 of the paper: the roots (base mesh) are at the top, the
// finest mesh at the bottom, and the regions follow each other from left to right.
const kLoaded = "#2d5f8b", kRefined = "#ed9945", kWhole = "#12171d";
const kWidth = 276, kHeight = 56;

export function makeFronts() {
  const canvas = document.createElement("canvas");
  canvas.className = "fronts";
  canvas.width = kWidth;
  canvas.height = kHeight;
  canvas.title = "Vertex forest, regions from left to right. Orange: above the refined front (shown). " +
    "Blue: above the loaded front (in the pool). Black: not loaded.";
  return canvas;
}

/// `fronts`: {refined, loaded}, each the percentage of the list entries by column.
export function drawFronts(canvas, { refined, loaded }) {
  const context = canvas.getContext("2d");
  context.fillStyle = kWhole;
  context.fillRect(0, 0, kWidth, kHeight);
  for (const [shares, colour] of [[loaded, kLoaded], [refined, kRefined]]) {
    context.fillStyle = colour;
    shares.forEach((share, i) => {
      const left = Math.round(i * kWidth / shares.length), right = Math.round((i + 1) * kWidth / shares.length);
      context.fillRect(left, 0, right - left, kHeight * share / 100);
    });
  }
}
