/** The page of a robot's own display: wires it. scene.js decides what it shows. */

import { Link } from "../../protocol/link.js";
import { Peer } from "../../protocol/peer.js";
import { Socket } from "../../protocol/socket.js";
import { element, pressStop, readConfig, write } from "../../lib/dom.js";
import { unixNow } from "../../lib/clock.js";
import { freshId } from "../../lib/ids.js";
import { readWords } from "../../lib/words.js";
import { Devices } from "../../presence/devices.js";
import { RemotePointers } from "../../presence/remote_pointers.js";
import { lineOf } from "../../presence/message_line.js";
import { SERVER_SILENCE, shownFaults } from "../../protocol/faults.js";
import { isRefusal, newRelease } from "../../protocol/estop_release.js";
import { Rejection, decodePacket, encodePacket } from "../../protocol/robot_api.js";
import { MediaSender } from "./media_sender.js";
import { createChime } from "./chime.js";
import { exchangeKey } from "./key.js";
import { Receipts, newFate, whenSeen } from "./receipts.js";
import { sceneFor, titleOf, troubleOf } from "./scene.js";
import { createVoice } from "./speech.js";

const TICK = 0.1; // s
const BEAT = 2; // s between two heartbeats to the robot
const FRESH = 5; // s after its last frame for which the visitor's video counts as on view
const RELOAD_AFTER = 3000; // ms
const NOT_ALLOWED = 4403;
const MOST_LINES = 30;
const REPEATED = new Set(["estop", "confirm_words"]); // until the robot answers

const [config, words, language] = [readConfig(), readWords(), document.documentElement.lang];
const [video, audio] = [element("video"), element("audio")];
const [volume, field] = [element("volume"), element("field")];
video.addEventListener("resize", () => show());
const voice = createVoice();
const chime = createChime();
const receipts = new Receipts((fields, id) => act("confirm_words", fields, id));

/** @type {import("./scene.js").Known} */
const known = {
  keyed: null,
  screen: null,
  state: null,
  heardAt: 0,
  online: true,
  stop: null,
  release: null,
  askedAt: null,
  sounds: false,
  trouble: "",
  failing: false,
  linked: false,
  actedAt: -Infinity,
  deniedAt: -Infinity,
};
const pointers = new RemotePointers({
  video,
  layer: element("pointers"),
  own: "screen",
  hovers: false, // an unused mouse at the display does not point
  say: (pointer) => {
    const packet = encodePacket("command/point", pointer);
    return (link.live && link.send(packet)) || socket.send(packet, { droppable: true });
  },
});
let announced = "";
let knock = "";
let beatAt = 0;
let beats = 0;
let frames = 0;
let frameAt = -Infinity;
/** What this display confirms to the robot. */
let confirmed = { shows: false, plays: false };
let attempt = 0;

/** @type {MediaSender} */
const mediaSender = new MediaSender({
  devices: new Devices({ onLost: (kind) => mediaSender.lost(kind) }),
  onChange: () => show(),
});

// --- connections ---------------------------------------------------------------------------------

const socket = new Socket({
  url: new URL(config.socket, location.href.replace(/^http/, "ws")).href,
  onPacket: (packet) => receive(packet),
  onOpen: () => show(),
  onLost: (code) => {
    if (code === NOT_ALLOWED) {
      known.keyed = false;
      link.close();
      socket.close();
    }
    known.online = known.failing = false;
    show();
  },
});

const link = new Link({
  makePeer: (role) =>
    new Peer({
      role: /** @type {any} */ (role),
      gives: true,
      onSignal: (message) => socket.send(encodePacket("signal", message)),
      onPacket: (packet) => receive(packet, true),
    }),
  onDropping: () => undefined,
  onOpening: (/** @type {any} */ peer) => {
    video.srcObject = new MediaStream([peer.video.track]);
    audio.srcObject = new MediaStream([peer.audio.track]);
    void hear();
  },
  onLive: () => {
    attempt = 0;
    if (link.peer) {
      void mediaSender.to(/** @type {Peer} */ (link.peer));
    }
    show();
  },
  onLost: () => open(),
});

