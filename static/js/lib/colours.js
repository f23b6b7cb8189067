/**
 * Returns a reader of the colours that style sheets give a canvas as custom properties. Reading a
 * style takes longer than drawing, so they are read once, as soon as the style sheets are loaded.
 * @param {Element} element
 * @param {string} prefix of the properties: `--map-`
 * @param {readonly string[]} names behind the prefix
 * @param {string} size weight and size of the font that texts are drawn in
 * @returns {() => Record<string, string>} colours by name, and `font`
 */
export const createPaint = (element, prefix, names, size) => {
  /** @type {Record<string, string> | null} */
  let known = null;

  return () => {
    if (known) {
      return known;
    }
    const style = getComputedStyle(element);
    const colours = names.map((name) => style.getPropertyValue(prefix + name).trim());
    /** @type {Record<string, string>} */
    const paint = { font: `${size} ${style.fontFamily}` };
    names.forEach((name, i) => (paint[name] = colours[i]));
    known = colours.every(Boolean) ? paint : null;
    return paint;
  };
};
