/** The study's slice of the page's state. */

export const newSlice = () => ({
  /**
   * what the page was told about the study that the drive belongs to:
   * experiments/participation/drive_config.py; null without one
   */
  study: /** @type {any} */ (null),
  /** how far the task of the study is, as the session manager last said: guide.js */
  told: /** @type {import("./guide.js").Told | null} */ (null),
  /** the photo that the robot has been asked for, until it can be judged */
  snap: /** @type {RobotAction | null} */ (null),
  /** what the visitor chose in the photo's window, until that has been understood: photo.js */
  answer: /** @type {import("./photo.js").Answer | null} */ (null),
  /** when the drive of a study ended, Unix seconds; null before */
  endedAt: /** @type {number | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
