/** Presses on the video: the point of the floor, and the maneuver that the page then drives. */

import { Maneuver } from "../../input/maneuver.js";
import { Pointing } from "../../input/pointing.js";
import { ABOUT, SIDE_TURN, arcTo, lookingAt, reach } from "../../input/pure_pursuit.js";
import { unixNow } from "../../lib/clock.js";
import { toRead } from "../../lib/reading_time.js";
import { roleOf } from "../../protocol/session.js";
import { halfWidth } from "../../autonomy/offer.js";
import { boxOf, fromElement, sideOf, toFloor } from "./camera_model.js";
import { sweep } from "../../lib/swept_path.js";
import { mapFromRobot, robotFromMap } from "../../lib/transforms.js";
import { hidesWall, isBehind } from "./visibility.js";

/**
 * @typedef {{no: string, point?: Point, at?: Place} | {turn: Point}
 *   | {goal: Point, sweptPath: any}} Target of a press
 * @typedef {import("../../input/pointing.js").Press} Press
 * @typedef {import("../../input/maneuver.js").Kind} Kind
 */

export class FloorPress {
  /** @param {Page} page @param {import("./feature.js").Surroundings} around */
  constructor({ store, element, driving, video, words }, around) {
    this.store = store;
    this.words = words;
    this.around = around;
    this.video = video;
    this.steering = driving.steering;
    this.stage = element("viewport");
    this.onChange = () => {};
    /** @type {Target | null} of the present press */
    this.target = null;
    this.hand = "mouse";
    /** the size of the stage, and how the video is fitted into it */
    this.size = { width: 0, height: 0, fit: "contain" };
    this.maneuver = new Maneuver({
      offer: (method, velocity) => this.steering.drive(method, velocity),
      onEnd: (end, kind) => this.#ended(end, kind),
    });
    this.pointing = new Pointing({
      stage: this.stage,
      onAim: (press) => this.#aim(press),
      onGo: (press) => this.#go(this.#targetOf(press), press.method),
      onHold: (press) => this.#hold(press),
      onEnd: (wasHeld) => this.#lifted(wasHeld),
      allowed: (method) => this.steering.mayUse(method),
      barred: (method) => store.update({ barred: { method, at: unixNow() }, now: unixNow() }),
      stop: driving.brake,
    });
    this.#watchHand();
  }

  /**
   * @param {string} word
   * @param {import("./state.js").Refusal | null} [refused] the point that the robot cannot drive
   *   straight to
   */
  say(word, refused = null) {
    const values = { cm: String(2 * halfWidth(this.footprint)) };
    const said = { ...toRead(this.words, word, values), refused };
    this.store.update({ said, now: said.at });
  }

  get footprint() {
    return this.store.get().factsheet?.footprint ?? [];
  }

  /** The frame on the screen: camera, pose of the robot, and box; null while unknown. */
  get eye() {
    const { camera, tilt } = this.store.get().factsheet ?? {};
    const { width, height, fit } = this.size;
    const moment = this.around.track.at(this.video.frameStamp());
    // nothing can be drawn while the angle of the head is unknown
    const isAimed = moment?.aimed || !tilt;
    return camera && moment && isAimed && width
      ? { camera, moment, box: boxOf(camera, width, height, fit) }
      : null;
  }

  tick() {
    this.pointing.tick();
    this.#drive();
  }

  backOut() {
    this.#startHere("back", (robot) => [robot.x, robot.y]);
  }

  turnAround() {
    this.#startHere("turn", (robot) => lookingAt(robot, ABOUT));
  }

