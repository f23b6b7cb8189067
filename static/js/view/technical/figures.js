/**
 * The figures of the connection: their sources and formats. Pure. Times are in seconds; an unknown
 * figure is a dash. docs/reference/technical-readings.md explains them.
 */

import { decimalFormat } from "../../lib/decimal.js";
import { between, pick } from "../../protocol/link_stats.js";

const WINDOW = 3; // samples of a figure: a second, at two a second
const SMOOTHED = 9; // samples whose median is shown

/**
 * @typedef {object} Raw
 * @property {RTCPeerConnection | null} connection
 * @property {State} state
 * @property {Record<Transport, number | null>} trips round trip on each transport, s
 * @property {number | null} glass from the robot's camera to the screen, for the last frame, s
 * @property {Point} size pixels of the frame on the screen
 */

/** @typedef {{key: string, value: string, unit: string}} Figure */

/**
 * More of a getStats() report than `pick`.
 * @param {Iterable<any>} report @returns {{codec: string, freezes: number, frozen: number}}
 */
export const pickMore = (report) => {
  const all = Array.from(report);
  const video = all.find((entry) => entry.type === "inbound-rtp" && entry.kind === "video");
  const codec = all.find((entry) => entry.id === video?.codecId);
  return {
    codec: (codec?.mimeType ?? "").replace("video/", ""),
    freezes: video?.freezeCount ?? 0,
    frozen: video?.totalFreezesDuration ?? 0,
  };
};

/**
 * The kind of a path: `host/udp` is direct.
 * @param {string | undefined} path @returns {"direct" | "relay" | "server" | ""}
 */
export const pathKindOf = (path) => {
  const kind = path?.split("/")[0] ?? "";
  return kind === "server" || kind === "relay" ? kind : kind && "direct";
};

/** @param {number[]} values @returns {number | null} */
const middle = (values) => [...values].sort((a, b) => a - b)[values.length >> 1] ?? null;

/** @param {number | null | undefined} seconds */
const ms = (seconds) =>
  seconds === null || seconds === undefined ? "–" : String(Math.round(seconds * 1000));

export class Figures {
  /**
   * @param {(path: "direct" | "relay" | "server") => string} nameOfPathKind in the visitor's
   *   language
   * @param {string} language a BCP 47 tag
   */
  constructor(nameOfPathKind, language) {
    this.nameOfPathKind = nameOfPathKind;
    const digits = (/** @type {number} */ count) => {
      const format = decimalFormat(language, count, false);
      return (/** @type {number | undefined} */ value) =>
        value === undefined || Number.isNaN(value) ? "–" : format(value);
    };
    this.whole = digits(0);
    this.tenth = digits(1);
    /** @type {RTCPeerConnection | null} */
    this.connection = null;
    /** @type {import("../../protocol/link_stats.js").Sample[]} */
    this.samples = [];
    /** @type {number[]} */
    this.glass = [];
    /** @type {{age: number, frameAge?: number | null} | null} the last applied command */
    this.applied = null;
  }

  /** A new connection. */
  forget() {
    this.samples = [];
    this.glass = [];
    this.applied = null;
  }

  /**
   * @param {Raw} raw
   * @param {any[] | null} report all entries of getStats(), null without a connection
   * @returns {Figure[]}
   */
  read(raw, report) {
    if (raw.connection !== this.connection) {
      this.connection = raw.connection;
      this.forget();
    }
    const sample = report && pick(report);
    this.samples = sample ? [...this.samples, sample].slice(-WINDOW) : [];
    this.glass = raw.glass === null ? [] : [...this.glass, raw.glass].slice(-SMOOTHED);
    this.applied = raw.state.robot?.applied?.at(-1) ?? this.applied;
    const first = this.samples[0];
    const second = raw.state.slow ? raw.state.network : first && sample && between(first, sample);
    return this.#rows(raw, second ?? {}, report && !raw.state.slow ? pickMore(report) : null);
  }

  /**
   * @param {Raw} raw @param {any} second @param {ReturnType<typeof pickMore> | null} more
   * @returns {Figure[]}
   */
  #rows({ state, trips, size }, second, more) {
    const refusals = /** @type {number[]} */ (Object.values(state.robot?.refused ?? {}));
    const refused = refusals.reduce((sum, one) => sum + one, 0);
    const kind = pathKindOf(second.path);
    const path = kind ? [this.nameOfPathKind(kind), second.path.split("/")[1]].join(", ") : "–";
    const codec = state.slow ? "JPEG" : (more?.codec ?? "");
    const rows = [
      ["fps", this.whole(second.fps), "/s"],
      ["glass", ms(middle(this.glass)), "ms"],
      ["trip_direct", ms(trips.datachannel), "ms"],
      ["trip_server", ms(trips.mqtt), "ms"],
      ["age", ms(this.applied?.age), "ms"],
      ["loop", ms(this.applied?.frameAge), "ms"],
      ["refused", state.robot ? String(refused) : "–", ""],
      ["loss", this.tenth(second.loss * 100), "%"],
      ["jitter", ms(second.jitter), "ms"],
      ["rate", this.whole(second.bitrate / 1000), "kbit/s"],
      ["freezes", more ? `${more.freezes} (${this.tenth(more.frozen)} s)` : "–", ""],
      ["size", size[0] ? `${size[0]}×${size[1]} ${codec}`.trim() : "–", ""],
      ["path", path, ""],
    ];
    return rows.map(([key, value, unit]) => ({ key, value, unit }));
  }
}
