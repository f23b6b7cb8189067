/**
 * The map of a course in the study builder. The fields of the form are the state: what is dragged
 * or moved by keys writes into them, and what is written into them moves on the map. What makes a
 * new checkpoint or zone is the form's own button, told where.
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
import { element, ground, pointList, UNIT, viewBoxOf } from "./course_ground.js";
import { MapEditor } from "./map_editor.js";
import { GRIP } from "./map_handles.js";

/**
 * @typedef {object} Handle something on the map that can be moved
 * @property {string} id
 * @property {string} kind spot, point or corner
 * @property {string} label
 * @property {Point} at m
 * @property {(at: Point) => void} move
 * @property {(() => void) | null} remove
 * @property {string} [number]
 * @property {number} [radius] m
 * @property {string} [item] the part of the form that it belongs to
 */

const PAUSE = 500; // ms without a change before the server is asked
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

/** Shows which part of the form is chosen. @param {string} item */
const mark = (item) => {
  for (const part of form.querySelectorAll("[data-item]")) {
    part.classList.toggle("is-chosen", /** @type {HTMLElement} */ (part).dataset.item === item);
  }
};

/** @param {string} title of a checkpoint in general @returns {Handle[]} */
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
    const zone = parsePoints(field(`zones.${n}.polygon`)?.value ?? "");
    found.push(
      ...(zone
        ? [
            element("polygon", {
              class: "course__zone",
              points: pointList(zone),
              "stroke-width": 2,
            }),
          ]
        : []),
    );
  }
  const path = parsePoints(field("path")?.value ?? "");
  return [
    ...found,
    ...(path
      ? [element("polyline", { class: "course__path", points: pointList(path), "stroke-width": 5 })]
      : []),
  ];
};

/** @param {Handle} handle @param {number} pixel units @returns {SVGElement} */
const drawn = (handle, pixel) => {
  const parts = [];
  if (handle.kind === "spot") {
    parts.push(
      element("circle", {
        class: "course__near",
        r: (handle.radius ?? 0.6) * UNIT,
        "stroke-width": 1.5,
      }),
    );
    parts.push(element("circle", { class: "course__spot", r: 12 * pixel }));
    const number = element("text", { class: "course__number", "font-size": 14 * pixel });
    number.textContent = handle.number ?? "";
    parts.push(number);
  } else {
    parts.push(
      element("circle", {
        class: `course__${handle.kind}`,
        r: 5 * pixel,
        "stroke-width": 2 * pixel,
      }),
    );
  }
  const size = handle.kind === "spot" ? GRIP : GRIP / 2;
  parts.push(
    element("circle", { class: "course__ring", r: 15 * pixel, "stroke-width": 3 * pixel }),
  );
  parts.push(element("circle", { class: "course__grip", r: size * pixel }));
  return element("g", {}, parts);
};

/** @extends {MapEditor<Handle>} */
class CourseMap extends MapEditor {
  /** @param {HTMLElement} page */
  constructor(page) {
    const text = document.getElementById("course-ground")?.textContent ?? "";
    const { plan: site, robot } = JSON.parse(text);
    super("course-map", viewBoxOf(site), TOOL, "move");
    this.words = page.dataset;
    // The top layer receives clicks first: checkpoints over the path over zones.
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

  draw() {
    const { layers, pixel } = this;
    layers.drawn.replaceChildren(...lines());
    const handles = [
      ...corners(),
      ...pointsOf("path", "point", 0),
      ...checkpoints(this.words.wordsCheckpoint ?? ""),
    ];
    this.drawHandles(
      handles,
      (handle) => drawn(handle, pixel),
      ({ kind }) => layers[kind],
    );
    for (const { group, handle } of this.shown.values()) {
      const isWrong = this.unreachable.includes(Number(handle.number));
      group.classList.toggle("is-unreachable", handle.kind === "spot" && isWrong);
    }
  }

  /** Ask the server what it says of the course. */
  async check() {
    this.asked.abort();
    this.asked = new AbortController();
    const place = /** @type {HTMLElement} */ (document.getElementById("course-check"));
    try {
      const answer = await fetch(this.words.check ?? "", {
        method: "POST",
        body: new FormData(form),
        signal: this.asked.signal,
      });
      if (!answer.ok) {
        throw new TypeError(String(answer.status));
      }
      const { problems, checkpoints: wrong } = await answer.json();
      this.unreachable = wrong;
      const list = document.createElement("ul");
      list.append(
        ...problems.map((/** @type {string} */ problem) =>
          Object.assign(document.createElement("li"), { textContent: problem }),
        ),
      );
      place.replaceChildren(...(problems.length ? [list] : [this.words.wordsFree ?? ""]));
      this.draw();
    } catch (error) {
      if (/** @type {Error} */ (error).name !== "AbortError") {
        place.textContent = this.words.wordsAway ?? "";
      }
    }
  }

  /** Choose the tool that was used last. */
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
