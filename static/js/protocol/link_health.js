/**
 * When to close a media link and open another. WebRTC notices a dead peer after half a minute,
 * missing heartbeats on the data channel show it after 1.5 s.
 */

const SILENCE_SECONDS = 1.5;
const ANSWER_SECONDS = 5;
const CONNECT_SECONDS = 10;
const FIRST_BEAT_SECONDS = 3;
const LOOKING_SECONDS = 7; // for a direct connection, until frames come through the server
const BARREN_SECONDS = 1; // the same without any address to try

/**
 * @param {object} link times in Unix seconds, null for what has not happened
 * @param {string} link.state of the RTCPeerConnection
 * @param {number | null} link.offeredAt @param {number | null} link.answeredAt
 * @param {number | null} link.openedAt when the data channel opened
 * @param {number} link.heardAt when its last packet arrived
 * @param {number} now @returns {"live" | "waiting" | "failed" | "no_answer" | "no_way" | "silent"}
 */
export const judge = (link, now) => {
  if (link.state === "failed" || link.state === "closed") {
    return "failed";
  }
  if (link.offeredAt !== null && link.answeredAt === null) {
    return now - link.offeredAt > ANSWER_SECONDS ? "no_answer" : "waiting";
  }
  if (link.openedAt === null) {
    return link.offeredAt !== null && now - link.offeredAt > CONNECT_SECONDS ? "no_way" : "waiting";
  }
  if (link.heardAt < link.openedAt) {
    return now - link.openedAt > FIRST_BEAT_SECONDS ? "silent" : "waiting";
  }
  return now - link.heardAt > SILENCE_SECONDS ? "silent" : "live";
};

/**
 * Whether to stop waiting for a direct connection. Attempts continue: even without addresses a
 * browser may reach a robot.
 * @param {{lookingSince: number | null, barren: boolean}} link protocol/link.js @param {number} now
 */
export const isStuck = ({ lookingSince, barren }, now) =>
  lookingSince !== null && now - lookingSince > (barren ? BARREN_SECONDS : LOOKING_SECONDS);

/** s until a lost link requests new credentials: half of their life, as in robots/ice.py */
const ICE_SECONDS = 3 * 3600;

/**
 * Whether a relay may no longer accept the credentials of these servers.
 * @param {{iceServers: RTCIceServer[], iceAt: number}} received with the Unix time when they came
 * @param {number} now Unix time
 */
export const areCredentialsOld = ({ iceServers, iceAt }, now) =>
  now - iceAt > ICE_SECONDS && iceServers.some(({ credential }) => credential);
