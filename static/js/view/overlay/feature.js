/**
 * The video as a place to drive by: what is drawn on it, pressing on it, the gamepad, and what the
 * page drives by itself for who pressed once. What to do is decided in the pure modules beside it,
 * in input/ and in view/hud/stuck.js.
 */

import { Gamepads } from "../../input/gamepad.js";
import { unixNow } from "../../lib/clock.js";
import { stuckFor } from "../hud/stuck.js";
import { scanPoints } from "../map/layers.js";
import { FloorPress } from "./floor_press.js";
import { OverlayCanvas } from "./overlay_canvas.js";
import { Track } from "../../lib/transforms.js";

const SCAN_SECONDS = 1; // an older sweep is outdated
const MOVING = 0.01; // m/s or rad/s

/** What is known of the robot's surroundings, for all parts of the overlay. */
export class Surroundings {
  constructor() {
    this.track = new Track();
    /** what the laser saw last, m, of the map @type {{points: Point[], at: number}} */
    this.scan = { points: [], at: -Infinity };
    /** @type {Point[]} what the robot follows by itself */
    this.path = [];
    this.heardAt = -Infinity;
    this.movedAt = -Infinity;
  }

  /** @param {any} message `state` or `pose` */
  moved(message) {
    this.track.add(message);
    this.heardAt = unixNow();
    if (Math.abs(message.velocity.linear) > MOVING || Math.abs(message.velocity.angular) > MOVING) {
      this.movedAt = this.heardAt;
    }
  }

  /** @returns {Point[]} */
  get seen() {
    return unixNow() - this.scan.at < SCAN_SECONDS ? this.scan.points : [];
  }
}

/** @param {Page} page */
const setUp = (page) => {
  const { store } = page;
  const around = new Surroundings();
  const press = new FloorPress(page, around);
  const canvas = new OverlayCanvas(page, around, press);
  const turnAround = () => store.get().robot?.docked || press.turnAround();
  press.onChange = () => canvas.refresh();
  [press.maneuver, press.pointing, newGamepads(page, press)].forEach((controller) =>
    page.driving.steering.add(controller),
  );

  return {
    handlers: newHandlers(store, around, canvas),
    actions: {
      /** Where the robot may not be sent, the page drives it out of its dock. */
      back_out: () => press.backOut(),
      turn_around: turnAround,
    },
    keys: { turn_around: { down: turnAround } },
    on: {
      changed: (/** @type {State} */ { maneuver }) => {
        if (maneuver && !press.maneuver.now) {
          store.update({ maneuver: null });
        }
      },
      frameShown: () => canvas.refresh(),
      steered: (/** @type {Intent} */ intent) => {
        const { pressing } = store.get();
        const presses = intent.linear !== 0 || intent.angular !== 0;
        if (presses !== (pressing !== null)) {
          store.update({ pressing: presses ? { since: unixNow() } : null });
        }
        canvas.intent = intent;
        canvas.refresh();
      },
      tick: () => {
        press.tick();
        const why = stuckFor(store.get(), {
          now: unixNow(),
          heardAt: around.heardAt,
          movedAt: around.movedAt,
        });
        if (why?.word !== store.get().stuck?.word) {
          store.update({ stuck: why });
        }
      },
    },
    render: () => canvas.refresh(),
  };
};

/** @param {Store} store @param {Surroundings} around @param {OverlayCanvas} canvas */
const newHandlers = (store, around, canvas) => {
  const moved = (/** @type {any} */ message) => {
    around.moved(message);
    canvas.refresh();
  };
  return {
    state: moved,
    pose: moved,
    path: (/** @type {{points: Point[]}} */ { points }) => {
      around.path = points;
      canvas.refresh();
    },
    scan: (/** @type {any} */ message) => {
      const [laser, moment] = [store.get().factsheet?.laser, around.track.at(message.stamp)];
      if (laser && moment) {
        around.scan = { points: scanPoints(message, laser, moment), at: unixNow() };
        canvas.refresh();
      }
    },
  };
};

/** @param {Page} page @param {FloorPress} press */
const newGamepads = ({ driving, connection }, press) => {
  const { steering } = driving;
  return new Gamepads({
    emit: (shares) => steering.steer("gamepad", shares),
    stop: driving.brake,
    step: (change) => steering.setStep(steering.step + change),
    onPad: ({ there, stick, standard }) => {
      press.say(!standard ? "pad.unknown" : there ? `pad.${stick}` : "pad.gone");
      connection.report("gamepad", { there, stick });
    },
  });
};

/** @type {Feature} */
export const overlay = { name: "overlay", setUp };
