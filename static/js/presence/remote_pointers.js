/**
 * Two pointers over a video, one for each side, on the drive page and on the robot's display. The
 * layer covers exactly the image, without the bars beside it. It takes presses and no keys.
 */

import { write } from "../lib/dom.js";
import { unixNow } from "../lib/clock.js";
import { RemotePointer, EVERY, Hand, frameOf, spotIn } from "./pointer_state.js";

const POLL_MS = 100; // between two checks whether to remove a pointer

/** @typedef {"driver" | "screen"} Side */

/**
 * @typedef {object} Options
 * @property {HTMLVideoElement} video
 * @property {HTMLElement} layer with a .remote-pointer of each side in it
 * @property {Side} own the side of this page
 * @property {boolean} hovers whether a mouse points without being pressed
 * @property {(pointer: {stamp: number, at: import("./pointer_state.js").Spot | null}) => void} say
 *   sends it to the other side
 * @property {() => void} [onLift] after a press
 */

export class RemotePointers {
  /** @param {Options} options */
  constructor({ video, layer, own, hovers, say, onLift = () => undefined }) {
    this.video = video;
    this.layer = layer;
    this.own = own;
    this.hovers = hovers;
    this.say = say;
    this.onLift = onLift;
    const side = (/** @type {Side} */ name) => ({
      pointer: new RemotePointer(),
      element: /** @type {HTMLElement} */ (layer.querySelector(`.remote-pointer--${name}`)),
    });
    this.sides = { driver: side("driver"), screen: side("screen") };
    this.hand = new Hand();
    this.open = false;
    /** @type {number | null} the pointer device that is pressed */
    this.pressed = null;
    /** @type {ReturnType<typeof setInterval> | undefined} while our pointer is on the video */
    this.telling = undefined;
    /** @type {ReturnType<typeof setTimeout> | undefined} while a pointer is shown */
    this.polling = undefined;
    new ResizeObserver(() => this.place()).observe(video);
    video.addEventListener("resize", () => this.place());
    this.#listen();
  }

  /** Covers the image; also called when the video moves within its element. */
  place() {
    const { video, layer } = this;
    const size = { width: video.videoWidth, height: video.videoHeight };
    const box = video.getBoundingClientRect();
    const around = /** @type {Element} */ (layer.parentElement).getBoundingClientRect();
    if (size.width && size.height && box.width) {
      const fit = getComputedStyle(video).objectFit;
      const frame = frameOf(size, box.width, box.height, fit);
      frame.left += box.left - around.left;
      frame.top += box.top - around.top;
      for (const [name, value] of Object.entries(frame)) {
        layer.style.setProperty(name, `${value}px`);
      }
    }
  }

  /**
   * Whether pointers are shown and sent from now on.
   * @param {boolean} may @param {string} name of the visitor, whose pointer has the initial
   */
  allow(may, name) {
    write(this.sides.driver.element, (Array.from(name)[0] ?? "").toUpperCase());
    if (may !== this.open) {
      this.place();
      if (!may) {
        this.pressed = null;
        this.#leave();
      }
      this.open = may;
      this.layer.toggleAttribute("data-open", may);
      this.#render();
    }
  }

  /**
   * A pointer of the other side.
   * @param {{stamp: number, by: Side, at: import("./pointer_state.js").Spot | null}} message
   */
  receive(message) {
    if (message.by !== this.own) {
      this.sides[message.by].pointer.receive(message, unixNow());
      this.#render();
    }
  }

  #listen() {
    const { layer } = this;
    layer.addEventListener("pointerdown", (event) => {
      if (this.open && this.pressed === null && event.button === 0) {
        this.pressed = event.pointerId;
        layer.setPointerCapture(this.pressed);
        this.#follow(event);
      }
    });
    layer.addEventListener("pointermove", (event) => {
      if (
        this.open &&
        (this.pressed === null
          ? this.hovers && event.pointerType !== "touch"
          : this.pressed === event.pointerId)
      ) {
        this.#follow(event);
      }
    });
    for (const name of /** @type {const} */ (["pointerup", "pointercancel"])) {
      layer.addEventListener(name, (event) => {
        if (this.pressed === event.pointerId) {
          this.pressed = null;
          this.#leave();
          this.onLift();
        }
      });
    }
    layer.addEventListener("pointerleave", () => this.pressed === null && this.#leave());
  }

  #render() {
    const now = unixNow();
    clearTimeout(this.polling);
    for (const { pointer, element } of Object.values(this.sides)) {
      const at = this.open ? pointer.at(now) : null;
      element.toggleAttribute("data-on", at !== null);
      if (at) {
        Object.assign(element.style, { left: `${100 * at[0]}%`, top: `${100 * at[1]}%` });
        this.polling = setTimeout(() => this.#render(), POLL_MS);
      }
    }
  }

  /** Sends our pointer, if there is news. */
  #tell() {
    const now = unixNow();
    const at = this.hand.take(now);
    if (at !== undefined) {
      this.sides[this.own].pointer.receive({ stamp: now, at }, now);
      this.say({ stamp: now, at });
      this.#render();
    }
  }

  /** @param {PointerEvent} event */
  #follow(event) {
    const at = spotIn(this.layer.getBoundingClientRect(), event);
    this.hand.is(at, this.pressed !== null);
    this.telling ??= setInterval(() => this.#tell(), 1000 * EVERY);
    this.#tell();
    // our own dot follows at once, not fifteen times a second
    this.sides[this.own].pointer.receive({ stamp: unixNow(), at }, unixNow());
    this.#render();
  }

  #leave() {
    clearInterval(this.telling);
    this.telling = undefined;
    this.hand.is(null);
    this.#tell();
  }
}
