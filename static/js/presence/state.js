/** The presence slice of the page's state. */

import { newOwn } from "./call.js";

export const newSlice = () => ({
  /** what the visitor sends to the robot: call.js */
  own: newOwn(),
  /** the panel that is open */
  panel: /** @type {"" | "talk" | "volumes" | "help"} */ (""),
  /** whether the field of the talk panel is open and takes the keys */
  writing: false,
  /** number of messages from the robot's side that have not been shown */
  unread: 0,
  /** the photo that the visitor takes for themselves, and its address once it is there */
  keptPhoto: /** @type {RobotAction | null} */ (null),
  keptPhotoUrl: "",
  /** hands and questions of viewers: audience/panel.js */
  audience: /** @type {import("../audience/panel.js").Audience | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
