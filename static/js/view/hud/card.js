/**
 * Decides the text and buttons of the card over the video: what the session is waiting for, asks,
 * or how it ended. Pure; rendered by card_panel.js.
 */

import { releaseFor, setsOut } from "../../autonomy/offer.js";
import { isHeld } from "../../protocol/estop_release.js";
import { roleOf } from "../../protocol/session.js";
import { studyCard } from "../../study/end_cards.js";
import { warningFor } from "./alert.js";
import { betweenVisits, pauseOf, reasonForWaiting } from "./pause.js";
import { isAway, isCutOff, standstillOf } from "../../protocol/standstill.js";

/**
 * @typedef {{action: string, url: string}} FreeRobot label and address of its button
 * @typedef {{action: string, word: string}} Button
 *
 * @typedef {object} Card
 * @property {string} word the sentences are `<word>.title` and `<word>.text`
 * @property {Record<string, string | number>} [values] for the sentences
 * @property {{word: string, values?: Record<string, string | number>} | null} [detail] a sentence
 *   in front of the text
 * @property {ReturnType<typeof warningFor>} [warning] an alert, in a line of its own
 * @property {boolean} [busy] something is in progress
 * @property {Button} [main]
 * @property {Button} [other]
 * @property {Button} [extra] something to do while waiting
 * @property {FreeRobot[]} [instead] robots that can be driven at once
 * @property {number} [countdown] seconds
 * @property {boolean} [quiet] no button gets the focus, so that no key answers by mistake
 */

const HOME = { action: "home", word: "do.home" };
const AGAIN = { action: "drive", word: "do.again" };
const PRIVATE = { word: "private" };
const BACK = { action: "back", word: "do.back" };
/** A simulated robot without users ends; only a new request starts one. */
const PRACTISE_AGAIN = { action: "practise_again", word: "do.back" };
const TAKE_OVER = { action: "ask_to_take_over", word: "do.take_over" };
const GO_SLOW = { action: "go_slow", word: "do.go_slow" };
const SOUVENIR = { action: "souvenir", word: "do.souvenir" };
const SHORTEST_TRIP = 0.5; // m; no picture of less
const SIGN_IN = { action: "sign_in", word: "do.sign_in" };

/** The outcomes that have words of their own, and the button for each. */
const AFTER = /** @type {Record<string, Button>} */ ({
  moved: TAKE_OVER,
  turn_missed: AGAIN,
  idle: AGAIN,
  timed_out: AGAIN,
  maintenance: AGAIN,
  completed: AGAIN,
  cancelled: AGAIN,
  left: AGAIN,
  connection_lost: AGAIN,
  connection_refused: AGAIN,
  robot_fault: BACK,
  stopped_by_operator: HOME,
});

/** @param {State} state @returns {Card | null} */
export const cardFor = (state) => {
  const card = studyCard(state, usualCard(state));
  const warning = card && warningFor(state);
  return warning ? { ...card, warning } : card;
};

/** @param {State} state @returns {Card | null} */
const usualCard = (state) => {
  if (state.visit.askedUntil !== null) {
    return {
      word: "idle",
      countdown: Math.max(0, Math.ceil(state.visit.askedUntil - state.now)),
      main: { action: "here", word: "do.here" },
      quiet: true,
    };
  }
  if (state.leaving) {
    return {
      word: state.returnsHome ? "leaving_home" : "leaving",
      main: { action: "leave_now", word: "do.leave" },
      other: { action: "stay", word: "do.stay" },
      quiet: true,
    };
  }
  if (state.takingOver) {
    // "Not now" is where the button was that asked, so that a double click changes nothing.
    return {
      word: "taking_over",
      main: { action: "stay", word: "do.not_now" },
      extra: { action: "take_over", word: "do.take_over" },
      quiet: true,
    };
  }
  const card = CARDS[state.visit.phase]?.(state) ?? null;
  return card && ["lobby", "queued"].includes(state.visit.phase) ? withRelease(card, state) : card;
};

/**
 * Card for a waiting operator, who may release the robot's emergency stop. Its button is not in the
 * place of the one to drive, so that no press meant for that releases a stop.
 * @param {Card} card @param {State} state @returns {Card}
 */
const withRelease = (card, state) => {
  const release = releaseFor(state);
  if (!release) {
    return card;
  }
  const isSaid = card.word === "lobby.stopped_operates" && release.word === "release.held";
  return { ...card, detail: isSaid ? null : { word: release.word }, extra: release.main };
};

