/** The connection as the browser measures it: for `page/network` and for the page's figures. */

/**
 * @typedef {object} Sample
 * @property {number} at ms, by the browser's statistics
 * @property {number} frames decoded so far
 * @property {number} received packets
 * @property {number} lost packets
 * @property {number} bytes
 * @property {number} freezes
 * @property {number | null} jitter s
 * @property {string} path such as "host/udp" or "relay/tcp"
 */

/**
 * The relevant values of a getStats() report.
 * @param {Iterable<any>} report @returns {Sample | null}
 */
export const pick = (report) => {
  const all = new Map(Array.from(report, (entry) => [entry.id, entry]));
  const video = [...all.values()].find(
    (entry) => entry.type === "inbound-rtp" && entry.kind === "video",
  );
  if (!video) {
    return null;
  }
  return {
    at: video.timestamp,
    frames: video.framesDecoded ?? 0,
    received: video.packetsReceived ?? 0,
    lost: Math.max(0, video.packetsLost ?? 0),
    bytes: video.bytesReceived ?? 0,
    freezes: video.freezeCount ?? 0,
    jitter: video.jitter ?? null,
    path: pathOf(all),
  };
};

/**
 * The second between two samples, in the words of `page/network`.
 * @param {Sample} before @param {Sample} after
 */
export const between = (before, after) => {
  const seconds = (after.at - before.at) / 1000;
  if (!(seconds > 0)) {
    return null;
  }
  const lost = Math.max(0, after.lost - before.lost);
  const sent = Math.max(0, after.received - before.received) + lost;
  return {
    fps: Math.max(0, (after.frames - before.frames) / seconds),
    loss: sent ? lost / sent : 0,
    bitrate: Math.max(0, ((after.bytes - before.bytes) * 8) / seconds),
    freezes: Math.max(0, after.freezes - before.freezes),
    jitter: after.jitter ?? undefined,
    path: after.path,
  };
};

/** @param {Map<string, any>} all */
const pathOf = (all) => {
  const transport = [...all.values()].find((entry) => entry.type === "transport");
  const pairs = [...all.values()].filter((entry) => entry.type === "candidate-pair");
  const pair =
    all.get(transport?.selectedCandidatePairId) ??
    pairs.find((entry) => entry.selected || (entry.nominated && entry.state === "succeeded"));
  const local = pair && all.get(pair.localCandidateId);
  return local ? `${local.candidateType}/${local.relayProtocol ?? local.protocol}` : "";
};
