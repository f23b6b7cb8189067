/**
 * What the findings of a check mean for a visitor: a line a topic, with what to do. Pure. The words
 * stand in templates/sessions/_check_words.html under `check.<topic>.<word>`.
 */

const QUICK = 0.3; // s: from here on driving is noticeably late

/**
 * @typedef {"good" | "note" | "poor" | "bad"} Mark note: nothing that driving needs; bad: it does
 *   not work
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
  return line("server", roundTrip < QUICK ? "good" : "poor", roundTrip < QUICK ? "quick" : "slow", {
    ms: Math.round(roundTrip * 1000),
  });
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
 * What it comes to: one can drive, drive by slow pictures, or not at all.
 * @param {Line[]} lines @returns {"good" | "slow" | "bad"}
 */
export const overall = (lines) => {
  const bad = lines.filter(({ mark }) => mark === "bad").map(({ topic }) => topic);
  return bad.includes("server") ? "bad" : bad.length > 0 ? "slow" : "good";
};

/**
 * The one thing to tell somebody whose connection does not come about; null when nothing was found.
 * @param {Line[]} lines
 * @param {boolean} [connected] whether the page reaches the server by now: then nothing blocks
 *   that, whatever was tried
 * @returns {Line | null}
 */
export const advice = (lines, connected = false) => {
  const told = connected ? lines.filter(({ word }) => word !== "check.server.blocked") : lines;
  return (
    told.find(({ mark }) => mark === "bad") ?? told.find(({ mark }) => mark === "poor") ?? null
  );
};

/**
 * For the record: the word of each topic, without its prefix.
 * @param {Line[]} lines @param {import("./probe.js").Found} found
 */
export const forRecord = (lines, { roundTrip, app }) => ({
  ...Object.fromEntries(
    lines.map(({ topic, word }) => [topic, word.slice(word.lastIndexOf(".") + 1)]),
  ),
  overall: overall(lines),
  roundTrip,
  ...(app ? { app } : {}),
});
