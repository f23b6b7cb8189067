/**
 * The codec of pages for Robot API version 1 and the WebSocket's own words. messages.js has their
 * shapes.
 *
 * A packet is a suffix, a newline, and JSON. What `decodePacket` returns has the right types and
 * ranges, with defaults filled in; for anything else it throws a Rejection, which the caller counts
 * and drops. tests/golden/ binds it to the codecs in Python.
 */

import { TO_PAGE } from "./messages.js";
import { ShapeError } from "./shapes.js";

export { ON_DATA_CHANNEL } from "./messages.js";

export class Rejection extends Error {
  /** @param {"oversized" | "malformed" | "unknown_topic"} reason @param {string} detail */
  constructor(reason, detail) {
    super(`${reason}: ${detail}`);
    this.reason = reason;
  }
}

/**
 * @param {string} suffix
 * @param {object} message fields in camelCase; those that are undefined are left out
 * @returns {string}
 */
export const encodePacket = (suffix, message) => `${suffix}\n${JSON.stringify(message)}`;

const PICTURE = [..."picture\n"].map((letter) => letter.charCodeAt(0));
const LARGEST_PICTURE = 48 * 1024;
const STAMP_BYTES = 8;

/**
 * A picture that came through the server, the one binary packet there is: suffix, newline, capture
 * stamp, JPEG.
 * @param {ArrayBuffer} packet
 * @returns {{suffix: "picture", message: {stamp: number, jpeg: Uint8Array}}} @throws {Rejection}
 */
const decodePicture = (packet) => {
  const bytes = new Uint8Array(packet);
  const start = PICTURE.length + STAMP_BYTES;
  if (bytes.length > PICTURE.length + LARGEST_PICTURE) {
    throw new Rejection("oversized", `picture: ${bytes.length}`);
  }
  if (bytes.length < start + 4 || PICTURE.some((letter, at) => bytes[at] !== letter)) {
    throw new Rejection("malformed", "not a picture");
  }
  const taken = new DataView(packet).getFloat64(PICTURE.length);
  const isJpeg =
    bytes[start] === 0xff &&
    bytes[start + 1] === 0xd8 &&
    bytes.at(-2) === 0xff &&
    bytes.at(-1) === 0xd9;
  if (!(taken >= 0 && taken <= 1e11) || !isJpeg) {
    throw new Rejection("malformed", "not a picture of a time");
  }
  return { suffix: "picture", message: { stamp: taken, jpeg: bytes.subarray(start) } };
};

/**
 * @param {unknown} packet
 * @returns {{suffix: keyof Received, message: any}} @throws {Rejection}
 */
export const decodePacket = (packet) => {
  if (packet instanceof ArrayBuffer) {
    return decodePicture(packet);
  }
  if (typeof packet !== "string") {
    throw new Rejection("malformed", "not text");
  }
  const newline = packet.indexOf("\n");
  if (newline < 0) {
    throw new Rejection("malformed", "no suffix in front of the message");
  }
  const suffix = /** @type {keyof ToPage} */ (packet.slice(0, newline));
  return { suffix, message: decode(suffix, packet.slice(newline + 1)) };
};

/** @param {string} suffix @param {string} payload @throws {Rejection} */
export const decode = (suffix, payload) => {
  if (!Object.hasOwn(TO_PAGE, suffix)) {
    throw new Rejection("unknown_topic", suffix.slice(0, 80));
  }
  const [limit, shape] = TO_PAGE[suffix];
  // A character takes at least one byte, so that no bytes need be counted.
  if (payload.length > limit) {
    throw new Rejection("oversized", `${suffix}: ${payload.length} > ${limit}`);
  }
  try {
    return shape(JSON.parse(payload));
  } catch (error) {
    if (
      error instanceof SyntaxError ||
      error instanceof ShapeError ||
      error instanceof RangeError
    ) {
      throw new Rejection("malformed", `${suffix}: ${error.message}`);
    }
    throw error;
  }
};
