/**
 * One media link to the robot: one RTCPeerConnection from its offer to its end. It is never
 * renegotiated: every track that a session may need is in the first offer, and recovery is a new
 * Peer.
 */

import { unixNow } from "../lib/clock.js";

const MOST_BUFFERED = 16 * 1024;
const SEARCH_SECONDS = 1;

export class Peer {
  /**
   * @param {object} options @param {"driver" | "observer"} options.role
   * @param {(message: object) => void} options.onSignal a signal to the robot
   * @param {(packet: unknown) => void} options.onPacket from the data channel
   * @param {boolean} [options.gives] whether this page may send sound and video
   */
  constructor({ role, onSignal, onPacket, gives = role === "driver" }) {
    this.role = role;
    this.onSignal = onSignal;
    /** @type {number | null} */
    this.offeredAt = null;
    /** @type {number | null} */
    this.answeredAt = null;
    /** @type {number | null} */
    this.openedAt = null;
    this.heardAt = -Infinity;
    this.candidates = 0;
    this.answerHasCandidates = true;
    this.connection = new RTCPeerConnection({ bundlePolicy: "max-bundle" });
    // The order is fixed: the robot's sound and, later, the visitor's voice; the robot's video; the
    // visitor's camera; a screen.
    const add = (/** @type {string} */ kind, /** @type {RTCRtpTransceiverDirection} */ direction) =>
      this.connection.addTransceiver(kind, { direction });
    this.lines = [add("audio", gives ? "sendrecv" : "recvonly"), add("video", "recvonly")];
    if (gives) {
      this.lines.push(add("video", "sendonly"), add("video", "sendonly"));
    }
    this.audio = this.lines[0].receiver;
    this.video = this.lines[1].receiver;
    const label = role === "driver" ? "control" : "telemetry";
    this.channel = this.connection.createDataChannel(label, { ordered: false, maxRetransmits: 0 });
    this.channel.onopen = () => (this.openedAt = unixNow());
    this.channel.onmessage = (event) => onPacket(event.data);
    this.connection.onicecandidate = ({ candidate }) => this.#trickle(candidate);
    /** @type {RTCIceCandidate[]} */
    this.held = [];
    this.offer = this.connection.createOffer();
    this.offer.catch(() => undefined);
  }

  /**
   * Offers, with these ICE servers.
   * @param {RTCIceServer[] | Promise<RTCIceServer[]>} servers
   */
  async start(servers) {
    const iceServers = servers instanceof Promise ? await servers : servers; // at once, if known
    if (this.isClosed) {
      return;
    }
    useServers(this.connection, iceServers);
    const offer = await this.offer;
    if (this.isClosed) {
      return;
    }
    await this.connection.setLocalDescription(offer);
    this.offeredAt = unixNow();
    this.onSignal({ type: "offer", sdp: this.connection.localDescription?.sdp ?? offer.sdp });
    for (const candidate of this.held.splice(0)) {
      this.#trickle(candidate);
    }
  }

  /**
   * @param {{type: string, sdp?: string, candidate?: string, sdpMid?: string | null,
   *   sdpMLineIndex?: number | null}} message
   * @returns {Promise<"taken" | "unexpected" | "bye">}
   */
  async signal(message) {
    if (message.type === "bye") {
      return "bye";
    }
    if (message.type === "candidate") {
      const { candidate, sdpMid, sdpMLineIndex } = message;
      if (this.connection.remoteDescription && candidate) {
        await this.connection.addIceCandidate({ candidate, sdpMid, sdpMLineIndex });
      }
      return "taken";
    }
    // An unexpected answer belongs to another offer, and so did the answer before it.
    if (this.answeredAt !== null || this.connection.signalingState !== "have-local-offer") {
      return "unexpected";
    }
    this.answeredAt = unixNow();
    this.answerHasCandidates = /^a=candidate:/m.test(message.sdp ?? "");
    await this.connection.setRemoteDescription({ type: "answer", sdp: message.sdp });
    return "taken";
  }

  get isOpen() {
    return this.channel.readyState === "open";
  }

  get isClosed() {
    return this.connection.signalingState === "closed";
  }

  /**
   * Whether this side, or the robot's, has no address to connect. A computer finds its addresses in
   * an instant; without any network Chromium never stops gathering.
   * @param {number} now
   */
  isBarren(now) {
    const searched =
      this.connection.iceGatheringState === "complete" ||
      (this.offeredAt !== null && now - this.offeredAt > SEARCH_SECONDS);
    return (searched && this.candidates === 0) || !this.answerHasCandidates;
  }

  /** @param {string} packet @returns {boolean} whether it was handed to the network */
  send(packet) {
    if (!this.isOpen || this.channel.bufferedAmount > MOST_BUFFERED) {
      return false;
    }
    this.channel.send(packet);
    return true;
  }

  close() {
    this.channel.onmessage = null;
    this.connection.onicecandidate = null;
    this.connection.close();
  }

  /** @param {RTCIceCandidate | null} candidate */
  #trickle(candidate) {
    this.candidates += candidate?.candidate ? 1 : 0;
    if (this.offeredAt === null) {
      if (candidate) {
        this.held.push(candidate);
      }
      return;
    }
    this.onSignal(messageOf(candidate));
  }
}

/** The signal for a candidate, or for their end. @param {RTCIceCandidate | null} candidate */
export const messageOf = (candidate) => {
  const { candidate: line = "", sdpMid = null, sdpMLineIndex = null } = candidate ?? {};
  return { type: "candidate", candidate: line, sdpMid, sdpMLineIndex };
};

/**
 * Sets the ICE servers of an existing connection.
 * @param {RTCPeerConnection} connection @param {RTCIceServer[]} iceServers
 */
export const useServers = (connection, iceServers) => {
  if (iceServers.length) {
    connection.setConfiguration({
      ...connection.getConfiguration(),
      iceServers: iceServers.map(forBrowser),
    });
  }
};

/** Whether this is a relay; each region has one entry. @param {RTCIceServer} server */
export const isRelay = ({ urls }) => [urls].flat().some((url) => /^turns?:/.test(url));

/**
 * An empty user name would not count as none.
 * @param {RTCIceServer} server @returns {RTCIceServer}
 */
export const forBrowser = ({ urls, username, credential }) =>
  username ? { urls, username, credential } : { urls };