  /**
   * With the controller that pressed the button, or else one that may steer.
   * @param {Kind} kind @param {(robot: Place) => Point} pointOf
   */
  #startHere(kind, pointOf) {
    const robot = this.around.track.newest;
    const { allowed } = this.steering;
    const method = this.steering.mayUse(this.hand) ? this.hand : (allowed?.[0] ?? this.hand);
    if (robot && roleOf(this.store.get().visit) === "driver") {
      this.#start(kind, pointOf(robot), method);
    }
  }

  /** @param {{px: number, py: number}} press @returns {Target} */
  #targetOf({ px, py }) {
    const [eye, robot, { plan }] = [this.eye, this.around.track.newest, this.store.get()];
    if (!eye || !robot) {
      return { no: "lost" };
    }
    const side = sideOf(eye.box, eye.camera, px);
    if (side && !this.store.get().robot?.docked) {
      return { turn: lookingAt(robot, side * SIDE_TURN) };
    }
    const [u, v] = fromElement(eye.box, [px, py]);
    const isInside = u >= 0 && v >= 0 && u <= eye.camera.width && v <= eye.camera.height;
    const floor = isInside ? toFloor(eye.camera, eye.moment.tilt, [u, v]) : null;
    if (!floor) {
      return { no: "sky" };
    }
    const point = mapFromRobot(eye.moment, floor);
    const own = robotFromMap(robot, point);
    const { seen } = this.around;
    const isHidden = robot.localized && hidesWall(plan, [robot.x, robot.y], point);
    const obstacles = seen.map((one) => robotFromMap(robot, one));
    if (isHidden || isBehind(obstacles, own)) {
      return { no: "wall", point, at: this.#touching(robot, point) };
    }
    const target = reach(robot, own, this.footprint, seen);
    return "no" in target ? { ...target, point, at: this.#touching(robot, point) } : target;
  }

  /**
   * The robot's pose when it touches the obstacle before a point.
   * @param {Place} robot @param {Point} point @returns {Place}
   */
  #touching(robot, point) {
    const sweptPath = sweep(arcTo(robot, point), this.footprint, this.around.seen);
    return sweptPath?.blocked
      ? sweptPath.end
      : { x: point[0], y: point[1], theta: Math.atan2(point[1] - robot.y, point[0] - robot.x) };
  }

  /** @param {Press} press */
  #aim(press) {
    this.target = this.#targetOf(press);
    this.onChange();
  }

  /** @param {Press} press */
  #hold(press) {
    this.target = this.#targetOf(press);
    if (!this.#go(this.target, press.method)) {
      this.maneuver.letGo();
    }
    this.onChange();
  }

  /** @param {boolean} wasHeld */
  #lifted(wasHeld) {
    this.target = null;
    if (wasHeld) {
      this.maneuver.letGo();
      this.store.update({ maneuver: null });
    }
    this.onChange();
  }

  /**
   * @param {Target} target @param {string} method
   * @returns {boolean} whether the robot goes there now
   */
  #go(target, method) {
    if ("no" in target) {
      const { no, point, at } = target;
      if (this.store.get().robot?.docked) {
        this.store.update({ pushedAt: unixNow(), now: unixNow() });
      } else {
        this.say(`point.${no}`, point && at ? { goal: point, at } : null);
      }
      return false;
    }
    if ("turn" in target) {
      this.#start("turn", target.turn, method);
    } else {
      this.#start("goal", target.goal, method);
    }
    return true;
  }

  /**
   * Starts at once, so that it wins over a controller that is still held.
   * @param {Kind} kind @param {Point} point @param {string} method
   */
  #start(kind, point, method) {
    const { maneuver, said } = this.store.get();
    if (maneuver !== kind || said) {
      this.store.update({ maneuver: kind, said: null, pushedAt: -Infinity });
    }
    this.maneuver.start(kind, point, method, unixNow());
    this.#drive();
  }

  #drive() {
    const now = unixNow();
    const { factsheet } = this.store.get();
    const { track, heardAt, seen } = this.around;
    if (factsheet) {
      const [{ limits }, { full }] = [factsheet, this.steering];
      const [moment, age] = [track.newest, now - heardAt];
      this.maneuver.tick({ moment, age, full, limits, footprint: this.footprint, seen }, now);
    }
  }

  /** @param {import("../../input/maneuver.js").End} end @param {string} kind */
  #ended(end, kind) {
    this.store.update({ maneuver: null });
    if (end === "there" && kind === "back") {
      this.turnAround(); // towards the room: the dock is at a wall
    } else if (end !== "taken" && end !== "there") {
      this.say(`point.${end}`);
    }
  }

  /** Notes the controller that presses the page, and marks the sides of the video, which turn. */
  #watchHand() {
    const { stage } = this;
    const showSide = (/** @type {PointerEvent} */ { clientX, target }) => {
      const { camera } = this.store.get().factsheet ?? {};
      const { width, height, fit } = this.size;
      const isOn =
        camera && width && /** @type {Element} */ (target).matches("#viewport, video, canvas");
      const px = clientX - stage.getBoundingClientRect().left;
      const side = isOn ? sideOf(boxOf(camera, width, height, fit), camera, px) : 0;
      const name = side > 0 ? "left" : side < 0 ? "right" : "";
      if (stage.dataset.side !== name) {
        stage.dataset.side = name;
      }
    };
    stage.addEventListener("pointerdown", showSide);
    stage.addEventListener("pointermove", showSide);
    stage.addEventListener("pointerleave", () => (stage.dataset.side = ""));
    addEventListener(
      "pointerdown",
      ({ pointerType }) => (this.hand = pointerType === "mouse" ? "mouse" : "touch"),
      true,
    );
    addEventListener("keydown", () => (this.hand = "keyboard"), true);
  }
}
