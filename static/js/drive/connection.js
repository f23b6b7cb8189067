/**
 * The page's connections: the WebSocket to the server, the media link to the robot, and which of
 * them a packet takes. Passes on the packets that arrive, and reconnects.
 */

import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";
import { toRead } from "../lib/reading_time.js";
import { ClockSync } from "../protocol/clock_sync.js";
import { CommandStream } from "../protocol/command_stream.js";
import { wordOfDenial } from "../protocol/denials.js";
import { Link } from "../protocol/link.js";
import { createNetworkReport } from "../protocol/network_report.js";
import { Peer } from "../protocol/peer.js";
import { ON_DATA_CHANNEL, Rejection, decodePacket, encodePacket } from "../protocol/robot_api.js";
import { roleOf } from "../protocol/session.js";
import { SfuPeer } from "../protocol/sfu_peer.js";
import { Socket } from "../protocol/socket.js";
import { TransportRouter } from "../protocol/transport_router.js";
import { SERVER_SILENCE, shownFaults } from "../protocol/faults.js";
import { ErrorReports } from "./error_reports.js";

const ROUND_TRIPS = 5; // until they count: the first are slow, and would raise an alarm

const newSlice = () => ({
  /** what fails, as the server says: sessions/protocol.py Fault */
  faults: /** @type {import("../protocol/faults.js").ShownFault[]} */ ([]),
  /** the last request that the server denied, and how long that is shown; null for none */
  denial: /** @type {ReturnType<typeof toRead> | null} */ (null),
  /** whether an open WebSocket is silent */
  serverSilent: false,
  /** s from the page to the robot and back on the transport of commands, null while unknown */
  roundTrip: /** @type {number | null} */ (null),
  /** the transport that commands take now */
  transport: /** @type {Transport} */ ("mqtt"),
  /** the last second of the connection: protocol/link_stats.js */
  network: /** @type {any} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store } = page;
  const clockSync = new ClockSync();
  let grantedAt = -Infinity; // when this page got the robot

  const errors = newErrorReports(page);
  const receive = newReceiver(page, errors);
  const socket = newSocket(page, receive);
  const commands = new CommandStream({ freshId: () => freshId("stop-") });
  const link = newLink(page, socket, receive);
  const router = new TransportRouter({ socket, link, clockSync, commands });
  const network = createNetworkReport({ store, socket, link, video: () => page.video });

  return {
    api: {
      socket,
      link,
      router,
      clockSync,
      commands,
      ...senders(store, socket),
      grantedAt: () => grantedAt,
    },
    handlers: {
      ...handlers(page, clockSync, link),
      denied: (message) => {
        page.session.dispatch({ type: "denied", message });
        const word = wordOfDenial(message);
        if (word) {
          store.update({ denial: toRead(page.words, word), now: unixNow() });
        }
      },
      event: () => undefined, // for the record that others keep
    },
    on: {
      granted: () => (grantedAt = unixNow()),
      phase: () => store.update({ denial: null }),
      linkOpening: () => {
        clockSync.reset("datachannel");
        network.begin();
      },
      tick: (now) => {
        link.watch(now);
        router.repeatStop(now);
      },
      poll: (now) => store.update(poll(page, now)),
      second: (now) => {
        errors.poll(now);
        void network.second(now);
      },
    },
  };
};

/** @param {Page} page */
const newErrorReports = (page) => {
  const errors = new ErrorReports((data) => page.connection.report("script_error", data));
  // an event without an error is not a script's
  window.addEventListener("error", ({ error }) => error && errors.note(error));
  window.addEventListener("unhandledrejection", ({ reason }) => errors.note(reason));
  return errors;
};

/**
 * Passes a packet to the features that take its message, or else to the session.
 * @param {Page} page @param {ErrorReports} errors
 * @returns {(packet: unknown, transport: Transport) => void}
 */
const newReceiver = (page, errors) => (packet, transport) => {
  try {
    const { suffix, message } = decodePacket(packet);
    if (
      (transport === "mqtt" || ON_DATA_CHANNEL.has(suffix)) &&
      !page.handle(suffix, message, transport)
    ) {
      page.session.dispatch({ type: suffix, message });
    }
  } catch (error) {
    if (!(error instanceof Rejection)) {
      throw error;
    }
    errors.note(error, transport);
  }
};

/** Heartbeats, and the state of the transports. @param {Page} page @param {number} now */
const poll = ({ store, video, connection }, now) => {
  const { router, clockSync, socket } = connection;
  const { visit } = store.get();
  const silence = roleOf(visit) ? socket.watch(now) : socket.silence(now);
  if (visit.phase === "driving") {
    router.beat(now, video.frameAge(now));
  }
  router.tellDirect(now);
  const transport = router.transport(now);
  return {
    transport,
    roundTrip:
      visit.phase === "driving" ? clockSync.roundTripNow(transport, now, ROUND_TRIPS) : null,
    serverSilent: silence > SERVER_SILENCE,
  };
};

/** @param {Page} page @param {(packet: unknown, transport: any) => void} receive */
const newSocket = (page, receive) =>
  new Socket({
    url: new URL(page.config.socket, location.href.replace(/^http/, "ws")).href,
    onPacket: (packet) => receive(packet, "mqtt"),
    onOpen: () => {
      performance.mark("drive:socket");
      page.connection.router.direct = false;
      page.emit("socketOpen");
      page.store.update({ faults: [] });
      page.session.dispatch({ type: "socket_open" });
    },
    onLost: (code) => page.session.dispatch({ type: "socket_closed", code }),
  });

/**
 * @param {Page} page @param {Socket} socket
 * @param {(packet: unknown, transport: any) => void} receive
 */
const newLink = (page, socket, receive) => {
  const onSignal = (/** @type {object} */ message) =>
    void socket.send(encodePacket("signal", message));
  const link = new Link({
    makePeer: (role) =>
      role === "sfu"
        ? new SfuPeer({ onSignal })
        : new Peer({ role, onSignal, onPacket: (packet) => receive(packet, "datachannel") }),
    onDropping: () => page.emit("linkDropping"),
    onOpening: (peer) => page.emit("linkOpening", /** @type {Peer} */ (peer)),
    onLive: () => {
      performance.mark("drive:link");
      page.session.dispatch({ type: "link_live" });
    },
    onLost: (why) => {
      page.connection.report("link_lost", { why });
      page.emit("linkLost");
      page.session.dispatch({ type: "link_lost" });
    },
  });
  window.addEventListener("online", () => link.hurry());
  return link;
};

/** @param {Store} store @param {Socket} socket */
const senders = (store, socket) => ({
  /** @type {Page["connection"]["send"]} */
  send: (suffix, message, options) => socket.send(encodePacket(suffix, message), options),
  /** @type {Page["connection"]["report"]} */
  report: (type, data = {}, stamp = unixNow()) =>
    Boolean(store.get().visit.session) &&
    socket.send(encodePacket("page/event", { stamp, type, data })),
});

/** @param {Page} page @param {ClockSync} clockSync @param {Link} link @returns {Handlers} */
const handlers = (page, clockSync, link) => ({
  heartbeat: (message, transport) => {
    const now = unixNow();
    clockSync.heard(transport, message, page.store.get().visit.peer, now);
    if (transport === "datachannel") {
      link.heard(now);
    }
  },
  "server/status": ({ faults }) => page.store.update({ faults: shownFaults(faults, unixNow()) }),
  "signal/reply": (message) => {
    page.session.dispatch({ type: "signal/reply", message });
    void link.signal(message);
  },
});

/** @type {Feature} */
export const connection = { name: "connection", state: newSlice, setUp };
