/**
 * The page's WebSocket. It always reconnects: after a growing, random pause, and at once when the
 * browser reports a network.
 */

import { backoff } from "../lib/backoff.js";
import { unixNow } from "../lib/clock.js";

const MOST_BUFFERED = 64 * 1024;
const MOST_SILENCE = 3; // s; an open WebSocket brings a packet every second

export class Socket {
  /**
   * @param {object} options @param {string} options.url
   * @param {(packet: unknown) => void} options.onPacket @param {() => void} options.onOpen
   * @param {(code: number) => void} options.onLost
   * @param {(url: string) => WebSocket} [options.connect]
   */
  constructor({ url, onPacket, onOpen, onLost, connect = (address) => new WebSocket(address) }) {
    this.url = url;
    this.onPacket = onPacket;
    this.onOpen = onOpen;
    this.onLost = onLost;
    this.connect = connect;
    this.attempt = 0;
    this.closed = false;
    this.receivedAt = 0; // Unix time of the last packet
    /** @type {WebSocket | null} */
    this.socket = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.wake = () => this.#hurry();
  }

  open() {
    globalThis.addEventListener?.("online", this.wake);
    this.#dial();
  }

  /** For good. */
  close() {
    this.closed = true;
    globalThis.removeEventListener?.("online", this.wake);
    clearTimeout(this.timer);
    this.socket?.close();
  }

  /** Closes a connection that may be dead, and dials again. */
  redial() {
    const dead = this.socket;
    if (!dead || this.closed) {
      return;
    }
    this.socket = null;
    dead.close();
    this.#lost(1006);
  }

  /**
   * Dials again when an open connection has been silent for too long: it, or the process at its
   * other end, may die without an event.
   * @param {number} now Unix time @returns {number} s of silence before
   */
  watch(now) {
    const silence = this.silence(now);
    if (silence > MOST_SILENCE) {
      this.redial();
    }
    return silence;
  }

  get isOpen() {
    return this.socket?.readyState === 1;
  }

  /** s since an open connection brought anything, 0 without one. @param {number} now Unix time */
  silence(now) {
    return this.isOpen ? now - this.receivedAt : 0;
  }

  /**
   * @param {string} packet
   * @param {{droppable?: boolean}} [options] droppable packets are not queued
   * @returns {boolean} whether it was handed to the network
   */
  send(packet, { droppable = false } = {}) {
    if (!this.socket || !this.isOpen || (droppable && this.socket.bufferedAmount > MOST_BUFFERED)) {
      return false;
    }
    this.socket.send(packet);
    return true;
  }

  #dial() {
    const socket = this.connect(this.url);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.attempt = 0;
      this.receivedAt = unixNow();
      this.onOpen();
    };
    socket.onmessage = (event) => {
      if (socket === this.socket) {
        this.receivedAt = unixNow();
        this.onPacket(event.data);
      }
    };
    socket.onclose = (event) => {
      if (socket === this.socket) {
        this.socket = null;
        this.#lost(event.code);
      }
    };
  }

  /** @param {number} code */
  #lost(code) {
    this.onLost(code);
    if (!this.closed) {
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.#dial(), backoff(this.attempt++) * 1000);
    }
  }

  #hurry() {
    if (!this.socket && !this.closed) {
      clearTimeout(this.timer);
      this.attempt = 0;
      this.#dial();
    }
  }
}
