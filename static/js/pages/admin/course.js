/**
 * The map of a course in the study builder. The fields of the form are the state: what is dragged or moved by keys writes into them, and
 * what is written into them moves on the map. What makes a new checkpoint or zone is the form's own button, told where.
 */

import { isShortcut } from "../../input/key_dispatcher.js";
import { formatPoints, parsePoints, rounded, stepOf, withMoved, without, withPoint } from "./course_points.js";
import { element, ground, pointList, toUnits, UNIT, viewBoxOf } from "./course_ground.js";

/** @typedef {[number, number]} Point */
/**
 * @typedef {object} Handle something on the map that can be moved
 * @property {string} id @property {string} kind spot, point or corner @property {string} label @property {Point} at m
 * @property {(at: Point) => void} move @property {(() => void) | null} remove @property {string} [number] @property {number} [radius] m
 * @property {string} [item] the part of the form that it belongs to
 */

const PAUSE = 500; // ms without a change before the server is asked
const GRIP = 22; // CSS px: half of what a finger hits
const TOOL = "course-tool";

const page = /** @type {HTMLElement | null} */ (document.getElementById("course"));
const form = /** @type {HTMLFormElement} */ (document.getElementById("part"));

/** @param {HTMLElement} page */
const open = (page) => {
  const words = page.dataset;
  const svg = /** @type {any} */ (document.getElementById("course-map"));
  const { plan: site, robot } = JSON.parse(/** @type {HTMLElement} */ (document.getElementById("course-ground")).textContent ?? "");
  const viewBox = viewBoxOf(site);
  // What is on top is hit first: checkpoints over the path over zones, however they came.
  const layers = /** @type {Record<string, SVGElement>} */ ({ drawn: element("g"), corner: element("g"), point: element("g"), spot: element("g") });
  svg.setAttribute("viewBox", viewBox.join(" "));
  svg.append(ground(site, robot), ...Object.values(layers));
  const shown = new Map();
  let unreachable = /** @type {number[]} */ ([]);

  const field = (/** @type {string} */ name) => /** @type {HTMLInputElement | null} */ (form.elements.namedItem(name));
  const write = (/** @type {string} */ name, /** @type {string} */ value) => {
    const input = field(name);
    if (input) {
      input.value = value;
      input.dispatchEvent(new Event("input", { bubbles: true }));
    }
  };
  const mayChange = () => !form.querySelector("fieldset")?.disabled;

  /** @returns {Handle[]} */
  const checkpoints = () => {
    const found = [];
    for (let n = 0; field(`checkpoints.${n}`); n += 1) {
      const [x, y, radius] = ["x", "y", "radius"].map((key) => Number((field(`checkpoints.${n}.${key}`)?.value ?? "").replace(",", ".") || NaN));
      if (Number.isFinite(x) && Number.isFinite(y)) {
        found.push({
          id: `c${n}`, kind: "spot", label: `${words.wordsCheckpoint} ${n}`, at: /** @type {Point} */ ([x, y]), number: String(n), item: `checkpoints.${n}`,
          radius: Number.isFinite(radius) ? radius : 0.6, remove: null,
          move: (/** @type {Point} */ at) => ["x", "y"].forEach((key, axis) => write(`checkpoints.${n}.${key}`, String(rounded(at[axis])))),
        });
      }
    }
    return found;
  };

  /** @param {string} name @param {string} kind @param {number} least @param {string} [item] @returns {Handle[]} */
  const pointsOf = (name, kind, least, item) => {
    const points = parsePoints(field(name)?.value ?? "") ?? [];
    const label = field(name)?.labels?.[0]?.textContent?.trim() ?? name;
    return points.map((at, n) => ({
      id: `${name}${n}`, kind, label: `${label} ${n + 1}`, at, item,
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

  const drawLines = () => {
    const lines = [];
    for (let n = 0; field(`zones.${n}`); n += 1) {
      const zone = parsePoints(field(`zones.${n}.polygon`)?.value ?? "");
      lines.push(...(zone ? [element("polygon", { class: "course__zone", points: pointList(zone), "stroke-width": 2 })] : []));
    }
    const path = parsePoints(field("path")?.value ?? "");
    lines.push(...(path ? [element("polyline", { class: "course__path", points: pointList(path), "stroke-width": 5 })] : []));
    layers.drawn.replaceChildren(...lines);
  };

  // --- handles ---

  /** @param {Handle} handle @param {number} pixel units @returns {SVGElement} */
  const drawn = (handle, pixel) => {
    const parts = [];
    if (handle.kind === "spot") {
      parts.push(element("circle", { class: "course__near", r: (handle.radius ?? 0.6) * UNIT, "stroke-width": 1.5 }));
      parts.push(element("circle", { class: "course__spot", r: 12 * pixel }));
      const number = element("text", { class: "course__number", "font-size": 14 * pixel });
      number.textContent = handle.number ?? "";
      parts.push(number);
    } else {
      parts.push(element("circle", { class: `course__${handle.kind}`, r: 5 * pixel, "stroke-width": 2 * pixel }));
    }
    const size = handle.kind === "spot" ? GRIP : GRIP / 2;
    parts.push(element("circle", { class: "course__ring", r: 15 * pixel, "stroke-width": 3 * pixel }));
    parts.push(element("circle", { class: "course__grip", r: size * pixel }));
    return element("g", {}, parts);
  };

  /** @param {Handle} handle */
  const attached = (handle) => {
    const group = element("g", { class: "course__handle", tabindex: 0, role: "button" });
    group.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !mayChange()) {
        return;
      }
      event.preventDefault();
      group.focus();
      group.setPointerCapture(event.pointerId);
      const grip = worldAt(event);
      const from = shown.get(handle.id).handle.at;
      const follow = (/** @type {PointerEvent} */ moved) => {
        const to = worldAt(moved);
        shown.get(handle.id).handle.move([from[0] + to[0] - grip[0], from[1] + to[1] - grip[1]]);
      };
      group.addEventListener("pointermove", follow);
      for (const end of ["pointerup", "pointercancel"]) {
        group.addEventListener(end, () => group.removeEventListener("pointermove", follow), { once: true });
      }
    });
    group.addEventListener("keydown", (event) => {
      const { handle: now } = shown.get(handle.id);
      const step = stepOf(event.key, event.shiftKey);
      if (!mayChange() || isShortcut(event) || (!step && event.key !== "Delete")) {
        return;
      }
      event.preventDefault();
      if (step) {
        now.move([now.at[0] + step[0], now.at[1] + step[1]]);
      } else {
        now.remove?.();
      }
    });
    group.addEventListener("focus", () => mark(handle.item ?? ""));
    return group;
  };

  /** @param {string} item shows which part of the form is chosen */
  const mark = (item) => {
    for (const part of form.querySelectorAll("[data-item]")) {
      part.classList.toggle("is-chosen", /** @type {HTMLElement} */ (part).dataset.item === item);
    }
  };

  const draw = () => {
    drawLines();
    const pixel = viewBox[2] / Math.max(svg.clientWidth, 1);
    const handles = [...corners(), ...pointsOf("path", "point", 0), ...checkpoints()];
    const ids = new Set(handles.map((handle) => handle.id));
    for (const [id, { group }] of shown) {
      if (!ids.has(id)) {
        group.remove();
        shown.delete(id);
      }
    }
    for (const handle of handles) {
      const group = shown.get(handle.id)?.group ?? attached(handle);
      shown.set(handle.id, { group, handle });
      const [x, y] = toUnits(handle.at);
      group.setAttribute("transform", `translate(${x} ${y})`);
      group.setAttribute("aria-label", `${handle.label}: ${rounded(handle.at[0])} ${rounded(handle.at[1])}`);
      group.classList.toggle("is-unreachable", handle.kind === "spot" && unreachable.includes(Number(handle.number)));
      group.replaceChildren(drawn(handle, pixel));
      if (!group.isConnected) {
        layers[handle.kind].append(group);
      }
    }
  };

  // --- the map itself ---

  /** @param {MouseEvent} event @returns {Point} m */
  const worldAt = (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [point.x / UNIT, -point.y / UNIT];
  };

  const tool = () => /** @type {HTMLInputElement | null} */ (page.querySelector(`[name="${TOOL}"]:checked`))?.value ?? "move";
  const showTool = () => svg.classList.toggle("is-adding", tool() !== "move");

  svg.addEventListener("click", (/** @type {MouseEvent} */ event) => {
    if (tool() === "move" || !mayChange() || /** @type {Element} */ (event.target).closest(".course__handle")) {
      return;
    }
    const at = worldAt(event);
    if (tool() === "path") {
      write("path", formatPoints(withPoint(parsePoints(field("path")?.value ?? "") ?? [], at)));
      return;
    }
    write("at", `${rounded(at[0])} ${rounded(at[1])}`);
    const button = form.querySelector(`[data-add="${tool()}"]`);
    form.requestSubmit(/** @type {HTMLElement} */ (button));
  });

  // --- what the server says of it ---

  const told = /** @type {HTMLElement} */ (document.getElementById("course-check"));
  let waiting = 0;
  let asked = new AbortController();

  /** @param {string[]} problems */
  const tell = (problems) => {
    const list = document.createElement("ul");
    list.append(...problems.map((problem) => Object.assign(document.createElement("li"), { textContent: problem })));
    told.replaceChildren(...(problems.length ? [list] : [words.wordsFree ?? ""]));
  };

  const check = async () => {
    asked.abort();
    asked = new AbortController();
    try {
      const answer = await fetch(words.check ?? "", { method: "POST", body: new FormData(form), signal: asked.signal });
      if (!answer.ok) {
        throw new TypeError(String(answer.status));
      }
      const { problems, checkpoints: wrong } = await answer.json();
      unreachable = wrong;
      tell(problems);
      draw();
    } catch (error) {
      if (/** @type {Error} */ (error).name !== "AbortError") {
        told.textContent = words.wordsAway ?? "";
      }
    }
  };

  form.addEventListener("input", (event) => {
    if (/** @type {HTMLInputElement} */ (event.target).name === TOOL) {
      sessionStorage.setItem(TOOL, tool());
      showTool();
      return;
    }
    draw();
    clearTimeout(waiting);
    waiting = window.setTimeout(check, PAUSE);
  });
  new ResizeObserver(draw).observe(svg);
  const last = page.querySelector(`[name="${TOOL}"][value="${sessionStorage.getItem(TOOL) ?? "move"}"]`);
  if (last) {
    /** @type {HTMLInputElement} */ (last).checked = true;
  }
  showTool();
  draw();
  if (mayChange()) {
    check();
  }
};

if (page) {
  open(page);
}
