/**
 * Judges the findings of a check: a line for each topic, with advice. Pure. The words are in
 * templates/sessions/_check_words.html, as `check.<topic>.<word>`.
 */

const QUICK = 0.3; // s; a longer round trip is noticeable

/**
 * @typedef {"good" | "note" | "poor" | "bad"} Mark note: not needed to drive; bad: does not work
 * @typedef {{topic: string, mark: Mark, word: string, values: Record<string, string | number>}}
 *   Line
 */

/**
 * @param {string} topic @param {Mark} mark @param {string} word
 * @param {Record<string, string | number>} [values] @returns {Line}
 */
const line = (topic, mark, word, values = {}) => ({
  topic,
  mark,
  word: `check.${topic}.${word}`,
  values,
});

/**
 * @param {import("./probe.js").Found} found
 * @param {RTCIceServer[]} iceServers that were asked for addresses
 * @returns {Line[]}
 */
export const judge = (found, iceServers) => {
  const urls = iceServers.flatMap(({ urls: some }) => some);
  const relays = urls.some((url) => url.startsWith("turn"));
  return [
    server(found),
    browser(found),
    ...(found.live
      ? [picture(found), way(found, urls.length > 0), ...(relays ? [detour(found)] : [])]
      : []),
    device("microphone", found.microphone),
    device("camera", found.camera),
    found.gamepad
      ? line("gamepad", "good", "there", { name: found.gamepad })
      : line("gamepad", "note", "none"),
  ];
};

/** @param {import("./probe.js").Found} found */
const server = ({ reached, roundTrip }) => {
  if (!reached || roundTrip === null) {
    return line("server", "bad", "blocked");
  }
  const values = { ms: Math.round(roundTrip * 1000) };
  const isQuick = roundTrip < QUICK;
  return line("server", isQuick ? "good" : "poor", isQuick ? "quick" : "slow", values);
};

/** @param {import("./probe.js").Found} found */
const browser = ({ live, app }) => {
  if (live) {
    return line("browser", "good", "live");
  }
  return app ? line("browser", "bad", "in_app") : line("browser", "bad", "off");
};

/** @param {import("./probe.js").Found} found */
const picture = ({ codecs }) => {
  // some browsers do not tell
  const shows = codecs.length === 0 || codecs.some((name) => /^video\/(vp8|h264)$/i.test(name));
  return shows ? line("picture", "good", "there") : line("picture", "bad", "none");
};

/**
 * @param {import("./probe.js").Found} found
 * @param {boolean} asked whether there was a server to ask for an address seen from outside
 */
const way = ({ ways }, asked) => {
  if (ways.length === 0) {
    return line("way", "bad", "none");
  }
  if (ways.includes("srflx") || !asked) {
    return asked ? line("way", "good", "open") : line("way", "note", "unknown");
  }
  return ways.includes("relay") ? line("way", "poor", "detour") : line("way", "bad", "blocked");
};

/** @param {import("./probe.js").Found} found */
const detour = ({ ways }) =>
  ways.includes("relay") ? line("detour", "good", "there") : line("detour", "poor", "none");

/** @param {string} topic @param {import("./probe.js").Device} state */
const device = (topic, state) => line(topic, state === "there" ? "good" : "note", state);

/**
 * The summary: one can drive, drive with slow video, or not at all.
 * @param {Line[]} lines @returns {"good" | "slow" | "bad"}
 */
export const overall = (lines) => {
  const bad = lines.filter(({ mark }) => mark === "bad").map(({ topic }) => topic);
  return bad.includes("server") ? "bad" : bad.length > 0 ? "slow" : "good";
};

/**
 * The most important problem; null without one.
 * @param {Line[]} lines
 * @param {boolean} [connected] whether the page has reached the server since
 * @returns {Line | null}
 */
export const advice = (lines, connected = false) => {
  const left = connected ? lines.filter(({ word }) => word !== "check.server.blocked") : lines;
  const first = (/** @type {Mark} */ wanted) => left.find(({ mark }) => mark === wanted);
  return first("bad") ?? first("poor") ?? null;
};

/**
 * For the record: the word of each topic, without its prefix.
 * @param {Line[]} lines @param {import("./probe.js").Found} found
 */
export const forRecord = (lines, { roundTrip, app }) => ({
  ...Object.fromEntries(lines.map(({ topic, word }) => [topic, word.split(".").at(-1)])),
  overall: overall(lines),
  roundTrip,
  ...(app ? { app } : {}),
});
