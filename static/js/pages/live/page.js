/** The live view's page: requests its data every two seconds while it is visible. */

import { element, make, readConfig, write } from "../../lib/dom.js";
import { fetchJson, pollWhileVisible } from "../../lib/page_poll.js";
import { readWords } from "../../lib/words.js";
import { layersOf } from "../../study/course.js";
import { RobotMap } from "../../view/map/robot_map.js";
import { courseOf, trailOf } from "./course.js";
import { formatted } from "../replay/readings.js";
import {
  batteryOf,
  doorStates,
  doorsOf,
  driverOf,
  lasted,
  networkOf,
  queueOf,
  stateOf,
  taskOf,
  timeOf,
  wizardOf,
} from "./labels.js";

const PERIOD_MS = 2000;
const PATIENCE_MS = 5000;
const RECORD_PATIENCE_MS = 20000; // that of a long session is large
const NO_SESSION = "00000000-0000-0000-0000-000000000000"; // its place in addresses
const [config, words] = [readConfig(), readWords()];
/**
 * @typedef {{card: HTMLElement, parts: Record<string, any>, map: RobotMap, session: string | null,
 *   stops: string | null}} Card stops: as they are drawn
 */
/** @type {Map<string, Card>} */
const cards = new Map();
let freshAt = Date.now() / 1000;

// --- robots --------------------------------------------------------------------------------------

/** @param {any} robot */
const cardOf = (robot) => {
  const known = cards.get(robot.name);
  if (known) {
    return known;
  }
  const card = element("robot").content.firstElementChild.cloneNode(true);
  const parts = Object.fromEntries(
    Array.from(card.querySelectorAll("[data-part]"), (part) => [part.dataset.part, part]),
  );
  card.dataset.robot = robot.name;
  element("robots").append(card);
  const map = new RobotMap({ canvas: parts.map });
  const made = { card, parts, map, session: null, stops: null };
  cards.set(robot.name, made);
  const site = config.sites[robot.name];
  parts.map.parentElement.hidden = !site;
  if (site) {
    map.open(site);
  }
  parts.form?.addEventListener("submit", (/** @type {SubmitEvent} */ event) =>
    act(event, robot.name),
  );
  return made;
};

/** @param {any} robot @param {any} drive or null @param {string[]} queue */
const showRobot = (robot, drive, queue) => {
  const shown = cardOf(robot);
  const { card, parts, map } = shown;
  if (shown.session !== (drive?.session ?? null)) {
    shown.session = drive?.session ?? null;
    map.setTrail([]); // without the path of another visitor
    showTrail(shown, shown.session);
  }
  const newest = drive?.pose && drive.stamp >= (robot.stamp ?? 0) ? drive : robot;
  if (newest.pose) {
    map.setPose({ covariance: null, localized: true, ...newest.pose }, newest.stamp);
  }
  map.setDoors(doorStates(robot, drive));
  showCourse(shown, robot, drive);
  card.dataset.driven = String(Boolean(drive));
  card.dataset.use = robot.use;
  parts.use.hidden = robot.use === "open";
  write(parts.use, robot.use === "open" ? "" : words.say(`use_${robot.use}`));
  write(parts.title, robot.title);
  write(parts.state, stateOf(robot, drive, words));
  write(parts.driver, driverOf(drive, words));
  write(parts.task, taskOf(drive, words));
  write(parts.wizard, wizardOf(drive, words));
  parts.wizard.parentElement.hidden = !drive?.wizard;
  write(parts.remaining, lasted(drive?.task?.remaining));
  const speed = formatted(drive?.speed, (value) => `${value.toFixed(2)} m/s`);
  write(parts.speed, speed);
  write(parts.network, networkOf(drive?.network, words));
  write(parts.battery, batteryOf(robot, words));
  write(parts.queue, queueOf(queue, words));
  write(parts.doors, doorsOf(robot, drive, words));
  showLinks(parts, robot, drive);
};

/**
 * Draws the course; data-stops of the canvas is for tests.
 * @param {Card} shown @param {any} robot @param {any} drive or null
 */
