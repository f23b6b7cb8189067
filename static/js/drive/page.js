/**
 * The drive page: the one place that wires everything. What to do is decided in pure modules (protocol/session.js, commands.js,
 * view/hud/card.js and others); here their decisions meet the browser.
 *
 * Longer than most files, because the wiring of the page should be readable in one go.
 */

import { createAutonomy } from "../autonomy/feature.js";
import { CommandStream, TICK_SECONDS } from "../protocol/command_stream.js";
import { TransportRouter } from "../protocol/transport_router.js";
import { ClockSync } from "../protocol/clock_sync.js";
import { Link, isSupported } from "../protocol/link.js";
import { Peer } from "../protocol/peer.js";
import { reduce, roleOf } from "../protocol/session.js";
import { Socket } from "../protocol/socket.js";
import { guard } from "../input/focus_loss.js";
import { Steering } from "../input/steering.js";
import { createAnnouncer } from "../view/hud/announcer.js";
import { cardFor } from "../view/hud/card.js";
import { createControls } from "../view/hud/controls.js";
import { createDials } from "../view/hud/dials.js";
import { CardPanel } from "../view/hud/card_panel.js";
import { KeyDispatcher } from "../input/key_dispatcher.js";
import { watchActivity } from "./activity.js";
import { createReadings } from "../view/hud/readings.js";
import { createView } from "../view/display/feature.js";
import { unixNow } from "../lib/clock.js";
import { lazy } from "../lib/lazy.js";
import { freshId } from "../lib/ids.js";
import { readWords } from "../lib/words.js";
import { createMapControls } from "../view/map/gestures.js";
import { RobotMap, loadFloorPlan } from "../view/map/robot_map.js";
import { createOverlay } from "../view/overlay/feature.js";
import { forget, recall, remember, rememberLeaving } from "./storage.js";
import { createPresence } from "../presence/feature.js";
import { ON_DATA_CHANNEL, Rejection, decodePacket, encodePacket } from "../protocol/robot_api.js";
import { createScheduler } from "./scheduler.js";
import { createStore, newState } from "./store.js";
import { controllersOf } from "../study/restrictions.js";
import { createStudy } from "../study/feature.js";
import { messageOf } from "../autonomy/robot_action.js";
import { ShownFrame } from "../view/video/capture_stamp.js";
import { JpegFallback } from "../view/video/jpeg_fallback.js";
import { Viewport } from "../view/video/viewport.js";

const MAP_TOOLS = 48; // CSS pixels that the buttons at the map's upper edge take

const element = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
const config = JSON.parse(element("config").textContent ?? "{}");
const words = readWords(/** @type {HTMLTemplateElement} */ (element("words")), document.documentElement.lang);
const cockpit = element("cockpit");
const title = document.title;

const store = createStore({ ...newState(), factsheet: config.factsheet ?? null, study: config.study ?? null, practice: config.practice ? "off" : "none" });
const keys = new KeyDispatcher();
const clockSync = new ClockSync();
const commands = new CommandStream({ freshId: () => freshId("stop-") });
const shown = new ShownFrame();
const refusedFrames = new Map();

// --- the visit -------------------------------------------------------------------------------------------------------

/** @param {import("../protocol/session.js").Happening} happening */
const dispatch = (happening) => {
  const before = store.get().visit;
  const now = unixNow();
  const { visit, effects } = reduce(before, { ...happening, now });
  store.update({ visit, now });
  entitle(visit);
  if (visit.phase === "queued" && before.phase !== "queued") {
    aside(({ waits }) => waits());
  } else if (visit.phase !== "queued" && before.phase === "queued") {
    aside(({ practice_over }) => practice_over());
  }
  if (visit.phase !== before.phase) {
    performance.mark(`drive:${visit.phase}`);
  }
  for (const effect of effects) {
    EFFECTS[effect.type](effect);
  }
};

/** The tab's name, which calls as well; said at once, because a page out of sight draws nothing. @param {import("../protocol/session.js").Visit} visit */
const entitle = ({ phase, askedUntil }) => {
  const word = askedUntil !== null ? "idle.title" : phase === "turn" ? "turn.title" : "";
  document.title = word ? `${words.say(word)} · ${title}` : title;
};

