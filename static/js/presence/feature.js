/**
 * Presence at the robot: voice and video to the robot, messages both ways, the head, and photos to
 * keep. The pure modules beside it decide. Driving needs none of this.
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

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store, element } = page;
  const media = new CallMedia(page);
  const photo = lazy(async () => new (await import("./kept_photo.js")).KeptPhoto(page));
  const knock = lazy(async () => (await import("./knock.js")).createKnock(page));
  const audience = lazy(async () => (await import("../audience/panel.js")).createPanel(page));
  const [messages, head] = [createMessages(page), createHead(page)];
  const callView = createCallView(page, media);
  setUpPanels(page, { media, messages, photo, knock });
  return {
    handlers: {
      audience: (message) => store.update({ audience: message }),
      denied: (message) => audience.now?.denied(message),
      action: (message) => {
        photo.now?.received(message);
        knock.now?.answered(message);
        messages.answered(message);
      },
      words: messages.received,
      receipt: messages.confirmed,
      pointer: (message) => media.preview.now?.pointed(message),
    },
    keys: { talk: media.talkKey, ...head.keys },
    on: {
      changed: (state) => {
        if (isLeftOpen(state, mayWriteWaiting(state))) {
          media.endAll();
          photo.now?.close();
          store.update({ panel: "", writing: false });
        }
        messages.changed(state);
        head.changed(state);
        if (!audience.now && state.audience?.open && state.room.observers) {
          audience(() => store.update({}));
        }
        audience.now?.changed(state);
      },
      socketOpen: () => audience.now?.reconnected(),
      linkOpening: (peer) => media.attachTo(peer),
      poll: (now) => [media, head, photo.now, messages, knock.now].forEach((one) => one?.poll(now)),
    },
    render: (state) => {
      showBar(element, state, mayWriteWaiting(state));
      const parts = [callView, messages, head, audience.now, photo.now];
      parts.forEach((part) => part?.render(state));
    },
  };
};

/**
 * Whether something is open that only a driver may have.
 * @param {State} state @param {boolean} waits at a stopped robot, with its chat
 */
const isLeftOpen = ({ visit, own, panel, keptPhoto }, waits) =>
  roleOf(visit) !== "driver" &&
  (callOf(own) || (panel && !(waits && panel === "talk")) || keptPhoto);

/**
 * @param {Page} page @param {ReturnType<typeof createMessages>} messages
 * @param {"volumes" | "help"} panel
 */
const toggle = ({ store, element }, messages, panel) => {
  messages.show(store.get().panel === panel ? "" : panel);
  // not the button: the space bar would press it again
  element(panel).focus({ preventScroll: true });
};

/**
 * The buttons, and how each panel is opened and closed.
 * @param {Page} page
 * @param {{media: CallMedia, messages: ReturnType<typeof createMessages>, photo: any, knock: any}}
 *   parts
 */
const setUpPanels = (page, { media, messages, photo, knock }) => {
  const { store, element, keys, words } = page;
  const closePhoto = () => photo.now?.close();
  const help = () => toggle(page, messages, "help");
  setUpButtons(page, {
    ...media.clicks,
    ...messages.clicks,
    "presence-photo": () => {
      messages.show("");
      photo(
        (/** @type {any} */ it) => it.take(),
        () => store.update({ said: toRead(words, "kept.failed"), now: unixNow() }),
      );
    },
    "presence-knock": () => knock((/** @type {any} */ it) => it.knock()),
    "presence-hear": () => page.act("sound"),
    "presence-volumes": () => toggle(page, messages, "volumes"),
    "kept-close": closePhoto,
    "help-open": help,
    "help-more": help,
    "help-close": messages.closePanel,
  });
  keys.add({
    down: ({ key }) => key === "?" && roleOf(store.get().visit) === "driver" && help(),
  });
  for (const panel of ["volumes", "help"]) {
    keys.closes(element(panel), messages.closePanel, () => messages.show(""));
  }
  keys.closes(element("presence-dismiss"), media.clicks["presence-dismiss"]);
  keys.closes(element("kept"), closePhoto);
};

/** @param {Page} page @param {Record<string, () => void>} clicks by the button's id */
const setUpButtons = ({ element, keys }, clicks) => {
  for (const [id, click] of Object.entries(clicks)) {
    element(id).addEventListener("click", () => {
      click();
      if (!keys.taken) {
        backToDriving(element);
      }
    });
  }
  const here = /** @type {HTMLInputElement} */ (element("volume-here"));
  const audio = /** @type {HTMLAudioElement} */ (element("audio"));
  here.addEventListener("input", () => (audio.volume = Number(here.value) / 100));
};

/** @type {Feature} */
export const presence = { name: "presence", setUp };

/**
 * @param {Page["element"]} element @param {State} state
 * @param {boolean} waits at a stopped robot: only with its chat
 */
const showBar = (element, state, waits) => {
  const drives = roleOf(state.visit) === "driver";
  const isOpen = state.panel === "volumes" || state.panel === "help";
  element("help-open").hidden = !drives;
  element("help-open").setAttribute("aria-expanded", String(state.panel === "help"));
  // A visitor who is writing keeps the field without video: otherwise the next keys would drive.
  element("presence").hidden = !waits && (!drives || !(state.playing || state.writing || isOpen));
  element("presence-volumes").hidden = waits;
  // in a study, photos belong to the task
  element("presence-photo").hidden =
    !isOffered(state, "photo") || Boolean(state.study) || !state.playing;
  // a phone has no room for this button beside the preview of the shared screen
  element("presence-knock").hidden =
    !drives || !state.robot?.knockable || state.own.shares || !mayAsk(state, "knock");
};
