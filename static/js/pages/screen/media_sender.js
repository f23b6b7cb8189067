/**
 * Sends the display's camera and microphone, in place of the robot's, where the robot's answer asks
 * for them. The page was allowed to use them when the display was set up; if the browser refuses,
 * the page says so and tries again.
 */

/** @typedef {import("../../presence/devices.js").Kind} Kind */

const AGAIN = 5; // s
/** The line of a peer for each; see protocol/peer.js. @type {Record<Kind, number>} */
const LINES = { audio: 0, video: 2 };

/** @param {RTCRtpTransceiver | undefined} line */
const isWanted = (line) =>
  line?.currentDirection === "sendrecv" || line?.currentDirection === "sendonly";

export class MediaSender {
  /**
   * @param {object} options
   * @param {Pick<import("../../presence/devices.js").Devices, "open" | "close" | "tracks">}
   *   options.devices
   * @param {() => void} options.onChange
   * @param {(again: () => void, seconds: number) => void} [options.later]
   */
  constructor({
    devices,
    onChange,
    later = (again, seconds) => void setTimeout(again, 1000 * seconds),
  }) {
    this.devices = devices;
    this.onChange = onChange;
    this.later = later;
    /** @type {Record<Kind, string>} why it is not sent although it is wanted, or "" */
    this.troubles = { audio: "", video: "" };
    /** @type {{lines: RTCRtpTransceiver[], isClosed: boolean} | null} */
    this.peer = null;
  }

  /** Why something is missing, or "". */
  get trouble() {
    return this.troubles.video || this.troubles.audio;
  }

  /**
   * Sends what a new connection wants.
   * @param {{lines: RTCRtpTransceiver[], isClosed: boolean}} peer
   */
  async to(peer) {
    this.peer = peer;
    for (const kind of /** @type {Kind[]} */ (["audio", "video"])) {
      await this.#give(kind, peer);
    }
  }

  /** A device was unplugged. @param {Kind} kind */
  lost(kind) {
    if (this.peer) {
      void this.#give(kind, this.peer);
    }
  }

  /** @param {Kind} kind @param {{lines: RTCRtpTransceiver[], isClosed: boolean}} peer */
  async #give(kind, peer) {
    const line = peer.lines[LINES[kind]];
    if (peer !== this.peer || peer.isClosed) {
      return;
    }
    if (!isWanted(line)) {
      this.devices.close(kind);
      this.troubles[kind] = "";
      return;
    }
    this.troubles[kind] = (await this.devices.open(kind)) ?? "";
    if (this.troubles[kind]) {
      this.later(() => void this.#give(kind, peer), AGAIN);
    } else if (!peer.isClosed) {
      await line.sender.replaceTrack(this.devices.tracks[kind]);
    }
    this.onChange();
  }
}
