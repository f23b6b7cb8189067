/**
 * Everything that the page shows: one object, a comment a field. Render functions read it; only console.js changes it.
 */

import { newVisit } from "../protocol/session.js";
import { NO_HELP } from "../autonomy/assistance.js";

export const newState = () => ({
  /** what this page is to the robot: protocol/session.js */
  visit: newVisit(),
  /** who else is here; `driver` is null when nobody drives */
  room: { driver: /** @type {string | null} */ (null), driving: false, observers: 0, waiting: 0 },
  /** what fails, as the server says: sessions/protocol.py Fault; `at` is the Unix time until which the robot still drives */
  faults: /** @type {{part: string, then: "waits" | "stops" | "stopped" | "goes_on", at: number | null}[]} */ ([]),
  /** whether a WebSocket that is open brings nothing any more */
  serverSilent: false,
  /** the robot's last state, null before the first; robots.api.messages.State */
  robot: /** @type {any} */ (null),
  /** the robot's factsheet, null while unknown; robots.api.messages.Factsheet */
  factsheet: /** @type {any} */ (null),
  /** seconds from the page to the robot and back on the way that commands take, null while unknown */
  roundTrip: /** @type {number | null} */ (null),
  /** the way that commands take now */
  way: /** @type {"datachannel" | "mqtt"} */ ("mqtt"),
  /** seconds since the picture on the screen was taken, null while unknown */
  frameAge: /** @type {number | null} */ (null),
  /** the last second of the connection: protocol/link_stats.js */
  network: /** @type {any} */ (null),
  /** whether a picture of the present link is on the screen */
  playing: false,
  /** whether pictures come through the server, slowly and without sound, because no direct way to the robot was found */
  slow: false,
  /** whether the visitor wants to hear the robot */
  sound: false,
  /** index into input/speeds.js STEPS */
  speedStep: 1,
  /** the profile that the visitor chose, null as long as it is not: view/display/profiles.js */
  profile: /** @type {string | null} */ (null),
  /** the profile that is offered first, null for none: sessions/interfaces.py */
  suggested: /** @type {string | null} */ (null),
  /** whether the map is open; on small screens it can be put away */
  mapOpen: true,
  /** whether the map stands in its own place, in that of the picture, or as large as can be */
  mapSize: /** @type {"small" | "swapped" | "large"} */ ("small"),
  /** whether the robot stays in the middle of the map */
  mapFollows: false,
  /** whether the map is turned so that the robot looks up */
  mapTurns: false,
  /** what the robot does by itself, or has just done: tasks.js; null when it does nothing */
  task: /** @type {import("../autonomy/robot_action.js").Task | null} */ (null),
  /** a point being chosen on the map, to go to or to say where the robot is; x is null before the first press */
  aim: /** @type {{kind: "goal" | "pose", x: number | null, y: number | null, theta: number | null} | null} */ (null),
  /** whether the menu of places is open */
  placesOpen: false,
  /** whether laser points are drawn; null leaves it to the level of assistance */
  laser: /** @type {boolean | null} */ (null),
  /** why the robot does not do quite what its driver asks: autonomy/assistance.js */
  help: NO_HELP,
  /** the level of assistance that was asked for and is not yet in force, and when; null when there is none */
  assistAsked: /** @type {{level: string, at: number} | null} */ (null),
  /** what the page was told about the study that the drive belongs to: experiments/tasks/page.py; null without one */
  study: /** @type {any} */ (null),
  /** how far the task of the study is, as the session manager last said: study/guide.js */
  told: /** @type {import("../study/guide.js").Told | null} */ (null),
  /** the photo that the robot has been asked for, until its picture can be judged */
  snap: /** @type {import("../autonomy/robot_action.js").Task | null} */ (null),
  /** what the visitor chose in the photo's window, until that has been understood: study/photo.js */
  answer: /** @type {import("../study/photo.js").Answer | null} */ (null),
  /** a controller that the visitor tried though the study keeps it off, and when; null for none */
  barred: /** @type {{method: string, at: number} | null} */ (null),
  /** when the drive of a study ended, Unix seconds; null before */
  endedAt: /** @type {number | null} */ (null),
  /** when the visitor last pressed forward, Unix seconds */
  pushedAt: -Infinity,
  /** since when the visitor presses something that ought to move the robot, null while nothing is pressed */
  pressing: /** @type {{since: number} | null} */ (null),
  /** why it does not move although the visitor presses: view/hud/stuck.js */
  stuck: /** @type {import("../view/hud/stuck.js").Why | null} */ (null),
  /** an answer to what the visitor has just tried, its word and when */
  said: /** @type {{word: string, at: number} | null} */ (null),
  /** what the page drives by itself for who pressed once: to a goal, a turn, or back out of the dock */
  maneuver: /** @type {import("../input/maneuver.js").Kind | null} */ (null),
  /** what seems wrong with the connection, and what to do: pages/check/verdict.js; null while nothing is known */
  finding: /** @type {{word: string, values: Record<string, string | number>} | null} */ (null),
  /** the browser to open this page in where one inside an app has no live video: pages/check/in_app.js; empty elsewhere */
  betterBrowser: "",
  /** practising in a simulated robot while one waits: not offered, offered, being made ready, under way: waiting/practice.js */
  practice: /** @type {"none" | "off" | "starting" | "on"} */ ("none"),
  /** whether the link to this page was copied */
  copied: false,
  /** whether the visitor who waits can still be asked to allow notifications */
  notifiable: false,
  /** the operator's last sentence */
  notice: "",
  /** whether the visitor is being asked if they mean to leave */
  leaving: false,
  /** whether a stop is on its way and not yet echoed */
  stopping: false,
  /** whether the robot has not echoed a stop for longer than it should */
  stopUnconfirmed: false,
  /** the plan of the place, null without one; robots.api.floorplan.FloorPlan */
  plan: /** @type {any} */ (null),
  /** when this page began to drive, and the robot's odometer then; null before */
  began: /** @type {{at: number, distance: number} | null} */ (null),
  /** Unix time, for count-downs; changes once a second */
  now: 0,
});

/** @typedef {ReturnType<typeof newState>} State */

/**
 * A small store: changes are merged, and subscribers hear of them once a frame.
 * @param {State} initial
 * @param {(callback: () => void) => unknown} [frame]
 */
export const createStore = (initial, frame = (callback) => requestAnimationFrame(callback)) => {
  let state = initial;
  let scheduled = false;
  /** @type {((state: State) => void)[]} */
  const subscribers = [];

  const tell = () => {
    if (scheduled) {
      scheduled = false;
      subscribers.forEach((subscriber) => subscriber(state));
    }
  };

  return {
    get: () => state,
    /** @param {Partial<State>} changes */
    update: (changes) => {
      state = { ...state, ...changes };
      if (!scheduled) {
        scheduled = true;
        frame(tell);
      }
    },
    /** Show now what has changed: what a visitor opens is open before their next key. */
    flush: tell,
    /** @param {(state: State) => void} subscriber */
    subscribe: (subscriber) => {
      subscribers.push(subscriber);
    },
  };
};
