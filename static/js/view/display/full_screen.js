/**
 * The whole screen, where the browser has it for pages (an iPhone has it for videos alone, and
 * those hide the buttons). The browser takes Escape for itself then, so whoever leaves by it,
 * perhaps to stop, stops.
 */

/**
 * @param {object} options
 * @param {any} options.document Safari on older iPads has the names with a prefix alone
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
      // A browser that says no leaves things as they are; the old names answer with nothing.
      (byButton ? exit.call(document) : enter.call(root, { navigationUI: "hide" }))?.catch(
        () => (byButton = false),
      );
    },
  };
};