/** @type {Record<string, (effect: any) => void>} */
const EFFECTS = {
  send: ({ suffix, message }) => socket.send(encodePacket(suffix, message)),
  prepare_link: ({ role }) => link.prepare(role),
  open_link: ({ role, iceServers, attempt }) => link.open(role, iceServers, attempt),
  close_link: () => {
    link.close();
    slow.stop();
    viewport.clear();
    store.update({ playing: false, slow: false, frameAge: null, roundTrip: null, network: null });
  },
  control: ({ lease }) => (lease ? takeControl(lease) : letControlGo()),
  remember: ({ session }) => remember(config.robot, session),
  forget: () => forget(config.robot),
  call: ({ word }) => aside(({ call }) => call(word)),
  close_socket: () => socket.close(),
};

let [sessionBefore, begun] = ["", ""]; // the visit that this tab was in when it was loaded, and the one that it drives

const takeControl = (/** @type {any} */ lease) => {
  const again = lease.session === sessionBefore;
  rounds.hurry();
  commands.bind(lease);
  steering.leaseLimits = lease.limits;
  steering.allow(controllersOf(store.get()));
  router.only = store.get().visit.terms?.controlWay ?? "any";
  study.began(lease.session);
  steering.enable();
  if (lease.session !== begun) {
    begun = lease.session;
    view.began(again);
  }
  if (!keys.taken) {
    element("viewport").focus({ preventScroll: true });
  }
};

const letControlGo = () => {
  store.update({ began: null });
  autonomy.forget();
  steering.disable();
  commands.unbind();
};

// --- the ways --------------------------------------------------------------------------------------------------------

const socket = new Socket({
  url: new URL(config.socket, location.href.replace(/^http/, "ws")).href,
  onFrame: (frame) => receive(frame, "mqtt"),
  onOpen: () => {
    performance.mark("drive:socket");
    router.direct = false;
    rounds.heardServer();
    slow.hurry();
    store.update({ faults: [] });
    dispatch({ type: "socket_open" });
  },
  onLost: (code) => dispatch({ type: "socket_closed", code }),
});

const link = new Link({
  makePeer: (role) => new Peer({ role, onSignal: (message) => socket.send(encodePacket("signal", message)), onFrame: (frame) => receive(frame, "datachannel") }),
  onDropping: () => viewport.freeze(),
  onOpening: (peer) => {
    shown.reset();
    clockSync.reset("datachannel");
    rounds.linkBegins();
    store.update({ playing: slow.isFresh(unixNow()) });
    viewport.attach(peer.video, peer.audio);
    presence.opening(peer);
  },
  onLive: () => {
    performance.mark("drive:link");
    dispatch({ type: "link_live" });
  },
  onLost: (why) => {
    report("link_lost", { why });
    if (!slow.on) {
      standStill();
    }
    dispatch({ type: "link_lost" });
  },
});

/** Nobody drives by a picture that is not there: what the page says then, that the robot has stopped, is true. */
const standStill = () => {
  store.update({ playing: false });
  steering.letGo();
  stop();
};

const router = new TransportRouter({ socket, link, clockSync, commands });

/** @param {unknown} frame @param {import("../protocol/clock_sync.js").Way} way */
const receive = (frame, way) => {
  try {
    const { suffix, message } = decodePacket(frame);
    if (way === "mqtt") {
      rounds.heardServer();
    }
    if (way === "mqtt" || ON_DATA_CHANNEL.has(suffix)) {
      take(suffix, message, way);
    }
  } catch (error) {
    if (!(error instanceof Rejection)) {
      throw error;
    }
    refusedFrames.set(error.reason, (refusedFrames.get(error.reason) ?? 0) + 1);
  }
};

/** @param {string} suffix @param {any} message @param {import("../protocol/clock_sync.js").Way} way */
const take = (suffix, message, way) => {
  const handler = HANDLERS[suffix];
  if (handler) {
    handler(message, way);
  } else {
    dispatch({ type: suffix, message });
  }
};

