/** The page of a hidden operator, who drives and speaks for the robot in a study: wires it. */

import { KeyDispatcher } from "../../input/key_dispatcher.js";
import { unixNow } from "../../lib/clock.js";
import { element, readConfig, write } from "../../lib/dom.js";
import { freshId } from "../../lib/ids.js";
import { readWords } from "../../lib/words.js";
import { SERVER_SILENCE, shownFaults } from "../../protocol/faults.js";
import { ShownFrame } from "../../view/video/capture_stamp.js";
import { Viewport } from "../../view/video/viewport.js";
import { createConnection } from "./connection.js";
import { faultFor } from "./fault.js";
import { noticeOfDenied } from "./packets.js";
import { Hand } from "./hand.js";
import { begin, turned, velocityOf } from "./moves.js";
import { drawScript, markSteps } from "./script_view.js";

const TICK_MS = 50;
const BEAT = 0.2; // s
const PENDING = 10; // s until an unconfirmed step is forgotten
const NO_LIMITS = { linear: 0.4, reverse: 0.2, angular: 0.6 }; // without a factsheet: slow
const FINAL = [4401, 4403, 4404]; // close codes after which the page does not reconnect

const [config, words] = [readConfig(), readWords()];
const limits = config.limits ?? NO_LIMITS;
const shown = new ShownFrame();

const state = {
  /** the session at the robot: packets.js "wizard/session" @type {any} */
  scene: null,
  /** session and epoch, while this page operates @type {any} */
  granted: null,
  /** the session to operate again after a reconnection */
  again: "",
  /** the newest "wizard/state" @type {any} */
  robot: null,
  online: true,
  connected: false,
  /** whether an open WebSocket is silent */
  silent: false,
  /** @type {import("../../protocol/faults.js").ShownFault[]} */
  faults: [],
  /** @type {{key: string, move: import("./moves.js").Move, actionId: string} | null} by the page */
  moving: null,
  /** steps that the robot has not confirmed yet @type {Map<string, {key: string, at: number}>} */
  pending: new Map(),
  /** the present step of the robot itself @type {{key: string, actionId: string} | null} */
  running: null,
  notice: "",
  /** @type {any} */
  participant: null,
  sound: false,
};
/** @type {Map<string, HTMLButtonElement>} */
let buttons = new Map();
let drawn = "";
let beatAt = 0;

const viewport = new Viewport({
  video: element("video"),
  audio: element("audio"),
  still: element("still"),
  slow: element("slow"),
  onFrame: (rtp) => shown.shown(rtp, unixNow()),
  onPlaying: () => show(),
});
const hand = new Hand({ onChange: () => steer() });
const connection = createConnection({
  url: config.socket,
  viewport,
  shown,
  onMessage: (suffix, message) => {
    (HANDLERS[suffix] ?? (() => undefined))(message);
    show();
  },
  onSocket: (open, code) => {
    state.connected = open;
    state.faults = [];
    if (!open) {
      lose();
    }
    if (FINAL.includes(code)) {
      connection.socket.close();
      state.again = "";
      state.notice = "refused";
    }
    show();
  },
});

// --- messages of the server ----------------------------------------------------------------------

/** @type {Record<string, (message: any) => void>} */
const HANDLERS = {
  "wizard/session": (scene) => {
    state.scene = scene;
    if (state.again && scene.session === state.again && !state.granted) {
      take(false);
    }
  },
  "wizard/granted": (granted) => {
    state.granted = granted;
    state.again = granted.session;
    state.notice = "";
    connection.commands.bind(granted);
    element("wizard").scrollIntoView({ block: "start" });
  },
  "wizard/lost": ({ reason }) => {
    lose();
    state.again = "";
    state.notice = reason;
  },
  "wizard/begun": ({ step, actionId, deviation, reason }) => {
    if (reason) {
      state.pending.delete(actionId);
      state.notice = "not_begun";
      if (state.moving?.actionId === actionId) {
        endMove();
      }
    } else {
      state.notice = deviation ? `deviation_${deviation}` : step === "free" ? "line_sent" : "";
    }
  },
  "wizard/participant": (view) => (state.participant = { ...view, at: unixNow() }),
  "wizard/state": (view) => {
    state.robot = view;
    connection.commands.heardState(view);
    const pending = state.moving && state.pending.get(state.moving.actionId);
    if (pending && view.commandAge !== null) {
      reached(state.moving?.actionId ?? "", view.commandAge);
    }
  },
  pose: ({ pose }) => {
    if (state.moving) {
      state.moving.move = turned(state.moving.move, pose.theta);
    }
  },
  action: (action) => {
    connection.commands.heardAction(action);
    const pending = state.pending.get(action.actionId);
    const { offset } = connection.clockSync;
    if (pending) {
      const at = offset === null ? unixNow() : action.stamp - offset;
      reached(action.actionId, at - pending.at);
      state.running = { key: pending.key, actionId: action.actionId };
    }
    const hasEnded = ["FINISHED", "FAILED", "CANCELLED"].includes(action.status);
    if (state.running?.actionId === action.actionId && hasEnded) {
      state.running = null;
      state.notice = action.status === "FAILED" ? "failed" : state.notice;
    }
  },
  robot: ({ online }) => (state.online = online),
  "server/status": ({ faults }) => (state.faults = shownFaults(faults, unixNow())),
  denied: (denied) => {
    state.notice = noticeOfDenied(denied) ?? state.notice;
    if (denied.suffix === "wizard/step") {
      state.pending.clear();
      endMove();
    }
  },
};

