/** The readings of the record at a time, in words and numbers. */

import { write } from "../../lib/dom.js";

import { commandAt, momentAt, networkAt } from "./record.js";

export const NONE = "–";

/** @param {number | null | undefined} value @param {(value: number) => string} format */
export const formatted = (value, format) => (value == null ? NONE : format(value));

/** Milliseconds, per cent and frames. @param {number | null | undefined} value */
export const inMs = (value) => formatted(value, (seconds) => `${Math.round(seconds * 1000)} ms`);
/** @param {number | null | undefined} value @param {number} [digits] */
export const inPercent = (value, digits = 0) =>
  formatted(value, (share) => `${(share * 100).toFixed(digits)} %`);

/**
 * @param {GetElement} element @param {SessionRecord} record @param {Words} words
 * @returns {(t: number) => void}
 */
export const createReadings = (element, record, words) => {
  return (t) => {
    for (const [name, text] of Object.entries(readingsAt(record, t, words))) {
      write(element(`reading-${name}`), text);
    }
  };
};

/**
 * @param {SessionRecord} record @param {number} t @param {Words} words
 * @returns {Record<string, string>}
 */
export const readingsAt = (record, t, words) => {
  const moment = momentAt(record.states, t);
  const { states } = record;
  const i = moment?.index ?? 0;
  const lost = moment?.localized ? "" : words.say("lost");
  const driven = `${states.v[i]?.toFixed(2)} m/s · ${states.w[i]?.toFixed(2)} rad/s`;
  const docked = states.docked[i] ? words.say("docked") : "";
  return {
    place: moment?.stale ? words.say("unknown") : moment ? listed(placeOf(moment), lost) : NONE,
    driven: moment && !moment.stale ? driven : NONE,
    command: commandText(commandAt(record, t), words),
    battery: moment ? listed(inPercent(states.charge[i]), docked) : NONE,
    clearance: formatted(moment && states.clearance[i], (value) => `${value.toFixed(2)} m`),
    network: networkText(networkAt(record, t), words),
  };
};

/** @param {string[]} parts without empty ones */
export const listed = (...parts) => parts.filter(Boolean).join(" · ");

/** @param {{x: number, y: number, theta: number}} pose */
const placeOf = ({ x, y, theta }) =>
  `${x.toFixed(2)}, ${y.toFixed(2)} m · ${((theta * 180) / Math.PI).toFixed(0)}°`;

/** @param {ReturnType<typeof commandAt>} command @param {Words} words */
const commandText = (command, words) => {
  if (!command) {
    return NONE;
  }
  const { method, v, w, age } = command;
  const name = words.has(`method.${method}`) ? words.say(`method.${method}`) : method;
  return `${name} · ${v.toFixed(2)} m/s · ${w.toFixed(2)} rad/s · ${inMs(age)}`;
};

/** @param {Record<string, number | null> | null} network @param {Words} words */
const networkText = (network, words) => {
  if (!network) {
    return NONE;
  }
  const loss = formatted(network.loss, () => `${inPercent(network.loss, 1)} ${words.say("loss")}`);
  const rate = formatted(network.fps, (fps) => `${Math.round(fps)} ${words.say("fps")}`);
  return `${inMs(network.roundTrip)} · ${loss} · ${rate}`;
};
