/**
 * Why nobody can drive a robot that is connected, by its last state: as robots/presence.py says it
 * to lists and the queue. Pure.
 */

const THERE = new Set(["screen", "button"]);

/**
 * @param {any} robot its last state, null before one came
 * @returns {"" | "estop_there" | "estop" | "not_connected" | "fault"} `estop_there`: somebody at
 *   the robot pressed it
 */
export const standstillOf = (robot) => {
  if (robot?.safety.estop) {
    return THERE.has((robot.safety.estopSource ?? "").split(":")[0]) ? "estop_there" : "estop";
  }
  if (
    robot?.errors?.some((/** @type {string} */ error) => /^adapter_(?:lost|starting): /.test(error))
  ) {
    return "not_connected";
  }
  return robot?.safety.inhibited === "fault" ? "fault" : "";
};
