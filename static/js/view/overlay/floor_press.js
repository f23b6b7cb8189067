/** Presses on the video: the point of the floor, and the maneuver that the page then drives. */

import { Maneuver } from "../../input/maneuver.js";
import { Pointing } from "../../input/pointing.js";
import { ABOUT, SIDE_TURN, arcTo, lookingAt, reach } from "../../input/pure_pursuit.js";
import { unixNow } from "../../lib/clock.js";
import { toRead } from "../../lib/reading_time.js";
import { RoutePreview, mayPreview } from "../../protocol/route_preview.js";
import { roleOf } from "../../protocol/session.js";
import { halfWidth } from "../../autonomy/offer.js";
import { boxOf, fromElement, sideOf, toFloor } from "./camera_model.js";
import { sweep } from "../../lib/swept_path.js";
import { mapFromRobot, robotFromMap } from "../../lib/transforms.js";
import { answerTo } from "./press_answer.js";
import { obstacleBefore, wallBefore } from "./visibility.js";

const ANSWER_SECONDS = 2; // after the release: later, the robot asks before it drives
const BRIEF = 1.5; // s of a held press, whose visitor may have expected the robot to drive on

/**
 * @typedef {import("./press_answer.js").Target} Target
 * @typedef {import("../../input/pointing.js").Press} Press
 * @typedef {import("../../input/maneuver.js").Kind} Kind
 */

