/**
 * Draws a floor plan: rooms, walls, doors, furniture and docks from its plan, or, for a site that
 * has only a map_server image, that image. robot_map.js stores the result and draws the robot over
 * it.
 */

import { bolt, disc, fill, label, stroke, trace } from "../../lib/canvas.js";
import { mapFromRobot } from "../../lib/transforms.js";
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
  return boundsOf(rectangle(0, 0, width, height).map((at) => mapFromRobot({ x, y, theta }, at)));
};

/**
 * @param {number} x @param {number} y @param {number} width @param {number} height @returns
 * {Point[]}
 */
const rectangle = (x, y, width, height) => [
  [x, y],
  [x + width, y],
  [x + width, y + height],
  [x, y + height],
];

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
    fill(context, paint.floor);
  }
  for (const { start, end, thickness = 0.15 } of [
    ...(plan.doors ?? []),
    ...(plan.passages ?? []),
  ]) {
    segment(context, view, start, end, thickness * view.scale + 1, paint.floor);
  }
  for (const piece of plan.furniture ?? []) {
    furniture(context, view, piece);
    fill(context, paint.furniture);
  }
  for (const { start, end, thickness = 0.15 } of plan.walls ?? []) {
    segment(context, view, start, end, Math.max(2, thickness * view.scale), paint.wall);
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
  trace(
    context,
    corners.map(([x, y]) => toScreen(view, x, y)),
  );
  context.closePath();
};

/**
 * @param {Canvas2D} context @param {MapView} view @param {Point} start
 * @param {Point} end @param {number} width @param {string} colour
 */
const segment = (context, view, start, end, width, colour) => {
  trace(context, [toScreen(view, ...start), toScreen(view, ...end)]);
  stroke(context, colour, width);
};

/** @param {Canvas2D} context @param {MapView} view @param {any} piece */
const furniture = (context, view, { shape, x, y, theta = 0, width, depth = 0.5 }) => {
  if (shape === "cylinder") {
    disc(context, ...toScreen(view, x, y), (width / 2) * view.scale);
  } else {
    const corners = rectangle(-width / 2, -depth / 2, width, depth);
    polygon(
      context,
      view,
      corners.map((at) => mapFromRobot({ x, y, theta }, at)),
    );
  }
};

/** @param {Canvas2D} context @param {MapView} view @param {any} door @param {Paint} paint */
const leaf = (context, view, door, paint) => {
  const [[x, y], [endX, endY]] = [door.start, door.end];
  const theta = door.state === "closed" ? 0 : door.swing;
  const tip = mapFromRobot({ x, y, theta }, [endX - x, endY - y]);
  const width = Math.max(1.5, (door.leaf ?? 0.04) * view.scale);
  segment(context, view, door.start, tip, width, paint.door);
};

/** @param {Canvas2D} context @param {MapView} view @param {any} dock @param {Paint} paint */
const station = (context, view, dock, paint) => {
  bolt(context, ...toScreen(view, dock.x, dock.y), Math.max(4, 0.16 * view.scale));
  fill(context, paint.dock);
};

/** @param {Canvas2D} context @param {MapView} view @param {any} room @param {Paint} paint */
const title = (context, view, room, paint) => {
  const { left, right, bottom, top } = boundsOf(room.polygon);
  context.font = paint.font;
  if (context.measureText(room.title).width > (right - left) * view.scale - 8) {
    return;
  }
  label(context, room.title, ...toScreen(view, (left + right) / 2, (bottom + top) / 2), paint.name);
};