const open = () => {
  if (known.screen) {
    link.open("observer", /** @type {any} */ (known.screen).iceServers, attempt++);
  }
};

/** @param {unknown} packet @param {boolean} [direct] from the data channel */
const receive = (packet, direct = false) => {
  try {
    const { suffix, message } = decodePacket(packet);
    if (direct) {
      link.heard(unixNow());
    }
    (HANDLERS[suffix] ?? (() => undefined))(message);
  } catch (error) {
    if (!(error instanceof Rejection)) {
      throw error;
    }
  }
};

/** @type {Record<string, (message: any) => void>} */
const HANDLERS = {
  hello: ({ online }) => {
    Object.assign(known, { keyed: true, online });
    attempt = 0;
    show();
  },
  screen: (message) => {
    const first = known.screen === null || !link.peer;
    if (message.session !== known.screen?.session || message.waiting !== known.screen?.waiting) {
      element("messages").replaceChildren();
      voice.hush();
      receipts.forget();
    }
    known.screen = message;
    if (first) {
      open();
    }
    show();
  },
  robot: ({ online }) => {
    known.online = online;
    show();
  },
  state: (message) => {
    if (!known.state || known.state.boot !== message.boot || known.state.seq < message.seq) {
      Object.assign(known, { state: message, heardAt: unixNow(), online: true });
      if (known.stop && message.safety.estop) {
        known.stop = null;
      }
      if (!message.safety.estop && message.safety.inhibited !== "stopped") {
        known.release = known.askedAt = null;
      }
      show();
    }
  },
  action: (message) => {
    receipts.answered(message);
    if (known.release && isRefusal(known.release, message)) {
      known.release.refused = true;
      show();
    }
  },
  words: (message) => {
    const state = receipts.known.get(message.actionId);
    if (state) {
      receipts.say(message.actionId, state, unixNow()); // the robot has restarted and repeats it
      return;
    }
    const list = element("messages");
    const own = message.by === "screen";
    const visitor = words.nameOf(message.who) || words.say("somebody");
    const line = lineOf({ who: own ? words.say("you") : visitor, text: message.text, own });
    list.append(line);
    while (list.children.length > MOST_LINES) {
      list.firstElementChild?.remove();
    }
    list.scrollTop = list.scrollHeight;
    const fate = newFate(
      (next) => message.receipts && receipts.say(message.actionId, next, unixNow()),
    );
    whenSeen(line, fate.seen);
    if (message.aloud) {
      voice.speak(message.text, message.language || language, loudness(), fate.spoken);
    }
  },
  pointer: (message) => pointers.receive(message),
  audience: ({ questions }) => {
    const text = questions.map((/** @type {{text: string}} */ one) => one.text).join(" · ");
    element("asked").hidden = text === "";
    write(element("asked-text"), text);
  },
  "signal/reply": (message) => void link.signal(message),
  "server/status": ({ faults }) => {
    known.failing = shownFaults(faults, 0).some(
      ({ part, then }) => part !== "robot" && then !== "goes_on",
    );
    show();
  },
  denied: ({ suffix }) => {
    if (suffix === "command/action") {
      known.release = null; // the robot did not get it: it is offered again
      known.deniedAt = unixNow();
      show();
    }
  },
};

// --- actions of the people at the robot ----------------------------------------------------------

/** @param {string} type @param {object} [fields] @param {string} [actionId] */
const act = (type, fields = {}, actionId = freshId("screen-")) => {
  const stamp = unixNow();
  if (!REPEATED.has(type)) {
    known.actedAt = stamp;
  }
  socket.send(encodePacket("command/action", { type, actionId, stamp, ...fields }));
};

const stop = () => {
  known.stop = { id: freshId("stop-"), since: unixNow() };
  known.release = known.askedAt = null;
  repeatStop();
  show();
};

