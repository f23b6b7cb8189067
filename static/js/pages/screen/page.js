/**
 * The page of a robot's own display: the one place that wires it. What to show is decided in
 * scene.js.
 */

import { Link } from "../../protocol/link.js";
import { Peer } from "../../protocol/peer.js";
import { Socket } from "../../protocol/socket.js";
import { write } from "../../lib/dom.js";
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
const BEAT = 2; // s; a sign of life of this display to the robot
const RELOAD_AFTER = 3000; // ms
const NOT_ALLOWED = 4403;
const MOST_LINES = 30;
const REPEATED = new Set(["estop", "confirm_words"]); // until the robot answers

const element = (/** @type {string} */ id) =>
  /** @type {HTMLElement} */ (document.getElementById(id));
const config = JSON.parse(element("config").textContent ?? "{}");
const words = readWords(
  /** @type {HTMLTemplateElement} */ (element("words")),
  document.documentElement.lang,
);
const video = /** @type {HTMLVideoElement} */ (element("video"));
video.addEventListener("resize", () => show());
const audio = /** @type {HTMLAudioElement} */ (element("audio"));
const volume = /** @type {HTMLInputElement} */ (element("volume"));
const field = /** @type {HTMLInputElement} */ (element("field"));
const voice = createVoice();
const chime = createChime();
const receipts = new Receipts((fields, id) => act("confirm_words", fields, id));

/** @type {import("./scene.js").Told} */
const told = {
  keyed: /** @type {any} */ (null),
  screen: null,
  state: null,
  heardAt: 0,
  online: true,
  stop: null,
  release: null,
  askedAt: null,
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
  hovers: false, // a mouse that lies about on a display points at nothing
  say: (pointer) => {
    const packet = encodePacket("command/point", pointer);
    return (link.live && link.send(packet)) || socket.send(packet, { droppable: true });
  },
});
let announced = "";
let knock = "";
let beatAt = 0;
let beats = 0;
let attempt = 0;

/** @type {MediaSender} */
const mediaSender = new MediaSender({
  devices: new Devices({ onLost: (kind) => mediaSender.lost(kind) }),
  onChange: () => show(),
});

// --- the ways ------------------------------------------------------------------------------------

