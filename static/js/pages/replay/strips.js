/**
 * The strips over the time line: events, speed with the input method, and the network. Drawn once a size; the line of the present moment
 * is an element of its own over them, so that playing draws nothing anew.
 */

import { ticks, written, xOf } from "./timeline.js";

const ROWS = { events: 26, speed: 64, network: 64, time: 20 }; // CSS pixels
const PADDING = 4;
const COMMANDS = 5; // CSS pixels of the band that tells by what was driven
const COMMAND_SECONDS = 0.12; // how long a command counts in it
const MOST = { speed: 0.4, trip: 0.1, fps: 40, loss: 0.2 }; // m/s, s, 1/s, share: the least ends of the scales, and the ends of the last two
const HEADROOM = 1.3; // room for the legend
const METHODS = 6; // --strip-method-0 … -5
const SOURCES = ["task", "server", "robot", "page"];

const HEIGHT = Object.values(ROWS).reduce((sum, each) => sum + each);

/** @typedef {{context: CanvasRenderingContext2D, width: number, top: number, height: number, colour: (name: string) => string, duration: number}} Row */

/**
 * @param {HTMLCanvasElement} canvas @param {import("./record.js").Record} record
 * @param {{speed: string, trip: string, fps: string, loss: string, method: (name: string) => string}} words @param {Set<string>} sources whose events are shown
 */
export const drawStrips = (canvas, record, words, sources) => {
  const context = canvas.getContext("2d");
  const width = canvas.clientWidth;
  if (!context || !width) {
    return;
  }
  canvas.width = Math.round(width * devicePixelRatio);
  canvas.height = Math.round(HEIGHT * devicePixelRatio);
  context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  const style = getComputedStyle(canvas);
  const colour = remembered((name) => style.getPropertyValue(`--${name}`).trim());
  context.font = `600 11px ${style.fontFamily}`;
  const row = (/** @type {number} */ top, /** @type {number} */ height) => ({ context, width, top, height, colour, duration: record.duration });
  drawEvents(row(0, ROWS.events), record.events.filter(([, source]) => sources.has(source)));
  drawSpeed(row(ROWS.events, ROWS.speed), record, words);
  drawNetwork(row(ROWS.events + ROWS.speed, ROWS.network), record, words);
  drawTime(row(HEIGHT - ROWS.time, ROWS.time));
};

/** Ask once for each name: a browser computes a style each time that it is asked. @param {(name: string) => string} ask @returns {(name: string) => string} */
const remembered = (ask) => {
  /** @type {Map<string, string>} */
  const known = new Map();
  return (name) => known.get(name) ?? (known.set(name, ask(name)).get(name) ?? "");
};

/** @param {Row} row @param {import("./record.js").Record["events"]} events */
const drawEvents = ({ context, width, top, height, colour, duration }, events) => {
  for (const [t, source] of events) {
    const lane = Math.max(0, SOURCES.indexOf(source));
    context.fillStyle = colour(`strip-${source}`);
    context.fillRect(Math.min(xOf(t, duration, width), width - 2), top + 2 + lane * 6, 2, height - 4 - lane * 6);
  }
};

/** A line of values, broken where one is missing or late. @param {Row} row @param {number[]} times @param {(number | null)[]} values @param {[number, number]} range @param {string} stroke @param {number} gap s */
const drawLine = ({ context, width, top, height, duration }, times, values, [low, high], stroke, gap) => {
  context.beginPath();
  context.strokeStyle = stroke;
  context.lineWidth = 1.5;
  let last = -Infinity;
  values.forEach((value, i) => {
    if (value === null || value === undefined) {
      last = -Infinity;
      return;
    }
    const share = (Math.min(Math.max(value, low), high) - low) / (high - low);
    const point = /** @type {[number, number]} */ ([xOf(times[i], duration, width), top + height - PADDING - share * (height - 2 * PADDING)]);
    if (times[i] - last > gap) {
      context.moveTo(...point);
    } else {
      context.lineTo(...point);
    }
    last = times[i];
  });
  context.stroke();
};

