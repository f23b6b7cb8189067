/** The alert when a part of the server, or the robot's computer, does not work. Pure. */

export const SERVER_SILENCE = 1.5; // s without a packet; an open WebSocket brings one a second

/**
 * @typedef {object} ShownFault
 * @property {string} part
 * @property {"waits" | "stops" | "stopped" | "goes_on"} then
 * @property {number | null} at the Unix time until which the robot still drives
 */

/**
 * @param {{part: string, then: any, seconds: number | null}[]} faults sessions/protocol.py Fault
 * @param {number} now Unix time @returns {ShownFault[]}
 */
export const shownFaults = (faults, now) =>
  faults.map(({ seconds, ...fault }) => ({
    ...fault,
    at: seconds === null ? null : now + seconds,
  }));

/**
 * The failed part, and the consequence for this page. Without a connection to the server its last
 * report may be outdated, and is not shown.
 * @param {{visit: {phase: string, link: string, socket: string}, faults: ShownFault[],
 *   serverSilent: boolean, now: number}} state
 * @returns {{word: string, tone: "danger" | "busy", values: {seconds: number}} | null}
 */
export const faultAlert = ({ visit, faults, serverSilent, now }) => {
  const fault = faults.find(
    ({ part, then }) => then !== "goes_on" && (part !== "robot" || visit.link !== "live"),
  );
  if (!fault || visit.socket === "lost" || serverSilent) {
    return null;
  }
  // Commands through the broker stop with it; those on the data channel end with the lease.
  const isOver = fault.at === null || (fault.part === "broker" && visit.link !== "live");
  const left = isOver ? 0 : Math.ceil(Number(fault.at) - now);
  const hasStopped = fault.part === "robot" || (fault.then === "stops" && left <= 0);
  // A driver reads about the drive, a waiting visitor about the queue, a viewer about the robot.
  const thens = /** @type {Record<string, string>} */ ({
    driving: hasStopped ? "stopped" : fault.then,
    watching: fault.part === "robot" ? "stopped" : "watched",
  });
  const then = thens[visit.phase] ?? "waits";
  return {
    word: `fault.${fault.part}.${then}`,
    tone: then === "waits" || then === "watched" ? "busy" : "danger",
    values: { seconds: left },
  };
};
