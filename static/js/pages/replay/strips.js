/**
 * The strips over the time line: events, speed with the input method, network and packet loss,
 * between axes with their units. Drawn once for each size; the line of the present time is an
 * element over them. x counts from the left axis.
 */

import { stroke } from "../../lib/canvas.js";

import { AXIS, plotWidth, ticks, written, xOf } from "./timeline.js";

const ROWS = { events: 26, speed: 76, network: 76, loss: 48, time: 20 }; // CSS pixels
const PADDING = 4;
const COMMANDS = 5; // CSS pixels of the band of input methods
const COMMAND_SECONDS = 0.12; // of a command in it
// m/s, ms, 1/s, %: the least ends of the scales, and the ends of the last two
const MOST = { speed: 0.5, trip: 100, fps: 40, loss: 20 };
const HEADROOM = 1.15; // room for the legend
const TEXT = 11; // CSS pixels
const METHODS = 6; // --strip-method-0 … -5
const SOURCES = ["task", "server", "robot", "page", "lab"];

/**
 * @typedef {{context: Canvas2D, width: number, top: number, height: number,
 *   colour: (name: string) => string, duration: number}} Row
 */

/**
 * @param {HTMLCanvasElement} canvas @param {SessionRecord} record
 * @param {{speed: string, trip: string, fps: string, loss: string, method: (name: string) =>
 *   string}} words
 * @param {Set<string>} sources whose events are shown
 */
export const drawStrips = (canvas, record, words, sources) => {
  const context = canvas.getContext("2d");
  const width = plotWidth(canvas.clientWidth);
  if (!context || !width) {
    return;
  }
  // blind coding has no network
  const rows = record.network.t.length ? ROWS : { ...ROWS, network: 0, loss: 0 };
  const whole = Object.values(rows).reduce((sum, each) => sum + each);
  canvas.style.blockSize = `${whole}px`;
  canvas.width = Math.round(canvas.clientWidth * devicePixelRatio);
  canvas.height = Math.round(whole * devicePixelRatio);
  context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, AXIS * devicePixelRatio, 0);
  const style = getComputedStyle(canvas);
  // A canvas does not know light-dark(), which the browser resolves as the colour of an element: of
  // a new one, because that of an old one may change gradually.
  const colour = remembered((name) => {
    const probe = document.createElement("i");
    probe.style.color = `var(--${name})`;
    canvas.append(probe);
    const { color } = getComputedStyle(probe);
    probe.remove();
    return color;
  });
  context.font = `600 ${TEXT}px ${style.fontFamily}`;
  const { duration } = record;
  const row = (/** @type {number} */ top, /** @type {number} */ height) =>
    /** @type {Row} */ ({ context, width, top, height, colour, duration });
  const events = record.events.filter(([, source]) => sources.has(source));
  drawEvents(row(0, rows.events), events);
  drawSpeed(row(rows.events, rows.speed), record, words);
  if (rows.network) {
    drawNetwork(row(rows.events + rows.speed, rows.network), record, words);
    drawLoss(row(rows.events + rows.speed + rows.network, rows.loss), record, words);
  }
  drawTime(row(whole - rows.time, rows.time));
};

/**
 * Asks once for each name, as a browser computes a style each time.
 * @param {(name: string) => string} ask @returns {(name: string) => string}
 */
const remembered = (ask) => {
  /** @type {Map<string, string>} */
  const known = new Map();
  return (name) => known.get(name) ?? known.set(name, ask(name)).get(name) ?? "";
};

/** @param {Row} row @param {SessionRecord["events"]} events */
const drawEvents = ({ context, width, top, height, colour, duration }, events) => {
  for (const [t, source] of events) {
    const lane = Math.max(0, SOURCES.indexOf(source));
    context.fillStyle = colour(`strip-${source}`);
    const x = Math.min(xOf(t, duration, width), width - 2);
    context.fillRect(x, top + 2 + lane * 5, 2, height - 4 - lane * 5);
  }
};

/**
 * A line of values, broken where one is missing or late.
 * @param {Row} row @param {number[]} times @param {(number | null)[]} values
 * @param {[number, number]} range @param {string} colour @param {number} gap s
 */
const drawLine = (row, times, values, [low, high], colour, gap) => {
  const { context, width, top, height, duration } = row;
  context.beginPath();
  let last = -Infinity;
  values.forEach((value, i) => {
    if (value === null || value === undefined) {
      last = -Infinity;
      return;
    }
    const share = (Math.min(Math.max(value, low), high) - low) / (high - low);
    const point = /** @type {[number, number]} */ ([
      xOf(times[i], duration, width),
      top + height - PADDING - share * (height - 2 * PADDING),
    ]);
    if (times[i] - last > gap) {
      context.moveTo(...point);
    } else {
      context.lineTo(...point);
    }
    last = times[i];
  });
  stroke(context, colour, 1.5);
};

