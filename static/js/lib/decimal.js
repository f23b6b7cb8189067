/** Numbers as people write them. Pure. */

/**
 * A number with a point or the language's own decimal mark; NaN for what is none, or is empty. A
 * comma that is no decimal mark is no part of a number: "1,000" is a thousand to some and one to
 * others.
 * @param {string} text
 * @param {string} [language] a BCP 47 tag; without it the page's
 */
export const readDecimal = (text, language = globalThis.document?.documentElement.lang) => {
  const parts = new Intl.NumberFormat(language || "en").formatToParts(0.5);
  const mark = parts.find(({ type }) => type === "decimal")?.value ?? ".";
  return Number(text.trim().replace(mark, ".") || NaN);
};
