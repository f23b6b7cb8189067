/**
 * What time does on the drive page: twenty times a second, five times, and once. What steers and heartbeats are sent, the ways to server
 * and robot and the picture are watched over, and the visitor learns how they do.
 */

import { TICK_SECONDS } from "../protocol/command_stream.js";
import { AgeTrend, BEAT_SECONDS, HASTY_SECONDS } from "../protocol/clock_sync.js";
import { createNetworkReport } from "../protocol/network_report.js";
import { awaitsAnswer, isSigning, roleOf } from "../protocol/session.js";
import { unixNow } from "../lib/clock.js";

const SERVER_SILENCE = 1.5; // s without any word on a WebSocket, which brings one a second, after which the visitor is told
const SOCKET_SILENCE = 3; // and after which another one is opened
const ANSWER_PATIENCE = 3; // s until a question that the server has not answered is asked again
const HURRY = 1.5; // s after a grant in which heartbeats come twice as often
const TROUBLE_PATIENCE = 6; // s without a way to server or robot until the page looks why
const STOP_PATIENCE = 3; // s a stop is repeated after the visit is over

/**
 * @param {object} page
 * @param {ReturnType<typeof import("./store.js").createStore>} page.store
 * @param {import("../protocol/socket.js").Socket} page.socket
 * @param {import("../protocol/link.js").Link} page.link
 * @param {import("../protocol/transport_router.js").TransportRouter} page.router
 * @param {import("../protocol/clock_sync.js").ClockSync} page.clockSync
 * @param {import("../protocol/command_stream.js").CommandStream} page.commands
 * @param {import("../view/video/jpeg_fallback.js").JpegFallback} page.slow
 * @param {import("../view/video/viewport.js").Viewport} page.viewport
 * @param {import("../view/video/capture_stamp.js").ShownFrame} page.shown
 * @param {(now: number) => number | null} page.frameAge s
 * @param {() => void} page.sendNow what steers
 * @param {() => void} page.standStill
 * @param {() => void} page.onTick twenty times a second
 * @param {(now: number) => void} page.onBeat five times a second
 * @param {(type: string, data?: Record<string, string | number | boolean | null>) => boolean} page.report
 * @param {(happening: import("../protocol/session.js").Happening) => void} page.dispatch
 * @param {(use: (aside: ReturnType<typeof import("../waiting/lazy_panels.js").createLazyPanels>) => void, missing?: () => void) => void} page.aside
 */
export const createScheduler = (page) => {
  const { store, socket, link, router, clockSync, commands, slow, viewport, shown, frameAge, report, dispatch } = page;
  const network = createNetworkReport({ store, socket, link, slow, frameAge });
  const ageTrend = new AgeTrend();
  let [beatAt, secondAt, askedSince, hurryUntil] = [0, 0, 0, 0];
  let serverAt = Infinity; // when the server last said anything
  let troubledSince = 0; // 0: all is well

  const tick = () => {
    const now = unixNow();
    link.watch(now);
    router.repeatStop(now);
    page.onTick();
    slow.tick(now, { roundTrip: clockSync.roundTrip("mqtt"), visible: !document.hidden });
    page.sendNow();
    // The robot takes no command before it has three echoes to judge its age by: the first come quickly. And it sends less when pictures
    // wait before a place that has become narrow, which it learns from the beats alone.
    const isHasty = ageTrend.look(frameAge(now)) || now < hurryUntil;
    if (now - beatAt >= (isHasty ? HASTY_SECONDS : BEAT_SECONDS) - TICK_SECONDS / 2) {
      beatAt = now;
      beat(now);
    }
    if (now - secondAt >= 1) {
      secondAt = now;
      everySecond(now);
    }
  };

  /** @param {number} now */
  const beat = (now) => {
    const { visit } = store.get();
    if (visit.phase === "driving") {
      router.beat(now, frameAge(now));
    }
    router.tellDirect(now);
    if (commands.pending && !roleOf(visit) && now - commands.pending.since > STOP_PATIENCE) {
      commands.giveUp();
    }
    // A WebSocket may die without a word, and so may the process at its other end.
    const silence = socket.isOpen ? now - serverAt : 0;
    if (roleOf(visit) && silence > SOCKET_SILENCE) {
      socket.redial();
    }
    const way = router.way(now);
    lookAfterPicture(now);
    page.onBeat(now);
    store.update({
      way,
      roundTrip: visit.phase === "driving" ? clockSync.roundTrip(way) : null,
      frameAge: frameAge(now),
      serverSilent: silence > SERVER_SILENCE,
      stopping: commands.pending !== null,
      stopUnconfirmed: commands.isUnconfirmed(now),
    });
  };

  /** Whether the direct link has shown a picture: a black one, which Chromium draws when an attempt ends, has no time stamp. */
  const isWatchable = () => link.live && viewport.isPlaying && shown.rtp !== null;

  /** Whether pictures come through the server, and whether they do come. @param {number} now */
  const lookAfterPicture = (now) => {
    const { visit, playing } = store.get();
    const wanted = roleOf(visit) !== "" && visit.online && (slow.on ? !isWatchable() : link.isStuck(now));
    if (wanted !== slow.on) {
      switchPicture(wanted);
    } else if (slow.on && playing && !slow.isFresh(now)) {
      page.standStill();
    }
  };

  /** @param {boolean} toSlow */
  const switchPicture = (toSlow) => {
    link.patient = toSlow;
    if (toSlow) {
      slow.start();
    } else {
      slow.stop();
      viewport.hideSlow();
    }
    report("slow_picture", { on: toSlow });
    store.update({ slow: toSlow, playing: !toSlow && isWatchable() });
  };

  /** @param {number} now */
  const everySecond = (now) => {
    store.update({ now });
    const { visit } = store.get();
    askedSince = awaitsAnswer(visit) ? askedSince || now : 0;
    if (askedSince && now - askedSince > ANSWER_PATIENCE) {
      askedSince = now;
      dispatch({ type: "no_answer" });
    }
    if (visit.phase === "turn" && visit.startBy !== null && now > visit.startBy) {
      dispatch({ type: "turn_missed" });
    }
    if (isSigning(visit, now)) {
      report("here"); // until the server says that it has one: its own ways may be broken for a moment
    }
    lookForTrouble(now);
    void network.second(now);
  };

  /** When the way to server or robot does not come about, find out once what to tell the visitor. @param {number} now */
  const lookForTrouble = (now) => {
    const { visit, playing, slow: bySlow, finding, robot } = store.get();
    const blind = roleOf(visit) !== "" && visit.online && (bySlow || !playing) && !robot?.cameraStatus; // a camera is no network's fault
    if (visit.socket === "open" ? !blind : visit.phase === "closed") {
      troubledSince = 0;
      if (finding && playing) {
        store.update({ finding: null });
      }
    } else if (troubledSince === 0) {
      troubledSince = now;
    } else if (now - troubledSince > TROUBLE_PATIENCE) {
      troubledSince = Infinity; // once for each trouble
      page.aside(
        ({ examine }) => void examine(),
        () => (troubledSince = now), // no way to the server at all: tried again while the trouble lasts
      );
    }
  };

  return {
    begin: () => setInterval(tick, TICK_SECONDS * 1000),
    /** The robot was given to this page. */
    hurry: () => {
      hurryUntil = unixNow() + HURRY;
    },
    /** The server said something, or a new way to it is open: it will. */
    heardServer: () => {
      serverAt = unixNow();
    },
    linkBegins: network.begin,
  };
};
