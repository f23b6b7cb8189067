/**
 * The visitor's microphone, camera and screen: requested one at a time and only on a click, and
 * released when they are not used.
 */

const [width, height] = [{ ideal: 640 }, { ideal: 480 }];
const frameRate = { ideal: 24, max: 30 };
const WANTED = {
  audio: { audio: { echoCancellation: true, noiseSuppression: true, autoGainControl: true } },
  video: { video: { width, height, frameRate, facingMode: "user" } },
};
// sharp rather than smooth
const SHARP = { width: { max: 1280 }, height: { max: 720 }, frameRate: { max: 10 } };

/** By the name of the browser's error. @type {Record<string, Trouble>} */
const TROUBLES = {
  NotAllowedError: "refused",
  SecurityError: "refused",
  PermissionDeniedError: "refused",
  NotFoundError: "missing",
  OverconstrainedError: "missing",
  DevicesNotFoundError: "missing",
  TypeError: "unsupported",
};

/** @typedef {"audio" | "video"} Kind */
/** @typedef {"refused" | "missing" | "busy" | "unsupported"} Trouble */

/** Why a browser did not give a device. @param {string} name of its error @returns {Trouble} */
export const troubleOf = (name) => TROUBLES[name] ?? "busy";

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

  /** @param {Kind} kind @returns {Promise<Trouble | null>} null when it is open */
  async open(kind) {
    if (!this.media?.getUserMedia) {
      return "unsupported"; // browsers give devices to secure (https) pages only
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

  /** Whether this browser can share a screen, which phones cannot. */
  get canShare() {
    return Boolean(this.media?.getDisplayMedia);
  }

  /** Has the visitor choose a screen, in place of the camera. @returns {Promise<boolean>} */
  async share() {
    try {
      const stream = await /** @type {MediaDevices} */ (this.media).getDisplayMedia({
        video: SHARP,
        audio: false,
      });
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
