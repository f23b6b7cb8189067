/** What the record says of the moment, in words and numbers. */

import { commandAt, momentAt, networkAt } from "./record.js";

const NONE = "–";

/** @param {number | null | undefined} value @param {(value: number) => string} write */
const told = (value, write) => (value === null || value === undefined ? NONE : write(value));

/**
 * @param {GetElement} element @param {SessionRecord} record @param {Words} words
 * @returns {(t: number) => void}
 */
export const createReadings = (element, record, words) => {
  const places = Object.fromEntries(
    ["place", "driven", "command", "battery", "clearance", "network"].map((name) => [
      name,
      element(`reading-${name}`),
    ]),
  );
  return (t) => {
    for (const [name, text] of Object.entries(readingsAt(record, t, words))) {
      if (places[name].textContent !== text) {
        places[name].textContent = text;
      }
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
  const place = () => (moment ? placeTold(moment) : NONE);
  return {
    place: moment?.stale
      ? words.say("unknown")
      : moment && !moment.localized
        ? `${place()} · ${words.say("lost")}`
        : place(),
    driven:
      moment && !moment.stale
        ? `${states.v[i].toFixed(2)} m/s · ${states.w[i].toFixed(2)} rad/s`
        : NONE,
    command: commandTold(commandAt(record, t), words),
    battery: moment ? batteryTold(states.charge[i], states.docked[i], words) : NONE,
    clearance: told(moment && states.clearance[i], (value) => `${value.toFixed(2)} m`),
    network: networkTold(networkAt(record, t), words),
  };
};

/** @param {{x: number, y: number, theta: number}} pose */
const placeTold = ({ x, y, theta }) =>
  `${x.toFixed(2)}, ${y.toFixed(2)} m · ${((theta * 180) / Math.PI).toFixed(0)}°`;

/** @param {number | null} charge @param {number} docked 0 or 1 @param {Words} words */
const batteryTold = (charge, docked, words) => {
  const level = told(charge, (share) => `${Math.round(share * 100)} %`);
  return docked ? `${level} · ${words.say("docked")}` : level;
};

/** @param {ReturnType<typeof commandAt>} command @param {Words} words */
const commandTold = (command, words) => {
  if (!command) {
    return NONE;
  }
  const method = words.has(`method.${command.method}`)
    ? words.say(`method.${command.method}`)
    : command.method;
  const age = told(command.age, (seconds) => `${Math.round(seconds * 1000)} ms`);
  return `${method} · ${command.v.toFixed(2)} m/s · ${command.w.toFixed(2)} rad/s · ${age}`;
};

/** @param {Record<string, number | null> | null} network @param {Words} words */
const networkTold = (network, words) => {
  if (!network) {
    return NONE;
  }
  const trip = told(network.roundTrip, (value) => `${Math.round(value * 1000)} ms`);
  const loss = told(network.loss, (value) => `${(value * 100).toFixed(1)} % ${words.say("loss")}`);
  const rate = told(network.fps, (value) => `${Math.round(value)} ${words.say("fps")}`);
  return `${trip} · ${loss} · ${rate}`;
};
