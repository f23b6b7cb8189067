/** Shapes that several canvases draw; a caller fills and strokes them. */

/** @param {Canvas2D} context @param {number} x @param {number} y @param {number} radius */
export const disc = (context, x, y, radius) => {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
};

/** A line through points. @param {Canvas2D} context @param {Iterable<Point>} points */
export const trace = (context, points) => {
  context.beginPath();
  for (const point of points) {
    context.lineTo(...point);
  }
};

/** @param {Canvas2D} context @param {string} colour @param {number} [alpha] */
export const fill = (context, colour, alpha = 1) => {
  context.globalAlpha = alpha;
  context.fillStyle = colour;
  context.fill();
  context.globalAlpha = 1;
};

/**
 * @param {Canvas2D} context @param {string} colour @param {number} width @param {number[]} [dash]
 */
export const stroke = (context, colour, width, dash = []) => {
  context.setLineDash(dash);
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.stroke();
  context.setLineDash([]);
};

/**
 * A line with an edge, readable on any ground.
 * @param {Canvas2D} context @param {string} colour @param {number} width @param {string} edge
 */
export const strokeWithEdge = (context, colour, width, edge) => {
  stroke(context, edge, width + 2.5);
  stroke(context, colour, width);
};

/** @type {Point[]} */
const BOLT = [
  [0.2, -1.3],
  [-0.8, 0.2],
  [-0.05, 0.2],
  [-0.2, 1.3],
  [0.8, -0.2],
  [0.05, -0.2],
];

/**
 * The sign of charging.
 * @param {Canvas2D} context @param {number} x @param {number} y @param {number} size
 */
export const bolt = (context, x, y, size) => {
  trace(
    context,
    BOLT.map(([u, v]) => [x + u * size, y + v * size]),
  );
  context.closePath();
};

/**
 * @param {Canvas2D} context @param {string} text @param {number} x its middle @param {number} y
 * @param {string} colour
 */
export const label = (context, text, x, y, colour) => {
  context.fillStyle = colour;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, x, y);
};
