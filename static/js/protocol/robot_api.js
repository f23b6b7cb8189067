/**
 * The words on the wire, for pages: Robot API version 1 as far as a page reads and writes it, and
 * the WebSocket's own words.
 *
 * A packet is a suffix, a newline, and JSON. `decodePacket` is the only door: what passes it has
 * the right types and ranges, with defaults filled in; what does not throws a Rejection, which the
 * caller counts and drops. tests/golden/ binds this file to robots/api and sessions/protocol.py.
 */

import {
  ShapeError,
  dictionary,
  flag,
  integer,
  list,
  matching,
  nullable,
  number,
  object,
  oneOf,
  optional,
  tagged,
  text,
  tuple,
} from "./shapes.js";

export class Rejection extends Error {
  /** @param {"oversized" | "malformed" | "unknown_topic"} reason @param {string} detail */
  constructor(reason, detail) {
    super(`${reason}: ${detail}`);
    this.reason = reason;
  }
}

const KIB = 1024;
const metres = number(-1e5, 1e5);
const radians = number(-7, 7);
const seconds = number(0, 1e6);
const stamp = number(0, 1e11);
const positive = number(Number.MIN_VALUE, 1e3);
const notNegative = number(0, 1e6);
const share = number(0, 1);
const count = integer(0, Number.MAX_SAFE_INTEGER);
const id = matching(/^[A-Za-z0-9_-]{1,64}$/);
const name = text(120);
const reason = text(300);
const point = tuple(metres, metres);
const variance = number(-1e10, 1e10);
const method = oneOf("keyboard", "mouse", "touch", "stick", "gamepad", "map", "script");
const way = oneOf("datachannel", "mqtt");
const assist = oneOf("off", "slow", "steer");
const absent = (/** @type {import("./shapes.js").Shape} */ shape) =>
  optional(nullable(shape), null);

const pose = object({
  x: metres,
  y: metres,
  theta: radians,
  covariance: absent(tuple(variance, variance, variance, variance, variance, variance)),
  localized: optional(flag, true),
  score: optional(share, 1),
});
const velocity = object({ linear: number(-10, 10), angular: number(-20, 20) });
const battery = object({
  charge: absent(share),
  voltage: absent(notNegative),
  charging: optional(nullable(flag), false),
});
const SAFE = {
  estop: false,
  estopSource: null,
  collision: false,
  inhibited: null,
  stopSeq: null,
  stopId: null,
  touched: [],
  button: null,
};
const safety = object({
  estop: optional(flag, false),
  estopSource: absent(name),
  collision: optional(flag, false),
  inhibited: absent(name),
  stopSeq: absent(count),
  stopId: absent(id),
  touched: optional(list(oneOf("ahead", "left", "behind", "right"), 4), []),
  button: absent(flag),
});
const applied = object({
  seq: count,
  stamp,
  method,
  way,
  age: number(-10, 1e4),
  linear: number(-10, 10),
  angular: number(-20, 20),
});
const limits = object({
  linear: positive,
  reverse: positive,
  angular: positive,
  linearAcceleration: positive,
  angularAcceleration: positive,
  linearBraking: positive,
  angularBraking: positive,
  commandAge: optional(positive, 0.25),
  commandAgeCeiling: optional(positive, 1),
  frameAge: optional(positive, 1),
  frameAgeCeiling: optional(positive, 3),
  deadman: optional(positive, 0.3),
});
const camera = object({
  width: integer(16, 7680),
  height: integer(16, 4320),
  fps: positive,
  hfov: number(0.1, 3.1),
  x: metres,
  z: metres,
  pitch: optional(radians, 0),
});
const tilt = object({
  minimum: radians,
  maximum: radians,
  home: optional(radians, 0),
  speed: optional(positive, 1),
});
const laser = object({ x: metres, y: optional(metres, 0), theta: optional(radians, 0) });
const EVENTS = [
  ...[
    "docked",
    "undocked",
    "charging",
    "goal_reached",
    "goal_blocked",
    "collision",
    "estop",
    "estop_cleared",
    "stopped",
    "photo",
  ],
  ...[
    "session_closed",
    "lease_taken",
    "lease_expired",
    "adapter_lost",
    "adapter_back",
    "localization_lost",
    "localization_found",
    "door_changed",
  ],
];
const NO_LIMITS = { linear: null, angular: null, commandAge: null, frameAge: null };
const leaseLimits = object({
  linear: absent(positive),
  angular: absent(positive),
  commandAge: absent(positive),
  frameAge: absent(positive),
});
const iceServer = object({
  urls: list(text(300), 8, 1),
  username: optional(text(300), ""),
  credential: optional(text(300), ""),
});
const iceServers = optional(list(iceServer, 8), []);

/**
 * What a page can be told: suffix → [the largest size in bytes, shape].
 * @type {Record<string, [number, import("./shapes.js").Shape]>}
 */
