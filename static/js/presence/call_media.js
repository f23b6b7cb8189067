/** The visitor's voice and video: devices, transceivers of the connection, and the request. */

import { isOffered } from "../protocol/capabilities.js";
import { ask } from "../protocol/robot_action.js";
import { backToDriving } from "../lib/dom.js";
import { freshId } from "../lib/ids.js";
import { lazy } from "../lib/lazy.js";
import { roleOf } from "../protocol/session.js";
import { AGAIN_SECONDS, callOf, isHeard, mustSay, newOwn } from "./call.js";
import { Devices } from "./devices.js";
import { PushToTalk } from "./push_to_talk.js";

const VIDEO_BITRATE = 600_000; // bit/s: driving comes first
const LINES = { audio: 0, video: 2 }; // of a peer: protocol/peer.js

export class CallMedia {
  /** @param {Page} page */
  constructor(page) {
    this.page = page;
    this.store = page.store;
    this.saidAt = -Infinity;
    /** @type {Peer | null} */
    this.peer = null;
    this.devices = new Devices({ onLost: (kind) => this.#lost(kind) });
    this.talkKey = new PushToTalk((down) => this.#talk(down));
    const { element, driving } = page;
    /** of the screen that is shown, which does not need it */
    this.preview = lazy(async () =>
      (await import("./screen_preview.js")).createPreview({
        element,
        sendPointer: driving.sendPointer,
        backToDriving: () => backToDriving(element),
      }),
    );
    const volume = /** @type {HTMLInputElement} */ (element("volume-there"));
    volume.addEventListener("input", () => this.change({ volume: Number(volume.value) / 100 }));
  }

  get own() {
    return /** @type {import("./call.js").Own} */ (this.store.get().own);
  }

  /** By the id of the button. @returns {Record<string, () => void>} */
  get clicks() {
    return {
      "presence-mic": () =>
        this.own.mic === "off"
          ? void this.#begin("audio")
          : this.change({ mic: this.own.mic === "on" ? "muted" : "on", talking: false }),
      "presence-camera": () =>
        this.own.camera === "off" ? void this.#begin("video") : this.#end("video"),
      "presence-share": () => (this.own.shares ? this.#end("video") : void this.#share()),
      "presence-hang-up": () => {
        this.#end("audio");
        this.#end("video");
      },
      "presence-again": () => this.own.trouble && void this.#begin(this.own.trouble.kind),
      "presence-dismiss": () => this.change({ trouble: null, turnedAway: false }),
    };
  }

  /** @param {Partial<import("./call.js").Own>} changes */
  change(changes) {
    this.store.update({ own: { ...this.own, ...changes } });
    if (this.devices.tracks.audio) {
      this.devices.tracks.audio.enabled = isHeard(this.own);
    }
    this.#attach();
  }

  endAll() {
    this.devices.close("audio");
    this.devices.close("video");
    this.store.update({ own: { ...newOwn(), volume: this.own.volume } });
  }

  /** @param {Peer} peer that is about to offer */
  attachTo(peer) {
    this.peer = peer;
    this.#attach();
  }

  /** Requests the call until the robot's state has it. @param {number} now */
  poll(now) {
    const state = this.store.get();
    const known = state.robot?.call ?? null;
    if (known?.status === "declined" && callOf(this.own) && now - this.saidAt > AGAIN_SECONDS / 2) {
      this.endAll();
      this.change({ turnedAway: true });
    }
    if (
      state.robot &&
      isOffered(state, "call") &&
      mustSay(this.own, known, takesPointers(state)) &&
      now - this.saidAt > AGAIN_SECONDS
    ) {
      this.saidAt = now;
      this.page.driving.sendAction(
        ask({ type: "call", ...(callOf(this.own) ?? { ringing: false }) }, freshId("call-"), now),
      );
    }
  }

  /** Sends the tracks; the connection has had their transceivers since its offer. */
  #attach() {
    if (this.peer?.role === "driver" && !this.peer.isClosed) {
      for (const kind of /** @type {const} */ (["audio", "video"])) {
        void replace(this.peer.lines[LINES[kind]].sender, this.devices.tracks[kind]);
      }
    }
  }

  /** @param {"audio" | "video"} kind */
  async #begin(kind) {
    const name = kind === "audio" ? "mic" : "camera";
    this.change({ [name]: "asking", trouble: null, turnedAway: false });
    const why = await this.devices.open(kind);
    this.page.connection.report(kind === "audio" ? "microphone" : "camera", {
      on: why === null,
      why: why ?? "",
    });
    if (why !== null) {
      this.change({ [name]: "off", talking: false, trouble: { kind, why } });
    } else if (roleOf(this.store.get().visit) !== "driver") {
      this.devices.close(kind); // the session has ended while the browser asked for permission
      this.change({ [name]: "off" });
    } else {
      this.change({
        [name]: kind === "audio" && this.talkKey.pressed ? "muted" : "on",
        talking: this.talkKey.pressed,
      });
    }
  }

  /** @param {"audio" | "video"} kind */
  #end(kind) {
    this.devices.close(kind);
    this.change(
      kind === "audio" ? { mic: "off", talking: false } : { camera: "off", shares: false },
    );
    this.page.connection.report(kind === "audio" ? "microphone" : "camera", { on: false, why: "" });
  }

  /** Shares a screen, a window or a tab. Cancelling changes nothing. */
  async #share() {
    if (!(await this.devices.share())) {
      return;
    }
    this.preview(() => this.store.update({}));
    this.page.connection.report("screen_shared", { on: true });
    if (roleOf(this.store.get().visit) === "driver") {
      this.change({ camera: "on", shares: true, trouble: null, turnedAway: false });
    } else {
      this.devices.close("video"); // the session has ended
    }
  }

  /** @param {boolean} down */
  #talk(down) {
    if (!isOffered(this.store.get(), "call")) {
      return;
    }
    if (down && this.own.mic === "off") {
      void this.#begin("audio");
    } else {
      this.change({ talking: down && this.own.mic === "muted" });
    }
  }

  /**
   * A device was unplugged, or the browser's own button has ended sharing, which is no trouble.
   * @param {"audio" | "video"} kind
   */
  #lost(kind) {
    const trouble =
      this.own.shares && kind === "video" ? null : { kind, why: /** @type {const} */ ("missing") };
    this.change({
      ...(kind === "audio" ? { mic: "off" } : { camera: "off", shares: false }),
      trouble,
    });
  }
}

/** @param {State} state */
export const takesPointers = ({ factsheet }) => Boolean(factsheet?.capabilities?.includes("point"));

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
    // a DOMException means that this connection has closed: the next one gets the track again
    if (!(error instanceof DOMException)) {
      throw error;
    }
  }
};
