/** Shows the call: its buttons and note, the visitor's own video, and the shared screen. */

import { isOffered, offersSound } from "../protocol/capabilities.js";
import { setPressed, write } from "../lib/dom.js";
import { callOf, isHeard, noteOf, previewOf } from "./call.js";
import { takesPointers } from "./call_media.js";

/** @param {Page} page @param {import("./call_media.js").CallMedia} media */
export const createCallView = ({ element, words }, media) => {
  const renderSelf = createSelfView(/** @type {HTMLVideoElement} */ (element("self")));

  /** @param {import("./call.js").Own} own @param {boolean} offered */
  const renderButtons = (own, offered) => {
    element("presence-mic").hidden = element("presence-camera").hidden = !offered;
    setPressed(element("presence-mic"), own.mic !== "off", own.mic === "asking");
    setPressed(element("presence-camera"), own.camera === "on", own.camera === "asking");
    element("presence-mic").toggleAttribute("data-sending", isHeard(own));
    element("presence-camera").toggleAttribute("data-sending", own.camera === "on");
    write(element("presence-mic-text"), words.say(micWord(own)));
    write(element("presence-camera-text"), words.say(cameraWord(own)));
    element("presence-share").hidden = !offered || !media.devices.canShare;
    write(
      element("presence-share-text"),
      words.say(own.shares ? "presence.share_off" : "presence.share"),
    );
    element("presence-hang-up").hidden = !offered || !callOf(own);
  };

  /** @param {import("./call.js").Own} own @param {string} key */
  const renderNote = (own, key) => {
    const note = element("presence-note");
    note.hidden = key === "";
    note.toggleAttribute("data-sending", isHeard(own) || own.camera === "on");
    note.toggleAttribute("data-trouble", own.trouble !== null);
    write(element("presence-note-text"), key && words.say(key));
    // an SVG has no property of that name
    element("presence-where").toggleAttribute("hidden", own.trouble?.why !== "refused");
    element("presence-again").hidden = own.trouble === null || own.trouble.why === "unsupported";
    element("presence-dismiss").hidden = own.trouble === null && !own.turnedAway;
  };

  return {
    /** @param {State} state */
    render: (state) => {
      const { own, robot } = state;
      const offered = isOffered(state, "call") && !state.slow;
      const [call, screens] = [offered ? robot?.call : null, robot?.screens ?? 0];
      renderButtons(own, offered);
      renderNote(own, offered ? noteOf(own, call, screens, state.hasScreen) : "");
      element("presence-hear").hidden = !callOf(own) || !offersSound(state);
      renderSelf(media.devices.tracks.video, own.shares);
      const { seen, points } = previewOf(own, call, screens);
      media.preview.now?.show({
        track: seen ? media.devices.tracks.video : null,
        points: points && takesPointers(state),
        name: state.room.driver ?? "",
      });
      element("volume-there-row").hidden = !isOffered(state, "call");
    },
  };
};

/** The label of the microphone's button. @param {import("./call.js").Own} own */
const micWord = ({ mic }) => {
  if (mic === "off" || mic === "asking") {
    return "presence.let_hear";
  }
  return mic === "on" ? "presence.mute" : "presence.unmute";
};

/** The label of the camera's button. @param {import("./call.js").Own} own */
const cameraWord = ({ camera, shares }) => {
  if (shares) {
    return "presence.share_off";
  }
  return camera === "on" ? "presence.camera_off" : "presence.let_see";
};

/** The visitor's own video. @param {HTMLVideoElement} self */
const createSelfView = (self) => {
  /** @type {MediaStreamTrack | null} */
  let shown = null;
  return (/** @type {MediaStreamTrack | null} */ track, /** @type {boolean} */ shares) => {
    self.hidden = track === null || shares;
    if (track !== shown) {
      shown = track;
      self.srcObject = track && new MediaStream([track]);
    }
  };
};
