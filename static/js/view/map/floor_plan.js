/**
 * Draws a floor plan: rooms, walls, doors, furniture and docks from its plan, or, for a site that
 * has only a map_server image, that image. Everything static; robot_map.js keeps the result and
 * draws the robot over it.
 */

import { boundsOf, imageTransform, toScreen } from "./transform.js";

/**
 * @typedef {{resolution: number, origin: [number, number, number], width: number, height: number,
 *   image?: string, plan?: any}} FloorPlan
 */

/** @param {FloorPlan} site @returns {import("./transform.js").Bounds} */
export const boundsOfSite = (site) => {
  const corners = (site.plan?.rooms ?? []).flatMap((/** @type {any} */ room) => room.polygon);
  if (corners.length) {
    return boundsOf(corners);
  }
  const [x, y, theta] = site.origin;
  const [width, height] = [site.width * site.resolution, site.height * site.resolution];
  const corner = (/** @type {number} */ u, /** @type {number} */ v) =>
    /** @type {Point} */ ([
      x + u * Math.cos(theta) - v * Math.sin(theta),
      y + u * Math.sin(theta) + v * Math.cos(theta),
    ]);
  return boundsOf([corner(0, 0), corner(width, 0), corner(0, height), corner(width, height)]);
};

/**
 * @param {Canvas2D} context its transform is device pixels; restored afterwards
 * @param {MapView} view @param {number} density @param {FloorPlan} site
 * @param {CanvasImageSource | null} image @param {Paint} paint
 */
export const drawFloorPlan = (context, view, density, site, image, paint) => {
  context.save();
  if (site.plan?.rooms?.length) {
    context.setTransform(density, 0, 0, density, 0, 0);
    drawPlan(context, view, site.plan, paint);
  } else if (image) {
    context.setTransform(...imageTransform(view, site, density));
    context.imageSmoothingEnabled = false;
    context.drawImage(image, 0, 0, site.width, site.height);
  }
  context.restore();
};

/** @param {Canvas2D} context @param {MapView} view @param {any} plan @param {Paint} paint */
const drawPlan = (context, view, plan, paint) => {
  context.lineCap = "butt";
  for (const room of plan.rooms) {
    polygon(context, view, room.polygon);
    context.fillStyle = paint.floor;
    context.fill();
  }
  for (const opening of [...(plan.doors ?? []), ...(plan.passages ?? [])]) {
    segment(
      context,
      view,
      opening.start,
      opening.end,
      (opening.thickness ?? 0.15) * view.scale + 1,
      paint.floor,
    );
  }
  context.fillStyle = paint.furniture;
  for (const piece of plan.furniture ?? []) {
    furniture(context, view, piece);
    context.fill();
  }
  for (const wall of plan.walls ?? []) {
    segment(
      context,
      view,
      wall.start,
      wall.end,
      Math.max(2, (wall.thickness ?? 0.15) * view.scale),
      paint.wall,
    );
  }
  for (const door of plan.doors ?? []) {
    leaf(context, view, door, paint);
  }
  for (const mirror of plan.mirrors ?? []) {
    segment(context, view, mirror.start, mirror.end, 2, paint.door);
  }
  for (const dock of plan.docks ?? []) {
    station(context, view, dock, paint);
  }
  for (const room of plan.rooms) {
    title(context, view, room, paint);
  }
};

/** @param {Canvas2D} context @param {MapView} view @param {Point[]} corners */
const polygon = (context, view, corners) => {
  context.beginPath();
  for (const [x, y] of corners) {
    context.lineTo(...toScreen(view, x, y));
  }
  context.closePath();
};

/**
 * @param {Canvas2D} context @param {MapView} view @param {Point} start
 * @param {Point} end @param {number} width @param {string} colour
 */
const segment = (context, view, start, end, width, colour) => {
  context.beginPath();
  context.moveTo(...toScreen(view, ...start));
  context.lineTo(...toScreen(view, ...end));
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.stroke();
};

/** @param {Canvas2D} context @param {MapView} view @param {any} piece */
const furniture = (context, view, piece) => {
  if (piece.shape === "cylinder") {
    context.beginPath();
    context.arc(
      ...toScreen(view, piece.x, piece.y),
      (piece.width / 2) * view.scale,
      0,
      2 * Math.PI,
    );
    return;
  }
  const [cos, sin] = [Math.cos(piece.theta ?? 0), Math.sin(piece.theta ?? 0)];
  const [along, across] = [piece.width / 2, (piece.depth ?? 0.5) / 2];
  const corners = [
    [along, across],
    [-along, across],
    [-along, -across],
    [along, -across],
  ];
  polygon(
    context,
    view,
    corners.map(([u, v]) => [piece.x + u * cos - v * sin, piece.y + u * sin + v * cos]),
  );
};

/** @param {Canvas2D} context @param {MapView} view @param {any} door @param {Paint} paint */
const leaf = (context, view, door, paint) => {
  const turn = door.state === "closed" ? 0 : door.swing;
  const [dx, dy] = [door.end[0] - door.start[0], door.end[1] - door.start[1]];
  const [cos, sin] = [Math.cos(turn), Math.sin(turn)];
  const tip = /** @type {Point} */ ([
    door.start[0] + dx * cos - dy * sin,
    door.start[1] + dx * sin + dy * cos,
  ]);
  segment(
    context,
    view,
    door.start,
    tip,
    Math.max(1.5, (door.leaf ?? 0.04) * view.scale),
    paint.door,
  );
};

/** @param {Canvas2D} context @param {MapView} view @param {any} dock @param {Paint} paint */
const station = (context, view, dock, paint) => {
  const [x, y] = toScreen(view, dock.x, dock.y);
  const size = Math.max(4, 0.16 * view.scale);
  context.beginPath();
  // A bolt: charging icon (not colour alone).
  context.moveTo(x + 0.2 * size, y - 1.3 * size);
  context.lineTo(x - 0.8 * size, y + 0.2 * size);
  context.lineTo(x - 0.05 * size, y + 0.2 * size);
  context.lineTo(x - 0.2 * size, y + 1.3 * size);
  context.lineTo(x + 0.8 * size, y - 0.2 * size);
  context.lineTo(x + 0.05 * size, y - 0.2 * size);
  context.closePath();
  context.fillStyle = paint.dock;
  context.fill();
};

/** @param {Canvas2D} context @param {MapView} view @param {any} room @param {Paint} paint */
const title = (context, view, room, paint) => {
  const { left, right, bottom, top } = boundsOf(room.polygon);
  context.font = paint.font;
  if (context.measureText(room.title).width > (right - left) * view.scale - 8) {
    return;
  }
  context.fillStyle = paint.name;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(room.title, ...toScreen(view, (left + right) / 2, (bottom + top) / 2));
};