/** @type {Record<string, (state: State) => Card | null>} */
const CARDS = {
  connecting: ({ finding }) => ({ word: "connecting", busy: true, detail: finding }),
  closed: (state) => closed(state),
  lobby: (state) => lobby(state),
  taking: ({ visit }) => ({ word: visit.socket === "open" ? "taking" : "connecting", busy: true }),
  queued: ({ visit, room, freeRobots, ...state }) => ({
    instead: freeRobots,
    ...queued(visit, room, Boolean(state.robot?.docked)),
    values: { place: visit.place, minutes: Math.max(1, Math.ceil(visit.minutes)) },
    ...meanwhile(state),
    other: { action: "leave_now", word: "do.leave_queue" },
  }),
  turn: ({ visit, now }) => ({
    word: "turn",
    countdown: Math.max(0, Math.ceil((visit.startBy ?? now) - now)),
    main: { action: "start", word: "do.start" },
    other: { action: "leave_now", word: "do.not_now" },
  }),
  driving: (state) => link(state),
  watching: (state) => link(state),
  elsewhere: (state) => elsewhere(state),
  refused: ({ visit: { reason }, ...state }) => ({
    word: `refused.${reason === "offline" && isSimulated(state) ? "simulated" : reason}`,
    main: ["offline", "observers_full"].includes(reason) ? tryAgain(state) : HOME,
  }),
  ended: ({ visit: { reason }, finding, guest, trip, practising, returnsHome, robot }) => {
    const hasSouvenir = trip && trip.metres > SHORTEST_TRIP && !practising && reason !== "moved";
    return {
      ...ended(reason, { guest, practising }, returnsHome && robot?.docked === false),
      detail: BROKEN.has(reason) ? finding : null,
      extra: hasSouvenir ? SOUVENIR : undefined,
    };
  },
};

/**
 * Whether the robot is a simulated one.
 * @param {Pick<State, "practising" | "guest">} state
 */
const isSimulated = ({ practising, guest }) => practising || guest;

/** @param {Parameters<typeof isSimulated>[0]} state */
const tryAgain = (state) => (isSimulated(state) ? PRACTISE_AGAIN : BACK);

/**
 * What to do while waiting.
 * @param {Pick<State, "practice" | "notifiable">} state @returns {Partial<Card>}
 */
const meanwhile = ({ practice, notifiable }) => {
  const tell = notifiable ? { action: "tell_me", word: "do.tell_me" } : undefined;
  if (practice === "starting") {
    return { busy: true, detail: { word: "practice.starting" }, extra: tell };
  }
  return practice === "off"
    ? { main: { action: "practise", word: "do.practise" }, extra: tell }
    : { main: tell };
};

/** The outcomes after which the card says that the robot returns to its dock. */
const GOES_HOME = new Set(["completed", "left", "timed_out", "idle"]);
const BROKEN = new Set(["connection_refused", "connection_lost"]);

/** @param {State} state @returns {Card} */
const closed = ({ visit, betterBrowser, copied }) => {
  const word = `closed.${visit.reason}`;
  if (visit.reason === "in_app") {
    const main = { action: "copy_link", word: copied ? "do.link_copied" : "do.copy_link" };
    return { word, values: { browser: betterBrowser }, main, extra: GO_SLOW, other: HOME };
  }
  if (visit.reason === "unsupported") {
    return { word, main: GO_SLOW, other: HOME };
  }
  return { word, main: visit.reason === "signed_out" ? SIGN_IN : HOME };
};

const PAUSES = new Set(["returning", "checked", "charging", "paused", "held", "maintenance"]);
const LACKS = new Set(["not_docked", "elsewhere", "lost", "charge", "silent"]);
const UNFIT = new Set(["no_picture", "network", "fault", "not_connected"]);

/**
 * The driver, or why a robot without a driver is not ready.
 * @param {Visit} visit @param {State["room"]} room @param {boolean} docked @returns {Card}
 */
const queued = ({ place, pause }, room, docked) => {
  const { why, reason } = pauseOf(pause);
  if (why === "start") {
    return { word: LACKS.has(reason) ? `queued.start_${reason}` : "queued.start_silent" };
  }
  if (!PAUSES.has(why)) {
    const { driver } = room;
    const named = driver ? { word: "queued.driver", values: { driver } } : null;
    const word = place <= 1 ? "queued.next" : "queued";
    return { word, detail: room.private ? PRIVATE : named };
  }
  if (reason === "offline" || reason === "estop") {
    return { word: `queued.${reason}` };
  }
  if (why === "paused") {
    const detail = reasonForWaiting(reason);
    const unfit = docked || UNFIT.has(reason) || detail?.word === "reason.not_connected";
    return { word: unfit ? "queued.unfit" : "queued.paused", detail };
  }
  const detail =
    why === "held" && reason ? { word: "because.held", values: { reason } } : undefined;
  return { word: `queued.${why}`, detail };
};

