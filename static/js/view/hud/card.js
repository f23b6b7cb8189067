/**
 * The card in the middle of the picture: what this visit is waiting for, asks, or ended with, and
 * one thing to do about it. Pure: which words and buttons; card_panel.js shows them.
 */

import { releaseFor, setsOut } from "../../autonomy/offer.js";
import { isHeld } from "../../protocol/estop_release.js";
import { roleOf } from "../../protocol/session.js";
import { studyCard } from "../../study/end_cards.js";
import { warningFor } from "./alert.js";
import { betweenVisits, pauseOf, reasonForWaiting } from "./pause.js";
import { isAway, isCutOff, standstillOf } from "../../protocol/standstill.js";

/**
 * @typedef {{action: string, url: string}} FreeRobot the words of its button, and where it leads
 *
 * @typedef {object} Card
 * @property {string} word the sentences are `<word>.title` and `<word>.text`
 * @property {Record<string, string | number>} [values] for the sentences
 * @property {{word: string, values?: Record<string, string | number>} | null} [detail] a sentence
 *   in front of the text
 * @property {ReturnType<typeof warningFor>} [warning] a line of its own: what fails just now
 * @property {boolean} [busy] something is under way
 * @property {{action: string, word: string}} [main]
 * @property {{action: string, word: string}} [other]
 * @property {{action: string, word: string}} [extra] something to do while waiting
 * @property {FreeRobot[]} [instead] robots that can be driven at once
 * @property {number} [countdown] seconds
 * @property {boolean} [quiet] no button has the focus: a key that was meant for something else must
 *   not answer
 */

const HOME = { action: "home", word: "do.home" };
const AGAIN = { action: "drive", word: "do.again" };
const PRIVATE = { word: "private" };
const BACK = { action: "back", word: "do.back" };
/** A simulated robot ends without users: only a new request starts one. */
const PRACTISE_AGAIN = { action: "practise_again", word: "do.back" };
const TAKE_OVER = { action: "ask_to_take_over", word: "do.take_over" };
const GO_SLOW = { action: "go_slow", word: "do.go_slow" };
const SOUVENIR = { action: "souvenir", word: "do.souvenir" };
const SHORTEST_TRIP = 0.5; // m that are worth a picture
const SIGN_IN = { action: "sign_in", word: "do.sign_in" };

/** The ends that have words of their own, and what a visitor may do then. */
const AFTER = /** @type {Record<string, {action: string, word: string}>} */ ({
  moved: TAKE_OVER,
  turn_missed: AGAIN,
  idle: AGAIN,
  timed_out: AGAIN,
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
    // The press that asked does not answer: its place is that of the button that leaves it so.
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
 * The card of who waits for a robot whose emergency stop they may release. Its button is not where
 * the one to drive was a moment ago: nobody is to release a stop by a press meant for that.
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
  taking: ({ visit }) =>
    visit.socket === "open" ? { word: "taking", busy: true } : { word: "connecting", busy: true },
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
  refused: ({ visit, ...state }) => ({
    word:
      visit.reason === "offline" && isSimulated(state)
        ? "refused.simulated"
        : `refused.${visit.reason}`,
    main: ["offline", "observers_full"].includes(visit.reason) ? tryAgain(state) : HOME,
  }),
  ended: ({ visit, finding, guest, trip, practising, returnsHome, robot }) => ({
    ...ended(visit.reason, { guest, practising }, returnsHome && robot?.docked === false),
    detail: BROKEN.has(visit.reason) ? finding : null,
    extra:
      trip && trip.metres > SHORTEST_TRIP && !practising && visit.reason !== "moved"
        ? SOUVENIR
        : undefined,
  }),
};

/**
 * Whether the page's robot is one to try or practise with: it cannot be switched off.
 * @param {Pick<State, "practising" | "guest">} state
 */
const isSimulated = ({ practising, guest }) => practising || guest;

/** @param {Parameters<typeof isSimulated>[0]} state */
const tryAgain = (state) => (isSimulated(state) ? PRACTISE_AGAIN : BACK);

/**
 * What one may do while one waits.
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

/** The ends after which a robot that stopped would be no news once it is on its way home. */
const GOES_HOME = new Set(["completed", "left", "timed_out", "idle"]);
const BROKEN = new Set(["connection_refused", "connection_lost"]);

/** The page does nothing any more, or nothing yet. @param {State} state @returns {Card} */
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

const PAUSES = new Set(["returning", "checked", "charging", "paused", "held"]);
const LACKS = new Set(["not_docked", "elsewhere", "lost", "charge", "silent"]);
const UNFIT = new Set(["no_picture", "network", "fault", "not_connected"]);

/**
 * Who keeps the queue waiting, or how the robot does when nobody drives it.
 * @param {Visit} visit @param {State["room"]} room @param {boolean} docked @returns {Card}
 */
const queued = ({ place, pause }, room, docked) => {
  const { why, reason } = pauseOf(pause);
  if (why === "start") {
    return { word: LACKS.has(reason) ? `queued.start_${reason}` : "queued.start_silent" };
  }
  if (!PAUSES.has(why)) {
    return {
      word: place <= 1 ? "queued.next" : "queued",
      detail: room.private
        ? PRIVATE
        : room.driver
          ? { word: "queued.driver", values: { driver: room.driver } }
          : null,
    };
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
 * A newer server may know more ends: for those there are general words.
 * @param {string} reason @param {{guest: boolean, practising: boolean}} who
 * @param {boolean} goesHome whether the robot drives to its station now
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
 * The visitor drives already, or another with the visitor's account.
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
  return word
    ? {
        word: `lobby.${word}`,
        values: { place: room.waiting + 1 },
        main: { action: "drive", word: "do.queue" },
        other,
      }
    : {
        word: ready,
        main: { action: "drive", word: "do.drive" },
        other,
      };
};

/**
 * Video has not begun: the link is made, or the camera starts, or why it does not. A link that is
 * lost has its banner instead, so that the last picture stays in sight, until it is known why; so
 * has a robot that is out of reach, whose camera nobody knows anything of.
 */
const link = (/** @type {State} */ state) => {
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
    return {
      word: "camera",
      busy: true,
      detail: { word: "camera.reason", values: { reason: camera.reason } },
    };
  }
  return { word: "link", busy: true, detail: camera ? null : finding };
};