const TO_PAGE = {
  factsheet: [
    16 * KIB,
    object({
      name: id,
      series: name,
      rca: name,
      capabilities: list(text(20), 64),
      limits,
      footprint: list(point, 64, 3),
      camera: absent(camera),
      tilt: absent(tilt),
      laser: absent(laser),
      mapId: optional(name, ""),
      viewers: optional(integer(0, 64), 8),
    }),
  ],
  state: [
    32 * KIB,
    object({
      stamp,
      boot: id,
      seq: count,
      session: absent(id),
      epoch: optional(count, 0),
      pose,
      velocity,
      battery,
      docked: optional(flag, false),
      chargerContact: absent(flag),
      tilt: absent(radians),
      mode: optional(oneOf("manual", "assisted", "goto", "docking", "stopped"), "manual"),
      assist: optional(assist, "off"),
      safety: optional(safety, SAFE),
      errors: optional(list(reason, 16), []),
      clearance: absent(notNegative),
      contacts: optional(count, 0),
      distance: optional(notNegative, 0),
      visitorSilence: absent(seconds),
      viewers: optional(count, 0),
      applied: optional(list(applied, 64), []),
      refused: optional(dictionary(count, 64), {}),
      assistWhy: optional(name, ""),
      assistPoint: absent(point),
      call: absent(
        object({
          status: oneOf("ringing", "accepted", "declined", "unanswered"),
          audio: optional(flag, false),
          video: optional(flag, false),
          volume: optional(share, 1),
          shares: optional(flag, false),
        }),
      ),
      screens: optional(count, 0),
      knockable: optional(flag, false),
      knock: absent(
        object({ actionId: id, status: oneOf("ringing", "answered", "declined", "unanswered") }),
      ),
      cameraStatus: absent(
        object({ status: oneOf("starting", "failed"), reason: optional(reason, "") }),
      ),
    }),
  ],
  words: [
    4 * KIB,
    object({
      stamp,
      actionId: id,
      session: id,
      by: oneOf("driver", "screen"),
      who: optional(name, ""),
      text: text(500),
      language: optional(text(16), ""),
      aloud: optional(flag, false),
      receipts: optional(flag, false),
    }),
  ],
  receipt: [
    KIB,
    object({ stamp, actionId: id, session: id, state: oneOf("shown", "spoken", "not_spoken") }),
  ],
  pointer: [KIB, object({ stamp, by: oneOf("driver", "screen"), at: absent(tuple(share, share)) })],
  pose: [
    KIB,
    object({
      stamp,
      pose,
      velocity,
      tilt: absent(radians),
      assistWhy: optional(name, ""),
      assistPoint: absent(point),
    }),
  ],
  scan: [
    32 * KIB,
    object({
      stamp,
      angleMin: radians,
      angleIncrement: radians,
      rangeMax: positive,
      ranges: list(nullable(notNegative), 2000),
    }),
  ],
  path: [64 * KIB, object({ stamp, points: list(point, 2000) })],
  event: [
    4 * KIB,
    object({
      stamp,
      boot: id,
      seq: count,
      session: absent(id),
      epoch: optional(count, 0),
      type: oneOf(...EVENTS),
      actionId: absent(id),
      sha256: absent(text(64)),
      lastSeq: absent(count),
      detail: optional(reason, ""),
    }),
  ],
  action: [
    4 * KIB,
    object({
      actionId: id,
      status: oneOf("WAITING", "RUNNING", "FINISHED", "FAILED", "CANCELLED"),
      stamp,
      type: optional(name, ""),
      reason: optional(reason, ""),
      result: optional(
        dictionary((value) => value, 16),
        {},
      ),
    }),
  ],
  heartbeat: [
    4 * KIB,
    object({
      n: count,
      stamp,
      echoes: optional(list(object({ peer: id, n: count, stamp, received: stamp }), 16), []),
    }),
  ],
  media: [
    KIB,
    object({ rtp: integer(0, 2 ** 32 - 1), stamp, rate: optional(integer(1, 1e6), 90000) }),
  ],
  "signal/reply": [
    128 * KIB,
    tagged("type", {
      answer: object({ sdp: text(64000) }),
      candidate: object({
        candidate: optional(text(2000), ""),
        sdpMid: absent(text(64)),
        sdpMLineIndex: absent(integer(0, 64)),
      }),
      bye: object({ reason: optional(reason, "") }),
      offer: object({ sdp: text(64000) }),
    }),
  ],
  hello: [
    KIB,
    object({
      peer: id,
      stamp,
      robot: id,
      online: flag,
      mayDrive: flag,
      mayObserve: flag,
      liveElsewhere: optional(flag, false),
      liveSince: absent(stamp),
    }),
  ],
  "session/granted": [
    16 * KIB,
    object({
      session: id,
      epoch: count,
      peer: id,
      resumed: optional(flag, false),
      turnSeconds: absent(seconds),
      iceServers,
      limits: optional(leaseLimits, NO_LIMITS),
      terms: absent(
        object({
          label: optional(name, ""),
          controllers: absent(list(method, 16)),
          actions: absent(list(name, 32)),
          assist: absent(assist),
          controlWay: optional(oneOf("any", "datachannel", "mqtt"), "any"),
          interface: optional(name, ""),
        }),
      ),
    }),
  ],
  "session/task": [
    16 * KIB,
    object({
      session: id,
      stamp,
      cue: optional(name, ""),
      number: absent(count),
      x: absent(metres),
      y: absent(metres),
      passed: optional(list(count, 100), []),
      remaining: absent(seconds),
      window: optional(oneOf("shut", "open", "review"), "shut"),
      photo: optional(text(64), ""),
      outcome: optional(name, ""),
      doors: optional(list(name, 1000), []),
    }),
  ],
  "session/queued": [
    KIB,
    object({ session: id, place: count, minutes: notNegative, reason: optional(reason, "") }),
  ],
  "session/offered": [KIB, object({ session: id, seconds })],
  "session/observing": [16 * KIB, object({ iceServers, sfu: optional(flag, false) })],
  "session/refused": [
    KIB,
    object({
      reason: oneOf(
        "offline",
        "disabled",
        "not_invited",
        "not_trained",
        "elsewhere",
        "observers_full",
        "private",
        "not_allowed",
        "ended",
        "paused",
        "closed",
        "reserved",
        "full",
      ),
      session: absent(id),
      outcome: optional(name, ""),
      since: absent(stamp),
    }),
  ],
  "session/turn_warning": [KIB, object({ session: id, remaining: seconds })],
  "session/asked_there": [KIB, object({ session: id, seconds })],
  "session/found_there": [KIB, object({ session: id })],
  "session/ended": [2 * KIB, object({ session: id, outcome: name, reason: optional(reason, "") })],
  room: [
    KIB,
    object({
      driver: absent(name),
      driving: optional(flag, false),
      observers: optional(count, 0),
      waiting: optional(count, 0),
      pause: optional(reason, ""),
      private: optional(flag, false),
    }),
  ],
  audience: [
    64 * KIB,
    object({
      open: optional(flag, false),
      moderates: optional(flag, false),
      raised: optional(flag, false),
      hands: optional(count, 0),
      names: optional(list(name, 30), []),
      questions: optional(
        list(
          object({
            id,
            text: text(280),
            state: oneOf("waiting", "answering", "answered", "declined"),
            who: optional(name, ""),
            own: optional(flag, false),
          }),
          100,
        ),
        [],
      ),
    }),
  ],
  screen: [
    16 * KIB,
    object({
      title: name,
      titles: optional(dictionary(name, 50), {}),
      session: absent(id),
      visitor: absent(name),
      waiting: absent(name),
      study: optional(flag, false),
      iceServers,
    }),
  ],
  robot: [2 * KIB, object({ online: flag, reason: optional(reason, "") })],
  "session/operator_message": [2 * KIB, object({ session: id, text: reason })],
  "server/status": [
    2 * KIB,
    object({
      faults: optional(
        list(
          object({
            part: oneOf("broker", "session_manager", "database", "disk_low", "disk_full", "robot"),
            then: oneOf("waits", "stops", "stopped", "goes_on"),
            seconds: absent(seconds),
          }),
          8,
        ),
        [],
      ),
    }),
  ],
  denied: [2 * KIB, object({ suffix: name, reason: name })],
};

/** The suffixes that a robot's data channel may carry to a page. */
export const ON_DATA_CHANNEL = new Set([
  "state",
  "pose",
  "path",
  "scan",
  "event",
  "action",
  "heartbeat",
  "pointer",
  "media",
]);

/**
 * @param {string} suffix
 * @param {object} message fields in camelCase; those that are undefined are left out
 * @returns {string}
 */
export const encodePacket = (suffix, message) => `${suffix}\n${JSON.stringify(message)}`;

const PICTURE = [..."picture\n"].map((letter) => letter.charCodeAt(0));
const LARGEST_PICTURE = 48 * KIB;
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

/** @param {unknown} packet @returns {{suffix: string, message: any}} @throws {Rejection} */
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
  const suffix = packet.slice(0, newline);
  return { suffix, message: decode(suffix, packet.slice(newline + 1)) };
};

/** @param {string} suffix @param {string} payload @throws {Rejection} */
export const decode = (suffix, payload) => {
  if (!Object.hasOwn(TO_PAGE, suffix)) {
    throw new Rejection("unknown_topic", suffix.slice(0, 80));
  }
  const [limit, shape] = TO_PAGE[suffix];
  // A character takes at least one byte: what is longer than the limit is oversized without
  // counting bytes.
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
