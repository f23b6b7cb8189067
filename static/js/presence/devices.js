/**
 * Microphone, camera and screen of the visitor: asked for one at a time and only on a click, given
 * back when they are not wanted.
 */

const WANTED = {
  audio: { audio: { echoCancellation: true, noiseSuppression: true, autoGainControl: true } },
  video: {
    video: {
      width: { ideal: 640 },
      height: { ideal: 480 },
      frameRate: { ideal: 24, max: 30 },
      facingMode: "user",
    },
  },
};

const SCREEN = {
  video: { width: { max: 1280 }, height: { max: 720 }, frameRate: { max: 10 } },
  audio: false,
}; // sharp rather than smooth

/** @typedef {"audio" | "video"} Kind */
/** @typedef {"refused" | "missing" | "busy" | "unsupported"} Trouble */

/**
 * Why a browser did not give a device, by the name of its error.
 * @param {string} name @returns {Trouble}
 */
export const troubleOf = (name) => {
  if (name === "NotAllowedError" || name === "SecurityError" || name === "PermissionDeniedError") {
    return "refused";
  }
  if (
    name === "NotFoundError" ||
    name === "OverconstrainedError" ||
    name === "DevicesNotFoundError"
  ) {
    return "missing";
  }
  return name === "TypeError" ? "unsupported" : "busy";
};

export class Devices {
  /**
   * @param {object} options
   * @param {(kind: Kind) => void} options.onLost the device was unplugged, or the browser took it
   *   back
   * @param {MediaDevices | undefined} [options.media]
   */
  constructor({ onLost, media = globalThis.navigator?.mediaDevices }) {
    this.onLost = onLost;
    this.media = media;
    /** @type {Record<Kind, MediaStreamTrack | null>} */
    this.tracks = { audio: null, video: null };
  }

  /** @param {Kind} kind @returns {Promise<Trouble | null>} null when it is there */
  async open(kind) {
    if (!this.media?.getUserMedia) {
      return "unsupported"; // browsers give devices to safe (https) pages only
    }
    if (this.tracks[kind]) {
      return null;
    }
    try {
      this.#take(kind, await this.media.getUserMedia(WANTED[kind]));
      return null;
    } catch (error) {
      if (error instanceof Error || error instanceof DOMException) {
        return troubleOf(error.name);
      }
      throw error;
    }
  }

  /** Whether this browser can show others a screen, a window or a tab; those of phones cannot. */
  get canShare() {
    return Boolean(this.media?.getDisplayMedia);
  }

  /**
   * Have the visitor choose what to show, in place of the camera.
   * @returns {Promise<boolean>} false when they would rather not
   */
  async share() {
    try {
      const stream = await /** @type {MediaDevices} */ (this.media).getDisplayMedia(SCREEN);
      this.close("video");
      this.#take("video", stream);
      /** @type {MediaStreamTrack} */ (this.tracks.video).contentHint = "text";
      return true;
    } catch (error) {
      if (error instanceof Error || error instanceof DOMException) {
        return false;
      }
      throw error;
    }
  }

  /** @param {Kind} kind @param {MediaStream} stream of one track */
  #take(kind, stream) {
    const [track] = stream.getTracks();
    track.addEventListener("ended", () => {
      if (this.tracks[kind] === track) {
        this.tracks[kind] = null;
        this.onLost(kind);
      }
    });
    this.tracks[kind] = track;
  }

  /** @param {Kind} kind */
  close(kind) {
    const track = this.tracks[kind];
    this.tracks[kind] = null; // first, so that its end is no loss
    track?.stop();
  }
}
