/**
 * Driving by the video: drawings on it, presses on it, gamepads, and maneuvers of the page. The
 * pure modules beside it, in input/ and view/hud/stuck.js decide.
 */

import { Gamepads } from "../../input/gamepad.js";
import { unixNow } from "../../lib/clock.js";
import { stuckFor } from "../hud/stuck.js";
import { scanPoints } from "../map/layers.js";
import { FloorPress } from "./floor_press.js";
import { OverlayCanvas } from "./overlay_canvas.js";
import { createPointNote } from "./point_note.js";
import { Track } from "../../lib/transforms.js";

const SCAN_SECONDS = 1; // an older sweep is outdated
const MOVING = 0.01; // m/s or rad/s

/** The robot's poses, laser points and path, for all parts of the overlay. */
export class Surroundings {
  track = new Track();
  /** the last sweep of the laser, m, of the map @type {{points: Point[], at: number}} */
  scan = { points: [], at: -Infinity };
  /** @type {Point[]} that the robot follows by itself */
  path = [];
  heardAt = -Infinity;
  movedAt = -Infinity;

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

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store } = page;
  const around = new Surroundings();
  const press = new FloorPress(page, around);
  const canvas = new OverlayCanvas(page, around, press);
  const showNote = createPointNote(page);
  const turnAround = () => store.get().robot?.docked || press.turnAround();
  press.onChange = () => canvas.refresh();
  [press.maneuver, press.pointing, newGamepads(page, press)].forEach((controller) =>
    page.driving.steering.add(controller),
  );

  return {
    handlers: {
      ...newHandlers(store, around, canvas),
      route: (message) => press.heardRoute(message),
    },
    actions: {
      back_out: () => press.backOut(),
      turn_around: turnAround,
    },
    keys: { turn_around: { down: turnAround } },
    on: {
      changed: ({ maneuver, stopping }) => {
        if (stopping) {
          press.pending = null;
        }
        if (maneuver && !press.maneuver.now) {
          store.update({ maneuver: null });
        }
      },
      frameShown: () => canvas.refresh(),
      steered: (intent) => {
        const { pressing } = store.get();
        const presses = intent.linear !== 0 || intent.angular !== 0;
        if (presses !== (pressing !== null)) {
          store.update({ pressing: presses ? { since: unixNow() } : null });
        }
        if (presses && !press.maneuver.now) {
          press.pending = null; // who steers now does not want to be driven there any more
        }
        canvas.intent = intent;
        canvas.refresh();
      },
      tick: () => {
        press.tick();
        const { heardAt, movedAt } = around;
        const why = stuckFor(store.get(), { now: unixNow(), heardAt, movedAt });
        if (why?.word !== store.get().stuck?.word) {
          store.update({ stuck: why });
        }
      },
    },
    render: (state) => {
      showNote(state);
      canvas.refresh();
    },
  };
};

/**
 * @param {Store} store @param {Surroundings} around @param {OverlayCanvas} canvas
 * @returns {Handlers}
 */
const newHandlers = (store, around, canvas) => {
  const moved = (/** @type {any} */ message) => {
    around.moved(message);
    canvas.refresh();
  };
  return {
    state: moved,
    pose: moved,
    path: ({ points }) => {
      around.path = points;
      canvas.refresh();
    },
    scan: (message) => {
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
