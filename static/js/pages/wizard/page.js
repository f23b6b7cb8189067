/**
 * The page of a hidden operator, who drives and speaks for the robot in a study: the one place that
 * wires it.
 */

import { KeyDispatcher } from "../../input/key_dispatcher.js";
import { unixNow } from "../../lib/clock.js";
import { write } from "../../lib/dom.js";
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
const PENDING = 10; // s after which a step that the robot has not confirmed is forgotten
// of a robot that has not said its own: slow
const NO_LIMITS = { linear: 0.4, reverse: 0.2, angular: 0.6 };
const FINAL = [4401, 4403, 4404]; // codes after which the page is not let in again

const element = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const config = JSON.parse(element("config").textContent ?? "{}");
const words = readWords(element("words"), document.documentElement.lang);
const limits = config.limits ?? NO_LIMITS;
const shown = new ShownFrame();

/** What the page knows. */
const told = {
  /** the session at the robot: packets.js "wizard/session" @type {any} */
  scene: null,
  /** session and epoch, while this page operates @type {any} */
  granted: null,
  /** the session to operate again when the connection is back */
  again: "",
  /** the newest "wizard/state" @type {any} */
  robot: null,
  online: true,
  connected: false,
  /** whether a WebSocket that is open brings nothing any more */
  silent: false,
  /** @type {import("../../protocol/faults.js").ShownFault[]} */
  faults: [],
  /**
   * a step that the page drives now
   * @type {{key: string, move: import("./moves.js").Move, actionId: string} | null}
   */
  moving: null,
  /** steps that the robot has not confirmed yet @type {Map<string, {key: string, at: number}>} */
  pending: new Map(),
  /** the step that the robot does by itself now @type {{key: string, actionId: string} | null} */
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
    told.connected = open;
    told.faults = [];
    if (!open) {
      lose();
    }
    if (FINAL.includes(code)) {
      connection.socket.close();
      told.again = "";
      told.notice = "refused";
    }
    show();
  },
});

// --- what the server says ------------------------------------------------------------------------

/** @type {Record<string, (message: any) => void>} */
const HANDLERS = {
  "wizard/session": (scene) => {
    told.scene = scene;
    if (told.again && scene.session === told.again && !told.granted) {
      take(false);
    }
  },
  "wizard/granted": (granted) => {
    told.granted = granted;
    told.again = granted.session;
    told.notice = "";
    connection.commands.bind(granted);
    element("wizard").scrollIntoView({ block: "start" });
  },
  "wizard/lost": ({ reason }) => {
    lose();
    told.again = "";
    told.notice = reason;
  },
  "wizard/begun": ({ step, actionId, deviation, reason }) => {
    if (reason) {
      told.pending.delete(actionId);
      told.notice = "not_begun";
      if (told.moving?.actionId === actionId) {
        endMove();
      }
    } else {
      told.notice = deviation ? `deviation_${deviation}` : step === "free" ? "line_sent" : "";
    }
  },
  "wizard/participant": (view) => (told.participant = { ...view, at: unixNow() }),
  "wizard/state": (view) => {
    told.robot = view;
    connection.commands.heardState(view);
    const pending = told.moving && told.pending.get(told.moving.actionId);
    if (pending && view.commandAge !== null) {
      reached(told.moving?.actionId ?? "", view.commandAge);
    }
  },
  pose: ({ pose }) => {
    if (told.moving) {
      told.moving.move = turned(told.moving.move, pose.theta);
    }
  },
  action: (action) => {
    connection.commands.heardAction(action);
    const pending = told.pending.get(action.actionId);
    const { offset } = connection.clockSync;
    if (pending) {
      reached(
        action.actionId,
        offset === null ? unixNow() - pending.at : action.stamp - offset - pending.at,
      );
      told.running = { key: pending.key, actionId: action.actionId };
    }
    if (
      told.running?.actionId === action.actionId &&
      ["FINISHED", "FAILED", "CANCELLED"].includes(action.status)
    ) {
      told.running = null;
      told.notice = action.status === "FAILED" ? "failed" : told.notice;
    }
  },
  robot: ({ online }) => (told.online = online),
  "server/status": ({ faults }) => (told.faults = shownFaults(faults, unixNow())),
  denied: (denied) => {
    told.notice = noticeOfDenied(denied) ?? told.notice;
    if (denied.suffix === "wizard/step") {
      told.pending.clear();
      endMove();
    }
  },
};

/** @param {string} actionId @param {number} latency s */
const reached = (actionId, latency) => {
  told.pending.delete(actionId);
  connection.send("wizard/reached", { actionId, latency: Math.min(60, Math.max(0, latency)) });
};

// --- what the operator does ----------------------------------------------------------------------

/** @param {boolean} takeover */
const take = (takeover) =>
  connection.send("wizard/take", { session: told.scene?.session, takeover });

/** Not operating any more: nothing is held, nothing is sent. */
const lose = () => {
  told.granted = null;
  told.moving = told.running = null;
  told.pending.clear();
  hand.letGo();
  connection.commands.unbind();
};

/** @param {any} step */
const press = (step) => {
  if (!told.granted) {
    return;
  }
  const now = unixNow();
  const actionId = freshId("step-");
  if (connection.send("wizard/step", { step: step.key, actionId, stamp: now })) {
    endMove();
    told.pending.set(actionId, { key: step.key, at: now });
    if (step.drive || step.turn !== null) {
      told.moving = { key: step.key, actionId, move: begin(step, now) };
      drive(now);
    }
  }
  show();
};

const endMove = () => {
  if (told.moving) {
    told.moving = null;
    connection.commands.intend({ linear: 0, angular: 0, method: "script" });
  }
};

