/**
 * The map of a course or of a plan: handles to move things, and a tool that adds things where the
 * map is clicked. The fields of the form are the state: handles write into them, and the map
 * follows.
 */

import { element, toUnits } from "./course_ground.js";
import { rounded } from "./course_points.js";
import { GRIP, movable, pointAt } from "./map_handles.js";

/** @typedef {import("./map_handles.js").Movable & {id: string, label: string}} AnyHandle */

/** @param {HTMLFormElement} form @returns {import("./plan_handles.js").Fields} */
export const fieldsOf = (form) => {
  const field = (/** @type {string} */ name) =>
    /** @type {HTMLInputElement | null} */ (form.elements.namedItem(name));
  return {
    read: (name) => {
      const input = field(name);
      return input && (input.type !== "checkbox" || input.checked) ? input.value : null;
    },
    write: (name, value) => {
      const input = field(name);
      if (input) {
        input.type === "checkbox" ? (input.checked = Boolean(value)) : (input.value = value);
        input.dispatchEvent(new Event("input", { bubbles: true }));
      }
    },
  };
};

/**
 * A subclass has `draw()`, `add(at)`, which adds a thing with the chosen tool, and
 * `choose(handle)`, for a handle that gets the focus.
 * @template {AnyHandle} Handle
 */
export class MapEditor {
  /**
   * @param {HTMLFormElement} form @param {string} id of the SVG
   * @param {[number, number, number, number]} viewBox
   * @param {string} toolName of the radio buttons @param {string} idle the tool that adds nothing
   */
  constructor(form, id, viewBox, toolName, idle) {
    this.form = form;
    this.svg = /** @type {any} */ (document.getElementById(id));
    this.viewBox = viewBox;
    this.svg.setAttribute("viewBox", viewBox.join(" "));
    this.toolName = toolName;
    this.idle = idle;
    /** @type {Map<string, {group: SVGElement, handle: Handle}>} */
    this.shown = new Map();
    this.svg.addEventListener("click", (/** @type {MouseEvent} */ event) => {
      const isHandle = /** @type {Element} */ (event.target).closest(".course__handle");
      if (this.tool !== this.idle && !isHandle && this.mayChange()) {
        /** @type {any} */ (this).add(pointAt(this.svg, event));
      }
    });
    new ResizeObserver(() => /** @type {any} */ (this).draw()).observe(this.svg);
  }

  mayChange() {
    return true;
  }

  /** Units a CSS pixel. */
  get pixel() {
    return this.viewBox[2] / Math.max(this.svg.clientWidth, 1);
  }

  get tool() {
    const chosen = document.querySelector(`[name="${this.toolName}"]:checked`);
    return /** @type {HTMLInputElement | null} */ (chosen)?.value ?? this.idle;
  }

  showTool() {
    this.svg.classList.toggle("is-adding", this.tool !== this.idle);
  }

  /** With the form's button for the tool, which makes a new part. */
  submit() {
    const button = this.form.querySelector(`[data-add="${this.tool}"]`);
    this.form.requestSubmit(/** @type {HTMLElement} */ (button));
  }

  /** Marks a part of the form, or none. @param {Element | null} part */
  mark(part) {
    this.form.querySelector(".is-chosen")?.classList.remove("is-chosen");
    part?.classList.add("is-chosen");
  }

  /**
   * @param {Handle[]} handles @param {(handle: Handle) => SVGElement} drawn
   * @param {(handle: Handle) => SVGElement} layerOf
   */
  drawHandles(handles, drawn, layerOf) {
    const ids = new Set(handles.map(({ id }) => id));
    for (const [id, { group }] of this.shown) {
      if (!ids.has(id)) {
        group.remove();
        this.shown.delete(id);
      }
    }
    for (const handle of handles) {
      const { id, label, at } = handle;
      const group = this.shown.get(id)?.group ?? this.#newGroup(id);
      this.shown.set(id, { group, handle });
      group.setAttribute("transform", `translate(${toUnits(at).join(" ")})`);
      group.setAttribute("aria-label", `${label}: ${at.map(rounded).join(" ")}`);
      group.replaceChildren(drawn(handle));
      if (!group.isConnected) {
        layerOf(handle).append(group);
      }
    }
  }

  /**
   * The parts of a handle: its mark, number, ring and grip.
   * @param {string} name class of the mark @param {number} size its radius, CSS px
   * @param {string | undefined} number @param {boolean} isSmall
   */
  marks(name, size, number, isSmall) {
    const { pixel } = this;
    const mark = element("circle", { class: name, r: size * pixel, "stroke-width": 2 * pixel });
    const text = element("text", { class: "course__number", "font-size": 14 * pixel });
    text.textContent = number ?? "";
    const width = { "stroke-width": 3 * pixel };
    const ring = element("circle", { class: "course__ring", r: (size + 4) * pixel, ...width });
    const r = (isSmall ? 0.55 * GRIP : GRIP) * pixel;
    return [mark, ...(number ? [text] : []), ring, element("circle", { class: "course__grip", r })];
  }

  /** @param {string} id */
  #newGroup(id) {
    const now = () => /** @type {{handle: Handle}} */ (this.shown.get(id)).handle;
    return movable({
      now,
      mayChange: () => this.mayChange(),
      worldAt: (event) => pointAt(this.svg, event),
      onFocus: () => /** @type {any} */ (this).choose(now()),
    });
  }
}
