/**
 * The map of the page that finishes a plan. The form's own buttons add things, at the point that
 * the map writes into its fields.
 */

import { element, ground, picture, toUnits, viewBoxOf } from "./course_ground.js";
import { rounded } from "./course_points.js";
import { MapEditor, fieldsOf } from "./map_editor.js";
import { handlesOf } from "./plan_handles.js";

/** @typedef {import("./plan_handles.js").Handle} Handle */
/** @typedef {import("./plan_handles.js").Part} Part */

const TOOL = "plan-tool";
const NAMED_WIDTH = 600; // CSS px of a map that shows names
/** @type {Record<string, [string, number]>} class and radius, CSS px */
const LOOKS = {
  opening: ["course__point", 7],
  dock: ["plan__dock", 12],
  heading: ["course__point", 6],
  place: ["plan__place", 8],
  checkpoint: ["course__spot", 12],
};

const form = /** @type {HTMLFormElement | null} */ (document.getElementById("plan"));

/**
 * Lines between the ends of openings, and from docks to their headings.
 * @param {Handle[]} handles @param {number} pixel @returns {SVGElement[]}
 */
const lines = (handles, pixel) =>
  handles.flatMap((handle, n) => {
    const next = handles[n + 1];
    if (next?.part !== handle.part) {
      return [];
    }
    const [[x1, y1], [x2, y2]] = [toUnits(handle.at), toUnits(next.at)];
    const kind = handle.kind === "dock" ? "plan__heading" : "plan__opening";
    return [element("line", { class: kind, x1, y1, x2, y2, "stroke-width": 4 * pixel })];
  });

/**
 * A line along each route, from checkpoint to checkpoint.
 * @param {Handle[]} handles @param {number} pixel @returns {SVGElement[]}
 */
const routes = (handles, pixel) => {
  /** @type {Map<string, string[]>} */
  const points = new Map();
  for (const { route, at } of handles) {
    if (route) {
      points.set(route, [...(points.get(route) ?? []), toUnits(at).join(",")]);
    }
  }
  const dashes = `${6 * pixel} ${6 * pixel}`;
  const looks = { class: "plan__route", "stroke-width": 2 * pixel, "stroke-dasharray": dashes };
  return [...points.values()].map((route) =>
    element("polyline", { ...looks, points: route.join(" ") }),
  );
};

/** @extends {MapEditor<Handle>} */
class PlanMap extends MapEditor {
  /** @param {HTMLFormElement} form */
  constructor(form) {
    const text = document.getElementById("plan-site")?.textContent ?? "";
    const site = JSON.parse(text);
    super(form, "plan-map", viewBoxOf(site), TOOL, "");
    this.fields = fieldsOf(form);
    this.site = site;
    this.layers = {
      ground: element("g"),
      picture: element("g", { class: "plan__picture" }, [picture(site)]),
      lines: element("g"),
      handles: element("g"),
    };
    this.svg.append(...Object.values(this.layers));
    form.addEventListener("input", (event) => this.#changed(event));
    form.addEventListener("focusin", (event) =>
      super.mark(/** @type {Element} */ (event.target).closest("[data-part]")),
    );
    this.showTool();
    this.#drawGround();
    this.draw();
  }

  /** @returns {Part[]} */
  #parts() {
    return [
      .../** @type {NodeListOf<HTMLElement>} */ (this.form.querySelectorAll("[data-part]")),
    ].map(({ dataset }) => {
      const { part = "", kind = "", number } = dataset;
      const title = this.fields.read(`${part}.title`) ?? "";
      const series = this.#series(part);
      const isStop = kind === "checkpoint";
      return {
        part,
        kind,
        number,
        label: title || `${kind} ${number ?? ""}`,
        name: isStop ? series : title,
        route: isStop ? series : undefined,
      };
    });
  }

  /** The robots that a part is for. @param {string} part */
  #series(part) {
    const select = /** @type {HTMLSelectElement | null} */ (
      this.form.elements.namedItem(`${part}.type`)
    );
    return select?.selectedOptions[0]?.text ?? "";
  }

  /** Shows the fields of the marked part. @param {Element | null} part */
  mark(part) {
    super.mark(part);
    const list = /** @type {HTMLElement | null | undefined} */ (part?.closest(".plan__parts"));
    if (list && part) {
      /** @type {HTMLDetailsElement} */ (part.closest("details")).open = true;
      list.scrollTop += part.getBoundingClientRect().top - list.getBoundingClientRect().top;
    }
  }

  /**
   * A mark with its name below, where the map is large enough for names.
   * @param {string | undefined} name @param {number} size radius of the mark, CSS px
   * @param {SVGElement[]} marks
   */
  #named(name, size, marks) {
    const { pixel } = this;
    if (!name || this.svg.clientWidth < NAMED_WIDTH) {
      return marks;
    }
    const place = { y: (size + 12) * pixel, "font-size": 12 * pixel, "stroke-width": 3 * pixel };
    const text = element("text", { class: "plan__name", ...place });
    text.textContent = name;
    return [text, ...marks];
  }

  /** The fixed parts of the plan, with the present titles of rooms. */
  #drawGround() {
    const rooms = this.site.plan.rooms.map((/** @type {any} */ room, /** @type {number} */ n) => ({
      ...room,
      title: this.fields.read(`rooms.${n}.title`) ?? room.title,
    }));
    const plan = { ...this.site.plan, rooms, doors: [], passages: [], docks: [] };
    this.layers.ground.replaceChildren(ground({ ...this.site, plan }, ""));
  }

  draw() {
    const { form, layers, pixel } = this;
    const { wordsEnd: end = "", wordsHeading: heading = "" } = form.dataset;
    const words = { end, heading };
    const handles = this.#parts().flatMap((part) => handlesOf(part, this.fields, words));
    layers.lines.replaceChildren(...routes(handles, pixel), ...lines(handles, pixel));
    this.drawHandles(
      handles,
      ({ kind, number, name }) => {
        const isSmall = kind !== "dock" && kind !== "checkpoint";
        const marks = this.marks(...LOOKS[kind], number, isSmall);
        return element("g", {}, this.#named(name, LOOKS[kind][1], marks));
      },
      () => layers.handles,
    );
  }

  /** @param {Handle} handle */
  choose({ part }) {
    this.mark(this.form.querySelector(`[data-part="${part}"]`));
  }

  /** @param {Point} at */
  add([x, y]) {
    this.fields.write("at_x", String(rounded(x)));
    this.fields.write("at_y", String(rounded(y)));
    this.submit();
  }

  /** @param {Event} event */
  #changed({ target }) {
    const { name } = /** @type {HTMLInputElement} */ (target);
    if (name === TOOL) {
      this.showTool();
    } else if (/^rooms\.\d+\.title$/.test(name)) {
      this.#drawGround();
    }
    this.draw();
  }
}

if (form) {
  new PlanMap(form);
}
