/** What the visitor sends to the robot and what the page says about it: decisions only. */

/** s until a wish that the robot's state does not show is said again */
export const AGAIN_SECONDS = 1;

/**
 * @typedef {object} Own
 * @property {"off" | "asking" | "muted" | "on"} mic
 * @property {"off" | "asking" | "on"} camera
 * @property {boolean} shares whether a screen goes out in place of the camera's picture
 * @property {boolean} talking the key of push to talk is down
 * @property {number} volume how loud the visitor wants to be there, 0 to 1
 * @property {{kind: import("./devices.js").Kind, why: import("./devices.js").Trouble} | null}
 *   trouble
 * @property {boolean} turnedAway whether the people there have declined
 */

/** @returns {Own} */
export const newOwn = () => ({
  mic: "off",
  camera: "off",
  shares: false,
  talking: false,
  volume: 1,
  trouble: null,
  turnedAway: false,
});

/** Whether the voice goes out at this moment. @param {Own} own */
export const isHeard = ({ mic, talking }) => mic === "on" || (mic === "muted" && talking);

/** What the robot is to know: the fields of a call, null for none. @param {Own} own */
export const callOf = ({ mic, camera, shares, volume }) => {
  const audio = mic === "on" || mic === "muted";
  const video = camera === "on";
  return audio || video ? { ringing: true, audio, video, volume, shares: video && shares } : null;
};

/**
 * Whether the robot must be told again: it lets through something else than what is sent.
 * @param {Own} own
 * @param {any} known the call as the robot's state says it, null for none
 * @param {boolean} points whether this robot takes pointers, and so tells a screen from a face; an
 *   older one never says that it knows
 */
export const mustSay = (own, known, points) => {
  const wanted = callOf(own);
  if (!wanted || !known) {
    return Boolean(wanted) !== Boolean(known);
  }
  const differs =
    known.audio !== wanted.audio ||
    known.video !== wanted.video ||
    (points && known.shares !== wanted.shares);
  return differs || Math.abs(known.volume - wanted.volume) > 0.005;
};

/**
 * What of a screen that is shared the people there see, and whether a dot on it reaches them.
 * @param {Own} own
 * @param {any} known the call as the robot says it
 * @param {number} screens the robot's displays that are connected
 */
export const previewOf = (own, known, screens) => {
  const seen = own.shares && known?.status === "accepted" && known.video === true;
  return { seen, points: seen && known.shares === true && screens > 0 };
};

/**
 * The line beside the buttons: a sentence's key, empty for none.
 * @param {Own} own
 * @param {any} known the call as the robot says it
 * @param {number} screens the robot's displays that are connected
 */
export const noteOf = (own, known, screens) => {
  if (own.trouble) {
    return `presence.${own.trouble.kind}.${own.trouble.why}`;
  }
  if (own.mic === "asking" || own.camera === "asking") {
    return "presence.asking";
  }
  if (own.turnedAway) {
    return "presence.declined";
  }
  if (!callOf(own)) {
    return "";
  }
  if (known?.status === "ringing") {
    return screens ? "presence.ringing" : "presence.no_screen";
  }
  if (known?.status === "unanswered") {
    return "presence.unanswered";
  }
  if (known?.status !== "accepted") {
    return "presence.connecting";
  }
  if (own.shares) {
    return isHeard(own) ? "presence.shared_heard" : "presence.shared";
  }
  if (own.camera === "on") {
    return isHeard(own)
      ? "presence.both"
      : own.mic === "muted"
        ? "presence.seen_muted"
        : "presence.seen";
  }
  return isHeard(own) ? "presence.heard" : "presence.muted";
};