/** @type {Record<string, (message: any, way: import("../protocol/clock_sync.js").Way) => void>} */
const HANDLERS = {
  heartbeat: (message, way) => {
    const now = unixNow();
    clockSync.heard(way, message, store.get().visit.peer, now);
    if (way === "datachannel") {
      link.heard(now);
    }
  },
  media: (message) => shown.told(message),
  picture: (message) => void slow.received(message, unixNow),
  state: (message) => {
    commands.heardState(message);
    map.setPose(message.pose, message.stamp);
    overlay.moved(message);
    const { robot: known, visit, began } = store.get();
    if (!known || known.boot !== message.boot || known.seq < message.seq) {
      store.update({ robot: message });
      autonomy.state(message);
    }
    autonomy.help(message);
    if (began === null && visit.phase === "driving" && message.session === visit.session) {
      store.update({ began: { at: unixNow(), distance: message.distance } });
    }
  },
  pose: (message) => {
    map.setPose(message.pose, message.stamp);
    overlay.moved(message);
    autonomy.help(message);
  },
  path: (message) => {
    map.setPath(message.points);
    overlay.path(message.points);
  },
  action: (message) => {
    commands.heardAction(message);
    study.action(message);
    autonomy.action(message);
    presence.action(message);
  },
  words: (message) => presence.said(message),
  pointer: (message) => presence.pointed(message),
  factsheet: (message) => {
    steering.robotLimits = message.limits;
    store.update({ factsheet: message });
  },
  robot: (message) => {
    slow.hurry();
    dispatch({ type: "robot", message });
  },
  room: (message) => store.update({ room: message }),
  "session/task": (message) => study.told(message),
  "server/status": ({ faults }) => {
    const now = unixNow();
    store.update({ faults: faults.map(({ part, then, seconds }) => ({ part, then, at: seconds === null ? null : now + seconds })) });
  },
  notice: (message) => store.update({ notice: message.text }),
  "signal/reply": (message) => {
    dispatch({ type: "signal/reply", message });
    void link.signal(message);
  },
  scan: (message) => {
    map.setScan(message, store.get().factsheet?.laser ?? null);
    overlay.scan(message);
  },
  // For the record that others keep.
  event: () => undefined,
  denied: (message) => {
    const what = `${message.suffix} ${message.reason}`;
    refusedFrames.set(what, (refusedFrames.get(what) ?? 0) + 1);
    dispatch({ type: "denied", message });
  },
};

/**
 * Something for the record of the session.
 * @param {string} type @param {Record<string, string | number | boolean | null>} [data]
 * @param {number} [stamp] when it was so, Unix seconds
 * @returns {boolean} whether it is on its way
 */
const report = (type, data = {}, stamp = unixNow()) =>
  Boolean(store.get().visit.session) && socket.send(encodePacket("page/event", { stamp, type, data }));

// --- what is seen ----------------------------------------------------------------------------------------------------

const viewport = new Viewport({
  video: /** @type {HTMLVideoElement} */ (element("video")),
  audio: /** @type {HTMLAudioElement} */ (element("audio")),
  still: /** @type {HTMLCanvasElement} */ (element("still")),
  slow: /** @type {HTMLCanvasElement} */ (element("slow")),
  onFrame: (rtp) => {
    shown.shown(rtp, unixNow());
    overlay.refresh();
  },
  onPlaying: () => {
    performance.mark("drive:first-frame");
    if (!slow.on) {
      store.update({ playing: true });
    }
  },
});

const slow = new JpegFallback({
  ask: (request) => socket.send(encodePacket("command/picture", request), { droppable: true }),
  show: (jpeg, isWanted) => viewport.showSlow(jpeg, isWanted),
  onShown: () => {
    store.update({ playing: true });
    overlay.refresh();
  },
});

/** Capture stamp of the picture on the screen, by the robot's clock; null while unknown. */
const pictureStamp = () => (slow.on ? slow.stamp : shown.stamp);

const map = new RobotMap({ canvas: /** @type {HTMLCanvasElement} */ (element("map")), tools: MAP_TOOLS });

