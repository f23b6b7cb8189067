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
import { MapEditor, fieldsOf } from "./map_editor.js";
import { spot } from "./plan_handles.js";

/** @typedef {import("./plan_handles.js").Handle & {radius?: number}} Handle radius in m */

const PAUSE = 500; // ms without a change until the server checks the course
const TOOL = "course-tool";

const page = /** @type {HTMLElement | null} */ (document.getElementById("course"));
const form = /** @type {HTMLFormElement} */ (document.getElementById("part"));
const fields = fieldsOf(form);

/** The names of the parts of a list. @param {string} list @returns {string[]} */
const partsOf = (list) => {
  const found = [];
  while (fields.read(`${list}.${found.length}`) !== null) {
    found.push(`${list}.${found.length}`);
  }
  return found;
};

/** @param {string} title @returns {Handle[]} */
const checkpoints = (title) =>
  partsOf("checkpoints").flatMap((name, n) => {
    const part = { part: name, kind: "spot", label: `${title} ${n}`, number: String(n) };
    const handle = spot(part, fields, ["x", "y"], part.label);
    const radius = readDecimal(fields.read(`${name}.radius`) ?? "");
    return handle
      ? [{ ...handle, remove: null, radius: Number.isFinite(radius) ? radius : 0.6 }]
      : [];
  });

/**
 * @param {string} name @param {string} kind @param {number} least @param {string} part of the form
 * @returns {Handle[]}
 */
const pointsOf = (name, kind, least, part) => {
  const points = parsePoints(fields.read(name) ?? "") ?? [];
  const field = /** @type {HTMLInputElement | null} */ (form.elements.namedItem(name));
  const label = field?.labels?.[0]?.textContent?.trim() ?? name;
  return points.map((at, n) => ({
    id: `${name}${n}`,
    kind,
    label: `${label} ${n + 1}`,
    at,
    part,
    move: (to) => fields.write(name, formatPoints(withMoved(points, n, to))),
    remove: () => fields.write(name, formatPoints(without(points, n, least))),
  }));
};

const corners = () =>
  partsOf("zones").flatMap((zone) => pointsOf(`${zone}.polygon`, "corner", 3, zone));

/**
 * The line of the points in a field, none without points.
 * @param {string} name @param {string} tag @param {string} look @param {number} width
 */
const line = (name, tag, look, width) => {
  const points = parsePoints(fields.read(name) ?? "");
  const shape = { class: look, points: pointList(points ?? []), "stroke-width": width };
  return points ? [element(tag, shape)] : [];
};

/** Zones and path. */
const lines = () => [
  ...partsOf("zones").flatMap((zone) => line(`${zone}.polygon`, "polygon", "course__zone", 2)),
  ...line("path", "polyline", "course__path", 5),
];

/** @extends {MapEditor<Handle>} */
class CourseMap extends MapEditor {
  /** @param {HTMLElement} page */
  constructor(page) {
    const text = document.getElementById("course-ground")?.textContent ?? "";
    const { plan: site, robot } = JSON.parse(text);
    super(form, "course-map", viewBoxOf(site), TOOL, "move");
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
  choose({ part }) {
    this.mark(form.querySelector(`[data-item="${part}"]`));
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
      ...pointsOf("path", "point", 0, ""),
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
      fields.write(
        "path",
        formatPoints(withPoint(parsePoints(fields.read("path") ?? "") ?? [], at)),
      );
    } else {
      fields.write("at", `${rounded(at[0])} ${rounded(at[1])}`);
      this.submit();
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