/** The hand wants something else: a step that the page drives is over. */
const steer = () => {
  if (!told.granted || !told.scene?.script?.byHand) {
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
  told.running = null;
  connection.router.stop(unixNow(), "stop");
  show();
};

/** @param {number} now */
const drive = (now) => {
  if (!told.moving) {
    return;
  }
  const velocity = velocityOf(told.moving.move, now, limits);
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
  if (isSilent !== told.silent) {
    told.silent = isSilent;
    show();
  }
  connection.router.repeatStop(now);
  if (told.granted) {
    drive(now);
    send(now);
    if (now - beatAt >= BEAT) {
      beatAt = now;
      connection.router.beat(now, frameAge(now));
    }
  }
  for (const [key, { at }] of told.pending) {
    if (now - at > PENDING) {
      told.pending.delete(key);
    }
  }
};

// --- what is shown -------------------------------------------------------------------------------

/** @param {any} step */
const describe = ({ text, aloud, action, place, angle, turn, drive: way }) => {
  if (text) {
    return words.say(aloud ? "does_say" : "does_show", { text });
  }
  if (way) {
    return words.say("does_drive", {
      s: way.seconds,
      v: way.linear.toFixed(2),
      w: way.angular.toFixed(2),
    });
  }
  const degrees = Math.round(((turn ?? angle) * 180) / Math.PI);
  return turn !== null
    ? words.say("does_turn", { degrees })
    : words.say(`does_${action}`, { place, degrees });
};

const status = () => {
  if (!told.connected || told.silent) {
    return "no_server";
  }
  if (!told.online) {
    return "no_robot";
  }
  if (!told.scene?.session) {
    return "nobody";
  }
  if (told.granted) {
    return told.robot?.safety.estop
      ? "estop"
      : told.robot?.safety.inhibited === "stopped"
        ? "stopped"
        : "operating";
  }
  return told.scene.operator === "other" ? "other" : "free";
};

const show = () => {
  const { scene } = told;
  const at = status();
  element("wizard").dataset.state = at;
  write(element("status"), words.say(at));
  const fault = faultFor(told, unixNow());
  const notice = fault?.word ?? told.notice;
  element("notice").dataset.word = notice;
  write(element("notice"), notice && words.say(notice, fault?.values));
  write(
    element("participant"),
    scene?.session
      ? words.say(scene.visitorSeen ? "participant" : "participant_gone", { k: scene.participant })
      : "",
  );
  write(element("condition"), scene?.condition ?? "");
  element("take").hidden = !(at === "free" || at === "other");
  write(element("take"), words.say(at === "other" ? "take_over" : "take"));
  element("release").hidden = !told.granted;
  element("line").querySelector("fieldset").disabled = !told.granted;
  element("hand").hidden = !scene?.script?.byHand;
  element("hand").disabled = !told.granted;
  element("video-wait").hidden = viewport.isPlaying;
  showParticipant();
  showScript();
};

const showParticipant = () => {
  const view = told.participant;
  element("participant-view").hidden = !told.scene?.script?.participantView;
  write(
    element("cue"),
    words.say(view?.cue ? `cue.${view.cue}` : "no_cue", { number: view?.number ?? "" }),
  );
};

const showScript = () => {
  const script = told.scene?.script;
  const key = JSON.stringify(script ?? null);
  if (script && key !== drawn) {
    drawn = key;
    buttons = drawScript(script, element("script"), { describe, onPress: press });
  }
  markSteps(
    buttons,
    told.scene?.done ?? [],
    Boolean(told.granted),
    told.moving?.key ?? told.running?.key ?? "",
  );
};

// --- keys and buttons ----------------------------------------------------------------------------

const keys = new KeyDispatcher();
keys.add({
  down: (event) => {
    const direction = Hand.directionOf(event.code);
    const step = told.scene?.script?.stages
      .flatMap((/** @type {any} */ stage) => stage.steps)
      .find((/** @type {any} */ one) => one.shortcut && one.shortcut === event.key.toLowerCase());
    if (keys.keymap.commandOf(event) === "stop") {
      event.preventDefault();
      stop();
    } else if (direction && told.scene?.script?.byHand) {
      event.preventDefault();
      hand.press(direction, "keyboard");
    } else if (step && !event.repeat) {
      event.preventDefault();
      press(step);
    }
  },
  up: ({ code }) => {
    const direction = Hand.directionOf(code);
    if (direction) {
      hand.release(direction);
    }
  },
  letGo: () => hand.letGo(),
});
document.addEventListener("visibilitychange", () => document.hidden && told.granted && stop());
window.addEventListener("pagehide", () => told.granted && stop());

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
element("take").addEventListener("click", () => take(told.scene?.operator === "other"));
element("release").addEventListener("click", () => {
  connection.send("wizard/release", {});
  told.again = "";
  lose();
  show();
});
element("sound").addEventListener("click", () => {
  told.sound = !told.sound;
  viewport.setSound(told.sound);
  element("sound").setAttribute("aria-pressed", String(told.sound));
});
element("line").addEventListener("submit", (/** @type {SubmitEvent} */ event) => {
  event.preventDefault();
  const text = element("line-text").value.trim();
  if (
    text &&
    connection.send("wizard/line", {
      text,
      aloud: element("line-aloud").checked,
      actionId: freshId("line-"),
      stamp: unixNow(),
    })
  ) {
    element("line-text").value = "";
  }
});
element("robot-choice")?.addEventListener("change", () => element("robot-choice").form.submit());

connection.socket.open();
setInterval(tick, TICK_MS);
show();
