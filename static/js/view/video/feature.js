/**
 * The robot's video and sound: over the media link, or as single JPEG frames through the server for
 * as long as no direct connection is found.
 */

import { unixNow } from "../../lib/clock.js";
import { roleOf } from "../../protocol/session.js";
import { ShownFrame } from "./capture_stamp.js";
import { JpegFallback } from "./jpeg_fallback.js";
import { Viewport } from "./viewport.js";

const STILL_SECONDS = 3;

const newSlice = () => ({
  /** seconds since the frame on the screen was taken, null while unknown */
  frameAge: /** @type {number | null} */ (null),
  /** whether a frame of the present link is on the screen */
  playing: false,
  /**
   * whether frames come through the server, slowly and without sound, because no direct connection
   * to the robot was found
   */
  slow: false,
  /** whether the SFU is connected and has brought no frame for a while: it has lost the robot */
  still: false,
  /** whether the visitor wants to hear the robot */
  sound: false,
});

/** @typedef {ReturnType<typeof newSlice>} Slice */

/** @param {Page} page */
const setUp = (page) => {
  const { store, emit } = page;
  const shown = new ShownFrame();
  const fallback = new JpegFallback({
    ask: (request) => page.connection.send("command/picture", request, { droppable: true }),
    show: (jpeg, isWanted) => viewport.showSlow(jpeg, isWanted),
    onShown: () => {
      store.update({ playing: true });
      emit("frameShown");
    },
  });
  const viewport = newViewport(page, shown, fallback);

  /** Capture stamp of the frame on the screen, by the robot's clock; null while unknown. */
  const frameStamp = () => (fallback.on ? fallback.stamp : shown.stamp);

  /**
   * Seconds since the frame on the screen was taken, by the robot's clock; null while unknown.
   * @param {number} now
   */
  const frameAge = (now) => {
    const stamp = frameStamp();
    const { offset } = page.connection.clockSync;
    return stamp === null || offset === null ? null : Math.max(0, now + offset - stamp);
  };

  return {
    api: { viewport, fallback, shown, frameStamp, frameAge },
    handlers: {
      media: (/** @type {any} */ message) => shown.told(message),
      picture: (/** @type {any} */ message) => void fallback.received(message, unixNow),
      robot: (/** @type {any} */ message) => {
        fallback.hurry();
        page.session.dispatch({ type: "robot", message });
      },
    },
    actions: {
      sound: () => {
        const sound = !store.get().sound;
        viewport.setSound(sound);
        store.update({ sound });
        page.connection.report("sound", { on: sound });
      },
    },
    on: newListeners(page, { viewport, fallback, shown, frameAge }),
  };
};

/**
 * @param {Page} page
 * @param {{viewport: Viewport, fallback: JpegFallback, shown: ShownFrame,
 *   frameAge: (now: number) => number | null}} video
 */
const newListeners = (page, { viewport, fallback, shown, frameAge }) => ({
  socketOpen: () => fallback.hurry(),
  linkLost: () => fallback.on || page.driving.standStill(),
  tick: (/** @type {number} */ now) =>
    fallback.tick(now, {
      roundTrip: page.connection.clockSync.roundTrip("mqtt"),
      visible: !document.hidden,
    }),
  poll: (/** @type {number} */ now) => {
    watch(page, { viewport, fallback, shown }, now);
    page.store.update({ frameAge: frameAge(now) });
  },
  linkDropping: () => viewport.freeze(),
  linkOpening: (/** @type {Peer} */ peer) => {
    shown.reset();
    page.store.update({ playing: fallback.isFresh(unixNow()) });
    viewport.attach(peer.video, peer.audio);
  },
  linkClosed: () => {
    fallback.stop();
    viewport.clear();
    page.store.update({
      playing: false,
      slow: false,
      frameAge: null,
      roundTrip: null,
      network: null,
    });
  },
});

/**
 * Whether frames have to come through the server, and whether they do come.
 * @param {Page} page @param {{viewport: Viewport, fallback: JpegFallback, shown: ShownFrame}} video
 * @param {number} now
 */
const watch = ({ store, connection, driving }, { viewport, fallback, shown }, now) => {
  const { link } = connection;
  const { visit, playing, still } = store.get();
  const isStill =
    visit.sfu &&
    link.live &&
    !document.hidden &&
    shown.rtp !== null &&
    now - shown.at > STILL_SECONDS;
  if (isStill !== still) {
    store.update({ still: isStill });
  }
  // A black frame, which Chromium draws when an attempt ends, has no time stamp.
  const isWatchable = link.live && viewport.isPlaying && shown.rtp !== null;
  const wanted =
    roleOf(visit) !== "" &&
    !visit.sfu &&
    visit.online &&
    (fallback.on ? !isWatchable : link.isStuck(now));
  if (wanted !== fallback.on) {
    link.patient = wanted;
    if (wanted) {
      fallback.start();
    } else {
      fallback.stop();
      viewport.hideSlow();
    }
    connection.report("slow_picture", { on: wanted });
    store.update({ slow: wanted, playing: !wanted && isWatchable });
  } else if (fallback.on && playing && !fallback.isFresh(now)) {
    driving.standStill();
  }
};

/** @param {Page} page @param {ShownFrame} shown @param {JpegFallback} fallback */
const newViewport = ({ element, store, emit }, shown, fallback) =>
  new Viewport({
    video: /** @type {HTMLVideoElement} */ (element("video")),
    audio: /** @type {HTMLAudioElement} */ (element("audio")),
    still: /** @type {HTMLCanvasElement} */ (element("still")),
    slow: /** @type {HTMLCanvasElement} */ (element("slow")),
    onFrame: (rtp) => {
      shown.shown(rtp, unixNow());
      emit("frameShown");
    },
    onPlaying: () => {
      performance.mark("drive:first-frame");
      if (!fallback.on) {
        store.update({ playing: true });
      }
    },
  });

/** @type {Feature} */
export const video = { name: "video", state: newSlice, setUp };
