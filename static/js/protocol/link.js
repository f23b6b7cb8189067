/**
 * The media link to the robot: prepared early, opened after a growing pause, checked twenty times a
 * second, and closed when it is silent.
 */

import { backoff } from "../lib/backoff.js";
import { unixNow } from "../lib/clock.js";
import { isStuck, judge } from "./link_health.js";
import { isRelay } from "./peer.js";

/**
 * @typedef {Peer | import("./sfu_peer.js").SfuPeer} AnyPeer
 * @typedef {import("./relay_regions.js").createRelayRegions} CreateRelayRegions
 * @typedef {"driver" | "observer" | "sfu"} LinkRole `sfu` watches through the server's SFU
 */

export class Link {
  /**
   * @param {object} options @param {(role: LinkRole, link: Link) => AnyPeer} options.makePeer
   * @param {(peer: AnyPeer) => void} options.onOpening before an offer, or an answer to the SFU
   * @param {() => void} options.onDropping before the video goes black
   * @param {() => void} options.onLive @param {(why: string) => void} options.onLost
   */
  constructor({ makePeer, onOpening, onDropping, onLive, onLost }) {
    this.makePeer = makePeer;
    this.onOpening = onOpening;
    this.onDropping = onDropping;
    this.onLive = onLive;
    this.onLost = onLost;
    /** @type {AnyPeer | null} */
    this.peer = null;
    /** @type {AnyPeer | null} made but not yet offered */
    this.prepared = null;
    this.live = false;
    /** @type {Promise<ReturnType<CreateRelayRegions>> | null} only where there are several */
    this.regions = null;
    /** @type {number | null} Unix seconds since which a link is wanted and not live */
    this.lookingSince = null;
    /** whether the last peer had no addresses to connect */
    this.barren = false;
    /** whether video comes through the server, so that attempts may be rarer */
    this.patient = false;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    /** @type {(() => void) | undefined} the present attempt, or the next one */
    this.next = undefined;
  }

  /** Makes an offer in the time until the server answers. @param {LinkRole} role */
  prepare(role) {
    if (isSupported() && this.prepared?.role !== role) {
      this.prepared?.close();
      this.prepared = this.makePeer(role, this);
    }
  }

  /**
   * @param {LinkRole} role @param {RTCIceServer[]} iceServers
   * @param {number} attempt 0 opens at once
   */
  open(role, iceServers, attempt) {
    clearTimeout(this.timer);
    this.lookingSince ??= unixNow();
    if (!isSupported()) {
      this.barren = true; // only frames through the server will ever arrive
      return;
    }
    this.next = () => this.#open(role, iceServers);
    if (attempt === 0) {
      this.next();
    } else {
      const pause = backoff(attempt - 1, this.patient ? { first: 2, most: 30 } : { first: 0.5 });
      this.timer = setTimeout(this.next, pause * 1000);
    }
  }

  /** The network has changed: starts the next attempt now, or the present one again. */
  hurry() {
    if (this.lookingSince !== null && this.patient && this.next) {
      clearTimeout(this.timer);
      this.next();
    }
  }

  /** Whether to request frames through the server. @param {number} now */
  isStuck(now) {
    this.barren = this.peer?.isBarren(now) ?? this.barren;
    return isStuck(this, now);
  }

  close() {
    clearTimeout(this.timer);
    this.lookingSince = null;
    this.barren = false;
    this.next = undefined;
    this.#drop();
    this.prepared?.close();
    this.prepared = null;
  }

  /** @param {any} message a Robot API signal @returns {Promise<void>} */
  async signal(message) {
    const { peer } = this;
    if (!peer) {
      return;
    }
    try {
      const outcome = await peer.signal(message);
      if (peer === this.peer && outcome === "offered") {
        this.onOpening(peer);
      } else if (peer === this.peer && (outcome === "bye" || outcome === "unexpected")) {
        this.#lose(outcome === "bye" ? `bye_${message.reason}` : "unexpected_answer");
      }
    } catch (error) {
      // The browser cannot use the description or candidate, or it arrived after the end.
      if (peer === this.peer && error instanceof DOMException) {
        this.#lose("unusable_answer");
      } else if (!(error instanceof DOMException)) {
        throw error;
      }
    }
  }

  /** A packet of the robot has arrived on the data channel. @param {number} now */
  heard(now) {
    if (this.peer) {
      /** @type {Peer} */ (this.peer).heardAt = now;
    }
  }

  /** @param {string} packet @returns {boolean} */
  send(packet) {
    return this.peer?.send(packet) ?? false;
  }

  /** Checks the link; call it often. @param {number} now */
  watch(now) {
    if (!this.peer) {
      return;
    }
    const { connection, offeredAt, answeredAt, openedAt, heardAt } = this.peer;
    const verdict = judge(
      { state: connection.connectionState, offeredAt, answeredAt, openedAt, heardAt },
      now,
    );
    if (verdict === "live" && !this.live) {
      this.live = true;
      this.lookingSince = null;
      this.onLive();
    } else if (verdict !== "live" && verdict !== "waiting") {
      this.#lose(verdict);
    }
  }

  /** @param {LinkRole} role @param {RTCIceServer[]} iceServers */
  #open(role, iceServers) {
    this.#drop();
    const prepared = this.prepared?.role === role ? this.prepared : null;
    if (!prepared) {
      this.prepared?.close();
    }
    const peer = prepared ?? this.makePeer(role, this);
    this.prepared = null;
    this.peer = peer;
    if (peer.video) {
      this.onOpening(peer); // what the SFU sends is known when it has offered
    }
    peer.start(this.#nearest(iceServers)).catch(() => {
      if (peer === this.peer) {
        this.#lose("no_offer");
      }
    });
  }

  /**
   * @param {RTCIceServer[]} iceServers
   * @returns {RTCIceServer[] | Promise<RTCIceServer[]>} with the relays of the nearest region alone
   */
  #nearest(iceServers) {
    if (iceServers.filter(isRelay).length < 2) {
      return iceServers;
    }
    this.regions ??= fetchRegions();
    return this.regions.then((regions) => regions.nearest(iceServers)).catch(() => iceServers);
  }

  /** @param {string} why */
  #lose(why) {
    this.#drop();
    this.onLost(why);
  }

  #drop() {
    if (this.peer) {
      this.onDropping();
      this.peer.close();
    }
    this.peer = null;
    this.live = false;
  }
}

/** Whether this browser has live video. */
export const isSupported = () => typeof RTCPeerConnection === "function";

const fetchRegions = async () => (await import("./relay_regions.js")).createRelayRegions();
