/**
 * From the robot's last state: why a connected robot cannot be driven, as robots/presence/report.py
 * decides for lists and the queue, and whether the state is still valid. Pure.
 */

const STALE_SECONDS = 4; // robots send a state at least once a second to an open page
const THERE = new Set(["screen", "button"]);

/** @param {any} robot its state @param {string} code of an error @returns {boolean} */
export const reports = (robot, code) =>
  Boolean(robot?.errors?.some((/** @type {string} */ error) => error.startsWith(`${code}: `)));

/**
 * @param {any} robot its last state, or null
 * @returns {"" | "runs_on" | "estop_there" | "estop" | "not_connected" | "fault"} `runs_on`: it
 *   moves although it should be at rest, a fault to the server; `estop_there`: pressed at the robot
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

/** Whether its agent has no connection to it. @param {any} robot its last state */
export const isAway = (robot) =>
  reports(robot, "adapter_lost") || reports(robot, "adapter_starting");

/**
 * Whether it reaches neither the server nor the page: its last state may be outdated.
 * @param {State} state
 */
export const isCutOff = ({ visit, serverSilent }) =>
  visit.link !== "live" && (!visit.online || visit.socket === "lost" || serverSilent);

/** Its last state, null after some seconds without one. @param {State} state @returns {any} */
export const knownNow = ({ robot, robotAt, now }) => (now - robotAt > STALE_SECONDS ? null : robot);
