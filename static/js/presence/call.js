/** The visitor's call: what is sent to the robot, and the page's note about it. Pure. */

export const AGAIN_SECONDS = 1; // until a call that the robot's state does not show is repeated

/**
 * @typedef {object} Own
 * @property {"off" | "asking" | "muted" | "on"} mic
 * @property {"off" | "asking" | "on"} camera
 * @property {boolean} shares whether a screen is sent in place of the camera's video
 * @property {boolean} talking the key of push to talk is down
 * @property {number} volume of the visitor at the robot, 0 to 1
 * @property {{kind: import("./devices.js").Kind, why: import("./devices.js").Trouble} | null}
 *   trouble
 * @property {boolean} turnedAway whether the people at the robot have declined
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

/** Whether the voice is sent now. @param {Own} own */
export const isHeard = ({ mic, talking }) => mic === "on" || (mic === "muted" && talking);

/** The fields of the call to request, null for none. @param {Own} own */
export const callOf = ({ mic, camera, shares, volume }) => {
  const audio = mic === "on" || mic === "muted";
  const video = camera === "on";
  return audio || video ? { ringing: true, audio, video, volume, shares: video && shares } : null;
};

/**
 * Whether to send the request again: the robot's state differs from it.
 * @param {Own} own
 * @param {any} known the call in the robot's state, null for none
 * @param {boolean} points whether this robot takes pointers, and therefore reports `shares`
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
 * Whether the people at the robot see the shared screen, and whether pointers on it reach them.
 * @param {Own} own
 * @param {any} known the call in the robot's state
 * @param {number} screens connected displays of the robot
 */
export const previewOf = (own, known, screens) => {
  const seen = own.shares && known?.status === "accepted" && known.video === true;
  return { seen, points: seen && known.shares === true && screens > 0 };
};

/**
 * The note beside the buttons: the key of a sentence, empty for none. An older robot cannot tell
 * what its display shows or plays.
 * @param {Own} own
 * @param {any} known the call in the robot's state
 * @param {number} screens connected displays of the robot
 * @param {boolean} hasScreen whether a display was set up for this robot
 */
export const noteOf = (own, known, screens, hasScreen = true) => {
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
  const isOff = screens === 0 && !known?.shown && !known?.audible;
  if (isOff && (known?.status === "ringing" || known?.status === "accepted")) {
    return hasScreen ? "presence.screen_off" : "presence.no_screen";
  }
  if (known?.status === "ringing") {
    return "presence.ringing";
  }
  if (known?.status === "unanswered") {
    return "presence.unanswered";
  }
  if (known?.status !== "accepted") {
    return "presence.connecting";
  }
  if (own.camera === "on" && known.shown === false) {
    return "presence.unseen";
  }
  if (isHeard(own) && known.audible === false) {
    return "presence.unheard";
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
