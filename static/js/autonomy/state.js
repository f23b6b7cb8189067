/** The slice of the page's state about what the robot does by itself. */

import { NO_HELP } from "./assistance.js";

/**
 * @typedef {object} PendingAim
 * @property {"goal" | "pose"} kind a point to go to, or where the robot is
 * @property {number | null} x null before the first press
 * @property {number | null} y
 * @property {number | null} theta
 */

/**
 * @typedef {object} Arrival
 * @property {string | null} session
 * @property {string | null} stopId the robot's last stop when the visit started
 * @property {boolean} isOver whether it is decided if the robot leaves its station
 * @property {number} since Unix seconds
 */

export const newSlice = () => ({
  /** what the robot does by itself, or has just done: robot_action.js; null when it does nothing */
  task: /** @type {RobotAction | null} */ (null),
  /** of the visit; null before the first */
  arrival: /** @type {Arrival | null} */ (null),
  /** a point being chosen on the map */
  aim: /** @type {PendingAim | null} */ (null),
  /** whether this person has used a point of the map before */
  hasAimed: false,
  /** whether the menu of places is open */
  placesOpen: false,
  /** whether laser points are drawn; null leaves it to the level of assistance */
  laser: /** @type {boolean | null} */ (null),
  /** why the robot does not do quite what its driver asks: assistance.js */
  help: NO_HELP,
  /** the level of assistance that the robot last reported for a visit, null before it did */
  assistKnown: /** @type {{session: string, level: string} | null} */ (null),
  /**
   * the level of assistance that was asked for and is not yet in force, and when; null when there
   * is none
   */
  assistAsked: /** @type {{level: string, at: number} | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