/** @param {string} actionId @param {number} latency s */
const reached = (actionId, latency) => {
  state.pending.delete(actionId);
  connection.send("wizard/reached", { actionId, latency: Math.min(60, Math.max(0, latency)) });
};

// --- actions of the operator ---------------------------------------------------------------------

/** @param {boolean} takeover */
const take = (takeover) =>
  connection.send("wizard/take", { session: state.scene?.session, takeover });

/** This page no longer operates the robot. */
const lose = () => {
  state.granted = null;
  state.moving = state.running = null;
  state.pending.clear();
  hand.letGo();
  connection.commands.unbind();
};

/** @param {any} step */
const press = (step) => {
  if (!state.granted) {
    return;
  }
  const now = unixNow();
  const actionId = freshId("step-");
  if (connection.send("wizard/step", { step: step.key, actionId, stamp: now })) {
    endMove();
    state.pending.set(actionId, { key: step.key, at: now });
    if (step.drive || step.turn !== null) {
      state.moving = { key: step.key, actionId, move: begin(step, now) };
      drive(now);
    }
  }
  show();
};

const endMove = () => {
  if (state.moving) {
    state.moving = null;
    connection.commands.intend({ linear: 0, angular: 0, method: "script" });
  }
};

/** Driving by hand ends a step that the page drives. */
const steer = () => {
  if (!state.granted || !state.scene?.script?.byHand) {
    return;
  }
  endMove();
  if (connection.commands.intend(hand.velocity(limits))) {
    send(unixNow());
  }
};

const stop = () => {
  hand.letGo();
  endMove();
  state.running = null;
  connection.router.stop(unixNow(), "stop");
  show();
};

/** @param {number} now */
const drive = (now) => {
  if (!state.moving) {
    return;
  }
  const velocity = velocityOf(state.moving.move, now, limits);
  if (velocity) {
    if (connection.commands.intend({ ...velocity, method: "script" })) {
      send(now);
    }
  } else {
    endMove();
    show();
  }
};

/** @param {number} now */
const send = (now) => connection.router.sendVelocity(now, shown.stamp);

/** @param {number} now */
const frameAge = (now) => {
  const { offset } = connection.clockSync;
  return shown.stamp === null || offset === null ? null : Math.max(0, now + offset - shown.stamp);
};

const tick = () => {
  const now = unixNow();
  connection.link.watch(now);
  const isSilent = connection.socket.watch(now) > SERVER_SILENCE;
  if (isSilent !== state.silent) {
    state.silent = isSilent;
    show();
  }
  connection.router.repeatStop(now);
  if (state.granted) {
    drive(now);
    send(now);
    if (now - beatAt >= BEAT) {
      beatAt = now;
      connection.router.beat(now, frameAge(now));
    }
  }
  for (const [key, { at }] of state.pending) {
    if (now - at > PENDING) {
      state.pending.delete(key);
    }
  }
};

// --- the page ------------------------------------------------------------------------------------

/** @param {any} step */
const describe = ({ text, aloud, action, place, angle, turn, drive: way }) => {
  if (text) {
    return words.say(aloud ? "does_say" : "does_show", { text });
  }
  if (way) {
    const [v, w] = [way.linear.toFixed(2), way.angular.toFixed(2)];
    return words.say("does_drive", { s: way.seconds, v, w });
  }
  const degrees = Math.round(((turn ?? angle) * 180) / Math.PI);
  return turn !== null
    ? words.say("does_turn", { degrees })
    : words.say(`does_${action}`, { place, degrees });
};