/** Seconds since the picture on the screen was taken, by the robot's clock; null while unknown. @param {number} now */
const frameAge = (now) => {
  const stamp = pictureStamp();
  return stamp === null || clockSync.offset === null ? null : Math.max(0, now + clockSync.offset - stamp);
};

const dialog = new CardPanel({ element: element("card"), words, onAction: (action) => act(action) });
const readings = createReadings(element, words);
const dials = createDials(element, document.documentElement.lang);
const announce = createAnnouncer(element("announcer"), words);
store.subscribe((state) => {
  const { visit } = state;
  const card = cardFor(state);
  Object.assign(cockpit.dataset, { phase: visit.phase, link: visit.link, role: roleOf(visit), way: state.way });
  cockpit.toggleAttribute("data-playing", state.playing);
  cockpit.toggleAttribute("data-slow", state.slow);
  cockpit.toggleAttribute("data-frozen", roleOf(visit) !== "" && (state.slow ? !state.playing : visit.link === "lost"));
  dialog.show(card);
  readings(state);
  dials(state);
  controls(state);
  autonomy.show(state);
  looking.show(state);
  overlay.show(state);
  study.show(state);
  presence.show(state);
  view.show(state);
  announce(state);
});

// --- what the visitor does -------------------------------------------------------------------------------------------

const sendNow = () => router.sendVelocity(unixNow(), pictureStamp());

const stop = () => {
  const role = roleOf(store.get().visit);
  if (role) {
    router.stop(unixNow(), "stop");
    store.update({ stopping: true });
  }
};

/** Everything counts as lifted, and the robot stops. */
const brake = () => {
  steering.letGo();
  stop();
};

const steering = new Steering({
  keys: keys,
  pad: element("stick"),
  knob: element("stick-knob"),
  onIntent: (intent) => {
    if (commands.intend(intent)) {
      sendNow();
    }
    if (intent.linear !== 0 || intent.angular !== 0) {
      study.steered(intent.method);
    }
    autonomy.steered(intent);
    overlay.steered(intent);
  },
  onBarred: (method) => store.update({ barred: { method, at: unixNow() }, now: unixNow() }),
  onStop: () => brake(),
  onStep: (speedStep) => store.update({ speedStep }),
});
steering.robotLimits = store.get().factsheet?.limits ?? null;

/** @param {import("../autonomy/robot_action.js").Task} task */
const sendAction = (task) => {
  if (commands.binding) {
    const now = unixNow();
    router.sendAction(messageOf(task, commands.binding, now), now - task.askedAt > TICK_SECONDS);
  }
};

/** @param {{stamp: number, at: [number, number] | null}} dot */
const sendPoint = (dot) => commands.binding && router.sendPoint(dot.stamp, { ...commands.binding, ...dot });

guard((why) => {
  if (steering.enabled) {
    steering.letGo();
    stop();
    report(why);
  }
  if (why === "pagehide" && config.practising) {
    dispatch({ type: "leave" });
  } else if (why === "pagehide") {
    rememberLeaving(config.robot);
  }
});

/** Somebody is there: said to the server now and then, for whoever only looks or writes is not away. */
const giveSign = () => {
  if (store.get().visit.phase === "driving") {
    report("here");
    dispatch({ type: "here" });
  }
};
watchActivity({ target: window, clock: unixNow, isAsked: () => store.get().visit.askedUntil !== null, onSign: giveSign });

const aside = lazy(async () => (await import("../waiting/lazy_panels.js")).createLazyPanels({ store, config, words, element, report, begin }));

/** Have what calls ready while the visitor waits: a page may sound only after a touch. */
window.addEventListener("click", () => {
  if (["taking", "queued", "turn"].includes(store.get().visit.phase)) {
    aside(({ prepare }) => void prepare());
  }
});

