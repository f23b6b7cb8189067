/**
 * A fresh id of the shape that the Robot API takes. `crypto.randomUUID` exists in secure contexts
 * only; this works in all.
 * @param {string} [prefix] @returns {string}
 */
export const freshId = (prefix = "") => {
  const bytes = crypto.getRandomValues(new Uint8Array(12));
  return prefix + Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
};
