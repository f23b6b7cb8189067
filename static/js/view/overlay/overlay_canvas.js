/** The canvas over the video: decides what it shows, and draws it when that has changed. */

import { isAnswered } from "../../autonomy/offer.js";
import { isMoving } from "../../protocol/robot_action.js";
import { arcTo } from "../../input/pure_pursuit.js";
import { createPaint } from "../../lib/colours.js";
import { backToDriving } from "../../lib/dom.js";
import { roleOf } from "../../protocol/session.js";
import { isOffered } from "../../protocol/capabilities.js";
import { cuesFor } from "./cues.js";
import { drawScene, signOf } from "./drawing.js";
import { heldSteps, lineSteps, sweep } from "../../lib/swept_path.js";

const TARGET = 44; // CSS pixels: --target
const SHOWN_SECONDS = 6; // s of driving: the camera sees no floor nearer than a metre
const COLOURS = ["free", "near", "close", "committed", "goal", "next", "edge"];
/** @type {Omit<import("./drawing.js").Scene, "cues" | "radius" | "footprint">} */
const NOTHING = Object.freeze({
  sweptPath: null,
  committed: false,
  goal: null,
  blocked: null,
  cross: null,
});

export class OverlayCanvas {
  /**
   * @param {Page} page @param {import("./feature.js").Surroundings} around
   * @param {import("./floor_press.js").FloorPress} press
   */
  constructor({ store, element, act }, around, press) {
    this.store = store;
    this.marker = new DockMarker(element, act);
    this.around = around;
    this.press = press;
    this.canvas = /** @type {HTMLCanvasElement} */ (element("overlay"));
    this.paint = createPaint(this.canvas, "--", COLOURS, "700 15px");
    /** @type {Intent} sent to the robot */
    this.intent = { linear: 0, angular: 0, method: "" };
    this.dirty = false;
    this.drawn = "";
    /** the last path and what it depends on @type {{of: any[], scene: typeof NOTHING}} */
    this.last = { of: [], scene: NOTHING };
    const video = element("video");
    new ResizeObserver(() => this.#resize(video)).observe(press.stage);
  }

  /** Draws with the next frame, if anything has changed. */
  refresh() {
    if (!this.dirty) {
      this.dirty = true;
      requestAnimationFrame(() => this.#draw());
    }
  }

  /** @param {HTMLElement} video */
  #resize(video) {
    const { clientWidth: width, clientHeight: height } = this.press.stage;
    this.press.size = { width, height, fit: getComputedStyle(video).objectFit };
    this.drawn = "?";
    if (this.store.get().pointNote) {
      this.store.update({ pointNote: null }); // its point is elsewhere now
    }
    this.canvas.width = Math.round(width * devicePixelRatio);
    this.canvas.height = Math.round(height * devicePixelRatio);
    this.refresh();
  }

  /** @returns {typeof NOTHING} */
  #path() {
    const [robot, { factsheet, task }] = [this.around.track.newest, this.store.get()];
    const { target, maneuver, footprint } = this.press;
    if (!robot || !factsheet) {
      return NOTHING;
    }
    if (target ? !("turn" in target) : this.#note()) {
      return this.#pressed(robot);
    }
    const { seen, path } = this.around;
    if (maneuver.now?.kind === "goal") {
      const goal = maneuver.now.point;
      return { ...NOTHING, goal, sweptPath: sweep(arcTo(robot, goal), footprint, seen) };
    }
    if (isMoving(task)) {
      const sweptPath = sweep(lineSteps(robot, path), footprint, []);
      return { ...NOTHING, committed: true, sweptPath };
    }
    const { linear, angular } = this.intent;
    const { limits } = factsheet;
    const isHeld = linear || angular;
    const held = isHeld ? heldSteps(robot, this.intent, limits, SHOWN_SECONDS) : [];
    return { ...NOTHING, sweptPath: sweep(held, footprint, seen, linear < 0 ? -1 : 1) };
  }

