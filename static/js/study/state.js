/** The study's slice of the page's state. */

export const newSlice = () => ({
  /** the study of the drive: experiments/participation/drive_config.py; null without one */
  study: /** @type {any} */ (null),
  /** the progress of the task, as the session manager last sent it: guide.js */
  progress: /** @type {import("./guide.js").Progress | null} */ (null),
  /** the requested photo, until it is reviewed */
  snap: /** @type {RobotAction | null} */ (null),
  /** the visitor's choice in the photo's window, until it is confirmed: photo.js */
  answer: /** @type {import("./photo.js").Answer | null} */ (null),
  /** when the drive of a study ended, Unix seconds; null before */
  endedAt: /** @type {number | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