/**
 * A release is confirmed first. "No" is where the button was, so that repeated presses on the stop
 * release nothing.
 * @param {boolean} asks
 */
const askToRelease = (asks) => {
  known.askedAt = asks ? unixNow() : null;
  show();
};

const release = () => {
  known.askedAt = null;
  known.release = newRelease("screen-");
  act("clear_estop", {}, known.release.id);
  show();
};

/** On both transports, until the robot's state confirms it. */
const repeatStop = () => {
  if (known.stop) {
    const { id: actionId } = known.stop;
    act("estop", {}, actionId);
    link.send(encodePacket("command/action", { type: "estop", actionId, stamp: unixNow() }));
  }
};

/** @param {string} text */
const say = (text) => {
  if (text.trim()) {
    act("say", { text: text.trim().slice(0, 500), language, aloud: false });
  }
};

const loudness = () => Number(volume.value) / 100;

/** Browsers play sound only after a touch, or where the display's owner has allowed it. */
const hear = async () => {
  try {
    await audio.play();
    element("hear").hidden = true;
  } catch (error) {
    if (!(error instanceof DOMException)) {
      throw error;
    }
    element("hear").hidden = error.name !== "NotAllowedError";
  }
  show();
};

pressStop(element("stop"), stop);
/** @type {Record<string, () => unknown>} */
const CLICKS = {
  accept: () => act("answer_call", { accept: true }),
  decline: () => act("answer_call", { accept: false }),
  "knock-accept": () => act("answer_call", { accept: true, knock }),
  "knock-decline": () => act("answer_call", { accept: false, knock }),
  "hang-up": () => act("answer_call", { accept: false }),
  release: () => askToRelease(true),
  "release-not": () => askToRelease(false),
  "release-sure": release,
  hear: () => void hear(),
};
Object.entries(CLICKS).forEach(([id, click]) => element(id).addEventListener("click", click));
volume.addEventListener("input", () => show());
element("quick").addEventListener("click", (/** @type {Event} */ { target }) => {
  if (target instanceof HTMLButtonElement) {
    say(target.textContent ?? "");
  }
});
element("form").addEventListener("submit", (/** @type {Event} */ event) => {
  event.preventDefault();
  say(field.value);
  field.value = "";
});
for (const touch of ["pointerdown", "pointerup"]) {
  document.addEventListener(touch, () => audio.paused && void hear());
}
// a browser may pause what it let play only while it was muted
audio.addEventListener("pause", () => link.live && void hear());
document.addEventListener("visibilitychange", () => show());

// --- the display ---------------------------------------------------------------------------------

const show = () => {
  known.sounds = !audio.paused;
  const display = sceneFor(known, unixNow());
  const { scene, watching, stopped } = display;
  const name = words.nameOf(display.name) || words.say("somebody");
  const robot = titleOf(known.screen, language) || config.title;
  const face = element("face");
  face.dataset.scene = scene;
  face.toggleAttribute("data-live", link.live);
  write(element("title"), words.say(`${scene}.title`, { name, robot }));
  write(element("text"), words.say(`${display.text}.text`, { name }));
  const hasInitial = ["visiting", "speaking", "ringing", "waiting"].includes(scene);
  write(element("initial"), hasInitial ? Array.from(name)[0].toUpperCase() : "");
  element("answers").hidden = scene !== "ringing";
  element("name").hidden = scene !== "seen";
  write(element("name-text"), words.say("visiting.title", { name }));
  element("watching").hidden = watching === 0;
  write(element("watching"), watching ? words.say("watching", { n: watching }) : "");
  element("notice").hidden = !display.study;
  known.trouble =
    mediaSender.trouble && (mediaSender.trouble === "refused" ? "refused" : "missing");
  known.linked = link.live;
  const trouble = troubleOf(known, socket.silence(unixNow()), unixNow());
  element("trouble").hidden = trouble === "";
  element("trouble").dataset.word = trouble;
  write(element("trouble"), trouble && words.say(trouble));
  // a face is cut to fill the display, a shared screen is not
  const isWhole = display.whole || Math.abs(video.videoWidth / video.videoHeight - 4 / 3) > 0.2;
  if (isWhole !== video.hasAttribute("data-whole")) {
    video.toggleAttribute("data-whole", isWhole);
    pointers.place();
  }
  pointers.allow(display.canPoint, name);
  audio.volume = Math.min(1, display.sound * loudness());
  audio.muted = display.sound === 0;
  element("quick").hidden = element("form").hidden = !display.canWrite;
  element("hang-up").hidden = !display.canHangUp;
  element("stopped").hidden = stopped === "";
  write(element("stopped"), stopped && words.say(`stopped.${stopped}`));
  showRelease(display.release);
  announce(scene, name);
  showKnock(display.knock, name);
  confirm(scene);
};

