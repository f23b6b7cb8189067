/**
 * The bar on top and the line over the picture: what is written into the page's elements, and
 * nothing else.
 */

import { roleOf } from "../../protocol/session.js";
import { alertFor, staysOverCards } from "./alert.js";
import { write } from "../../lib/dom.js";
import { knownNow } from "../../protocol/standstill.js";
import { statusFor } from "./status.js";

const LOW_BATTERY = 0.2;

/** @param {GetElement} element @param {Words} words @returns {(state: State) => void} */
export const createReadings = (element, words) => {
  const parts = {
    status: element("status"),
    statusText: element("status-text"),
    alert: element("alert"),
    people: element("people"),
    peopleText: element("people-text"),
    waiting: element("waiting"),
    waitingText: element("waiting-text"),
    battery: element("battery"),
    batteryName: element("battery-name"),
    batteryText: element("battery-text"),
    batteryMore: element("battery-more"),
    batteryLevel: element("battery-level"),
    trip: element("round-trip"),
    tripText: element("round-trip-text"),
  };

  return (state) => {
    const status = statusFor(state);
    parts.status.dataset.tone = status.tone;
    write(parts.statusText, words.say(status.word));
    showAlert(parts.alert, state, words);
    showPeople(parts, state, words);
    showBattery(parts, state, words);
    const trip = roleOf(state.visit) === "driver" ? state.roundTrip : null;
    parts.trip.hidden = trip === null;
    parts.trip.dataset.transport = state.transport;
    write(
      parts.tripText,
      trip === null ? "" : words.say("reading.round_trip", { ms: Math.round(trip * 1000) }),
    );
  };
};

/** @param {HTMLElement} line @param {State} state @param {Words} words */
const showAlert = (line, state, words) => {
  const alert = alertFor(state);
  line.hidden = alert === null;
  line.dataset.tone = alert?.tone ?? "";
  line.dataset.word = alert?.word ?? "";
  line.toggleAttribute("data-over-cards", staysOverCards(line.dataset.word));
  write(line, alert ? words.say(alert.word, alert.values) : "");
};

/** @param {Record<string, HTMLElement>} parts @param {State} state @param {Words} words */
const showPeople = (parts, { visit, room }, words) => {
  const others = Math.max(0, room.observers - (visit.phase === "watching" ? 1 : 0));
  const driver = visit.phase !== "driving" && room.driving && room.driver;
  const sentences = [
    driver ? words.say("reading.driver", { driver }) : "",
    others ? words.say("reading.watching", { n: others }) : "",
  ];
  parts.people.hidden = !sentences.some(Boolean);
  parts.people.dataset.watching = String(others);
  write(parts.peopleText, sentences.filter(Boolean).join(" · "));
  // the card says where in the queue one is oneself
  const waits = Math.max(0, room.waiting - (["queued", "turn"].includes(visit.phase) ? 1 : 0));
  parts.waiting.hidden = waits === 0;
  write(parts.waitingText, waits ? words.say("reading.waiting", { n: waits }) : "");
};

/** @param {Record<string, HTMLElement>} parts @param {State} state @param {Words} words */
const showBattery = (parts, state, words) => {
  const robot = knownNow(state);
  parts.battery.hidden = !robot;
  if (!robot) {
    return;
  }
  const { charge, charging } = robot.battery;
  const known = charge !== null;
  parts.battery.toggleAttribute("data-charging", charging === true);
  parts.battery.toggleAttribute("data-low", known && charge < LOW_BATTERY && !charging);
  parts.batteryLevel.hidden = !known;
  parts.batteryLevel.style.setProperty("--charge", String(charge ?? 0));
  parts.batteryName.hidden = !known; // the words for an unknown one name it themselves
  write(
    parts.batteryText,
    known
      ? words.say("reading.battery", { percent: Math.round(charge * 100) })
      : words.say("reading.battery_unknown"),
  );
  write(parts.batteryMore, charging ? words.say("reading.charging") : "");
};