/** @type {Record<string, () => void>} */
const ACTIONS = {
  here: giveSign,
  home: () => (config.practising && parent !== window ? parent.postMessage("practice_over", location.origin) : element("home").click()),
  sign_in: () => location.reload(), // the page's address itself asks for it, and leads back here
  reload: () => location.reload(),
  stay: () => {
    store.update({ leaving: false });
    element("viewport").focus({ preventScroll: true });
  },
  leave: () => (store.get().visit.phase === "driving" ? store.update({ leaving: true }) : act("leave_now")),
  leave_now: () => {
    store.update({ leaving: false, notice: "" });
    dispatch({ type: "leave" });
  },
  stop: brake,
  sound: () => {
    const sound = !store.get().sound;
    viewport.setSound(sound);
    store.update({ sound });
    report("sound", { on: sound });
  },
  map: () => store.update({ mapOpen: !store.get().mapOpen }),
};
for (const name of /** @type {const} */ (["tell_me", "copy_link", "go_slow", "practise"])) {
  ACTIONS[name] = () => aside((actions) => void actions[name]());
}

/** @param {string} action one of ACTIONS, a speed step, or something that happens to the visit */
const act = (action) => {
  if (action.startsWith("speed-")) {
    steering.setStep(Number(action.slice("speed-".length)));
  } else if (action.startsWith("assist-")) {
    autonomy.assist(action.slice("assist-".length));
  } else if (action.startsWith("go_to:")) {
    autonomy.goTo(action.slice("go_to:".length));
  } else if (ACTIONS[action]) {
    ACTIONS[action]();
  } else {
    dispatch({ type: action });
  }
  store.flush();
};
keys.closes(element("card"), () => act(store.get().leaving ? "stay" : "here"));

const controls = createControls(element, words, act);
const study = createStudy({ store, config, words, element, map, report, sendAction });
const presence = createPresence({ store, config, words, element, keys, report, sendAction, sendPoint });
const autonomy = createAutonomy({ store, words, element, keys, map, act, sendAction, sendAssist: (level) => socket.send(encodePacket("session/assist", { level })) });
const overlay = createOverlay({ store, element, steering, pictureStamp, stop: brake, report });
const view = createView({
  store,
  config,
  words,
  element,
  report,
  setStep: (step) => steering.setStep(step),
  assist: (level) => autonomy.assist(level),
  brake,
  raw: () => ({
    connection: slow.on ? null : (link.peer?.connection ?? null),
    state: store.get(),
    trips: { datachannel: clockSync.roundTrip("datachannel"), mqtt: clockSync.roundTrip("mqtt") },
    glass: slow.on || clockSync.offset === null || shown.stamp === null ? null : Math.max(0, shown.at + clockSync.offset - shown.stamp),
    size: viewport.size,
  }),
});
const looking = createMapControls({ element, map, store, autonomy });
Object.assign(ACTIONS, study.actions, autonomy.actions, overlay.actions, looking.actions);

// --- time ------------------------------------------------------------------------------------------------------------

const rounds = createScheduler({
  store,
  socket,
  link,
  router,
  clockSync,
  commands,
  slow,
  viewport,
  shown,
  frameAge,
  sendNow,
  standStill,
  report,
  dispatch,
  aside,
  onTick: () => overlay.tick(),
  onBeat: (now) => [autonomy, study, presence].forEach((one) => one.tick(now)),
});

// --- begin -----------------------------------------------------------------------------------------------------------

const begin = () => {
  const address = new URL(location.href);
  const go = address.searchParams.get("go") === "1";
  if (go) {
    // Leaving and coming back by the browser's own buttons must not take the robot again.
    address.searchParams.delete("go");
    history.replaceState(null, "", address);
  }
  const { session, left } = recall(config.robot);
  sessionBefore = session ?? "";
  dispatch({ type: "loaded", session, takeover: left, go });
  socket.open();
  rounds.begin();
};

window.addEventListener("online", () => link.hurry());

window.addEventListener("pageshow", (event) => {
  // A page that comes back out of the browser's cache has lost its connections and its timers: begin again.
  if (event.persisted) {
    location.reload();
  }
});

if (config.floorplan) {
  loadFloorPlan(config.floorplan).then(
    ({ site, image }) => {
      map.show(site, image);
      store.update({ plan: site.plan ?? null });
    },
    () => cockpit.setAttribute("data-no-map", ""),
  );
} else {
  cockpit.setAttribute("data-no-map", "");
}

if (isSupported()) {
  begin();
} else {
  aside(({ explain }) => explain());
}
