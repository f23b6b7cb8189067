/**
 * What the robot's last state still tells: why a connected robot cannot be driven, as
 * robots/presence/report.py has it for lists and the queue, and its present state. Pure.
 */

const STALE_SECONDS = 4; // robots speak at least once a second to a page that is open

const THERE = new Set(["screen", "button"]);

/** @param {any} robot its state @param {string} code of an error @returns {boolean} */
export const reports = (robot, code) =>
  Boolean(robot?.errors?.some((/** @type {string} */ error) => error.startsWith(`${code}: `)));

/**
 * @param {any} robot its last state, null before one came
 * @returns {"" | "runs_on" | "estop_there" | "estop" | "not_connected" | "fault"} `runs_on`: it
 *   moves although it should be at rest, for the server a `fault`; `estop_there`: a person at the
 *   robot pressed it
 */
export const standstillOf = (robot) => {
  if (reports(robot, "runs_on")) {
    return "runs_on";
  }
  if (robot?.safety.estop) {
    return THERE.has((robot.safety.estopSource ?? "").split(":")[0]) ? "estop_there" : "estop";
  }
  if (isAway(robot)) {
    return "not_connected";
  }
  return robot?.safety.inhibited === "fault" ? "fault" : "";
};

/** Whether its agent does not reach it. @param {any} robot its last state */
export const isAway = (robot) =>
  reports(robot, "adapter_lost") || reports(robot, "adapter_starting");

/**
 * Whether neither the server nor the page reaches it: what it said last may be over.
 * @param {State} state
 */
export const isCutOff = ({ visit, serverSilent }) =>
  visit.link !== "live" && (!visit.online || visit.socket === "lost" || serverSilent);

/**
 * Its last state, while that is of the present: a robot that has gone has no speed any more.
 * @param {State} state
 * @returns {any} null without a state for some seconds
 */
export const knownNow = ({ robot, robotAt, now }) => (now - robotAt > STALE_SECONDS ? null : robot);
