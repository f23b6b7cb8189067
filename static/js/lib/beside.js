/** Places an element beside a point of the box that it is positioned in. */

const FINGER = 34; // CSS pixels between the point and the element
const EDGE = 8;

/**
 * Above the point, or below it without room, and wholly within the box.
 * @param {{width: number, height: number}} size of the element
 * @param {{width: number, height: number}} box @param {Point} point CSS pixels
 * @returns {Point} its upper left corner
 */
export const cornerBeside = (size, box, [px, py]) => {
  const left = Math.max(EDGE, Math.min(px - size.width / 2, box.width - size.width - EDGE));
  const above = py - FINGER - size.height;
  const lowest = Math.max(EDGE, box.height - size.height - EDGE);
  return [left, above >= EDGE ? above : Math.min(py + FINGER, lowest)];
};

/** @param {HTMLElement} element @param {HTMLElement} box @param {Point} point CSS pixels */
export const placeBeside = (element, box, point) => {
  const sizeOf = (/** @type {HTMLElement} */ one) => ({
    width: one.offsetWidth,
    height: one.offsetHeight,
  });
  const [left, top] = cornerBeside(sizeOf(element), sizeOf(box), point).map(Math.round);
  element.style.transform = `translate(${left}px, ${top}px)`;
};