/** @param {Row} row @param {import("./record.js").Record} record @param {{speed: string, method: (name: string) => string}} words */
const drawSpeed = (row, { states, commands, words: names }, words) => {
  const { context, width, top, height, colour, duration } = row;
  const most = Math.max(MOST.speed, largest(states.v) * HEADROOM);
  rule(row, top, colour("line"));
  rule(row, top + (height - COMMANDS) / 2, colour("line"));
  for (const [from, to, method] of stretches(commands)) {
    context.fillStyle = colour(methodColour(method));
    context.fillRect(xOf(from, duration, width), top + height - COMMANDS, Math.max(1, xOf(to - from, duration, width)), COMMANDS);
  }
  drawLine({ ...row, height: height - COMMANDS }, states.t, states.v, [-most, most], colour("ink"), 2);
  const methods = [...new Set(commands.method)].map((i) => /** @type {[string, string]} */ ([words.method(names[i]), colour(methodColour(i))]));
  legend(row, [[`${words.speed} ±${most.toFixed(1)} m/s`, colour("ink")], ...methods]);
};

/**
 * Stretches of time that were driven with one input method without a pause, so that thousands of commands are a few rectangles.
 * @param {{t: number[], method: number[]}} commands @returns {[number, number, number][]} from s, to s, method
 */
export const stretches = ({ t, method }) => {
  /** @type {[number, number, number][]} */
  const found = [];
  for (let i = 0; i < t.length; i += 1) {
    const last = found.at(-1);
    if (last && last[2] === method[i] && t[i] <= last[1]) {
      last[1] = t[i] + COMMAND_SECONDS;
    } else {
      found.push([t[i], t[i] + COMMAND_SECONDS, method[i]]);
    }
  }
  return found;
};

/** @param {number} i @returns {string} */
const methodColour = (i) => `strip-method-${i % METHODS}`;

/** @param {Row} row @param {import("./record.js").Record} record @param {{trip: string, fps: string, loss: string}} words */
const drawNetwork = (row, { network }, words) => {
  const { context, width, top, height, colour, duration } = row;
  const times = /** @type {number[]} */ (network.t);
  const slowest = Math.max(MOST.trip, largest(network.roundTrip) * HEADROOM);
  rule(row, top, colour("line"));
  drawLine(row, times, network.fps, [0, MOST.fps], colour("strip-fps"), 3);
  drawLine(row, times, network.roundTrip, [0, slowest], colour("strip-trip"), 3);
  context.fillStyle = colour("strip-loss");
  network.loss.forEach((value, i) => {
    const tall = Math.min(1, (value ?? 0) / MOST.loss) * (height - PADDING);
    context.fillRect(xOf(times[i], duration, width), top + height - tall, 2, tall);
  });
  legend(row, [
    [`${words.trip} ≤ ${Math.round(slowest * 1000)} ms`, colour("strip-trip")],
    [`${words.fps} ≤ ${MOST.fps}`, colour("strip-fps")],
    [`${words.loss} ≤ ${MOST.loss * 100} %`, colour("strip-loss")],
  ]);
};

/** @param {(number | null)[]} values @returns {number} */
const largest = (values) => values.reduce((/** @type {number} */ most, value) => Math.max(most, Math.abs(value ?? 0)), 0);

/** @param {Row} row @param {number} y @param {string} stroke */
const rule = ({ context, width }, y, stroke) => {
  context.fillStyle = stroke;
  context.fillRect(0, Math.round(y), width, 1);
};

/** What the colours of a strip mean, in its upper left corner. @param {Row} row @param {[string, string][]} entries text, colour */
const legend = ({ context, top, colour }, entries) => {
  context.textAlign = "left";
  context.textBaseline = "top";
  let x = 4;
  for (const [text, mark] of entries) {
    const width = context.measureText(text).width;
    context.globalAlpha = 0.8;
    context.fillStyle = colour("surface");
    context.fillRect(x - 2, top + 1, width + 18, 15);
    context.globalAlpha = 1;
    context.fillStyle = mark;
    context.fillRect(x, top + 4, 8, 8);
    context.fillStyle = colour("ink-2");
    context.fillText(text, x + 12, top + 3);
    x += width + 22;
  }
};

/** @param {Row} row */
const drawTime = (row) => {
  const { context, width, top, colour, duration } = row;
  rule(row, top, colour("line"));
  context.textBaseline = "top";
  for (const t of ticks(duration, width)) {
    const x = xOf(t, duration, width);
    context.fillStyle = colour("line-strong");
    context.fillRect(Math.min(x, width - 1), top, 1, 5);
    const text = written(t);
    const half = context.measureText(text).width / 2;
    context.fillStyle = colour("ink-2");
    context.textAlign = "center";
    context.fillText(text, Math.min(Math.max(x, half), width - half), top + 6);
  }
};
