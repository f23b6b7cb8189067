/** Shows the bar on top and the alert over the video. */

import { roleOf } from "../../protocol/session.js";
import { alertFor, staysOverCards } from "./alert.js";
import { write } from "../../lib/dom.js";
import { knownNow } from "../../protocol/standstill.js";
import { statusFor } from "./status.js";

const LOW_BATTERY = 0.2;

/** @param {GetElement} element @param {Words} words @returns {(state: State) => void} */
export const createReadings = (element, words) => {
  return (state) => {
    const status = statusFor(state);
    element("status").dataset.tone = status.tone;
    write(element("status-text"), words.say(status.word));
    showAlert(element("alert"), state, words);
    showPeople(element, state, words);
    showBattery(element, state, words);
    const trip = roleOf(state.visit) === "driver" ? state.roundTrip : null;
    element("round-trip").hidden = trip === null;
    element("round-trip").dataset.transport = state.transport;
    const ms = Math.round(1000 * Number(trip));
    write(element("round-trip-text"), trip === null ? "" : words.say("reading.round_trip", { ms }));
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

/** @param {GetElement} element @param {State} state @param {Words} words */
const showPeople = (element, { visit, room }, words) => {
  const others = Math.max(0, room.observers - (visit.phase === "watching" ? 1 : 0));
  const driver = visit.phase !== "driving" && room.driving && room.driver;
  const sentences = [
    driver ? words.say("reading.driver", { driver }) : "",
    others ? words.say("reading.watching", { n: others }) : "",
  ];
  element("people").hidden = !sentences.some(Boolean);
  element("people").dataset.watching = String(others);
  write(element("people-text"), sentences.filter(Boolean).join(" · "));
  // without the visitor, whose place is on the card
  const waits = Math.max(0, room.waiting - (["queued", "turn"].includes(visit.phase) ? 1 : 0));
  element("waiting").hidden = waits === 0;
  write(element("waiting-text"), waits ? words.say("reading.waiting", { n: waits }) : "");
};

/** @param {GetElement} element @param {State} state @param {Words} words */
const showBattery = (element, state, words) => {
  const robot = knownNow(state);
  const battery = element("battery");
  battery.hidden = !robot;
  if (!robot) {
    return;
  }
  const { charge, charging } = robot.battery;
  const known = charge !== null;
  battery.toggleAttribute("data-charging", charging === true);
  battery.toggleAttribute("data-low", known && charge < LOW_BATTERY && !charging);
  element("battery-level").hidden = !known;
  element("battery-level").style.setProperty("--charge", String(charge ?? 0));
  element("battery-name").hidden = !known; // the sentence for an unknown charge names it
  const word = known ? "reading.battery" : "reading.battery_unknown";
  write(element("battery-text"), words.say(word, { percent: Math.round(charge * 100) }));
  write(element("battery-more"), charging ? words.say("reading.charging") : "");
};