const socket = new Socket({
  url: new URL(config.socket, location.href.replace(/^http/, "ws")).href,
  onPacket: (packet) => receive(packet),
  onOpen: () => show(),
  onLost: (code) => {
    if (code === NOT_ALLOWED) {
      told.keyed = false;
      link.close();
      socket.close();
    }
    told.online = told.failing = false;
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
  if (told.screen) {
    link.open("observer", /** @type {any} */ (told.screen).iceServers, attempt++);
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
    Object.assign(told, { keyed: true, online });
    attempt = 0;
    show();
  },
  screen: (message) => {
    const first = told.screen === null || !link.peer;
    if (message.session !== told.screen?.session || message.waiting !== told.screen?.waiting) {
      element("messages").replaceChildren();
      voice.hush();
      receipts.forget();
    }
    told.screen = message;
    if (first) {
      open();
    }
    show();
  },
  robot: ({ online }) => {
    told.online = online;
    show();
  },
  state: (message) => {
    if (!told.state || told.state.boot !== message.boot || told.state.seq < message.seq) {
      Object.assign(told, { state: message, heardAt: unixNow(), online: true });
      if (told.stop && message.safety.estop) {
        told.stop = null;
      }
      if (!message.safety.estop && message.safety.inhibited !== "stopped") {
        told.release = told.askedAt = null;
      }
      show();
    }
  },
  action: (message) => {
    receipts.answered(message);
    if (told.release && isRefusal(told.release, message)) {
      told.release.refused = true;
      show();
    }
  },
  words: (message) => {
    const known = receipts.known.get(message.actionId);
    if (known) {
      // the robot has begun anew, and asks with the same words
      receipts.say(message.actionId, known, unixNow());
      return;
    }
    const list = element("messages");
    const line = lineOf({
      who:
        message.by === "screen"
          ? words.say("you")
          : words.nameOf(message.who) || words.say("somebody"),
      text: message.text,
      own: message.by === "screen",
    });
    list.append(line);
    while (list.children.length > MOST_LINES) {
      list.firstElementChild?.remove();
    }
    list.scrollTop = list.scrollHeight;
    const fate = newFate(
      (state) => message.receipts && receipts.say(message.actionId, state, unixNow()),
    );
    whenSeen(line, fate.seen);
    if (message.aloud) {
      voice.speak(
        message.text,
        message.language || document.documentElement.lang,
        loudness(),
        fate.spoken,
      );
    }
  },
  pointer: (message) => pointers.told(message),
  audience: ({ questions }) => {
    const text = questions.map((/** @type {{text: string}} */ one) => one.text).join(" · ");
    element("asked").hidden = text === "";
    write(element("asked-text"), text);
  },
  "signal/reply": (message) => void link.signal(message),
  "server/status": ({ faults }) => {
    told.failing = shownFaults(faults, 0).some(
      ({ part, then }) => part !== "robot" && then !== "goes_on",
    );
    show();
  },
  denied: ({ suffix }) => {
    if (suffix === "command/action") {
      told.release = null; // the robot was not asked: it is offered again
      told.deniedAt = unixNow();
      show();
    }
  },
};

// --- what the people here do ---------------------------------------------------------------------

/** @param {string} type @param {object} [fields] @param {string} [actionId] */
const act = (type, fields = {}, actionId = freshId("screen-")) => {
  const stamp = unixNow();
  if (!REPEATED.has(type)) {
    told.actedAt = stamp;
  }
  socket.send(encodePacket("command/action", { type, actionId, stamp, ...fields }));
};

const stop = () => {
  told.stop = { id: freshId("stop-"), since: unixNow() };
  told.release = told.askedAt = null;
  repeatStop();
  show();
};

/**
 * Asked first, with the answer that changes nothing where the button was: whoever presses the stop
 * again and again releases nothing.
 * @param {boolean} asks
 */
const askToRelease = (asks) => {
  told.askedAt = asks ? unixNow() : null;
  show();
};

const release = () => {
  told.askedAt = null;
  told.release = newRelease("screen-");
  act("clear_estop", {}, told.release.id);
  show();
};

/** On both ways, until the robot's state says so. */
const repeatStop = () => {
  if (told.stop) {
    act("estop", {}, told.stop.id);
    link.send(
      encodePacket("command/action", { type: "estop", actionId: told.stop.id, stamp: unixNow() }),
    );
  }
};

/** @param {string} text */
const say = (text) => {
  if (text.trim()) {
    act("say", {
      text: text.trim().slice(0, 500),
      language: document.documentElement.lang,
      aloud: false,
    });
  }
};

const loudness = () => Number(volume.value) / 100;

/**
 * Browsers play sound only where somebody has touched the page, or where the display's owner has
 * allowed it.
 */
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
};

// At the moment of pressing, not of lifting: a stop is not to be thought over.
element("stop").addEventListener("pointerdown", (event) => {
  event.preventDefault();
  stop();
});
element("stop").addEventListener("click", (event) => {
  if (event.detail === 0) {
    stop();
  }
});
element("accept").addEventListener("click", () => act("answer_call", { accept: true }));
element("decline").addEventListener("click", () => act("answer_call", { accept: false }));
element("knock-accept").addEventListener("click", () =>
  act("answer_call", { accept: true, knock }),
);
element("knock-decline").addEventListener("click", () =>
  act("answer_call", { accept: false, knock }),
);
element("hang-up").addEventListener("click", () => act("answer_call", { accept: false }));
element("release").addEventListener("click", () => askToRelease(true));
element("release-not").addEventListener("click", () => askToRelease(false));
element("release-sure").addEventListener("click", release);
element("hear").addEventListener("click", () => void hear());
volume.addEventListener("input", () => show());
element("quick").addEventListener("click", ({ target }) => {
  if (target instanceof HTMLButtonElement) {
    say(target.textContent ?? "");
  }
});
element("form").addEventListener("submit", (event) => {
  event.preventDefault();
  say(field.value);
  field.value = "";
});
document.addEventListener("pointerdown", () => void hear(), { once: true });

// --- what they see -------------------------------------------------------------------------------

const show = () => {
  const {
    scene,
    name,
    study,
    sound,
    whole,
    canPoint,
    canWrite,
    canHangUp,
    knock: rings,
    watching,
    stopped,
    release: releasing,
  } = sceneFor(told, unixNow());
  const shownName = words.nameOf(name) || words.say("somebody");
  const robot = titleOf(told.screen, document.documentElement.lang) || config.title;
  const face = element("face");
  face.dataset.scene = scene;
  face.toggleAttribute("data-live", link.live);
  write(element("title"), words.say(`${scene}.title`, { name: shownName, robot }));
  write(element("text"), words.say(`${scene}.text`, { name: shownName }));
  write(
    element("initial"),
    ["visiting", "speaking", "ringing", "waiting"].includes(scene)
      ? Array.from(shownName)[0].toUpperCase()
      : "",
  );
  element("answers").hidden = scene !== "ringing";
  element("name").hidden = scene !== "seen";
  write(element("name-text"), words.say("visiting.title", { name: shownName }));
  element("watching").hidden = watching === 0;
  write(element("watching"), watching ? words.say("watching", { n: watching }) : "");
  element("notice").hidden = !study;
  told.trouble = mediaSender.trouble && (mediaSender.trouble === "refused" ? "refused" : "missing");
  told.linked = link.live;
  const trouble = troubleOf(told, socket.silence(unixNow()), unixNow());
  element("trouble").hidden = trouble === "";
  element("trouble").dataset.word = trouble;
  write(element("trouble"), trouble && words.say(trouble));
  // A face may lose its edges to fill the display; a screen that is shown has to be read to them.
  const isWhole = whole || Math.abs(video.videoWidth / video.videoHeight - 4 / 3) > 0.2;
  if (isWhole !== video.hasAttribute("data-whole")) {
    video.toggleAttribute("data-whole", isWhole);
    pointers.place();
  }
  pointers.allow(canPoint, shownName);
  audio.volume = Math.min(1, sound * loudness());
  audio.muted = sound === 0;
  for (const part of ["quick", "form"]) {
    element(part).hidden = !canWrite;
  }
  element("hang-up").hidden = !canHangUp;
  element("stopped").hidden = stopped === "";
  write(element("stopped"), stopped && words.say(`stopped.${stopped}`));
  showRelease(releasing);
  announce(scene, shownName);
  showKnock(rings, shownName);
};

/** @param {import("./scene.js").Display["release"]} releasing */
const showRelease = (releasing) => {
  const button = /** @type {HTMLButtonElement} */ (element("release"));
  const asks = releasing === "sure";
  button.hidden = releasing === "" || asks;
  element("release-sure").hidden = element("release-not").hidden = !asks;
  // Back at once, for whoever sees somebody walk in while the robot releases it.
  element("stop").hidden = releasing === "offered" || asks;
  button.disabled = releasing === "asked";
  write(button, words.say(button.disabled ? "release.asked" : "release.offered"));
};

/**
 * A knock is seen as long as it rings, and heard once.
 * @param {string} rings its id
 * @param {string} name
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

/**
 * Somebody who stands with their back to the robot hears that it rings.
 * @param {string} scene @param {string} name
 */
const announce = (scene, name) => {
  const next = scene === "ringing" ? `${told.screen?.session}` : "";
  if (next && next !== announced) {
    voice.speak(words.say("ringing.title", { name }), document.documentElement.lang, loudness());
  }
  announced = next;
};

const tick = () => {
  const now = unixNow();
  link.watch(now);
  repeatStop();
  receipts.tick(now);
  const silence = socket.watch(now);
  if (told.release || told.askedAt || silence > SERVER_SILENCE) {
    show(); // the time for an answer runs
  }
  if (now - beatAt > BEAT) {
    beatAt = now;
    link.send(encodePacket("command/heartbeat", { n: (beats += 1), stamp: now }));
    show();
  }
};

const begin = async () => {
  try {
    told.keyed = (await exchangeKey(config)) ? /** @type {any} */ (null) : false;
  } catch (error) {
    if (!(error instanceof TypeError)) {
      throw error;
    }
    // no network yet: a display is switched on before its router
    setTimeout(() => location.reload(), RELOAD_AFTER);
    return;
  }
  show();
  if (told.keyed !== false) {
    socket.open();
    setInterval(tick, TICK * 1000);
  }
};

void begin();
