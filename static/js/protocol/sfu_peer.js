/**
 * One media link to the server's SFU, for viewers of a robot with many viewers: like a Peer, but
 * the SFU offers and this page answers, and there is no data channel: the robot's messages come
 * through the server.
 */

import { unixNow } from "../lib/clock.js";
import { messageOf, useServers } from "./peer.js";

export class SfuPeer {
  /** @param {{onSignal: (message: object) => void}} options a signal to the SFU */
  constructor({ onSignal }) {
    this.role = /** @type {const} */ ("sfu");
    this.onSignal = onSignal;
    /** @type {number | null} when the offer was asked for */
    this.offeredAt = null;
    /** @type {number | null} when it came */
    this.answeredAt = null;
    /** @type {number | null} */
    this.openedAt = null;
    this.connectedAt = -Infinity;
    /** @type {RTCRtpReceiver | null} */
    this.audio = null;
    /** @type {RTCRtpReceiver | null} */
    this.video = null;
    this.isOpen = false; // there is no data channel
    this.connection = new RTCPeerConnection({ bundlePolicy: "max-bundle" });
    this.connection.onicecandidate = ({ candidate }) => this.onSignal(messageOf(candidate));
    this.connection.onconnectionstatechange = () => {
      if (this.connection.connectionState === "connected") {
        this.openedAt ??= unixNow();
      }
    };
  }

  /** @param {RTCIceServer[] | Promise<RTCIceServer[]>} servers */
  async start(servers) {
    useServers(this.connection, await servers);
    this.offeredAt = unixNow();
    this.onSignal({ type: "want" });
  }

  /**
   * @param {{type: string, sdp?: string, reason?: string}} message
   * @returns {Promise<"taken" | "offered" | "unexpected" | "bye">}
   */
  async signal({ type, sdp }) {
    if (type === "bye") {
      return "bye";
    }
    if (type !== "offer" || this.answeredAt !== null) {
      return type === "candidate" ? "taken" : "unexpected";
    }
    this.answeredAt = unixNow();
    await this.connection.setRemoteDescription({ type, sdp: sdp ?? "" });
    const receiver = (/** @type {string} */ kind) =>
      this.connection.getReceivers().find(({ track }) => track.kind === kind) ?? null;
    this.audio = receiver("audio");
    this.video = receiver("video");
    await this.connection.setLocalDescription();
    this.onSignal({ type: "answer", sdp: this.connection.localDescription?.sdp });
    return "offered";
  }

  /** The last time when it was connected; read twenty times a second by the link. */
  get heardAt() {
    if (this.connection.connectionState === "connected") {
      this.connectedAt = unixNow();
    }
    return this.connectedAt;
  }

  get isClosed() {
    return this.connection.signalingState === "closed";
  }

  /** Only for a link to the robot there are frames through the server instead. */
  isBarren() {
    return false;
  }

  send() {
    return false;
  }

  close() {
    this.connection.onicecandidate = null;
    this.connection.onconnectionstatechange = null;
    this.connection.close();
  }
}
