/**
 * The robot's video and sound. While a link is down the last frame stays, marked as frozen, until
 * the first one of the next link, or is covered by frames through the server.
 */

export class Viewport {
  /**
   * @param {object} options @param {HTMLVideoElement} options.video
   * @param {HTMLAudioElement} options.audio
   * @param {HTMLCanvasElement} options.still the last frame, over the video while it is frozen
   * @param {HTMLCanvasElement} options.slow the frame through the server, over both
   * @param {(rtp: number) => void} options.onFrame RTP timestamp of each frame as it is shown
   * @param {() => void} options.onPlaying at the first frame of a stream
   */
  constructor({ video, audio, still, slow, onFrame, onPlaying }) {
    this.video = video;
    this.audio = audio;
    this.still = still;
    this.slow = slow;
    this.onFrame = onFrame;
    this.onPlaying = onPlaying;
    /** @type {RTCRtpReceiver | null} */
    this.receiver = null;
    this.waiting = false;
    this.frames = 0;
    this.#follow();
  }

  /** @param {RTCRtpReceiver} video @param {RTCRtpReceiver} audio */
  attach(video, audio) {
    this.receiver = video;
    this.waiting = true;
    this.video.srcObject = new MediaStream([video.track]);
    this.audio.srcObject = new MediaStream([audio.track]);
    this.#play(this.video);
    this.#play(this.audio);
  }

  /** Keeps the last frame, marked as old. */
  freeze() {
    if (this.video.videoWidth && this.still.hidden) {
      this.still.width = this.video.videoWidth;
      this.still.height = this.video.videoHeight;
      this.still.getContext("2d")?.drawImage(this.video, 0, 0);
      this.still.hidden = false;
    }
  }

  /** Whether a frame of the present link has been shown. */
  get isPlaying() {
    return this.receiver !== null && !this.waiting;
  }

  /**
   * Shows a frame that came through the server.
   * @param {Uint8Array} jpeg @param {() => boolean} isWanted called when it is decoded
   * @returns {Promise<boolean>} whether it is shown
   */
  async showSlow(jpeg, isWanted) {
    let bitmap;
    try {
      const blob = new Blob([/** @type {any} */ (jpeg)], { type: "image/jpeg" });
      bitmap = await createImageBitmap(blob);
    } catch (error) {
      if (error instanceof DOMException) {
        return false;
      }
      throw error;
    }
    const wanted = isWanted();
    if (wanted) {
      this.slow.width = bitmap.width;
      this.slow.height = bitmap.height;
      this.slow.getContext("2d")?.drawImage(bitmap, 0, 0);
      this.slow.hidden = false;
    }
    bitmap.close();
    return wanted;
  }

  /** Of the frame on the screen, in its own pixels. @returns {[number, number]} */
  get size() {
    return this.slow.hidden
      ? [this.video.videoWidth, this.video.videoHeight]
      : [this.slow.width, this.slow.height];
  }

  /** Removes the frames through the server. */
  hideSlow() {
    this.slow.hidden = true;
  }

  /** The session has ended. */
  clear() {
    this.slow.hidden = true;
    this.receiver = null;
    this.waiting = false;
    this.video.srcObject = null;
    this.audio.srcObject = null;
    this.still.hidden = true;
  }

  /** @param {boolean} on */
  setSound(on) {
    this.audio.muted = !on;
    if (on) {
      this.#play(this.audio);
    }
  }

  #follow() {
    if ("requestVideoFrameCallback" in this.video) {
      /** @type {VideoFrameRequestCallback} */
      const callback = (_now, { rtpTimestamp }) => {
        this.#shown(rtpTimestamp ?? this.#lastRendered());
        this.video.requestVideoFrameCallback(callback);
      };
      this.video.requestVideoFrameCallback(callback);
    } else {
      /** @type {HTMLVideoElement} */ (this.video).addEventListener("timeupdate", () =>
        this.#shown(this.#lastRendered()),
      );
    }
  }

  /** @param {number | undefined} rtp */
  #shown(rtp) {
    this.frames += 1;
    if (rtp !== undefined) {
      this.onFrame(rtp);
    }
    if (this.waiting) {
      this.waiting = false;
      this.still.hidden = true;
      this.onPlaying();
    }
  }

  /** The timestamp of the newest packet, in browsers that do not report that of the frame. */
  #lastRendered() {
    return this.receiver?.getSynchronizationSources?.()[0]?.rtpTimestamp;
  }

  /** @param {HTMLMediaElement} element */
  #play(element) {
    // Sound waits for the visitor's click, and a replaced stream aborts: neither is an error.
    element.play().catch(() => undefined);
  }
}
