/** The overlay's slice of the page's state. */

/**
 * @typedef {{word: string, at: number, until: number, values?: Record<string, string>}} Said
 *   `until` it can have been read
 * @typedef {Said & {spot: Point, goal: Point | null, route: Point[]}} PointNote the answer beside
 *   a pressed point: `spot` in CSS pixels of the stage, and where the robot can go instead, m, with
 *   its route
 */

export const newSlice = () => ({
  /** when the visitor last pressed forward, Unix seconds */
  pushedAt: -Infinity,
  /** since when the visitor steers, null while not */
  pressing: /** @type {{since: number} | null} */ (null),
  /** why the robot does not move although the visitor steers: view/hud/stuck.js */
  stuck: /** @type {import("../hud/stuck.js").Why | null} */ (null),
  /** the answer to the visitor's last input */
  said: /** @type {Said | null} */ (null),
  /** the answer to a press that the robot cannot follow; it lasts while the point is pressed */
  pointNote: /** @type {PointNote | null} */ (null),
  /** the maneuver that the page drives: to a goal, a turn, or out of the dock */
  maneuver: /** @type {import("../../input/maneuver.js").Kind | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
