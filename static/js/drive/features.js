/**
 * The features of the drive page, in the order in which they are set up, notified and rendered. A
 * feature is one folder, or one file of drive/ that the page needs to start; see registry.js.
 */

import { newSlice as newAutonomy } from "../autonomy/state.js";
import { driving } from "../input/feature.js";
import { newSlice as newPresence } from "../presence/state.js";
import { newSlice as newStudy } from "../study/state.js";
import { newSlice as newDisplay } from "../view/display/state.js";
import { hud } from "../view/hud/feature.js";
import { newSlice as newMap } from "../view/map/state.js";
import { newSlice as newOverlay } from "../view/overlay/state.js";
import { video } from "../view/video/feature.js";
import { waiting } from "../waiting/feature.js";
import { connection } from "./connection.js";
import { session } from "./session.js";

/**
 * What the first frame, steering and stopping need; the page connects once these are set up.
 * @type {Feature[]}
 */
export const FIRST = [connection, session, video, driving, waiting, hud];

/**
 * Loaded later, one at a time. Their slices of the state exist from the start.
 * @type {(() => Promise<Feature>)[]}
 */
export const LATER = [
  async () => (await import("../view/map/feature.js")).map,
  async () => (await import("../view/overlay/feature.js")).overlay,
  async () => (await import("../autonomy/feature.js")).autonomy,
  async () => (await import("../view/display/feature.js")).display,
  async () => (await import("../study/feature.js")).study, // whose record has the profile
  async () => (await import("../presence/feature.js")).presence,
  async () => (await import("../view/technical/feature.js")).technical,
];

export const SLICES = [
  ...FIRST.map(({ state }) => state ?? (() => ({}))),
  newMap,
  newOverlay,
  newAutonomy,
  newStudy,
  newPresence,
  newDisplay,
];

/** The slices of all features: everything that the page shows. */
export const newState = () =>
  /** @type {State} */ (Object.assign({}, ...SLICES.map((newSlice) => newSlice())));

/**
 * @typedef {import("./connection.js").Slice
 *   & import("./session.js").Slice
 *   & import("../view/video/feature.js").Slice
 *   & import("../input/feature.js").Slice
 *   & import("../waiting/feature.js").Slice
 *   & import("../view/map/state.js").Slice
 *   & import("../view/overlay/state.js").Slice
 *   & import("../autonomy/state.js").Slice
 *   & import("../study/state.js").Slice
 *   & import("../presence/state.js").Slice
 *   & import("../view/display/state.js").Slice} State
 */
