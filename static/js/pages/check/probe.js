/**
 * Checks this browser and its network without any permission: it only exchanges a few messages with
 * the server, and requests addresses from the site's ICE servers. verdict.js judges the findings.
 */

import { appOf } from "./in_app.js";

const ECHOES = 5;
const SERVER_SECONDS = 6;
const ADDRESS_SECONDS = 6;

/**
 * @typedef {object} Found
 * @property {boolean} reached whether a WebSocket to the server opens
 * @property {number | null} roundTrip s, the median of a few
 * @property {boolean} live whether the browser has live video at all
 * @property {string} app whose browser this is, empty for others
 * @property {string[]} codecs of video, such as video/VP8
 * @property {string[]} ways kinds of addresses: host, srflx (seen from outside), relay
 * @property {Device} microphone
 * @property {Device} camera
 * @property {string} gamepad its name, empty without one
 *
 * @typedef {"there" | "none" | "blocked" | "barred"} Device barred: on an insecure page
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
  const app = appOf(navigator.userAgent);
  return { ...server, live, app, codecs: live ? codecs() : [], ways, microphone, camera, gamepad };
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

/** @param {RTCIceCandidate} candidate in some browsers without a type; it may be empty */
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
    // the browser does not know the permission
  }
  const devices = await navigator.mediaDevices.enumerateDevices();
  return devices.some((one) => one.kind === kind) ? "there" : "none";
};
