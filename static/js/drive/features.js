/**
 * The features of the drive page, in the order in which they are set up, hear of things and render. A feature is one folder, or one file
 * of drive/ where the page could not live without it; see registry.js.
 */

import { autonomy } from "../autonomy/feature.js";
import { driving } from "../input/feature.js";
import { presence } from "../presence/feature.js";
import { study } from "../study/feature.js";
import { display } from "../view/display/feature.js";
import { hud } from "../view/hud/feature.js";
import { map } from "../view/map/feature.js";
import { overlay } from "../view/overlay/feature.js";
import { technical } from "../view/technical/feature.js";
import { video } from "../view/video/feature.js";
import { waiting } from "../waiting/feature.js";
import { connection } from "./connection.js";
import { session } from "./session.js";

/** @type {import("./registry.js").Feature[]} */
export const FEATURES = [connection, session, video, driving, map, overlay, autonomy, hud, study, presence, display, technical, waiting];

/** Everything that the page shows: the slices of all features. Render functions read it and change nothing. */
export const newState = () => /** @type {State} */ (Object.assign({}, ...FEATURES.map(({ state }) => state?.() ?? {})));

/** @typedef {any} State */
