/**
 * The words for requests that the server denies. Pure. Commands that the robot must confirm (a
 * velocity, a stop, a signal) have alerts of their own: view/hud/alert.js.
 */

/** @type {Record<string, string>} by the suffix of the request */
const WORDS = {
  "session/take": "denied.take",
  "session/observe": "denied.observe",
  "session/leave": "denied.leave",
  "session/assist": "denied.assist",
  "command/action": "denied.action",
  "audience/hand": "denied.request",
  "audience/mark": "denied.request",
  "audience/lower": "denied.request",
};

/** The same request may succeed later. */
const PASSING = new Set(["unavailable", "busy", "rate"]);

/**
 * The word of the alert; empty for none, as when the drive has ended, which the page shows anyway.
 * @param {{suffix: string, reason: string}} denied
 */
export const wordOfDenial = ({ suffix, reason }) => {
  if (suffix === "session/assist" && reason === "fixed") {
    return "denied.assist_fixed";
  }
  if (reason === "not_allowed") {
    return suffix in WORDS ? "denied.not_allowed" : "";
  }
  return isPassing({ reason }) ? (WORDS[suffix] ?? "") : "";
};

/** Whether the request may be repeated. @param {{reason: string}} denied */
export const isPassing = ({ reason }) => PASSING.has(reason);

/**
 * Whether the denied request still waits for an answer.
 * @param {string} word of the denial @param {Visit} visit
 */
export const isUnsettled = (word, { phase, unsaid, observesAgain }) =>
  ({
    "denied.take": phase === "taking",
    "denied.observe": phase === "taking" || observesAgain,
    "denied.leave": unsaid !== null,
  })[word] ?? true;
