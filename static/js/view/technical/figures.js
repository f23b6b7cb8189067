/**
 * The connection in figures, for those who want to know: what each is made of, and how it is
 * written. Pure. Times are in seconds; a figure that is not known is a dash. What they mean is told
 * in docs/reference/technical-readings.md.
 */

import { between, pick } from "../../protocol/link_stats.js";

const WINDOW = 3; // samples that a figure is taken over: a second, at two a second
const SMOOTHED = 9; // samples of which the middle one counts, for what jumps

/**
 * @typedef {object} Raw
 * @property {RTCPeerConnection | null} connection
 * @property {State} state
 * @property {{datachannel: number | null, mqtt: number | null}} trips seconds to the robot and back
 *   on each way
 * @property {number | null} glass seconds from the robot's camera to the screen, when the last
 *   frame was shown
 * @property {Point} size pixels of the picture on the screen
 */

/** @typedef {{key: string, value: string, unit: string}} Figure */

/**
 * What getStats() tells beside `pick`.
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
 * Where pictures and commands go: `host/udp` is direct.
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

/** @param {string} language a BCP 47 tag @param {number} digits */
const format = (language, digits) =>
  new Intl.NumberFormat(language, {
    minimumFractionDigits: digits,
    maximumFractionDigits: digits,
    useGrouping: false,
  });

export class Figures {
  /**
   * @param {(path: "direct" | "relay" | "server") => string} nameOfPathKind in the visitor's
   *   language
   * @param {string} language a BCP 47 tag
   */
  constructor(nameOfPathKind, language) {
    this.nameOfPathKind = nameOfPathKind;
    const [whole, tenth] = [format(language, 0), format(language, 1)];
    this.whole = (/** @type {number | undefined} */ value) =>
      value === undefined ? "–" : whole.format(value);
    this.tenth = (/** @type {number | undefined} */ value) =>
      value === undefined ? "–" : tenth.format(value);
    /** @type {RTCPeerConnection | null} */
    this.connection = null;
    /** @type {import("../../protocol/link_stats.js").Sample[]} */
    this.samples = [];
    /** @type {number[]} */
    this.glass = [];
    /** @type {{age: number, frameAge?: number | null} | null} the last command at the wheels */
    this.applied = null;
  }

  /** Another connection has figures of its own. */
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
    const refused = Object.values(state.robot?.refused ?? {}).reduce(
      (sum, one) => sum + Number(one),
      0,
    );
    const kind = pathKindOf(second.path);
    const path = kind ? [this.nameOfPathKind(kind), second.path.split("/")[1]].join(", ") : "–";
    return [
      { key: "fps", value: this.whole(second.fps), unit: "/s" },
      { key: "glass", value: ms(middle(this.glass)), unit: "ms" },
      { key: "trip_direct", value: ms(trips.datachannel), unit: "ms" },
      { key: "trip_server", value: ms(trips.mqtt), unit: "ms" },
      { key: "age", value: ms(this.applied?.age), unit: "ms" },
      { key: "loop", value: ms(this.applied?.frameAge), unit: "ms" },
      { key: "refused", value: state.robot ? String(refused) : "–", unit: "" },
      {
        key: "loss",
        value: this.tenth(second.loss === undefined ? undefined : second.loss * 100),
        unit: "%",
      },
      { key: "jitter", value: ms(second.jitter), unit: "ms" },
      {
        key: "rate",
        value: this.whole(second.bitrate === undefined ? undefined : second.bitrate / 1000),
        unit: "kbit/s",
      },
      {
        key: "freezes",
        value: more ? `${more.freezes} (${this.tenth(more.frozen)} s)` : "–",
        unit: "",
      },
      {
        key: "size",
        value: size[0]
          ? `${size[0]}×${size[1]} ${state.slow ? "JPEG" : (more?.codec ?? "")}`.trim()
          : "–",
        unit: "",
      },
      { key: "path", value: path, unit: "" },
    ];
  }
}