const showCourse = (shown, robot, drive) => {
  const marks = courseOf(config.courses[robot.name] ?? {}, config.version, drive);
  const stops = marks?.stops.map(({ number, status }) => `${number}:${status}`).join(" ") ?? "";
  if (stops !== shown.stops) {
    shown.stops = stops;
    shown.parts.map.dataset.stops = stops;
    shown.map.setCourse(layersOf(marks));
  }
};

/**
 * Draws the path before this page was opened.
 * @param {Card} shown @param {string | null} session
 */
const showTrail = async (shown, session) => {
  if (!session) {
    return;
  }
  try {
    const address = config.record.replace(NO_SESSION, session);
    const record = await fetchJson(address, RECORD_PATIENCE_MS);
    if (shown.session === session) {
      shown.map.setTrail(trailOf(record.states));
      shown.parts.map.dataset.trail = session;
    }
  } catch {
    // the path starts where the robot is now
  }
};

/** @param {Record<string, any>} parts @param {any} robot @param {any} drive or null */
const showLinks = (parts, robot, drive) => {
  parts.watch.hidden = !config.watch[robot.name];
  parts.watch.href = config.watch[robot.name] ?? "";
  parts.replay.hidden = !drive;
  parts.replay.href = drive ? config.replay.replace(NO_SESSION, drive.session) : "";
  /** @type {Record<string, unknown>} */
  const enabled = { message: drive, end: drive, hold: !robot.held, release: robot.held };
  for (const button of parts.form?.querySelectorAll("button") ?? []) {
    button.disabled = !enabled[button.value];
  }
};

/** @param {SubmitEvent} event @param {string} name */
const act = async (event, name) => {
  event.preventDefault();
  const form = /** @type {HTMLFormElement} */ (event.target);
  const { parts, session } = /** @type {any} */ (cards.get(name));
  const body = new FormData(form, event.submitter);
  if (body.get("act") === "end" && !confirm(words.say("end"))) {
    return;
  }
  body.set("robot", name);
  body.set("session", session ?? "");
  try {
    const signal = AbortSignal.timeout(PATIENCE_MS);
    const answer = await fetch(config.act, { method: "POST", body, signal });
    const isJson = answer.headers.get("Content-Type")?.startsWith("application/json");
    const { problem } = isJson ? await answer.json() : { problem: words.say("failed") };
    write(parts.said, problem || words.say("done"));
    if (!problem) {
      form.reset();
    }
  } catch {
    write(parts.said, words.say("failed"));
  }
  refresh();
};

// --- people --------------------------------------------------------------------------------------

/** @param {any[]} people */
const showPeople = (people) => {
  element("no-people").hidden = people.length > 0;
  const rows = people.map((person) => {
    const row = make("tr");
    const kind = words.say(person.kind);
    const cells = [
      kind ? `${person.code} (${kind})` : person.code,
      person.step,
      lasted(person.since),
      String(person.visit),
      person.condition,
      lasted(person.seen),
    ];
    row.append(...cells.map((text, i) => make(i ? "td" : "th", "", text || "–")));
    return row;
  });
  element("people").replaceChildren(...rows);
};

// --- requests ------------------------------------------------------------------------------------

/** @param {any} news */
const show = (news) => {
  freshAt = news.stamp;
  const drives = new Map(news.drives.map((/** @type {any} */ drive) => [drive.robot, drive]));
  element("no-robots").hidden = news.robots.length > 0;
  news.robots.forEach((/** @type {any} */ robot) =>
    showRobot(robot, drives.get(robot.name) ?? null, news.queues[robot.name] ?? []),
  );
  for (const [name, { card }] of cards) {
    card.hidden = !news.robots.some((/** @type {any} */ robot) => robot.name === name);
  }
  showPeople(news.participants);
  element("stale").hidden = true;
  element("fresh").textContent = words.say("fresh", { t: timeOf(news.stamp) });
  element("live").dataset.state = "fresh";
};

/** @param {string} word */
const showStale = (word) => {
  element("live").dataset.state = "stale";
  write(element("stale"), words.say(word, { t: timeOf(freshAt) }));
  element("stale").hidden = false;
};

const refresh = async () => {
  try {
    show(await fetchJson(config.data));
  } catch (error) {
    showStale(/** @type {any} */ (error).status === 404 ? "refused" : "stale");
  }
};

void refresh().then(() => pollWhileVisible(refresh, PERIOD_MS));