/**
 * With general words for the outcomes of a newer server.
 * @param {string} reason @param {{guest: boolean, practising: boolean}} who
 * @param {boolean} goesHome whether the robot drives to its dock now
 * @returns {Card}
 */
const ended = (reason, { guest, practising }, goesHome) => {
  if (guest) {
    return { word: "ended.guest", main: { action: "sign_up", word: "do.sign_up" }, other: HOME };
  }
  const usual = AFTER[reason] ?? HOME;
  const drives = usual === AGAIN || usual === BACK;
  const main = practising && drives ? { ...PRACTISE_AGAIN, word: usual.word } : usual;
  const word = reason in AFTER ? reason : "completed";
  return {
    word: `ended.${word}${goesHome && GOES_HOME.has(word) ? "_home" : ""}`,
    main,
    other: usual === HOME ? undefined : HOME,
  };
};

/**
 * The visitor's account drives on another page.
 * @param {Pick<State, "visit" | "elsewhere">} state @returns {Card}
 */
const elsewhere = ({ visit: { liveSince }, elsewhere: where }) => ({
  word: where ? `elsewhere.${where}` : "elsewhere",
  detail: liveSince ? { word: "elsewhere.since", values: { time: timeOfDay(liveSince) } } : null,
  main: TAKE_OVER,
  other: HOME,
});

/** @param {number} stamp Unix time */
const timeOfDay = (stamp) =>
  new Date(1000 * stamp).toLocaleTimeString([], {
    hour: "2-digit",
    minute: "2-digit",
    hourCycle: "h23",
  });

/** @param {State} state @returns {Card} */
const lobby = (state) => {
  const { visit, room, robot } = state;
  const watch = { action: "watch", word: "do.watch" };
  if (visit.socket !== "open") {
    return { word: "connecting", busy: true };
  }
  if (visit.liveElsewhere && visit.mayDrive) {
    return elsewhere(state);
  }
  if (visit.liveSince !== null && visit.mayDrive && visit.online) {
    return { word: "lobby.own", main: { action: "drive", word: "do.go_on" }, other: HOME };
  }
  if (!visit.online) {
    return isSimulated(state)
      ? { word: "refused.simulated", main: PRACTISE_AGAIN, other: HOME }
      : { word: "lobby.offline", busy: true, other: HOME };
  }
  const mayWatch = visit.mayObserve && !room.private;
  if (!visit.mayDrive) {
    return mayWatch
      ? { word: "lobby.watch_only", main: watch, other: HOME }
      : { word: `refused.${room.private ? "private" : "not_invited"}`, main: HOME };
  }
  const other = mayWatch ? watch : undefined;
  if (room.driving || room.driver !== null) {
    const word = room.driver ? "lobby.busy" : "lobby.busy_unnamed";
    return {
      word,
      values: { driver: room.driver ?? "", place: room.waiting + 1 },
      detail: room.private ? PRIVATE : null,
      main: { action: "drive", word: "do.queue" },
      other,
    };
  }
  const [standstill, why] = [standstillOf(robot), betweenVisits(room.pause)];
  const leaves = setsOut(state);
  const word =
    standstill ||
    (why === "paused" && robot?.docked ? "unfit" : why) ||
    (room.waiting > 0 ? "waiting" : "");
  const stopped = state.operates ? "lobby.stopped_operates" : "lobby.stopped";
  const ready = isHeld(robot, room.driver) ? stopped : leaves ? "lobby.docked" : "lobby";
  const [queue, drive] = [
    { action: "drive", word: "do.queue" },
    { action: "drive", word: "do.drive" },
  ];
  return word
    ? { word: `lobby.${word}`, values: { place: room.waiting + 1 }, main: queue, other }
    : { word: ready, main: drive, other };
};

/**
 * There is no video yet: the link is being made, the camera starts, or why it does not. A lost link
 * has an alert instead, so that the last frame stays visible until the reason is known, and so has
 * a robot out of reach.
 * @param {State} state @returns {Card | null}
 */
const link = (state) => {
  const { visit, robot, finding, slow } = state;
  if (!roleOf(visit) || state.playing || isCutOff(state) || isAway(robot)) {
    return null;
  }
  const isReached = visit.link !== "lost" || slow;
  const camera = isReached ? robot?.cameraStatus : null;
  if (visit.link !== "connecting" && !finding && !camera) {
    return null;
  }
  if (camera?.reason) {
    const detail = { word: "camera.reason", values: { reason: camera.reason } };
    return { word: "camera", busy: true, detail };
  }
  return { word: "link", busy: true, detail: camera ? null : finding };
};
