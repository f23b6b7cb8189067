/** The overlay's slice of the page's state. */

/**
 * @typedef {{goal: Point, at: Place}} Refusal a point that was
 *   pressed, and where the robot would touch what is in the way
 */

/**
 * @typedef {{word: string, at: number, until: number, refused?: Refusal | null,
 *   values?: Record<string, string>}} Said `until` it can have been read
 */

export const newSlice = () => ({
  /** when the visitor last pressed forward, Unix seconds */
  pushedAt: -Infinity,
  /**
   * since when the visitor presses something that ought to move the robot, null while nothing is
   * pressed
   */
  pressing: /** @type {{since: number} | null} */ (null),
  /** why it does not move although the visitor presses: view/hud/stuck.js */
  stuck: /** @type {import("../hud/stuck.js").Why | null} */ (null),
  /** an answer to what the visitor has just tried, its word and when */
  said: /** @type {Said | null} */ (null),
  /**
   * what the page drives by itself for who pressed once: to a goal, a turn, or back out of the dock
   */
  maneuver: /** @type {import("../../input/maneuver.js").Kind | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