/** Reports to the robot, with the next heartbeat or at once, what the people here get. */
const confirm = (/** @type {string} */ scene) => {
  const now = unixNow();
  const { totalVideoFrames } = video.getVideoPlaybackQuality();
  frameAt = totalVideoFrames > frames ? now : frameAt; // a new connection counts from 0
  frames = totalVideoFrames;
  const isOnView = scene === "seen" && document.visibilityState === "visible";
  const next = { shows: isOnView && now - frameAt < FRESH, plays: !audio.paused && loudness() > 0 };
  const isNews = next.shows !== confirmed.shows || next.plays !== confirmed.plays;
  confirmed = next;
  if (isNews || now - beatAt > BEAT) {
    beatAt = now;
    link.send(encodePacket("command/heartbeat", { n: (beats += 1), stamp: now, ...next }));
  }
};

/** @param {import("./scene.js").Display["release"]} releasing */
const showRelease = (releasing) => {
  const button = /** @type {HTMLButtonElement} */ (element("release"));
  const asks = releasing === "sure";
  button.hidden = releasing === "" || asks;
  element("release-sure").hidden = element("release-not").hidden = !asks;
  // back at once, in case it is needed while the robot releases the stop
  element("stop").hidden = releasing === "offered" || asks;
  button.disabled = releasing === "asked";
  write(button, words.say(button.disabled ? "release.asked" : "release.offered"));
};

/**
 * A knock is shown while it rings, and sounds once.
 * @param {string} rings its id @param {string} name
 */
const showKnock = (rings, name) => {
  element("knock").hidden = rings === "";
  write(element("knock-text"), rings && words.say("knock", { name }));
  if (rings && rings !== knock) {
    void chime.ring(loudness()).then((sounds) => {
      if (!sounds && loudness() > 0) {
        element("hear").hidden = false;
      }
    });
  }
  knock = rings || knock;
};

/** Announces a call aloud. @param {string} scene @param {string} name */
const announce = (scene, name) => {
  const next = scene === "ringing" ? `${known.screen?.session}` : "";
  if (next && next !== announced) {
    voice.speak(words.say("ringing.title", { name }), language, loudness());
  }
  announced = next;
};

const tick = () => {
  const now = unixNow();
  link.watch(now);
  repeatStop();
  receipts.tick(now);
  const silence = socket.watch(now);
  const waits = known.release || known.askedAt || silence > SERVER_SILENCE; // for an answer
  if (waits || now - beatAt > BEAT) {
    show();
  }
};

const begin = async () => {
  try {
    known.keyed = (await exchangeKey(config)) ? null : false;
  } catch (error) {
    if (!(error instanceof TypeError)) {
      throw error;
    }
    // no network yet: a display is switched on before its router
    setTimeout(() => location.reload(), RELOAD_AFTER);
    return;
  }
  show();
  if (known.keyed !== false) {
    socket.open();
    setInterval(tick, TICK * 1000);
  }
};

void begin();
