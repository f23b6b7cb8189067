/** Numbers as people write them. Pure. */

/**
 * A number with a point or the language's decimal mark; NaN for anything else. A comma that is not
 * the decimal mark is refused: "1,000" is a thousand in some languages and one in others.
 * @param {string} text
 * @param {string} [language] a BCP 47 tag; without it the page's
 */
export const readDecimal = (text, language = globalThis.document?.documentElement.lang) => {
  const parts = new Intl.NumberFormat(language || "en").formatToParts(0.5);
  const mark = parts.find(({ type }) => type === "decimal")?.value ?? ".";
  return Number(text.trim().replace(mark, ".") || NaN);
};

/**
 * Writes numbers with so many decimals.
 * @param {string} language a BCP 47 tag @param {number} digits @param {boolean} [useGrouping]
 * @returns {(value: number) => string}
 */
export const decimalFormat = (language, digits, useGrouping = true) =>
  new Intl.NumberFormat(language, {
    minimumFractionDigits: digits,
    maximumFractionDigits: digits,
    useGrouping,
  }).format;
