/**
 * The map of a course in the study builder. The form's own buttons add checkpoints and zones, at
 * the point that the map writes into a field.
 */

import {
  formatPoints,
  parsePoints,
  rounded,
  withMoved,
  without,
  withPoint,
} from "./course_points.js";
import { readDecimal } from "../../lib/decimal.js";
import { make } from "../../lib/dom.js";
import { element, ground, pointList, UNIT, viewBoxOf } from "./course_ground.js";
import { MapEditor } from "./map_editor.js";

/**
 * @typedef {object} Handle
 * @property {string} id
 * @property {string} kind spot, point or corner
 * @property {string} label
 * @property {Point} at m
 * @property {(at: Point) => void} move
 * @property {(() => void) | null} remove
 * @property {string} [number]
 * @property {number} [radius] m
 * @property {string} [item] its part of the form
 */

const PAUSE = 500; // ms without a change until the server checks the course
const TOOL = "course-tool";

const page = /** @type {HTMLElement | null} */ (document.getElementById("course"));
const form = /** @type {HTMLFormElement} */ (document.getElementById("part"));

/** A field of the form. @param {string} name */
const field = (name) => /** @type {HTMLInputElement | null} */ (form.elements.namedItem(name));

/** @param {string} name @param {string} value */
const write = (name, value) => {
  const input = field(name);
  if (input) {
    input.value = value;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }
};

/** Marks a part of the form. @param {string} item */
const mark = (item) => {
  for (const part of form.querySelectorAll("[data-item]")) {
    part.classList.toggle("is-chosen", /** @type {HTMLElement} */ (part).dataset.item === item);
  }
};

/** @param {string} title @returns {Handle[]} */
const checkpoints = (title) => {
  const found = [];
  for (let n = 0; field(`checkpoints.${n}`); n += 1) {
    const [x, y, radius] = ["x", "y", "radius"].map((key) =>
      readDecimal(field(`checkpoints.${n}.${key}`)?.value ?? ""),
    );
    if (Number.isFinite(x) && Number.isFinite(y)) {
      found.push({
        id: `c${n}`,
        kind: "spot",
        label: `${title} ${n}`,
        at: /** @type {Point} */ ([x, y]),
        number: String(n),
        item: `checkpoints.${n}`,
        radius: Number.isFinite(radius) ? radius : 0.6,
        remove: null,
        move: (/** @type {Point} */ at) =>
          ["x", "y"].forEach((key, axis) =>
            write(`checkpoints.${n}.${key}`, String(rounded(at[axis]))),
          ),
      });
    }
  }
  return found;
};

/**
 * @param {string} name @param {string} kind @param {number} least @param {string} [item]
 * @returns {Handle[]}
 */
const pointsOf = (name, kind, least, item) => {
  const points = parsePoints(field(name)?.value ?? "") ?? [];
  const label = field(name)?.labels?.[0]?.textContent?.trim() ?? name;
  return points.map((at, n) => ({
    id: `${name}${n}`,
    kind,
    label: `${label} ${n + 1}`,
    at,
    item,
    move: (to) => write(name, formatPoints(withMoved(points, n, to))),
    remove: () => write(name, formatPoints(without(points, n, least))),
  }));
};

/** @returns {Handle[]} */
const corners = () => {
  const found = [];
  for (let n = 0; field(`zones.${n}`); n += 1) {
    found.push(...pointsOf(`zones.${n}.polygon`, "corner", 3, `zones.${n}`));
  }
  return found;
};

/** Zones and path. @returns {SVGElement[]} */
const lines = () => {
  const found = [];
  for (let n = 0; field(`zones.${n}`); n += 1) {
    const points = parsePoints(field(`zones.${n}.polygon`)?.value ?? "");
    if (points) {
      const shape = { points: pointList(points), "stroke-width": 2 };
      found.push(element("polygon", { class: "course__zone", ...shape }));
    }
  }
  const path = parsePoints(field("path")?.value ?? "");
  if (path) {
    const shape = { points: pointList(path), "stroke-width": 5 };
    found.push(element("polyline", { class: "course__path", ...shape }));
  }
  return found;
};

