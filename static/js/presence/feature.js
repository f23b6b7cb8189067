/**
 * Being there, on the drive page: voice and face to the robot, words both ways, the head, and photos to keep. console.js calls it; what to
 * do is decided in the pure modules beside it. Nothing here is needed to drive, and whatever fails leaves driving as it is.
 *
 * Longer than most files, because it wires seven buttons, two fields and two devices.
 */

import { roleOf } from "../protocol/session.js";
import { write } from "../view/hud/card_panel.js";
import { can } from "../autonomy/offer.js";
import { unixNow } from "../lib/clock.js";
import { lazy } from "../lib/lazy.js";
import { freshId } from "../lib/ids.js";
import { ask, heard, pass } from "../autonomy/robot_action.js";
import { Snapshots } from "../study/snapshots.js";
import { Devices } from "./devices.js";
import { lineOf } from "./message_line.js";
import { AGAIN_SECONDS, callOf, isHeard, mustSay, newOwn, noteOf, previewOf } from "./call.js";
import { TalkKey } from "./push_to_talk.js";
import { Tilting, stepOf } from "./tilt.js";

const MOST_LINES = 50;
const VIDEO_BITRATE = 600_000; // bit/s: driving comes first

/**
 * @param {object} page
 * @param {ReturnType<typeof import("../drive/store.js").createStore>} page.store
 * @param {any} page.config of the page
 * @param {import("../lib/words.js").Words} page.words
 * @param {(id: string) => HTMLElement} page.element
 * @param {import("../input/key_dispatcher.js").KeyDispatcher} page.keys
 * @param {(type: string, data?: Record<string, string | number | boolean | null>) => boolean} page.report
 * @param {(order: import("../autonomy/robot_action.js").Task) => void} page.sendAction
 * @param {(dot: {stamp: number, at: [number, number] | null}) => void} page.sendPoint
 */