const status = () => {
  if (!state.connected || state.silent) {
    return "no_server";
  }
  if (!state.online) {
    return "no_robot";
  }
  if (!state.scene?.session) {
    return "nobody";
  }
  if (state.granted) {
    const { estop, inhibited } = state.robot?.safety ?? {};
    return estop ? "estop" : inhibited === "stopped" ? "stopped" : "operating";
  }
  return state.scene.operator === "other" ? "other" : "free";
};

const show = () => {
  const { scene } = state;
  const at = status();
  element("wizard").dataset.state = at;
  write(element("status"), words.say(at));
  const fault = faultFor(state, unixNow());
  const notice = fault?.word ?? state.notice;
  element("notice").dataset.word = notice;
  write(element("notice"), notice && words.say(notice, fault?.values));
  const participant = scene?.visitorSeen ? "participant" : "participant_gone";
  const text = scene?.session ? words.say(participant, { k: scene.participant }) : "";
  write(element("participant"), text);
  write(element("condition"), scene?.condition ?? "");
  element("take").hidden = !(at === "free" || at === "other");
  write(element("take"), words.say(at === "other" ? "take_over" : "take"));
  element("release").hidden = !state.granted;
  element("line").querySelector("fieldset").disabled = !state.granted;
  element("hand").hidden = !scene?.script?.byHand;
  element("hand").disabled = !state.granted;
  element("video-wait").hidden = viewport.isPlaying;
  showParticipant();
  showScript();
};

const showParticipant = () => {
  const view = state.participant;
  element("participant-view").hidden = !state.scene?.script?.participantView;
  const cue = view?.cue ? `cue.${view.cue}` : "no_cue";
  write(element("cue"), words.say(cue, { number: view?.number ?? "" }));
};

const showScript = () => {
  const script = state.scene?.script;
  const key = JSON.stringify(script ?? null);
  if (script && key !== drawn) {
    drawn = key;
    buttons = drawScript(script, element("script"), { describe, onPress: press });
  }
  const running = state.moving?.key ?? state.running?.key ?? "";
  markSteps(buttons, state.scene?.done ?? [], Boolean(state.granted), running);
};

// --- keys and buttons ----------------------------------------------------------------------------

const keys = new KeyDispatcher();
keys.add({
  down: (event) => {
    const command = keys.keymap.commandOf(event);
    const direction = Hand.directionOf(command);
    const step = state.scene?.script?.stages
      .flatMap((/** @type {any} */ stage) => stage.steps)
      .find((/** @type {any} */ one) => one.shortcut && one.shortcut === event.key.toLowerCase());
    if (command === "stop") {
      event.preventDefault();
      stop();
    } else if (direction && state.scene?.script?.byHand) {
      event.preventDefault();
      hand.press(direction, "keyboard");
    } else if (step && !event.repeat) {
      event.preventDefault();
      press(step);
    }
  },
  up: (event) => {
    const direction = Hand.directionOf(keys.keymap.commandOf(event));
    if (direction) {
      hand.release(direction);
    }
  },
  letGo: () => hand.letGo(),
});
document.addEventListener("visibilitychange", () => document.hidden && state.granted && stop());
window.addEventListener("pagehide", () => state.granted && stop());

for (const button of element("hand").querySelectorAll("[data-direction]")) {
  const { direction } = button.dataset;
  button.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
    event.preventDefault();
    button.setPointerCapture(event.pointerId);
    hand.press(direction, "touch");
  });
  ["pointerup", "pointercancel", "lostpointercapture"].forEach((kind) =>
    button.addEventListener(kind, () => hand.release(direction)),
  );
}
element("stop").addEventListener("click", stop);
element("take").addEventListener("click", () => take(state.scene?.operator === "other"));
element("release").addEventListener("click", () => {
  connection.send("wizard/release", {});
  state.again = "";
  lose();
  show();
});
element("sound").addEventListener("click", () => {
  state.sound = !state.sound;
  viewport.setSound(state.sound);
  element("sound").setAttribute("aria-pressed", String(state.sound));
});
element("line").addEventListener("submit", (/** @type {SubmitEvent} */ event) => {
  event.preventDefault();
  const text = element("line-text").value.trim();
  const aloud = element("line-aloud").checked;
  const line = { text, aloud, actionId: freshId("line-"), stamp: unixNow() };
  if (text && connection.send("wizard/line", line)) {
    element("line-text").value = "";
  }
});
element("robot-choice")?.addEventListener("change", () => element("robot-choice").form.submit());

connection.socket.open();
setInterval(tick, TICK_MS);
show();
