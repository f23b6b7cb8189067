/**
 * What this browser and its network can do, found out without asking the visitor for anything:
 * nothing is allowed, nothing is sent but a few words to the server and to the address servers that
 * the site has. What it means stands in verdict.js.
 */

import { appOf } from "./in_app.js";

const ECHOES = 5;
const SERVER_SECONDS = 6;
const ADDRESS_SECONDS = 6;

/**
 * @typedef {object} Found
 * @property {boolean} reached whether a live line to the server opens
 * @property {number | null} roundTrip s, the median of a few
 * @property {boolean} live whether the browser carries live video at all
 * @property {string} app whose browser this is, empty for a browser proper
 * @property {string[]} codecs of video that it shows, such as video/VP8
 * @property {string[]} ways kinds of addresses: host, srflx (seen from outside), relay
 * @property {Device} microphone
 * @property {Device} camera
 * @property {string} gamepad its name, empty without one
 *
 * @typedef {"there" | "none" | "blocked" | "barred"} Device barred: the page came over an address
 *   where browsers give none
 */

/** @param {{socket: string, iceServers: RTCIceServer[]}} config @returns {Promise<Found>} */
export const probe = async (config) => {
  const live = typeof RTCPeerConnection === "function";
  const [server, ways, microphone, camera] = await Promise.all([
    reach(config.socket),
    live ? addresses(config.iceServers) : [],
    device("audioinput", "microphone"),
    device("videoinput", "camera"),
  ]);
  const gamepad = [...(navigator.getGamepads?.() ?? [])].find((pad) => pad?.connected)?.id ?? "";
  return {
    ...server,
    live,
    app: appOf(navigator.userAgent),
    codecs: live ? codecs() : [],
    ways,
    microphone,
    camera,
    gamepad,
  };
};

/** @param {number} seconds @returns {Promise<void>} */
const wait = (seconds) => new Promise((resolve) => setTimeout(resolve, seconds * 1000));

/** @param {string} address @returns {Promise<{reached: boolean, roundTrip: number | null}>} */
const reach = async (address) => {
  const url = new URL(address, location.href.replace(/^http/, "ws")).href;
  /** @type {number[]} */
  const trips = [];
  let asked = 0;
  const socket = new WebSocket(url);
  const ask = () => {
    asked = performance.now();
    socket.send("?");
  };
  const done = new Promise((resolve) => {
    socket.onopen = ask;
    socket.onmessage = () => {
      trips.push((performance.now() - asked) / 1000);
      trips.length < ECHOES ? ask() : resolve(undefined);
    };
    socket.onerror = resolve;
    socket.onclose = resolve;
  });
  await Promise.race([done, wait(SERVER_SECONDS)]);
  socket.close();
  trips.sort((a, b) => a - b);
  return { reached: trips.length > 0, roundTrip: trips[Math.floor(trips.length / 2)] ?? null };
};

/**
 * The kinds of addresses at which this browser can be reached.
 * @param {RTCIceServer[]} iceServers @returns {Promise<string[]>}
 */
const addresses = async (iceServers) => {
  const connection = new RTCPeerConnection({ iceServers });
  const kinds = new Set();
  try {
    connection.createDataChannel("check");
    const done = new Promise((resolve) => {
      connection.onicecandidate = ({ candidate }) =>
        candidate ? kinds.add(kindOf(candidate)) : resolve(undefined);
    });
    await connection.setLocalDescription(await connection.createOffer());
    await Promise.race([done, wait(ADDRESS_SECONDS)]);
  } finally {
    connection.close();
  }
  kinds.delete("");
  return [...kinds];
};

/**
 * @param {RTCIceCandidate} candidate a line of it says its kind also where the browser does not;
 *   some end with an empty one
 */
const kindOf = ({ candidate, type }) => type ?? / typ (\w+)/.exec(candidate)?.[1] ?? "";

const codecs = () => [
  ...new Set(
    (RTCRtpReceiver.getCapabilities?.("video")?.codecs ?? []).map(({ mimeType }) => mimeType),
  ),
];

/**
 * @param {MediaDeviceKind} kind
 * @param {string} name of the permission
 * @returns {Promise<Device>}
 */
const device = async (kind, name) => {
  if (!navigator.mediaDevices) {
    return "barred";
  }
  try {
    const permission = await navigator.permissions.query({
      name: /** @type {PermissionName} */ (name),
    });
    if (permission.state === "denied") {
      return "blocked";
    }
  } catch {
    // Not every browser knows every permission by name: then whether there is one has to do.
  }
  const devices = await navigator.mediaDevices.enumerateDevices();
  return devices.some((one) => one.kind === kind) ? "there" : "none";
};
