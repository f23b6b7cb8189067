/**
 * The connections of a hidden operator's page: the WebSocket, which takes all commands, and the
 * robot's video and sound. When the WebSocket is lost, the server and the robot stop the robot.
 */

import { unixNow } from "../../lib/clock.js";
import { freshId } from "../../lib/ids.js";
import { ClockSync } from "../../protocol/clock_sync.js";
import { CommandStream } from "../../protocol/command_stream.js";
import { Link, isSupported } from "../../protocol/link.js";
import { Peer } from "../../protocol/peer.js";
import { areCredentialsOld } from "../../protocol/link_health.js";
import { Rejection, encodePacket } from "../../protocol/robot_api.js";
import { Socket } from "../../protocol/socket.js";
import { TransportRouter } from "../../protocol/transport_router.js";
import { readPacket } from "./packets.js";

/**
 * @typedef {{peer: string | null, iceServers: RTCIceServer[], iceAt: number,
 *   attempt: number}} Peering
 */

/**
 * @param {object} options @param {string} options.url
 * @param {import("../../view/video/viewport.js").Viewport} options.viewport
 * @param {import("../../view/video/capture_stamp.js").ShownFrame} options.shown
 * @param {(suffix: string, message: any) => void} options.onMessage
 * @param {(open: boolean, code: number) => void} options.onSocket
 */
export const createConnection = ({ url, viewport, shown, onMessage, onSocket }) => {
  const clockSync = new ClockSync();
  const commands = new CommandStream({ freshId: () => freshId("stop-") });
  const peering = /** @type {Peering} */ ({ peer: null, iceServers: [], iceAt: 0, attempt: 0 });

  /** @param {unknown} packet @param {Transport} transport */
  const receive = (packet, transport) => {
    try {
      const { suffix, message } = readPacket(packet);
      take(suffix, message, transport);
    } catch (error) {
      if (!(error instanceof Rejection)) {
        throw error;
      }
    }
  };

  /** @param {string} suffix @param {any} message @param {Transport} transport */
  const take = (suffix, message, transport) => {
    const now = unixNow();
    if (transport === "datachannel") {
      link.heard(now);
    }
    if (suffix === "heartbeat") {
      clockSync.heard(transport, message, peering.peer, now);
    } else if (suffix === "media") {
      shown.clock = message;
    } else if (suffix === "signal/reply") {
      void link.signal(message);
    } else if (transport === "mqtt") {
      if (suffix === "wizard/hello") {
        const { peer, iceServers } = message;
        Object.assign(peering, { peer, iceServers, iceAt: now, attempt: 0 });
        openVideo(link, peering);
      }
      onMessage(suffix, message);
    }
  };

  const socket = new Socket({
    url: new URL(url, location.href.replace(/^http/, "ws")).href,
    onPacket: (packet) => receive(packet, "mqtt"),
    onOpen: () => onSocket(true, 0),
    onLost: (code) => onSocket(false, code),
  });
  const link = newLink({ viewport, shown, socket, clockSync, peering, receive });
  const router = new TransportRouter({ socket, link, clockSync, commands });
  router.only = "mqtt";

  return {
    socket,
    link,
    router,
    commands,
    clockSync,
    send: (/** @type {string} */ suffix, /** @type {object} */ message) =>
      socket.send(encodePacket(suffix, message)),
  };
};

/**
 * The robot's video and sound, opened again whenever they are lost.
 * @param {object} parts @param {import("../../view/video/viewport.js").Viewport} parts.viewport
 * @param {import("../../view/video/capture_stamp.js").ShownFrame} parts.shown
 * @param {Socket} parts.socket @param {ClockSync} parts.clockSync @param {Peering} parts.peering
 * @param {(packet: unknown, transport: "datachannel") => void} parts.receive
 */
const newLink = ({ viewport, shown, socket, clockSync, peering, receive }) => {
  const link = new Link({
    makePeer: (role) =>
      new Peer({
        role: /** @type {any} */ (role),
        onSignal: (message) => socket.send(encodePacket("signal", message)),
        onPacket: (packet) => receive(packet, "datachannel"),
      }),
    onDropping: () => viewport.freeze(),
    onOpening: (/** @type {any} */ peer) => {
      shown.reset();
      clockSync.reset("datachannel");
      viewport.attach(peer.video, peer.audio);
    },
    onLive: () => (peering.attempt = 0),
    onLost: () => {
      if (areCredentialsOld(peering, unixNow())) {
        socket.redial(); // the server's first message has new credentials
      } else {
        openVideo(link, peering);
      }
    },
  });
  return link;
};

/** @param {Link} link @param {Peering} peering */
const openVideo = (link, peering) => {
  if (isSupported()) {
    link.open("observer", peering.iceServers, peering.attempt++);
  }
};
