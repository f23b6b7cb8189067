/** The canvas over the video: decides what it shows, and draws it when that has changed. */

import { isAnswered } from "../../autonomy/offer.js";
import { isMoving } from "../../protocol/robot_action.js";
import { arcTo } from "../../input/pure_pursuit.js";
import { createPaint } from "../../lib/colours.js";
import { roleOf } from "../../protocol/session.js";
import { cuesFor } from "./cues.js";
import { drawScene } from "./drawing.js";
import { heldSteps, lineSteps, sweep } from "../../lib/swept_path.js";

const SHOWN_SECONDS = 6; // s of driving: the camera sees no floor nearer than a metre
const COLOURS = ["free", "near", "close", "committed", "goal", "next", "edge"];
/** @type {Omit<import("./drawing.js").Scene, "cues" | "radius" | "footprint">} */
const NOTHING = Object.freeze({ sweptPath: null, committed: false, goal: null, blocked: null });

export class OverlayCanvas {
  /**
   * @param {Page} page @param {import("./feature.js").Surroundings} around
   * @param {import("./floor_press.js").FloorPress} press
   */
  constructor({ store, element }, around, press) {
    this.store = store;
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
    if (target) {
      return "goal" in target
        ? { ...NOTHING, ...target }
        : { ...NOTHING, blocked: ("at" in target && target.at) || null };
    }
    const refused = this.store.get().said?.refused;
    if (refused && isAnswered(this.store.get())) {
      return { ...NOTHING, blocked: refused.at };
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

  #pathNow() {
    const [{ track, scan, path }, { task, factsheet, said, now }] = [this.around, this.store.get()];
    const { target, maneuver } = this.press;
    const of = /** @type {any[]} */ ([
      track.newest,
      scan,
      path,
      this.intent,
      target,
      maneuver.now?.point,
    ]);
    of.push(task, factsheet, said, said?.refused && now);
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
    const isEmpty = !(scene?.sweptPath || scene?.goal || scene?.blocked || scene?.cues.length);
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

/** What the canvas shows. @param {import("./drawing.js").Scene | null} scene */
const forTests = (scene) => {
  const {
    goal = null,
    blocked = null,
    sweptPath = null,
    committed = false,
    cues = [],
  } = scene ?? {};
  const path = sweptPath?.slices.length ? (committed ? "path" : "held") : "";
  return {
    shows: blocked ? "blocked" : goal ? "goal" : path,
    goal: goal?.map((value) => value.toFixed(3)).join(" ") ?? "",
    cues: cues.map(({ sign, hidden }) => `${sign || "dock"}${hidden ? " hidden" : ""}`).join(),
  };
};

/**
 * A key of the drawing.
 * @param {import("./drawing.js").Scene} scene @param {import("./drawing.js").Eye} eye
 */
const keyOf = ({ sweptPath, goal, blocked, cues }, { moment, box }) => {
  const end = sweptPath?.slices.at(-1);
  const parts = [
    moment.x,
    moment.y,
    moment.theta,
    moment.tilt,
    ...(end?.left ?? []),
    end?.clearance ?? 0,
    ...(goal ?? []),
    ...(blocked ? [blocked.x, blocked.y, blocked.theta] : []),
    sweptPath?.slices.length ?? 0,
    box.scale,
    box.left,
    box.top,
  ];
  const signs = cues.map(({ sign, hidden }) => sign + hidden);
  return `${parts.map((value) => value.toFixed(3))}${signs}`;
};