export const createPresence = ({ store, config, words, element, keys, report, sendAction, sendPoint }) => {
  const button = (/** @type {string} */ id) => /** @type {HTMLButtonElement} */ (element(id));
  const input = (/** @type {string} */ id) => /** @type {HTMLInputElement} */ (element(id));
  const self = /** @type {HTMLVideoElement} */ (element("self"));
  const tilting = new Tilting();
  let own = newOwn();
  /** @type {MediaStreamTrack | null} what stands in the small mirror */
  let mirrored = null;
  let saidAt = -Infinity;
  let open = ""; // the panel that is open: talk, volumes or none
  let writing = false; // whether the field of the talk panel is open, which takes the keys
  let unread = 0;
  let session = "";
  /** @type {import("../autonomy/robot_action.js").Task | null} */
  let photo = null;
  let photoFound = "";
  /** @type {import("../protocol/peer.js").Peer | null} */
  let peer = null;

  const devices = new Devices({
    onLost: (kind) => {
      // Who ends the sharing by the browser's own button has not lost anything.
      const trouble = own.shares && kind === "video" ? null : { kind, why: /** @type {const} */ ("missing") };
      change({ ...(kind === "audio" ? { mic: "off" } : { camera: "off", shares: false }), trouble });
    },
  });

  const snapshots = new Snapshots({
    list: config.snapshots,
    onFound: (_, url) => {
      photoFound = url;
      store.update({});
    },
  });

  /** @param {Partial<import("./call.js").Own>} changes */
  const change = (changes) => {
    own = { ...own, ...changes };
    if (devices.tracks.audio) {
      devices.tracks.audio.enabled = isHeard(own);
    }
    attach();
    store.update({});
  };

  // --- voice and face ------------------------------------------------------------------------------------------------

  /** Give the connection what there is to send; it has had the lines for it since its offer. */
  const attach = () => {
    if (peer?.role !== "driver" || peer.isClosed) {
      return;
    }
    void replace(peer.lines[0].sender, devices.tracks.audio);
    void replace(peer.lines[2].sender, devices.tracks.video);
  };

  /** @param {"audio" | "video"} kind */
  const begin = async (kind) => {
    const name = kind === "audio" ? "mic" : "camera";
    change({ [name]: "asking", trouble: null, turnedAway: false });
    const why = await devices.open(kind);
    report(kind === "audio" ? "microphone" : "camera", { on: why === null, why: why ?? "" });
    if (why !== null) {
      change({ [name]: "off", talking: false, trouble: { kind, why } });
    } else if (roleOf(store.get().visit) !== "driver") {
      devices.close(kind); // the visit has ended while the browser asked
      change({ [name]: "off" });
    } else {
      change({ [name]: kind === "audio" && talkKey.pressed ? "muted" : "on", talking: talkKey.pressed });
    }
  };

  /** @param {"audio" | "video"} kind */
  const end = (kind) => {
    devices.close(kind);
    change(kind === "audio" ? { mic: "off", talking: false } : { camera: "off", shares: false });
    report(kind === "audio" ? "microphone" : "camera", { on: false, why: "" });
  };

  const fetchPreview = lazy(async () => (await import("./screen_preview.js")).createPreview({ element, sendPoint, backToDriving }));
  /** @type {ReturnType<typeof import("./screen_preview.js").createPreview> | null} of the screen that is shown; without it it is shown all the same */
  let preview = null;

  /** Show them a screen, a window or a tab. Whoever would rather not leaves things as they are. */
  const share = async () => {
    if (!(await devices.share())) {
      return;
    }
    fetchPreview((it) => {
      preview = it;
      store.update({});
    });
    report("screen_shared", { on: true });
    if (roleOf(store.get().visit) === "driver") {
      change({ camera: "on", shares: true, trouble: null, turnedAway: false });
    } else {
      devices.close("video"); // the visit has ended while they chose
    }
  };

  const endAll = () => {
    devices.close("audio");
    devices.close("video");
    own = { ...newOwn(), volume: own.volume };
  };

  const talkKey = new TalkKey({
    keys: keys,
    onTalk: (down) => {
      if (!isOffered(store.get(), "call")) {
        return;
      }
      if (down && own.mic === "off") {
        void begin("audio");
      } else {
        change({ talking: down && own.mic === "muted" });
      }
    },
  });

  /** @param {import("../drive/store.js").State} state @param {string} capability */
  const isOffered = (state, capability) => roleOf(state.visit) === "driver" && can(state, capability);

  const takesDots = () => Boolean(store.get().factsheet?.capabilities?.includes("point"));

  /** @param {number} now */
  const sayCall = (now) => {
    const { robot } = store.get();
    const known = robot?.call ?? null;
    if (known?.status === "declined" && callOf(own) && now - saidAt > AGAIN_SECONDS / 2) {
      endAll();
      change({ turnedAway: true });
    }
    if (robot && isOffered(store.get(), "call") && mustSay(own, known, takesDots()) && now - saidAt > AGAIN_SECONDS) {
      saidAt = now;
      sendAction(ask({ type: "call", ...(callOf(own) ?? { ringing: false }) }, freshId("call-"), now));
    }
  };

  // --- words ---------------------------------------------------------------------------------------------------------

  /** Open a panel, at once: the visitor's next key goes to what they have opened. @param {string} panel @param {boolean} [writes] */
  const show = (panel, writes = false) => {
    [open, writing] = [panel, writes];
    unread = open === "talk" ? 0 : unread;
    store.update({});
    store.flush();
  };

  const toggleWriting = () => {
    show(writing ? "" : "talk", !writing);
    if (writing) {
      input("talk-field").focus({ preventScroll: true });
    } else {
      backToDriving();
    }
  };

  const backToDriving = () => element("viewport").focus({ preventScroll: true });
  const closePanel = () => {
    show("");
    backToDriving();
  };
  keys.closes(element("talk"), closePanel, () => show("talk"));
  keys.closes(element("volumes"), closePanel, () => show(""));

  element("talk-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const field = input("talk-field");
    const text = field.value.trim().slice(0, 500);
    if (text) {
      sendAction(ask({ type: "say", text, aloud: input("talk-aloud").checked, language: document.documentElement.lang }, freshId("say-"), unixNow()));
      field.value = "";
    }
    show("talk"); // what was said, and what is answered, stays in sight
    backToDriving();
  });

  // --- the head ------------------------------------------------------------------------------------------------------

  /** @param {number} angle rad */
  const tiltTo = (angle) => {
    const { factsheet } = store.get();
    if (factsheet?.tilt && isOffered(store.get(), "tilt")) {
      tilting.want(angle, factsheet.tilt);
      store.update({});
    }
  };

  input("tilt-slider").addEventListener("input", () => tiltTo(Number(input("tilt-slider").value)));
  input("tilt-slider").addEventListener("pointerup", backToDriving); // the arrows are to drive again, and not to nod
  keys.add({
    down: (event) => {
      const step = stepOf(event);
      const { robot, factsheet } = store.get();
      if (step !== 0 && factsheet?.tilt) {
        tiltTo((tilting.shown(robot?.tilt ?? null, unixNow()) ?? factsheet.tilt.home) + step);
      }
    },
  });

  // --- photos --------------------------------------------------------------------------------------------------------

  const takePhoto = () => {
    if (photo === null || photo.endedAt !== null) {
      photoFound = "";
      photo = ask({ type: "photo" }, freshId("photo-"), unixNow());
      sendAction(photo);
    }
  };

  const closePhoto = () => {
    photo = null;
    photoFound = "";
    snapshots.want("");
  };

  // --- buttons -------------------------------------------------------------------------------------------------------

  /** @type {Record<string, () => void>} */
  const clicks = {
    "presence-mic": () => (own.mic === "off" ? void begin("audio") : change({ mic: own.mic === "on" ? "muted" : "on", talking: false })),
    "presence-camera": () => (own.camera === "off" ? void begin("video") : end("video")),
    "presence-share": () => (own.shares ? end("video") : void share()),
    "presence-talk": toggleWriting,
    "presence-volumes": () => {
      show(open === "volumes" ? "" : "volumes");
      element("volumes").focus({ preventScroll: true }); // not the button, which the space bar would press again
    },
    "presence-photo": takePhoto,
    "presence-hang-up": () => {
      end("audio");
      end("video");
    },
    "presence-again": () => own.trouble && void begin(own.trouble.kind),
    "presence-dismiss": () => change({ trouble: null, turnedAway: false }),
    "kept-close": closePhoto,
  };
  for (const [id, click] of Object.entries(clicks)) {
    button(id).addEventListener("click", () => {
      click();
      store.update({});
      if (!keys.taken) {
        backToDriving(); // the space bar is to stop the robot, not to press this again
      }
    });
  }
  input("volume-there").addEventListener("input", () => change({ volume: Number(input("volume-there").value) / 100 }));
  input("volume-here").addEventListener("input", () => {
    /** @type {HTMLAudioElement} */ (element("audio")).volume = Number(input("volume-here").value) / 100;
  });

  // --- what is seen --------------------------------------------------------------------------------------------------

  /** @param {import("../drive/store.js").State} state */
  const showSending = (state) => {
    const offered = isOffered(state, "call") && !state.slow;
    button("presence-mic").hidden = button("presence-camera").hidden = !offered;
    const heardNow = isHeard(own);
    press(button("presence-mic"), own.mic !== "off", own.mic === "asking");
    press(button("presence-camera"), own.camera === "on", own.camera === "asking");
    button("presence-mic").toggleAttribute("data-sending", heardNow);
    button("presence-camera").toggleAttribute("data-sending", own.camera === "on");
    write(element("presence-mic-text"), words.say(own.mic === "off" || own.mic === "asking" ? "presence.let_hear" : own.mic === "on" ? "presence.mute" : "presence.unmute"));
    write(element("presence-camera-text"), words.say(own.shares ? "presence.share_off" : own.camera === "on" ? "presence.camera_off" : "presence.let_see"));
    button("presence-share").hidden = !offered || !devices.canShare;
    write(element("presence-share-text"), words.say(own.shares ? "presence.share_off" : "presence.share"));
    button("presence-hang-up").hidden = !offered || !callOf(own);
    const key = offered ? noteOf(own, state.robot?.call ?? null, state.robot?.screens ?? 0) : "";
    const note = element("presence-note");
    note.hidden = key === "";
    note.toggleAttribute("data-sending", heardNow || own.camera === "on");
    note.toggleAttribute("data-trouble", own.trouble !== null);
    write(element("presence-note-text"), key && words.say(key));
    element("presence-where").toggleAttribute("hidden", own.trouble?.why !== "refused"); // an SVG has no property of that name
    button("presence-again").hidden = own.trouble === null || own.trouble.why === "unsupported";
    button("presence-dismiss").hidden = own.trouble === null && !own.turnedAway;
    showSelf();
    const { seen, points } = previewOf(own, offered ? state.robot?.call : null, state.robot?.screens ?? 0);
    preview?.show({ track: seen ? devices.tracks.video : null, points: points && takesDots(), name: state.room.driver ?? "" });
  };

  const showSelf = () => {
    const track = devices.tracks.video;
    self.hidden = track === null || own.shares;
    if (track !== mirrored) {
      mirrored = track;
      self.srcObject = track && new MediaStream([track]);
    }
  };

  /** @param {import("../drive/store.js").State} state */
  const showWords = (state) => {
    const offered = isOffered(state, "say");
    button("presence-talk").hidden = !offered;
    open = offered || open !== "talk" ? open : "";
    writing &&= open === "talk";
    element("talk").hidden = open !== "talk" || (!writing && element("talk-list").childElementCount === 0);
    element("talk").toggleAttribute("data-holds-keys", writing);
    element("talk-writing").hidden = !writing;
    element("volumes").hidden = open !== "volumes";
    press(button("presence-talk"), writing, false);
    press(button("presence-volumes"), open === "volumes", false);
    element("unread").hidden = unread === 0;
    write(element("unread"), String(unread));
    element("volume-there-row").hidden = !isOffered(state, "call");
  };

  /** @param {import("../drive/store.js").State} state */
  const showHead = (state) => {
    const range = isOffered(state, "tilt") && state.playing ? state.factsheet.tilt : null;
    element("tilt").hidden = !range;
    if (range) {
      const slider = input("tilt-slider");
      Object.assign(slider, { min: String(range.minimum), max: String(range.maximum), step: "0.01" });
      const shown = tilting.shown(state.robot?.tilt ?? null, unixNow());
      if (shown !== null && Math.abs(Number(slider.value) - shown) > 0.005) {
        slider.value = String(shown);
      }
    }
  };

  /** @param {import("../drive/store.js").State} state */
  const showPhoto = (state) => {
    // In a study its photos belong to the task.
    button("presence-photo").hidden = !isOffered(state, "photo") || Boolean(state.study) || !state.playing;
    const done = photo?.status === "FINISHED" || photoFound !== "";
    element("kept").hidden = photo === null;
    const key = !photo ? "" : photo.status === "FAILED" ? "kept.failed" : photoFound ? "kept.here" : done ? "kept.coming" : "kept.taking";
    write(element("kept-text"), key && words.say(key));
    const image = /** @type {HTMLImageElement} */ (element("kept-picture"));
    const link = /** @type {HTMLAnchorElement} */ (element("kept-download"));
    image.hidden = link.hidden = photoFound === "";
    if (photoFound && image.getAttribute("src") !== photoFound) {
      image.src = link.href = photoFound;
      link.download = `${config.robot}.jpg`;
    }
  };

  return {
    /** @param {import("../protocol/peer.js").Peer} next that is about to offer */
    opening: (next) => {
      peer = next;
      attach();
    },
    /** @param {{by: string, who: string, text: string}} message */
    said: ({ by, who, text }) => {
      const list = element("talk-list");
      const mine = by === "driver";
      list.append(lineOf({ who: mine ? words.say("presence.you") : who || words.say("presence.they"), text, own: mine }));
      while (list.children.length > MOST_LINES) {
        list.firstElementChild?.remove();
      }
      if (!mine && open !== "talk") {
        unread += 1;
        // What somebody says there is worth seeing at once; the keys go on driving, or stay with the menu that has them.
        open ||= "talk";
      }
      unread = open === "talk" ? 0 : unread;
      store.update({});
      store.flush(); // what is hidden cannot be scrolled
      list.scrollTop = list.scrollHeight;
    },
    /** @param {any} message where somebody there points */
    pointed: (message) => preview?.pointed(message),
    /** @param {Parameters<typeof heard>[1]} message */
    action: (message) => {
      if (photo?.id === message.actionId) {
        photo = heard(photo, message, unixNow());
        if (photo?.status === "FINISHED") {
          snapshots.want(photo.id);
        }
      }
    },
    /** @param {import("../drive/store.js").State} state */
    show: (state) => {
      const { visit } = state;
      if (roleOf(visit) !== "driver" && (callOf(own) || open || photo)) {
        endAll();
        [open, writing] = ["", false];
        closePhoto();
      }
      if (visit.session && visit.session !== session) {
        session = visit.session;
        element("talk-list").replaceChildren();
      }
      // Who writes goes on writing while the picture is away: a field that goes would leave the next letters to the robot.
      element("presence").hidden = roleOf(visit) !== "driver" || !(state.playing || writing || open === "volumes");
      showSending(state);
      showWords(state);
      showHead(state);
      showPhoto(state);
    },
    /** @param {number} now */
    tick: (now) => {
      sayCall(now);
      const angle = tilting.take(now);
      if (angle !== null) {
        sendAction(ask({ type: "tilt", angle }, freshId("tilt-"), now));
      }
      const next = photo?.status === "ASKED" ? pass(photo, now) : { task: photo, send: false };
      if (next.send && next.task) {
        sendAction(next.task);
      }
      photo = next.task;
    },
  };
};

/** @param {RTCRtpSender} sender @param {MediaStreamTrack | null} track */
const replace = async (sender, track) => {
  if (sender.track === track) {
    return;
  }
  try {
    await sender.replaceTrack(track);
    const parameters = sender.getParameters();
    if (track?.kind === "video" && parameters.encodings?.length) {
      parameters.encodings[0].maxBitrate = VIDEO_BITRATE;
      await sender.setParameters(parameters);
    }
  } catch (error) {
    if (!(error instanceof DOMException)) {
      throw error; // a DOMException says that this connection is over: the next one is given the track again
    }
  }
};

/** @param {HTMLButtonElement} button @param {boolean} pressed @param {boolean} busy */
const press = (button, pressed, busy) => {
  button.setAttribute("aria-pressed", String(pressed));
  button.disabled = busy;
};
