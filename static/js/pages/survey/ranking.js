/**
 * Options to rank: the rows are in the order of their places. Moving one, by its list of places or
 * by its handle, gives every option a place; before that none has one.
 */

import { make } from "../../lib/dom.js";

/**
 * @template T
 * @param {T[]} things
 * @param {number} from @param {number} to its place afterwards
 */
export const moved = (things, from, to) => {
  const others = things.filter((_, n) => n !== from);
  return [...others.slice(0, to), things[from], ...others.slice(to)];
};

/**
 * @typedef {{ top: number, bottom: number }} Span of a row, CSS pixels from the top of the window
 */

/**
 * Where a row moves that is dragged to a height: -1 before the one above, 1 behind the one below.
 * It is under the pointer afterwards; otherwise rows of different heights would move back at once.
 *
 * @param {number} y @param {Span} own @param {Span | null} above @param {Span | null} below
 */
export const stepTo = (y, own, above, below) => {
  const height = own.bottom - own.top;
  if (above && y < Math.min(own.top, above.top + height)) return -1;
  if (below && y > Math.max(own.bottom, below.bottom - height)) return 1;
  return 0;
};

/** @param {Element} row */
const placesOf = (row) => /** @type {HTMLSelectElement} */ (row.querySelector("select"));

/** @param {Element} row its place from 1; 0 without one */
const placeOf = (row) => placesOf(row).selectedIndex;

/** @param {Element | null} row */
const spanOf = (row) => row && row.getBoundingClientRect();

/**
 * Puts rows into an order around one that stays, as it would lose focus and pointer if it was
 * moved.
 *
 * @param {Element[]} ordered @param {Element} kept
 */
const arrange = (ordered, kept) => {
  const at = ordered.indexOf(kept);
  kept.before(...ordered.slice(0, at));
  kept.after(...ordered.slice(at + 1));
};

/** @param {HTMLElement} holder */
export const keepOrder = (holder) => {
  const list = /** @type {HTMLElement} */ (holder.querySelector("ul"));
  const rows = () => [...list.children];

  const follow = () => {
    const all = rows();
    const isRanked = all.every((row) => placeOf(row) > 0);
    // An order can be changed, or cleared as a whole.
    for (const row of all) placesOf(row).options[0].disabled = isRanked;
    if (!isRanked) return;
    const ordered = [...all].sort((one, other) => placeOf(one) - placeOf(other));
    arrange(ordered, all.find((row) => row.contains(document.activeElement)) ?? all[0]);
  };

  list.addEventListener("change", (event) => {
    const row = /** @type {Element} */ (event.target).closest("li");
    if (!row || placeOf(row) === 0) return;
    const all = rows();
    const ordered = moved(all, all.indexOf(row), placeOf(row) - 1);
    ordered.forEach((one, n) => (placesOf(one).selectedIndex = n + 1));
    follow();
  });
  list.addEventListener("survey:restored", follow, true);
  for (const row of rows()) addHandle(row, rows);
  /** @type {HTMLElement} */ (holder.querySelector("[data-scripted]")).hidden = false;
  follow();
};

/**
 * A handle to drag a row by. The list of places is what a keyboard and a screen reader use.
 * @param {Element} row @param {() => Element[]} rows
 */
const addHandle = (row, rows) => {
  const handle = make("span", "ranking__handle");
  handle.setAttribute("aria-hidden", "true");
  /** @type {Element[] | null} the order before, while the row is dragged */
  let before = null;

  handle.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
    if (event.button !== 0 || !event.isPrimary) return;
    handle.setPointerCapture(event.pointerId);
    before = rows();
    row.setAttribute("data-held", "");
  });
  handle.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
    if (before) dragTo(row, event.clientY);
  });
  handle.addEventListener("pointerup", () => {
    if (!before) return;
    letGo();
    // A row that is released where it was confirms the order.
    const place = rows().indexOf(row) + 1;
    if (placeOf(row) === place) return;
    placesOf(row).selectedIndex = place;
    placesOf(row).dispatchEvent(new Event("change", { bubbles: true }));
  });
  handle.addEventListener("lostpointercapture", () => {
    if (!before) return;
    arrange(before, row);
    letGo();
  });
  const letGo = () => {
    before = null;
    row.removeAttribute("data-held");
  };
  row.prepend(handle);
};

/** @param {Element} row @param {number} y */
const dragTo = (row, y) => {
  for (;;) {
    const { previousElementSibling: above, nextElementSibling: below } = row;
    const step = stepTo(y, row.getBoundingClientRect(), spanOf(above), spanOf(below));
    if (step === 0) return;
    if (step < 0) row.after(/** @type {Element} */ (above));
    else row.before(/** @type {Element} */ (below));
  }
};
