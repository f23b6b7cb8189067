/**
 * The server's messages to a hidden operator's page (sessions/wizard/protocol.py), with defaults
 * filled in; protocol/robot_api.js reads all others.
 */

import { isPassing } from "../../protocol/denials.js";
import { decodePacket } from "../../protocol/robot_api.js";

const STEP = {
  shortcut: "",
  text: "",
  aloud: true,
  action: "",
  place: "",
  angle: 0,
  drive: null,
  turn: null,
};
const DRIVE = { linear: 0, angular: 0 };

/** @param {any} step */
const stepOf = (step) => ({
  ...STEP,
  ...step,
  drive: step.drive ? { ...DRIVE, ...step.drive } : null,
});

/** @param {any} script */
const scriptOf = (script) =>
  script && {
    isOrdered: true,
    byHand: true,
    participantView: false,
    ...script,
    stages: (script.stages ?? []).map((/** @type {any} */ stage) => ({
      ...stage,
      steps: (stage.steps ?? []).map(stepOf),
    })),
  };

/** @type {Record<string, (message: any) => any>} */
const READERS = {
  "wizard/hello": (message) => ({ iceServers: [], ...message }),
  "wizard/session": (message) => ({
    session: null,
    participant: "",
    condition: "",
    visitorSeen: false,
    operator: "",
    done: [],
    ...message,
    script: scriptOf(message.script ?? null),
  }),
  "wizard/granted": (message) => message,
  "wizard/lost": (message) => message,
  "wizard/begun": (message) => ({ deviation: "", skipped: 0, reason: "", ...message }),
  "wizard/state": (message) => ({
    tilt: null,
    epoch: 0,
    commandAge: null,
    ...message,
    safety: { estop: false, inhibited: null, stopId: null, stopSeq: null, ...message.safety },
  }),
  "wizard/participant": (message) => ({
    cue: "",
    number: null,
    remaining: null,
    outcome: "",
    ...message,
  }),
};

/**
 * The notice about a denied request; null for none, such as for one velocity too many.
 * @param {{suffix: string, reason: string}} denied
 */
export const noticeOfDenied = ({ suffix, reason }) =>
  REQUEST.test(suffix) && isPassing({ reason }) ? "unavailable" : null;

const REQUEST = /^(command\/action|wizard\/(?!reached))/;

/**
 * @param {unknown} packet @returns {{suffix: string, message: any}}
 * @throws {import("../../protocol/robot_api.js").Rejection}
 */
export const readPacket = (packet) => {
  const newline = typeof packet === "string" ? packet.indexOf("\n") : -1;
  const suffix = newline < 0 ? "" : String(packet).slice(0, newline);
  return Object.hasOwn(READERS, suffix)
    ? { suffix, message: READERS[suffix](JSON.parse(String(packet).slice(newline + 1))) }
    : decodePacket(packet);
};