/** @extends {MapEditor<Handle>} */
class CourseMap extends MapEditor {
  /** @param {HTMLElement} page */
  constructor(page) {
    const text = document.getElementById("course-ground")?.textContent ?? "";
    const { plan: site, robot } = JSON.parse(text);
    super("course-map", viewBoxOf(site), TOOL, "move");
    this.words = page.dataset;
    // the top layer receives clicks first
    this.layers = /** @type {Record<string, SVGElement>} */ ({
      drawn: element("g"),
      corner: element("g"),
      point: element("g"),
      spot: element("g"),
    });
    this.svg.append(ground(site, robot), ...Object.values(this.layers));
    this.unreachable = /** @type {number[]} */ ([]);
    this.waiting = 0;
    this.asked = new AbortController();
    this.#chooseTool();
    form.addEventListener("input", (event) => this.#changed(event));
    this.draw();
    if (this.mayChange()) {
      void this.check();
    }
  }

  mayChange() {
    return !form.querySelector("fieldset")?.disabled;
  }

  /** @param {Handle} handle */
  choose({ item }) {
    mark(item ?? "");
  }

  /** @param {Handle} handle @returns {SVGElement} */
  #drawn({ kind, number, radius = 0.6 }) {
    const isSpot = kind === "spot";
    const near = { class: "course__near", r: radius * UNIT, "stroke-width": 1.5 };
    const marks = this.marks(`course__${kind}`, isSpot ? 12 : 5, number, !isSpot);
    return element("g", {}, isSpot ? [element("circle", near), ...marks] : marks);
  }

  draw() {
    const { layers } = this;
    layers.drawn.replaceChildren(...lines());
    const handles = [
      ...corners(),
      ...pointsOf("path", "point", 0),
      ...checkpoints(this.words.wordsCheckpoint ?? ""),
    ];
    this.drawHandles(
      handles,
      (handle) => this.#drawn(handle),
      ({ kind }) => layers[kind],
    );
    for (const { group, handle } of this.shown.values()) {
      const isWrong = this.unreachable.includes(Number(handle.number));
      group.classList.toggle("is-unreachable", handle.kind === "spot" && isWrong);
    }
  }

  /** Has the server check the course. */
  async check() {
    this.asked.abort();
    this.asked = new AbortController();
    const place = /** @type {HTMLElement} */ (document.getElementById("course-check"));
    try {
      const [body, { signal }] = [new FormData(form), this.asked];
      const answer = await fetch(this.words.check ?? "", { method: "POST", body, signal });
      if (!answer.ok) {
        throw new TypeError(String(answer.status));
      }
      const { problems, checkpoints: wrong } = await answer.json();
      this.unreachable = wrong;
      const list = make("ul");
      list.append(...problems.map((/** @type {string} */ problem) => make("li", "", problem)));
      place.replaceChildren(...(problems.length ? [list] : [this.words.wordsFree ?? ""]));
      this.draw();
    } catch (error) {
      if (/** @type {Error} */ (error).name !== "AbortError") {
        place.textContent = this.words.wordsAway ?? "";
      }
    }
  }

  /** Chooses the last tool. */
  #chooseTool() {
    const last = sessionStorage.getItem(TOOL) ?? "move";
    const button = document.querySelector(`[name="${TOOL}"][value="${last}"]`);
    if (button) {
      /** @type {HTMLInputElement} */ (button).checked = true;
    }
    this.showTool();
  }

  /** @param {Point} at */
  add(at) {
    if (this.tool === "path") {
      write("path", formatPoints(withPoint(parsePoints(field("path")?.value ?? "") ?? [], at)));
    } else {
      write("at", `${rounded(at[0])} ${rounded(at[1])}`);
      this.submit(form);
    }
  }

  /** @param {Event} event */
  #changed({ target }) {
    if (/** @type {HTMLInputElement} */ (target).name === TOOL) {
      sessionStorage.setItem(TOOL, this.tool);
      this.showTool();
      return;
    }
    this.draw();
    clearTimeout(this.waiting);
    this.waiting = window.setTimeout(() => void this.check(), PAUSE);
  }
}

if (page) {
  new CourseMap(page);
}