export class FloorPress {
  /** @param {Page} page @param {import("./feature.js").Surroundings} around */
  constructor(page, around) {
    const { store, element, driving, video, words } = page;
    this.page = page;
    this.store = store;
    this.words = words;
    this.around = around;
    this.video = video;
    this.steering = driving.steering;
    this.stage = element("viewport");
    this.onChange = () => {};
    /** @type {Target | null} of the present press */
    this.target = null;
    /** @type {Press | null} that is held, or was released last */
    this.press = null;
    /**
     * a press that was released and waits for the robot's answer
     * @type {{target: Exclude<Target, {turn: Point}>, method: string, until: number,
     *   isUnderWay?: boolean} | null}
     */
    this.pending = null;
    this.preview = new RoutePreview((request) => driving.askRoute(request));
    /** of the maneuver to a goal @type {Target | null} */
    this.driven = null;
    this.heldAt = Infinity; // s, since when the robot drives for a held press
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
      onGo: (press) => this.#go(this.#targetOf(press), press),
      onHold: (press) => this.#hold(press),
      onEnd: (wasHeld) => this.#lifted(wasHeld),
      allowed: (method) => this.steering.mayUse(method),
      barred: (method) => store.update({ barred: { method, at: unixNow() }, now: unixNow() }),
      stop: driving.brake,
    });
    this.#watchHand();
  }

  /** @param {string} word */
  say(word) {
    const said = toRead(this.words, word, this.#values);
    this.store.update({ said, now: said.at });
  }

  get #values() {
    return { cm: String(2 * halfWidth(this.footprint)) };
  }

  /**
   * Answers at the pressed point.
   * @param {{word: string, values?: Record<string, string>, goal: Point | null}} answer
   * @param {Point[]} [route] to its goal
   */
  #note({ word, values = {}, goal }, route = []) {
    const { press } = this;
    const before = this.store.get().pointNote;
    if (press) {
      const spot = /** @type {Point} */ ([press.px, press.py]);
      const said = toRead(this.words, word, { ...this.#values, ...values });
      const until = this.target ? Infinity : said.until;
      const isSame = before?.word === word && before.until === until && before.goal === goal;
      if (!isSame || before.spot[0] !== spot[0] || before.spot[1] !== spot[1]) {
        const pointNote = { ...said, until, spot, goal, route: goal ? route : [] };
        this.store.update({ pointNote, said: null });
      }
    }
  }

  #forgetNote() {
    if (this.store.get().pointNote) {
      this.store.update({ pointNote: null });
    }
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
    if (this.target || this.pending) {
      this.preview.tick(unixNow());
    }
    if (this.pending && unixNow() >= this.pending.until) {
      this.#decide();
    }
    this.#drive();
  }

  /** Takes the robot's answer. @param {ToPage["route"]} message */
  heardRoute(message) {
    if (this.preview.heard(message)) {
      this.#showAnswer();
      this.#decide();
      this.onChange();
    }
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
    const obstacles = seen.map((one) => robotFromMap(robot, one));
    const wall = robot.localized ? wallBefore(plan, [robot.x, robot.y], point) : Infinity;
    const before = Math.min(wall, obstacleBefore(obstacles, own));
    if (before < Infinity) {
      const share = before / Math.hypot(...own);
      const foot = mapFromRobot(robot, [share * own[0], share * own[1]]);
      return { no: "wall", point: foot, at: this.#touching(robot, point), hidden: true };
    }
    const target = reach(robot, own, this.footprint, seen);
    return "no" in target
      ? { ...target, point, at: this.#touching(robot, point) }
      : { ...target, point };
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

  /** Whether the robot plans a route, where none leads straight ahead. @param {Target} target */
  #needsRoute(target) {
    return ("no" in target || "cut" in target) && target.point && mayPreview(this.store.get())
      ? target.point
      : null;
  }

  /**
   * The answer to a press that does not lead straight ahead, as far as it is known.
   * @param {Target | null} target @returns {import("./press_answer.js").Answer | null}
   */
  answerFor(target) {
    const robot = this.around.track.newest;
    if (!target || !robot || "turn" in target || !("no" in target || "cut" in target)) {
      return null;
    }
    const found = target.point ? this.preview.answerFor(target.point) : null;
    return answerTo(target, found, robot);
  }

  /** Shows why a held press leads nowhere. */
  #showAnswer() {
    const { target } = this;
    const answer = this.store.get().robot?.docked ? null : this.answerFor(target);
    if (answer && "word" in answer) {
      this.#note(answer, this.routeFor(target));
    } else if (target) {
      this.#forgetNote();
    }
  }

  /** The robot's route for a press, as far as it is known. @param {Target | null} target */
  routeFor(target) {
    const isAsked = target && !("turn" in target) && target.point;
    return (isAsked && this.preview.answerFor(target.point ?? [0, 0])?.points) || [];
  }

  /** @param {Press} press */
  #aim(press) {
    Object.assign(this, { target: this.#targetOf(press), press, pending: null });
    const point = this.target && this.#needsRoute(this.target);
    if (point) {
      this.preview.ask(point, unixNow());
    } else {
      this.preview.forget();
    }
    this.#showAnswer();
    this.onChange();
  }

  /** @param {Press} press @returns {boolean} whether the robot drives there while it is held */
  #hold(press) {
    this.#aim(press);
    const { target } = this;
    const drives =
      target !== null && !("no" in target) && !("go" in (this.answerFor(target) ?? {}));
    if (drives) {
      this.heldAt = Math.min(this.heldAt, unixNow());
      this.#drivesTo(target, press.method);
    } else {
      this.maneuver.letGo();
    }
    return drives;
  }

  /** @param {boolean} wasHeld */
  #lifted(wasHeld) {
    this.target = null;
    if (wasHeld) {
      const stops = this.maneuver.now !== null && unixNow() - this.heldAt < BRIEF;
      this.maneuver.letGo();
      this.store.update({ maneuver: null, pointNote: null });
      if (stops) {
        this.say("point.let_go");
      }
    }
    this.heldAt = Infinity;
    this.onChange();
  }

  /** A press was released. @param {Target} target @param {Press} press */
  #go(target, press) {
    this.press = press;
    if (!("no" in target || "cut" in target)) {
      this.#drivesTo(target, press.method);
    } else if (this.store.get().robot?.docked) {
      this.store.update({ pushedAt: unixNow(), now: unixNow() });
    } else {
      const point = this.#needsRoute(target);
      const until = point ? unixNow() + ANSWER_SECONDS : 0;
      this.pending = { target, method: press.method, until };
      if (point) {
        this.preview.ask(point, unixNow());
      }
      this.#decide();
    }
  }

  /** Follows a released press once the robot has answered, or does not. */
  #decide() {
    const [{ pending }, robot] = [this, this.around.track.newest];
    if (!pending || !robot) {
      return;
    }
    const { target, method, until, isUnderWay } = pending;
    const found = target.point ? this.preview.answerFor(target.point) : null;
    if (!found && unixNow() < until) {
      if (!isUnderWay) {
        this.#note({ word: "point.asking", goal: null });
      }
      return;
    }
    this.pending = null;
    const answer = answerTo(target, found, robot);
    if ("go" in answer) {
      this.page.autonomy?.goTo(answer.go);
    } else if ("straight" in answer) {
      this.#drivesTo(target, method);
    } else if (isUnderWay && "no" in target) {
      this.say(`point.${target.no}`); // the pressed point is elsewhere in the video by now
    } else {
      this.#note(answer, found?.points);
    }
    this.onChange();
  }

  /** @param {Target} target @param {string} method */
  #drivesTo(target, method) {
    if ("turn" in target) {
      this.#start("turn", target.turn, method);
    } else if ("goal" in target) {
      this.driven = target;
      this.#start("goal", target.goal, method);
    }
  }

  /**
   * Starts at once, so that it wins over a controller that is still held.
   * @param {Kind} kind @param {Point} point @param {string} method
   */
  #start(kind, point, method) {
    const { maneuver, said, pointNote } = this.store.get();
    if (maneuver !== kind || said || pointNote) {
      this.store.update({ maneuver: kind, said: null, pointNote: null, pushedAt: -Infinity });
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
    } else if (end === "there") {
      if (kind === "goal" && this.driven && "cut" in this.driven) {
        this.say("point.short");
      }
    } else if (kind !== "goal" || !this.#goesOn(end)) {
      this.say(`point.${end}`);
    }
  }

  /**
   * Whether the robot is asked for a route around what has stopped it before its goal.
   * @param {import("../../input/maneuver.js").End} end
   */
  #goesOn(end) {
    const { driven, press } = this;
    const point = driven && "point" in driven ? driven.point : null;
    const isInTheWay = end === "blocked" || end === "stuck";
    if (!isInTheWay || !point || !press || this.target || !mayPreview(this.store.get())) {
      return false;
    }
    const until = unixNow() + ANSWER_SECONDS;
    const { method } = press;
    this.pending = { target: { no: end, point }, method, until, isUnderWay: true };
    this.preview.forget();
    this.preview.ask(point, unixNow());
    return true;
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
