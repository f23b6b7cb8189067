/**
 * Two dots over a video, one of each side, and the hand that draws one of them: what the drive page and the robot's own display have in
 * common. The layer stands in the element that the video fills, and is laid just over the picture, without the bars beside it, so that a
 * share of the layer is a share of the picture.
 *
 * It takes presses and nothing else: who cannot point has words and voice, and no key leads here that would have to lead out again.
 */

import { write } from "../lib/dom.js";
import { unixNow } from "../lib/clock.js";
import { RemotePointer, EVERY, Hand, frameOf, spotIn } from "./pointer_state.js";

const LOOK = 100; // ms between two looks at whether a dot is to go

/** @typedef {"driver" | "screen"} Side */

/**
 * @param {object} options
 * @param {HTMLVideoElement} options.video
 * @param {HTMLElement} options.layer with a .dot of each side in it
 * @param {Side} options.own whose hand this is
 * @param {boolean} options.hovers whether a mouse points without being pressed
 * @param {(dot: {stamp: number, at: import("./pointer_state.js").Spot | null}) => void} options.say tell the other side
 * @param {() => void} [options.onLift] a press is over
 */
export const createRemotePointers = ({ video, layer, own, hovers, say, onLift = () => undefined }) => {
  const sides = {
    driver: { dot: new RemotePointer(), element: /** @type {HTMLElement} */ (layer.querySelector(".dot--driver")) },
    screen: { dot: new RemotePointer(), element: /** @type {HTMLElement} */ (layer.querySelector(".dot--screen")) },
  };
  const hand = new Hand();
  let open = false;
  /** @type {number | null} the pointer that is pressed */
  let pressed = null;
  /** @type {ReturnType<typeof setInterval> | undefined} while a hand is on the picture */
  let saying;
  /** @type {ReturnType<typeof setTimeout> | undefined} while a dot is shown */
  let looking;

  const place = () => {
    const picture = { width: video.videoWidth, height: video.videoHeight };
    const [box, around] = [video, /** @type {Element} */ (layer.parentElement)].map((element) => element.getBoundingClientRect());
    if (picture.width && picture.height && box.width) {
      const { left, top, width, height } = frameOf(picture, box.width, box.height, getComputedStyle(video).objectFit);
      const from = { left: box.left - around.left + left, top: box.top - around.top + top };
      Object.assign(layer.style, { left: `${from.left}px`, top: `${from.top}px`, width: `${width}px`, height: `${height}px` });
    }
  };
  new ResizeObserver(place).observe(video);
  video.addEventListener("resize", place);

  const render = () => {
    const now = unixNow();
    clearTimeout(looking);
    for (const { dot, element } of Object.values(sides)) {
      const at = open ? dot.at(now) : null;
      element.toggleAttribute("data-on", at !== null);
      if (at) {
        Object.assign(element.style, { left: `${100 * at[0]}%`, top: `${100 * at[1]}%` });
        looking = setTimeout(render, LOOK);
      }
    }
  };

  /** Whatever there is to say of the hand. */
  const tell = () => {
    const now = unixNow();
    const at = hand.take(now);
    if (at !== undefined) {
      sides[own].dot.told({ stamp: now, at }, now);
      say({ stamp: now, at });
      render();
    }
  };

  /** @param {PointerEvent} event */
  const follow = (event) => {
    const at = spotIn(layer.getBoundingClientRect(), event);
    hand.is(at, pressed !== null);
    saying ??= setInterval(tell, 1000 * EVERY);
    tell();
    sides[own].dot.told({ stamp: unixNow(), at }, unixNow()); // under one's own hand at once, not fifteen times a second
    render();
  };

  const leave = () => {
    clearInterval(saying);
    saying = undefined;
    hand.is(null);
    tell();
  };

  layer.addEventListener("pointerdown", (event) => {
    if (open && pressed === null && event.button === 0) {
      pressed = event.pointerId;
      layer.setPointerCapture(pressed);
      follow(event);
    }
  });
  layer.addEventListener("pointermove", (event) => {
    if (open && (pressed === null ? hovers && event.pointerType !== "touch" : pressed === event.pointerId)) {
      follow(event);
    }
  });
  for (const name of /** @type {const} */ (["pointerup", "pointercancel"])) {
    layer.addEventListener(name, (event) => {
      if (pressed === event.pointerId) {
        pressed = null;
        leave();
        onLift();
      }
    });
  }
  layer.addEventListener("pointerleave", () => pressed === null && leave());

  return {
    /** The picture lies elsewhere in its element, for a reason that is no size. */
    place,
    /** Whether pointers are shown and the hand is heard from now on. @param {boolean} may @param {string} name of the visitor, whose initial their dot bears */
    allow: (may, name) => {
      write(sides.driver.element, (Array.from(name)[0] ?? "").toUpperCase());
      if (may !== open) {
        place();
        if (!may) {
          pressed = null;
          leave();
        }
        open = may;
        layer.toggleAttribute("data-open", open);
        render();
      }
    },
    /** A dot of the other side. @param {{stamp: number, by: Side, at: import("./pointer_state.js").Spot | null}} message */
    told: (message) => {
      if (message.by !== own) {
        sides[message.by].dot.told(message, unixNow());
        render();
      }
    },
  };
};
