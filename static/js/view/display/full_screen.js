/**
 * Full screen, where the browser has it for pages (an iPhone has it for videos only, which would
 * hide the buttons). The browser then uses Escape itself, so a visitor who presses it, perhaps to
 * stop, also stops the robot.
 */

/**
 * @param {object} options
 * @param {any} options.document Safari on older iPads has prefixed names only
 * @param {(byButton: boolean) => void} options.onLeft
 */
export const createFullScreen = ({ document, onLeft }) => {
  const root = document.documentElement;
  const enter = root.requestFullscreen ?? root.webkitRequestFullscreen;
  const exit = document.exitFullscreen ?? document.webkitExitFullscreen;
  const isOn = () => Boolean(document.fullscreenElement ?? document.webkitFullscreenElement);
  let byButton = false;

  const changed = () => {
    if (!isOn()) {
      onLeft(byButton);
      byButton = false;
    }
  };
  document.addEventListener("fullscreenchange", changed);
  document.addEventListener("webkitfullscreenchange", changed);

  return {
    exists: Boolean(enter && exit),
    isOn,
    toggle: () => {
      byButton = isOn();
      // The browser may refuse; the prefixed functions return nothing.
      (byButton ? exit.call(document) : enter.call(root, { navigationUI: "hide" }))?.catch(
        () => (byButton = false),
      );
    },
  };
};
