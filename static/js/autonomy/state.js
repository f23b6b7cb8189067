/** The slice of the page's state about the robot's actions and assistance. */

import { NO_HELP } from "./assistance.js";

/**
 * @typedef {object} PendingAim
 * @property {"goal" | "pose"} kind a point to go to, or the robot's position
 * @property {number | null} x null before the first press
 * @property {number | null} y
 * @property {number | null} theta
 */

/**
 * @typedef {object} Arrival
 * @property {string | null} session
 * @property {string | null} stopId the robot's last stop when the session started
 * @property {boolean} isOver whether it is decided if the robot leaves its dock
 * @property {number} since Unix seconds
 */

export const newSlice = () => ({
  /** the robot's action, or the last one: robot_action.js; null for none */
  task: /** @type {RobotAction | null} */ (null),
  /** of the session; null before the first */
  arrival: /** @type {Arrival | null} */ (null),
  /** the point that is being chosen on the map */
  aim: /** @type {PendingAim | null} */ (null),
  /** the robot's route to it, null while unknown */
  aimRoute: /** @type {import("../protocol/route_preview.js").Preview | null} */ (null),
  /** whether this person has used a point of the map before */
  hasAimed: false,
  /** whether the menu of places is open */
  placesOpen: false,
  /** whether laser points are drawn; null leaves it to the level of assistance */
  laser: /** @type {boolean | null} */ (null),
  /** how assistance changes the driver's command: assistance.js */
  help: NO_HELP,
  /** the last reported level of assistance of the session, null without one */
  assistKnown: /** @type {{session: string, level: string} | null} */ (null),
  /** the level of this visitor's last session on this page, or of their next one */
  assistUsual: "",
  /** the requested level of assistance that is not yet in force, and when; null without one */
  assistAsked: /** @type {{level: string, at: number} | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
