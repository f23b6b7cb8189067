/**
 * The picture as a place to drive by: what is drawn on it, pressing on it, the pad, and what the page drives by itself for who pressed
 * once. console.js calls it; what to do is decided in the pure modules beside it, in controllers/ and in view/hud/stuck.js.
 */

import { roleOf } from "../../protocol/session.js";
import { Maneuver } from "../../input/maneuver.js";
import { Gamepads } from "../../input/gamepad.js";
import { Pointing } from "../../input/pointing.js";
import { SIDE_TURN, lookingAt, reach, wayTo } from "../../input/pure_pursuit.js";
import { stuckFor } from "../hud/stuck.js";
import { unixNow } from "../../lib/clock.js";
import { scanPoints } from "../map/layers.js";
import { isMoving } from "../../autonomy/robot_action.js";
import { cuesFor } from "./cues.js";
import { Track, robotFromMap, mapFromRobot } from "./transforms.js";
import { boxOf, fromElement, sideOf, toFloor } from "./camera_model.js";
import { drawScene } from "./drawing.js";
import { hidesWall, isBehind } from "./visibility.js";
import { heldSteps, lineSteps, sweep } from "./swept_path.js";

const SHOWN_SECONDS = 6; // of driving on like this: the camera sees no floor that is nearer than a metre
const SCAN_SECONDS = 1; // an older sweep says nothing of the present
const MOVING = 0.01; // m/s or rad/s
const COLOURS = ["free", "near", "close", "committed", "goal", "next", "edge"];

/** @typedef {import("../../protocol/command_stream.js").Intent} Intent */

/**
 * @param {object} page
 * @param {ReturnType<typeof import("../../drive/store.js").createStore>} page.store
 * @param {(id: string) => HTMLElement} page.element
 * @param {import("../../input/steering.js").Steering} page.steering
 * @param {() => number | null} page.pictureStamp
 * @param {() => void} page.stop brake, and let go of everything
 * @param {(type: string, data?: Record<string, string | number | boolean | null>) => boolean} page.report
 */
