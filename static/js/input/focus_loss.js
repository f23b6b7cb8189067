/**
 * Releases all controllers and stops the robot when the window loses focus, the tab is hidden or
 * the page is left.
 */

/**
 * @param {(why: "blur" | "hidden" | "pagehide") => void} letGo
 * @param {{window?: EventTarget, document?: EventTarget & {visibilityState?: string}}} [where]
 */
export const onFocusLoss = (
  letGo,
  { window = globalThis, document = globalThis.document } = {},
) => {
  window.addEventListener("blur", () => letGo("blur"));
  window.addEventListener("pagehide", () => letGo("pagehide"));
  document.addEventListener("visibilitychange", () => {
    if (document.visibilityState === "hidden") {
      letGo("hidden");
    }
  });
};
