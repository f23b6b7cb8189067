/**
 * A small preview of the shared screen on the drive page, to check it and to point on it. Fetched
 * when a screen is first shared.
 */

import { RemotePointers } from "./remote_pointers.js";

/**
 * @param {object} page @param {GetElement} page.element
 * @param {(pointer: {stamp: number, at: import("./pointer_state.js").Spot | null}) => void}
 *   page.sendPointer
 * @param {() => void} page.backToDriving
 */
export const createPreview = ({ element, sendPointer, backToDriving }) => {
  const box = element("shared");
  const video = /** @type {HTMLVideoElement} */ (element("shared-video"));
  const pointers = new RemotePointers({
    video,
    layer: element("shared-pointers"),
    own: "driver",
    hovers: true,
    say: sendPointer,
    onLift: backToDriving,
  });
  /** @type {MediaStreamTrack | null} */
  let shown = null;

  // otherwise a press would reach the video below, and drive there
  box.addEventListener("pointerdown", (event) => event.stopPropagation());

  return {
    pointed: (/** @type {any} */ message) => pointers.receive(message),
    /**
     * @param {{track: MediaStreamTrack | null, points: boolean, name: string}} what the visible
     *   screen, null for none; whether pointers reach the robot; the visitor's name
     */
    show: ({ track, points, name }) => {
      box.hidden = track === null;
      if (track !== shown) {
        shown = track;
        video.srcObject = track && new MediaStream([track]);
      }
      pointers.allow(points, name);
    },
  };
};
