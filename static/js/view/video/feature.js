/**
 * The robot's video and sound: over the media link, or as single JPEG frames through the server
 * while there is no direct connection.
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
  /** whether frames come through the server, without sound, as there is no direct connection */
  slow: false,
  /** whether the connected SFU has sent no frame for a while: it has lost the robot */
  still: false,
  /** whether the visitor wants to hear the robot */
  sound: false,
  /** whether the visitor has chosen so */
  soundChosen: false,
});

/** @typedef {ReturnType<typeof newSlice>} Slice */

/** @type {Feature["setUp"]} */
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

  /** Seconds since the frame on the screen was taken; null while unknown. @param {number} now */
  const frameAge = (now) => {
    const stamp = frameStamp();
    const { offset } = page.connection.clockSync;
    return stamp === null || offset === null ? null : Math.max(0, now + offset - stamp);
  };

  return {
    api: { viewport, fallback, shown, frameStamp, frameAge },
    handlers: {
      media: (message) => (shown.clock = message),
      picture: (message) => void fallback.received(message, unixNow),
      robot: (message) => {
        fallback.hurry();
        page.session.dispatch({ type: "robot", message });
      },
    },
    actions: {
      sound: () => {
        const sound = !store.get().sound;
        viewport.setSound(sound);
        store.update({ sound, soundChosen: true });
        page.connection.report("sound", { on: sound });
      },
    },
    on: newListeners(page, { viewport, fallback, shown, frameAge }),
  };
};

/**
 * @param {Page} page
 * @param {Pick<Page["video"], "viewport" | "fallback" | "shown" | "frameAge">} video
 * @returns {Listeners}
 */
const newListeners = (page, { viewport, fallback, shown, frameAge }) => ({
  socketOpen: () => fallback.hurry(),
  linkLost: () => fallback.on || page.driving.standStill(),
  tick: (now) => {
    const roundTrip = page.connection.clockSync.roundTrip("mqtt");
    fallback.tick(now, { roundTrip, visible: !document.hidden });
  },
  poll: (now) => {
    watch(page, { viewport, fallback, shown }, now);
    page.store.update({ frameAge: frameAge(now) });
  },
  linkDropping: () => viewport.freeze(),
  linkOpening: (peer) => {
    shown.reset();
    page.store.update({ playing: fallback.isFresh(unixNow()) });
    viewport.attach(peer.video, peer.audio);
  },
  linkClosed: () => {
    fallback.stop();
    viewport.clear();
    const over = { playing: false, slow: false, frameAge: null, roundTrip: null, network: null };
    page.store.update(over);
  },
});

/**
 * Starts and ends frames through the server, and stops the robot when they stop coming.
 * @param {Page} page @param {Pick<Page["video"], "viewport" | "fallback" | "shown">} video
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
  // Chromium draws a black frame without a timestamp when an attempt ends.
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
