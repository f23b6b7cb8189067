/**
 * Options that are put into an order: the rows stand in the order of their places, and whoever
 * moves one, by its list of places or by its handle, gives every option a place. Before that none
 * has one.
 */

/**
 * @template T
 * @param {T[]} things
 * @param {number} from
 * @param {number} to where it stands afterwards
 */
export const moved = (things, from, to) => {
  const others = things.filter((_, n) => n !== from);
  return [...others.slice(0, to), things[from], ...others.slice(to)];
};

/**
 * @typedef {{ top: number, bottom: number }} Span where a row stands, in CSS pixels from the top of
 *   what is seen
 */

/**
 * Which way a row goes that is held at a height: -1 before the one above, 1 behind the one below.
 * It stands under the pointer afterwards, or else it would go back at once where rows differ in
 * height.
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
 * Put rows into an order. One stays where it is and the others move round it, because taken out it
 * would lose focus and pointer.
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
    // A respondent who has given an order changes it, or clears the whole.
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
  const handle = document.createElement("span");
  handle.className = "ranking__handle";
  handle.setAttribute("aria-hidden", "true");
  /** @type {Element[] | null} the order before, while the row is held */
  let before = null;

  handle.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !event.isPrimary) return;
    handle.setPointerCapture(event.pointerId);
    before = rows();
    row.setAttribute("data-held", "");
  });
  handle.addEventListener("pointermove", (event) => {
    if (before) dragTo(row, event.clientY);
  });
  handle.addEventListener("pointerup", () => {
    if (!before) return;
    letGo();
    // Held and let go where it stood, it says that the order is right.
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
