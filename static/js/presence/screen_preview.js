/**
 * What the visitor shows of their screen, small on the drive page, as the people at the robot see
 * it: to see what one shows, and to point on it. Fetched when a screen is shown for the first time.
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

  // a press on the stage beneath would drive there
  box.addEventListener("pointerdown", (event) => event.stopPropagation());

  return {
    pointed: (/** @type {any} */ message) => pointers.told(message),
    /**
     * @param {{track: MediaStreamTrack | null, points: boolean, name: string}} what the screen that
     *   they see, null for none; whether pointers reach them; the visitor's name
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
