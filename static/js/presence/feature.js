/**
 * Being there, on the drive page: voice and video to the robot, messages both ways, the head, and
 * photos to keep. What to do is decided in the pure modules beside it. Nothing here is needed to
 * drive, and whatever fails leaves driving as it is.
 */

import { backToDriving } from "../lib/dom.js";
import { isOffered, mayWriteWaiting, mayAsk } from "../protocol/capabilities.js";
import { unixNow } from "../lib/clock.js";
import { toRead } from "../lib/reading_time.js";
import { lazy } from "../lib/lazy.js";
import { roleOf } from "../protocol/session.js";
import { callOf } from "./call.js";
import { CallMedia } from "./call_media.js";
import { createCallView } from "./call_view.js";
import { createHead } from "./head.js";
import { createMessages } from "./messages.js";

/** @param {Page} page */
const setUp = (page) => {
  const { store, element } = page;
  const media = new CallMedia(page);
  const [photo, knock] = [newPhoto(page), newKnock(page)];
  const [messages, head, audience] = [createMessages(page), createHead(page), newAudience(page)];
  const callView = createCallView(page, media);
  setUpButtons(page, {
    ...media.clicks,
    ...messages.clicks,
    "presence-photo": photo.take,
    "presence-knock": knock.knock,
    "kept-close": photo.close,
    "presence-volumes": () => toggleVolumes(page, messages),
  });
  page.keys.closes(element("volumes"), messages.closePanel, () => messages.show(""));
  const renders = [callView.render, messages.render, head.render, audience.render];
  return {
    api: { media },
    handlers: {
      ...audience.handlers,
      action: (/** @type {any} */ message) => {
        photo.heard(message);
        knock.answered(message);
        messages.answered(message);
      },
      words: messages.received,
      receipt: messages.confirmed,
      pointer: (/** @type {any} */ message) => media.preview?.pointed(message),
    },
    keys: { talk: media.talkKey, ...head.keys },
    on: {
      changed: (/** @type {State} */ state) => {
        if (isLeftOpen(state, mayWriteWaiting(state))) {
          media.endAll();
          photo.close();
          store.update({ panel: "", writing: false });
        }
        messages.changed(state);
        head.changed(state);
        audience.changed(state);
      },
      socketOpen: audience.reconnected,
      linkOpening: (/** @type {Peer} */ peer) => media.attachTo(peer),
      poll: (/** @type {number} */ now) => {
        media.poll(now);
        head.poll(now);
        photo.poll(now);
        messages.poll(now);
        knock.poll(now);
      },
    },
    render: (/** @type {State} */ state) => {
      showBar(element, state, mayWriteWaiting(state));
      renders.forEach((render) => render(state));
      photo.render(state);
    },
  };
};

/**
 * Whether something is open that only a driver may have.
 * @param {State} state
 * @param {boolean} waits at a stopped robot: with its chat
 */
const isLeftOpen = ({ visit, own, panel, keptPhoto }, waits) =>
  roleOf(visit) !== "driver" &&
  (callOf(own) || (panel && !(waits && panel === "talk")) || keptPhoto);

/** @param {Page} page */
const newPhoto = (page) => {
  const fetchPhoto = lazy(async () => new (await import("./kept_photo.js")).KeptPhoto(page));
  /** @type {import("./kept_photo.js").KeptPhoto | null} fetched with the first photo */
  let fetched = null;
  return {
    take: () =>
      fetchPhoto(
        (it) => {
          fetched = it;
          it.take();
        },
        () => page.store.update({ said: toRead(page.words, "kept.failed"), now: unixNow() }),
      ),
    close: () => fetched?.close(),
    heard: (/** @type {any} */ message) => fetched?.heard(message),
    poll: (/** @type {number} */ now) => fetched?.poll(now),
    render: (/** @type {State} */ state) => fetched?.render(state),
  };
};

/** @param {Page} page */
const newKnock = (page) => {
  const fetchKnock = lazy(async () => (await import("./knock.js")).createKnock(page));
  /**
   * @type {ReturnType<typeof import("./knock.js").createKnock> | null} fetched with the first knock
   */
  let fetched = null;
  return {
    knock: () =>
      fetchKnock((it) => {
        fetched = it;
        it.knock();
      }),
    answered: (/** @type {any} */ message) => fetched?.answered(message),
    poll: (/** @type {number} */ now) => fetched?.poll(now),
  };
};

/** @param {Page} page */
const newAudience = (page) => {
  const fetchPanel = lazy(async () => (await import("../audience/panel.js")).createPanel(page));
  /**
   * @type {ReturnType<typeof import("../audience/panel.js").createPanel> | null} fetched when
   *   somebody watches
   */
  let panel = null;
  return {
    handlers: {
      audience: (/** @type {any} */ audience) => page.store.update({ audience }),
      denied: (/** @type {any} */ message) => panel?.denied(message),
    },
    reconnected: () => panel?.reconnected(),
    changed: (/** @type {State} */ state) => {
      if (!panel && state.audience?.open && state.room.observers) {
        fetchPanel((it) => {
          panel = it;
          page.store.update({});
        });
      }
      panel?.changed(state);
    },
    render: (/** @type {State} */ state) => panel?.render(state),
  };
};

/** @param {Page} page @param {ReturnType<typeof createMessages>} messages */
const toggleVolumes = ({ store, element }, messages) => {
  messages.show(store.get().panel === "volumes" ? "" : "volumes");
  // not the button, which the space bar would press again
  element("volumes").focus({ preventScroll: true });
};

/** @param {Page} page @param {Record<string, () => void>} clicks by the button's id */
const setUpButtons = ({ element, keys }, clicks) => {
  for (const [id, click] of Object.entries(clicks)) {
    element(id).addEventListener("click", () => {
      click();
      if (!keys.taken) {
        backToDriving(element); // the space bar is to stop the robot, not to press this again
      }
    });
  }
  const [here, audio] = [
    /** @type {HTMLInputElement} */ (element("volume-here")),
    /** @type {HTMLAudioElement} */ (element("audio")),
  ];
  here.addEventListener("input", () => {
    audio.volume = Number(here.value) / 100;
  });
};

/** @type {Feature} */
export const presence = { name: "presence", setUp };

/**
 * @param {Page["element"]} element @param {State} state
 * @param {boolean} waits at a stopped robot: with its chat, and nothing else of this
 */
const showBar = (element, state, waits) => {
  const drives = roleOf(state.visit) === "driver";
  // A visitor who is writing keeps the field while the video is away: without it the next letters
  // would go to the robot.
  element("presence").hidden =
    !waits && (!drives || !(state.playing || state.writing || state.panel === "volumes"));
  element("presence-volumes").hidden = waits;
  // In a study its photos belong to the task.
  element("presence-photo").hidden =
    !isOffered(state, "photo") || Boolean(state.study) || !state.playing;
  // What is shared lies beside the bar; on a phone there is no room for one more button.
  element("presence-knock").hidden =
    !drives || !state.robot?.knockable || state.own.shares || !mayAsk(state, "knock");
};
