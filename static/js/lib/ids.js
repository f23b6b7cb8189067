/**
 * A fresh id of the shape that the Robot API takes. `crypto.randomUUID` exists in secure contexts
 * only; this works in all.
 * @param {string} [prefix] @returns {string}
 */
export const freshId = (prefix = "") => {
  return prefix + hexOf(crypto.getRandomValues(new Uint8Array(12)));
};

/** A version 4 UUID (RFC 9562), also in insecure contexts. */
export const newUuid = () => {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  bytes[6] = (bytes[6] & 0x0f) | 0x40;
  bytes[8] = (bytes[8] & 0x3f) | 0x80;
  return hexOf(bytes).replace(/^(.{8})(.{4})(.{4})(.{4})/, "$1-$2-$3-$4-");
};

/** @param {Uint8Array} bytes */
const hexOf = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
