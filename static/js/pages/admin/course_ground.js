/**
 * The ground of a course as SVG: rooms, walls, doors, mirrors and stations of a plan, or the image
 * of a map. One unit is a centimetre.
 */

import { boundsOfSite } from "../../view/map/floor_plan.js";
import { boundsOf } from "../../view/map/transform.js";

export const UNIT = 100; // units a metre
const MARGIN = 0.4; // m
const SVG = "http://www.w3.org/2000/svg";

/**
 * @param {string} tag @param {Record<string, string | number>} [attributes]
 * @param {Element[]} [children] @returns {SVGElement}
 */
export const element = (tag, attributes = {}, children = []) => {
  const made = /** @type {SVGElement} */ (document.createElementNS(SVG, tag));
  for (const [name, value] of Object.entries(attributes)) {
    made.setAttribute(name, String(value));
  }
  made.append(...children);
  return made;
};

/** @param {Point} point m @returns {Point} units, y down */
export const toUnits = ([x, y]) => [x * UNIT, -y * UNIT];

/** @param {Point[]} points @returns {string} */
export const pointList = (points) => points.map((point) => toUnits(point).join(",")).join(" ");

/** @param {string} kind @param {any} line @param {number} width m */
const segment = (kind, { start, end }, width) => {
  const [[x1, y1], [x2, y2]] = [toUnits(start), toUnits(end)];
  const name = `course__${kind}`;
  return element("line", { class: name, x1, y1, x2, y2, "stroke-width": width * UNIT });
};

/** @param {any} room */
const roomName = (room) => {
  const { left, right, bottom, top } = boundsOf(room.polygon);
  const [x, y] = toUnits([(left + right) / 2, (bottom + top) / 2]);
  const text = element("text", { class: "course__name", x, y, "font-size": 28 });
  text.textContent = room.title;
  return text;
};

/** @param {any} piece */
const furniture = (piece) => {
  const [x, y] = toUnits([piece.x, piece.y]);
  if (piece.shape === "cylinder") {
    const r = (piece.width / 2) * UNIT;
    return element("circle", { class: "course__furniture", cx: x, cy: y, r });
  }
  const [width, depth] = [piece.width * UNIT, (piece.depth ?? 0.5) * UNIT];
  const turn = `translate(${x} ${y}) rotate(${(-(piece.theta ?? 0) * 180) / Math.PI})`;
  const box = { x: -width / 2, y: -depth / 2, width, height: depth };
  return element("rect", { class: "course__furniture", ...box, transform: turn });
};

/** @param {any} dock @param {string} robot */
const station = (dock, robot) => {
  const [x, y] = toUnits([dock.x, dock.y]);
  const sign = element("path", {
    class: "course__dock",
    d: "M8 -34 L-18 4 L-2 4 L-8 34 L18 -6 L2 -6 Z",
    transform: `translate(${x} ${y})`,
  });
  sign.setAttribute("opacity", dock.type === robot ? "1" : "0.3");
  return sign;
};

/** @param {any} site robots.plans.floorplans.plan_content @returns {SVGElement} */
export const picture = ({ origin: [x, y, theta], resolution, width, height, image }) => {
  const [left, bottom] = toUnits([x, y]);
  const turn = [
    `translate(${left} ${bottom})`,
    `rotate(${(-theta * 180) / Math.PI})`,
    `translate(0 ${-height * resolution * UNIT})`,
  ].join(" ");
  const size = { width: width * resolution * UNIT, height: height * resolution * UNIT };
  return element("image", { href: image, ...size, transform: turn });
};

/** @param {any} site @param {string} robot @returns {SVGElement} */
export const ground = (site, robot) => {
  const plan = site.plan ?? {};
  if (!plan.rooms?.length) {
    return element("g", {}, [picture(site)]);
  }
  const openings = [...(plan.doors ?? []), ...(plan.passages ?? [])];
  return element("g", {}, [
    ...plan.rooms.map((/** @type {any} */ room) =>
      element("polygon", { class: "course__room", points: pointList(room.polygon) }),
    ),
    ...openings.map((opening) => segment("gap", opening, (opening.thickness ?? 0.15) + 0.02)),
    ...(plan.furniture ?? []).map(furniture),
    ...(plan.walls ?? []).map((/** @type {any} */ wall) =>
      segment("wall", wall, wall.thickness ?? 0.15),
    ),
    ...(plan.doors ?? []).map((/** @type {any} */ door) => segment("door", door, 0.06)),
    ...(plan.mirrors ?? []).map((/** @type {any} */ mirror) => segment("mirror", mirror, 0.08)),
    ...(plan.docks ?? []).map((/** @type {any} */ dock) => station(dock, robot)),
    ...plan.rooms.map(roomName),
  ]);
};

/**
 * @param {any} site
 * @returns {[number, number, number, number]} what the map shows: left, top, width, height in units
 */
export const viewBoxOf = (site) => {
  const { left, right, bottom, top } = boundsOfSite(site);
  const wide = (right - left + 2 * MARGIN) * UNIT;
  return [(left - MARGIN) * UNIT, -(top + MARGIN) * UNIT, wide, (top - bottom + 2 * MARGIN) * UNIT];
};