export const createOverlay = ({ store, element, steering, pictureStamp, stop, report }) => {
  const [stage, video] = [element("viewport"), element("video")];
  const canvas = /** @type {HTMLCanvasElement} */ (element("overlay"));
  const track = new Track();
  /** what the laser saw last, m, of the map @type {{points: [number, number][], at: number}} */
  let scan = { points: [], at: -Infinity };
  /** @type {[number, number][]} what the robot follows by itself */
  let path = [];
  /** @type {Intent} */
  let intent = { linear: 0, angular: 0, method: "" };
  let [heardAt, movedAt] = [-Infinity, -Infinity];
  /** @type {{no: string} | {turn: [number, number]} | {goal: [number, number], sweptPath: any} | null} what the present press means */
  let pressed = null;
  let hand = "mouse";
  let [width, height, fit, dirty, drawn] = [0, 0, "contain", false, ""];

  /** @param {string} word */
  const say = (word) => store.update({ said: { word, at: unixNow() }, now: unixNow() });
  const footprint = () => store.get().factsheet?.footprint ?? [];
  const seen = () => (unixNow() - scan.at < SCAN_SECONDS ? scan.points : []);

  const maneuver = new Maneuver({
    offer: (method, velocity) => steering.drive(method, velocity),
    onEnd: (end, kind) => {
      store.update({ maneuver: null });
      if (end !== "taken" && !(end === "there" && kind !== "back")) {
        say(end === "there" ? "task.done.back" : `point.${end}`);
      }
    },
  });

  const eye = () => {
    const { camera, tilt } = store.get().factsheet ?? {};
    const moment = track.at(pictureStamp());
    const isAimed = moment?.aimed || !tilt; // where a head looks that nobody knows the angle of, nothing can be drawn
    return camera && moment && isAimed && width ? { camera, moment, box: boxOf(camera, width, height, fit) } : null;
  };

  /** At which side of the picture a hand is: there it turns the robot. @param {PointerEvent} event */
  const showSide = ({ clientX, target }) => {
    const { camera } = store.get().factsheet ?? {};
    const isOn = camera && width && /** @type {Element} */ (target).matches("#viewport, video, canvas");
    const side = isOn ? sideOf(boxOf(camera, width, height, fit), camera, clientX - stage.getBoundingClientRect().left) : 0;
    const name = side > 0 ? "left" : side < 0 ? "right" : "";
    if (stage.dataset.side !== name) {
      stage.dataset.side = name;
    }
  };
  stage.addEventListener("pointerdown", showSide);
  stage.addEventListener("pointermove", showSide);
  stage.addEventListener("pointerleave", () => (stage.dataset.side = ""));

  /** What a press on the picture means. @param {{px: number, py: number}} press */
  const look = ({ px, py }) => {
    const [by, robot, { plan }] = [eye(), track.newest, store.get()];
    if (!by || !robot) {
      return { no: "lost" };
    }
    const side = sideOf(by.box, by.camera, px);
    if (side && !store.get().robot?.docked) {
      return { turn: lookingAt(robot, side * SIDE_TURN) };
    }
    const [u, v] = fromElement(by.box, [px, py]);
    const isInside = u >= 0 && v >= 0 && u <= by.camera.width && v <= by.camera.height;
    const floor = isInside ? toFloor(by.camera, by.moment.tilt, [u, v]) : null;
    if (!floor) {
      return { no: "sky" };
    }
    const point = mapFromRobot(by.moment, floor);
    const own = robotFromMap(robot, point);
    if (isBehind(seen().map((one) => robotFromMap(robot, one)), own) || (robot.localized && hidesWall(plan, [robot.x, robot.y], point))) {
      return { no: "wall" };
    }
    return reach(robot, own, footprint(), seen());
  };

  /** @param {ReturnType<typeof look>} found @param {string} method @returns {boolean} whether the robot goes there now */
  const go = (found, method) => {
    if ("no" in found) {
      const docked = store.get().robot?.docked;
      store.update(docked ? { pushedAt: unixNow(), now: unixNow() } : {});
      if (!docked) {
        say(`point.${found.no}`);
      }
      return false;
    }
    if ("turn" in found) {
      start("turn", found.turn, method);
    } else {
      start("goal", found.goal, method);
    }
    return true;
  };

  /** From this very moment, so that an older hand that is still held has lost. @param {import("../../input/maneuver.js").Kind} kind @param {[number, number]} point @param {string} method */
  const start = (kind, point, method) => {
    if (store.get().maneuver !== kind || store.get().said) {
      store.update({ maneuver: kind, said: null, pushedAt: -Infinity });
    }
    maneuver.start(kind, point, method, unixNow());
    runErrand();
  };

  const runErrand = () => {
    const [now, { factsheet }] = [unixNow(), store.get()];
    if (factsheet) {
      maneuver.tick({ moment: track.newest, age: now - heardAt, full: steering.full, limits: factsheet.limits, footprint: footprint(), seen: seen() }, now);
    }
  };

  const pointing = new Pointing({
    stage,
    onAim: (press) => {
      pressed = look(press);
      refresh();
    },
    onGo: (press) => go(look(press), press.method),
    onHold: (press) => {
      pressed = look(press);
      if (!go(pressed, press.method)) {
        maneuver.letGo();
      }
      refresh();
    },
    onEnd: (wasHeld) => {
      pressed = null;
      if (wasHeld) {
        maneuver.letGo();
        store.update({ maneuver: null });
      }
      refresh();
    },
    allowed: (method) => steering.mayUse(method),
    barred: (method) => store.update({ barred: { method, at: unixNow() }, now: unixNow() }),
    stop,
  });

  const gamepads = new Gamepads({
    emit: (shares) => steering.steer("gamepad", shares),
    stop,
    step: (change) => steering.setStep(steering.step + change),
    onPad: ({ there, stick, standard }) => {
      say(!standard ? "pad.unknown" : there ? `pad.${stick}` : "pad.gone");
      report("gamepad", { there, stick });
    },
  });
  [maneuver, pointing, gamepads].forEach((one) => steering.add(one));

  // Which hand presses the buttons of the page, for what is driven by them.
  for (const [name, of] of /** @type {[string, (event: any) => string][]} */ ([["pointerdown", ({ pointerType }) => (pointerType === "mouse" ? "mouse" : "touch")], ["keydown", () => "keyboard"]])) {
    addEventListener(name, (event) => (hand = of(event)), true);
  }

  /** What is to be seen now. @returns {Omit<import("./drawing.js").Scene, "cues" | "radius">} */
  const way = () => {
    const [robot, { factsheet, task }] = [track.newest, store.get()];
    const nothing = { sweptPath: null, committed: false, goal: null };
    if (!robot || !factsheet) {
      return nothing;
    }
    if (pressed) {
      return "goal" in pressed ? { ...nothing, ...pressed } : nothing;
    }
    if (maneuver.now?.kind === "goal") {
      return { ...nothing, goal: maneuver.now.point, sweptPath: sweep(wayTo(robot, maneuver.now.point), footprint(), seen()) };
    }
    if (isMoving(task)) {
      return { ...nothing, committed: true, sweptPath: sweep(lineSteps(robot, path), footprint(), []) };
    }
    const held = intent.linear || intent.angular ? heldSteps(robot, intent, factsheet.limits, SHOWN_SECONDS) : [];
    return { ...nothing, sweptPath: sweep(held, footprint(), seen(), intent.linear < 0 ? -1 : 1) };
  };

  /** @type {{of: any[], scene: ReturnType<typeof way>}} thirty pictures a second show the same way */
  let last = { of: [], scene: { sweptPath: null, committed: false, goal: null } };
  const wayNow = () => {
    const of = [track.newest, scan, path, intent, pressed, maneuver.now?.point, store.get().task, store.get().factsheet];
    if (of.some((one, i) => one !== last.of[i])) {
      last = { of, scene: way() };
    }
    return last.scene;
  };

  const draw = () => {
    dirty = false;
    const [state, by, context] = [store.get(), eye(), canvas.getContext("2d")];
    const shows = state.playing && roleOf(state.visit) === "driver" && by !== null;
    const scene = shows ? { ...wayNow(), radius: Math.max(...footprint().map(([x]) => x)), cues: cuesFor(state, by.moment) } : null;
    const key = scene && (scene.sweptPath || scene.goal || scene.cues.length) ? keyOf(scene, by) : "";
    if (key === drawn || !context) {
      return;
    }
    drawn = key;
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, width, height);
    if (key && scene && by) {
      drawScene(context, by, scene, paint());
    }
    canvas.dataset.shows = scene?.goal ? "goal" : scene?.sweptPath?.slices.length ? (scene.committed ? "path" : "held") : "";
    canvas.dataset.goal = scene?.goal?.map((value) => value.toFixed(3)).join(" ") ?? "";
    canvas.dataset.cues = scene?.cues.map(({ sign, hidden }) => `${sign || "dock"}${hidden ? " hidden" : ""}`).join() ?? "";
  };

  /** @param {import("./drawing.js").Scene} scene @param {NonNullable<ReturnType<typeof eye>>} by */
  const keyOf = ({ sweptPath, goal, cues }, { moment, box }) => {
    const end = sweptPath?.slices.at(-1);
    const parts = [moment.x, moment.y, moment.theta, moment.tilt, ...(end?.left ?? []), end?.clearance ?? 0, ...(goal ?? []), sweptPath?.slices.length ?? 0, box.scale, box.left, box.top];
    return `${parts.map((value) => value.toFixed(3))}${cues.map(({ sign, hidden }) => sign + hidden)}`;
  };

  const paint = () => {
    const style = getComputedStyle(canvas);
    return { ...Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()])), font: `700 15px ${style.fontFamily}` };
  };

  /** Draw with the next frame, if there is anything new. */
  function refresh() {
    if (!dirty) {
      dirty = true;
      requestAnimationFrame(draw);
    }
  }

  new ResizeObserver(() => {
    [width, height, fit, drawn] = [stage.clientWidth, stage.clientHeight, getComputedStyle(video).objectFit, "?"];
    canvas.width = Math.round(width * devicePixelRatio);
    canvas.height = Math.round(height * devicePixelRatio);
    refresh();
  }).observe(stage);

  return {
    refresh,
    /** @param {any} message `state` or `pose` */
    moved: (message) => {
      track.add(message);
      heardAt = unixNow();
      if (Math.abs(message.velocity.linear) > MOVING || Math.abs(message.velocity.angular) > MOVING) {
        movedAt = heardAt;
      }
      refresh();
    },
    /** @param {any} message */
    scan: (message) => {
      const [laser, moment] = [store.get().factsheet?.laser, track.at(message.stamp)];
      if (laser && moment) {
        scan = { points: scanPoints(message, laser, moment), at: unixNow() };
        refresh();
      }
    },
    /** @param {[number, number][]} points */
    path: (points) => {
      path = points;
      refresh();
    },
    /** @param {Intent} wish that is sent to the robot */
    steered: (wish) => {
      const { pressing } = store.get();
      const presses = wish.linear !== 0 || wish.angular !== 0;
      if (presses !== (pressing !== null)) {
        store.update({ pressing: presses ? { since: unixNow() } : null });
      }
      intent = wish;
      refresh();
    },
    /** @param {import("../../drive/store.js").State} state */
    show: ({ maneuver: shown }) => {
      if (shown && !maneuver.now) {
        store.update({ maneuver: null });
      }
      refresh();
    },
    /** Twenty times a second. */
    tick: () => {
      const [now, { stuck }] = [unixNow(), store.get()];
      pointing.tick();
      runErrand();
      const why = stuckFor(store.get(), { now, heardAt, movedAt });
      if (why?.word !== stuck?.word) {
        store.update({ stuck: why });
      }
    },
    actions: {
      /** Where the robot may not be sent, the page drives it out of its dock. */
      back_out: () => {
        const robot = track.newest;
        const method = steering.mayUse(hand) ? hand : (steering.allowed?.[0] ?? hand);
        if (robot && roleOf(store.get().visit) === "driver") {
          start("back", [robot.x, robot.y], method);
        }
      },
    },
  };
};
