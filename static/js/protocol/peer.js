/**
 * One media link to the robot: one RTCPeerConnection from its offer to its end. It is never
 * renegotiated and never repaired: every track that a visit may ever need is in the first offer,
 * and recovery is a new Peer.
 */

import { unixNow } from "../lib/clock.js";

const MOST_BUFFERED = 16 * 1024;
const SEARCH_SECONDS = 1;

export class Peer {
  /**
   * @param {object} options @param {"driver" | "observer"} options.role
   * @param {(message: object) => void} options.onSignal what to tell the robot through the server
   * @param {(packet: unknown) => void} options.onPacket from the data channel
   * @param {boolean} [options.gives] whether this page has sound and picture of its own, if they
   *   are wanted
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
    // In this order for good: the robot's sound and, later, the visitor's voice; the robot's
    // picture; the visitor's camera; a screen.
    const lines = [
      this.connection.addTransceiver("audio", { direction: gives ? "sendrecv" : "recvonly" }),
    ];
    lines.push(this.connection.addTransceiver("video", { direction: "recvonly" }));
    if (gives) {
      lines.push(
        this.connection.addTransceiver("video", { direction: "sendonly" }),
        this.connection.addTransceiver("video", { direction: "sendonly" }),
      );
    }
    this.lines = lines;
    this.audio = lines[0].receiver;
    this.video = lines[1].receiver;
    const label = role === "driver" ? "control" : "telemetry";
    this.channel = this.connection.createDataChannel(label, { ordered: false, maxRetransmits: 0 });
    this.channel.onopen = () => {
      this.openedAt = unixNow();
    };
    this.channel.onmessage = (event) => onPacket(event.data);
    this.connection.onicecandidate = ({ candidate }) => this.#trickle(candidate);
    /** @type {RTCIceCandidate[]} */
    this.held = [];
    this.offer = this.connection.createOffer();
    this.offer.catch(() => undefined);
  }

  /**
   * Offer, with the servers that the server named.
   * @param {RTCIceServer[] | Promise<RTCIceServer[]>} servers
   */
  async start(servers) {
    const iceServers = servers instanceof Promise ? await servers : servers;
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
      if (this.connection.remoteDescription && message.candidate) {
        await this.connection.addIceCandidate({
          candidate: message.candidate,
          sdpMid: message.sdpMid,
          sdpMLineIndex: message.sdpMLineIndex,
        });
      }
      return "taken";
    }
    // An answer when none is awaited belongs to another offer: the one taken before it was not ours
    // either.
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
   * Whether there is nothing to connect: this side, or the robot's, has found no address of its
   * own. A computer finds its own addresses in an instant; without any network Chromium goes on
   * looking for ever.
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

/**
 * The signal for a candidate, or for the end of the candidates.
 * @param {RTCIceCandidate | null} candidate
 */
export const messageOf = (candidate) => {
  const { candidate: line = "", sdpMid = null, sdpMLineIndex = null } = candidate ?? {};
  return { type: "candidate", candidate: line, sdpMid, sdpMLineIndex };
};

/**
 * Have a connection that was made before ask the servers that the server named.
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

/**
 * Whether a server of a list relays, for which there is one entry a region.
 * @param {RTCIceServer} server
 */
export const isRelay = ({ urls }) => [urls].flat().some((url) => /^turns?:/.test(url));

/**
 * An empty user name is not the same as none.
 * @param {RTCIceServer} server @returns {RTCIceServer}
 */
export const forBrowser = ({ urls, username, credential }) =>
  username ? { urls, username, credential } : { urls };