/**
 * @param {Row} row @param {SessionRecord} record
 * @param {{speed: string, method: (name: string) => string}} words
 */
const drawSpeed = (row, { states, commands, words: names }, words) => {
  const { context, width, top, height, colour, duration } = row;
  const most = scaleEnd(Math.max(MOST.speed, largest(states.v) * HEADROOM));
  rule(row, top, colour("line"));
  axis({ ...row, height: height - COMMANDS }, [-most, 0, most], "m/s", "left");
  for (const [from, to, method] of stretches(commands)) {
    context.fillStyle = colour(methodColour(method));
    const wide = Math.max(1, xOf(to - from, duration, width));
    context.fillRect(xOf(from, duration, width), top + height - COMMANDS, wide, COMMANDS);
  }
  const above = { ...row, height: height - COMMANDS };
  drawLine(above, states.t, states.v, [-most, most], colour("ink"), 2);
  const methods = [...new Set(commands.method)].map(
    (i) => /** @type {[string, string]} */ ([words.method(names[i]), colour(methodColour(i))]),
  );
  legend(row, [[words.speed, colour("ink")], ...methods]);
};

/**
 * Stretches of time that were driven with one input method without a pause.
 * @param {Record<string, number[]>} commands
 * @returns {[number, number, number][]} from s, to s, method
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

/**
 * @param {Row} row @param {SessionRecord} record
 * @param {{trip: string, fps: string, loss: string}} words
 */
const drawNetwork = (row, { network }, words) => {
  const { top, colour } = row;
  const times = /** @type {number[]} */ (network.t);
  const trips = network.roundTrip.map((value) => (value == null ? null : value * 1000));
  const slowest = scaleEnd(Math.max(MOST.trip, largest(trips) * HEADROOM));
  rule(row, top, colour("line"));
  axis(row, [0, slowest / 2, slowest], "ms", "left");
  axis(row, [0, MOST.fps / 2, MOST.fps], "1/s", "right");
  drawLine(row, times, network.fps, [0, MOST.fps], colour("strip-fps"), 3);
  drawLine(row, times, trips, [0, slowest], colour("strip-trip"), 3);
  legend(row, [
    [words.trip, colour("strip-trip")],
    [words.fps, colour("strip-fps")],
  ]);
};

/** @param {Row} row @param {SessionRecord} record @param {{loss: string}} words */
const drawLoss = (row, { network }, words) => {
  const { context, width, top, height, colour, duration } = row;
  rule(row, top, colour("line"));
  axis(row, [0, MOST.loss], "%", "left");
  context.fillStyle = colour("strip-loss");
  network.loss.forEach((value, i) => {
    const tall = Math.min(1, ((value ?? 0) * 100) / MOST.loss) * (height - 2 * PADDING);
    const x = xOf(Number(network.t[i]), duration, width);
    context.fillRect(x, top + height - PADDING - tall, 2, tall);
  });
  legend(row, [[words.loss, colour("strip-loss")]]);
};

/**
 * A round end of a scale: 1, 2 or 5 and as many zeros as it takes.
 * @param {number} least @returns {number}
 */
export const scaleEnd = (least) => {
  const ten = 10 ** Math.floor(Math.log10(least));
  return ten * ([1, 2, 5].find((step) => step * ten >= least * (1 - 1e-9)) ?? 10);
};

/**
 * A scale beside a strip, with a fine line through the strip at each value of the left one.
 * @param {Row} row
 * @param {number[]} values ascending
 * @param {string} unit @param {"left" | "right"} side
 */
const axis = (row, values, unit, side) => {
  const { context, width, top, height, colour } = row;
  const [low, high] = [values[0], values[values.length - 1]];
  const x = side === "left" ? -6 : width + 6;
  context.textAlign = side === "left" ? "right" : "left";
  context.textBaseline = "middle";
  for (const value of values) {
    const y = top + height - PADDING - ((value - low) / (high - low)) * (height - 2 * PADDING);
    if (side === "left") {
      rule(row, y, colour("line"));
    }
    context.fillStyle = colour("ink-2");
    const text = String(value).replace("-", "−");
    const middle = Math.min(Math.max(y, top + TEXT / 2 + 1), top + height - TEXT / 2);
    context.fillText(value === high ? `${text} ${unit}` : text, x, middle);
  }
};

/** @param {(number | null)[]} values @returns {number} */
const largest = (values) =>
  values.reduce((/** @type {number} */ most, value) => Math.max(most, Math.abs(value ?? 0)), 0);

/** @param {Row} row @param {number} y @param {string} stroke */
const rule = ({ context, width }, y, stroke) => {
  context.fillStyle = stroke;
  context.fillRect(0, Math.round(y), width, 1);
};

/**
 * The legend of a strip, in its upper left corner.
 * @param {Row} row @param {[string, string][]} entries text, colour
 */
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
