/**
 * The transport of each message: for velocities the data channel while the robot acknowledges on
 * it, otherwise the WebSocket; for a stop both. All use the same counter, so that a change of
 * transport makes no difference to the robot.
 */

import { encodePacket } from "./robot_api.js";

/** s without a heartbeat (five a second) on the data channel, until the server sends everything */
const DIRECT_SILENCE = 0.7;

export class TransportRouter {
  /**
   * @param {object} options
   * @param {{send: (packet: string, options?: {droppable?: boolean}) => boolean, isOpen: boolean}}
   *   options.socket
   * @param {{send: (packet: string) => boolean}} options.link
   * @param {import("./clock_sync.js").ClockSync} options.clockSync
   * @param {import("./command_stream.js").CommandStream} options.commands
   */
  constructor({ socket, link, clockSync, commands }) {
    this.socket = socket;
    this.link = link;
    this.clockSync = clockSync;
    this.commands = commands;
    /** the last `page/direct` on this connection to the server */
    this.direct = false;
    /** the one transport on which the robot accepts commands, if it is fixed; stops use both */
    this.only = /** @type {"any" | Transport} */ ("any");
  }

  /** @param {Transport} transport */
  allows(transport) {
    return this.only === "any" || this.only === transport;
  }

  /** @param {number} now @returns {Transport} */
  transport(now) {
    if (this.only !== "any") {
      return this.only;
    }
    return this.clockSync.isFresh("datachannel", now) ? "datachannel" : "mqtt";
  }

  /**
   * Sends the velocity of now, if there is one.
   * @param {number} now @param {number | null} frame
   */
  sendVelocity(now, frame) {
    const message = this.commands.velocity(now, frame);
    if (message) {
      this.#sendFast(now, "command/velocity", message);
    }
  }

  /**
   * Sends an action by the reliable transport, or by both if it is repeated or the server is away.
   * @param {object} action @param {boolean} again
   */
  sendAction(action, again) {
    const packet = encodePacket("command/action", action);
    if (this.allows("datachannel") && (again || !this.socket.isOpen || !this.allows("mqtt"))) {
      this.link.send(packet);
    }
    if (this.allows("mqtt")) {
      this.socket.send(packet, { droppable: true });
    }
  }

  /** Sends a pointer on the shared screen. @param {number} now @param {object} pointer */
  sendPointer(now, pointer) {
    this.#sendFast(now, "command/point", pointer);
  }

  /** Asks where the robot would drive. @param {number} now @param {object} request */
  askRoute(now, request) {
    this.#sendFast(now, "command/route", { stamp: now, ...request });
  }

  /** @param {number} now @param {"stop" | "estop"} type @param {boolean} [isAsked] */
  stop(now, type, isAsked) {
    this.#both(this.commands.stop(now, type, isAsked));
  }

  /** @param {number} now */
  repeatStop(now) {
    const message = this.commands.repeat(now);
    if (message) {
      this.#both(message);
    }
  }

  /** Sends a heartbeat on each transport. @param {number} now @param {number | null} frameAge */
  beat(now, frameAge) {
    const beatOn = (/** @type {Transport} */ transport) =>
      encodePacket("command/heartbeat", this.clockSync.beat(transport, now, frameAge));
    this.link.send(beatOn("datachannel"));
    this.socket.send(beatOn("mqtt"), { droppable: true });
  }

  /** Tells the server whether it need not relay the robot's messages. @param {number} now */
  tellDirect(now) {
    const direct = this.clockSync.silence("datachannel", now) < DIRECT_SILENCE;
    if (
      direct !== this.direct &&
      this.socket.send(encodePacket("page/direct", { direct }), { droppable: true })
    ) {
      this.direct = direct;
    }
  }

  /**
   * By the present transport, or not at all: a message that waits would arrive too late.
   * @param {number} now @param {string} suffix @param {object} message
   */
  #sendFast(now, suffix, message) {
    const packet = encodePacket(suffix, message);
    if (!(this.transport(now) === "datachannel" && this.link.send(packet)) && this.allows("mqtt")) {
      this.socket.send(packet, { droppable: true });
    }
  }

  /** @param {object} action */
  #both(action) {
    const packet = encodePacket("command/action", action);
    this.link.send(packet);
    this.socket.send(packet);
  }
}
