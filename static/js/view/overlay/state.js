/** The overlay's slice of the page's state. */

/**
 * @typedef {{goal: Point, at: Place}} Refusal a pressed point, and where the robot would touch an
 *   obstacle before it
 * @typedef {{word: string, at: number, until: number, refused?: Refusal | null,
 *   values?: Record<string, string>}} Said `until` it can have been read
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
  /** the maneuver that the page drives: to a goal, a turn, or out of the dock */
  maneuver: /** @type {import("../../input/maneuver.js").Kind | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
