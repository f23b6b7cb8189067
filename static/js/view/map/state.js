/** The map's slice of the page's state. */

export const newSlice = () => ({
  /** whether the map is open; on small screens it can be put away */
  mapOpen: true,
  /** whether the map stands in its own place, in that of the video, or as large as can be */
  mapSize: /** @type {"small" | "swapped" | "large"} */ ("small"),
  /** whether the robot stays in the middle of the map */
  mapFollows: false,
  /** whether the map is turned so that the robot looks up */
  mapTurns: false,
  /** the plan of the place, null without one; robots.api.floorplan.FloorPlan */
  plan: /** @type {any} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
