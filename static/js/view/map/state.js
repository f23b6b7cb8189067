/** The map's slice of the page's state. */

export const newSlice = () => ({
  /** whether the map is open; on small screens it can be closed */
  mapOpen: true,
  /** whether the map is in its own place, in that of the video, or as large as possible */
  mapSize: /** @type {"small" | "swapped" | "large"} */ ("small"),
  /** whether the robot stays in the middle of the map */
  mapFollows: false,
  /** whether the robot's heading is up */
  mapTurns: false,
  /** robots.api.floorplan.FloorPlan, null without one */
  plan: /** @type {any} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