  /** The answer beside a pressed point, while it is shown. */
  #note() {
    const { pointNote, now } = this.store.get();
    return pointNote && isAnswered({ said: pointNote, now }) ? pointNote : null;
  }

  /**
   * What a press leads to: straight ahead, by the robot's route, or a cross and, where the robot
   * can go instead, the route to there.
   * @param {Moment} robot @returns {typeof NOTHING}
   */
  #pressed(robot) {
    const [{ target, press, footprint }, note] = [this.press, this.#note()];
    const answer = this.press.answerFor(target);
    const isThere = answer !== null && "go" in answer;
    if (target && "goal" in target && !isThere) {
      const { goal, sweptPath } = target;
      return { ...NOTHING, goal, sweptPath };
    }
    const leads = isThere || (answer !== null && "word" in answer && answer.goal !== null);
    const route = target ? (leads ? this.press.routeFor(target) : []) : (note?.route ?? []);
    const sweptPath = route.length ? sweep(lineSteps(robot, route), footprint, []) : null;
    const goal = route.at(-1) ?? null;
    const cross = isThere || !press ? null : /** @type {Point} */ ([press.px, press.py]);
    const blocked = !goal && target && "at" in target ? (target.at ?? null) : null;
    return { sweptPath, committed: true, goal, blocked, cross };
  }

  #pathNow() {
    const [{ track, scan, path }, { task, factsheet }] = [this.around, this.store.get()];
    const { target, maneuver } = this.press;
    const of = /** @type {any[]} */ ([
      track.newest,
      scan,
      path,
      this.intent,
      target,
      maneuver.now?.point,
    ]);
    of.push(task, factsheet, this.#note(), this.press.preview.asked?.found);
    if (of.some((one, i) => one !== this.last.of[i])) {
      this.last = { of, scene: this.#path() };
    }
    return this.last.scene;
  }

  #draw() {
    this.dirty = false;
    const [state, { eye }, context] = [this.store.get(), this.press, this.canvas.getContext("2d")];
    const shows = state.playing && roleOf(state.visit) === "driver" && eye !== null;
    const { footprint } = this.press;
    const radius = Math.max(...footprint.map((/** @type {number[]} */ [x]) => x));
    const scene = shows
      ? { ...this.#pathNow(), footprint, radius, cues: cuesFor(state, eye.moment) }
      : null;
    const isEmpty = !(
      scene?.sweptPath ||
      scene?.goal ||
      scene?.blocked ||
      scene?.cross ||
      scene?.cues.length
    );
    this.marker.show(scene && eye && isOffered(state, "dock") ? dockSign(eye, scene.cues) : null);
    const key = scene && eye && !isEmpty ? keyOf(scene, eye) : "";
    if (key === this.drawn || !context) {
      return;
    }
    this.drawn = key;
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, this.press.size.width, this.press.size.height);
    if (key && scene && eye) {
      drawScene(context, eye, scene, this.paint());
    }
    Object.assign(this.canvas.dataset, forTests(scene));
  }
}

/** The button on the sign of the charging station. */
class DockMarker {
  /** @param {GetElement} element @param {(action: string) => void} act */
  constructor(element, act) {
    this.button = element("dock-marker");
    this.button.addEventListener("click", () => {
      act("go_home");
      backToDriving(element);
    });
  }

  /** @param {Point | null} at CSS pixels of the stage; null hides it */
  show(at) {
    const size = TARGET / 2;
    this.button.hidden = at === null;
    if (at) {
      this.button.style.transform = `translate(${at[0] - size}px, ${at[1] - size}px)`;
    }
  }
}

/**
 * Where the sign of the charging station is drawn, CSS pixels.
 * @param {import("./drawing.js").Eye} eye @param {import("./drawing.js").Cue[]} cues
 */
const dockSign = (eye, cues) => {
  const station = cues.find(({ sign }) => sign === "");
  return station ? signOf(eye, station.point) : null;
};

/** What the canvas shows. @param {import("./drawing.js").Scene | null} scene */
const forTests = (scene) => {
  const { goal = null, cross = null, sweptPath = null, committed = false, cues = [] } = scene ?? {};
  const path = sweptPath?.slices.length ? (committed ? "path" : "held") : "";
  return {
    shows: cross ? (goal ? "beside" : "blocked") : goal ? "goal" : path,
    goal: goal?.map((value) => value.toFixed(3)).join(" ") ?? "",
    cues: cues.map(({ sign, hidden }) => `${sign || "dock"}${hidden ? " hidden" : ""}`).join(),
  };
};

/**
 * A key of the drawing.
 * @param {import("./drawing.js").Scene} scene @param {import("./drawing.js").Eye} eye
 */
const keyOf = ({ sweptPath, goal, blocked, cross, cues }, { moment, box }) => {
  const end = sweptPath?.slices.at(-1);
  const parts = [
    moment.x,
    moment.y,
    moment.theta,
    moment.tilt,
    ...(end?.left ?? []),
    end?.clearance ?? 0,
    ...(goal ?? []),
    ...(cross ?? []),
    ...(blocked ? [blocked.x, blocked.y, blocked.theta] : []),
    sweptPath?.slices.length ?? 0,
    box.scale,
    box.left,
    box.top,
  ];
  const signs = cues.map(({ sign, hidden }) => sign + hidden);
  return `${parts.map((value) => value.toFixed(3))}${signs}`;
};
