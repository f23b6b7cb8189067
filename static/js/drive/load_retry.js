/**
 * A classic script that runs before the drive page's modules. When a module or a style sheet does
 * not load, for instance because the phone has changed its network, it reloads the page, and shows
 * an error after some attempts. A module cannot do this: one that is missing stops all of them.
 */

(() => {
  const KEY = "reloads";
  const PAUSES = [300, 1000, 3000]; // ms before each attempt
  let failed = false;

  const attempts = () => {
    try {
      return Number(sessionStorage.getItem(KEY) ?? 0) || 0;
    } catch {
      return PAUSES.length; // without storage it would reload for ever
    }
  };

  const keep = (/** @type {number} */ count) => {
    try {
      sessionStorage.setItem(KEY, String(count));
    } catch {
      // As above.
    }
  };

  /** A page that will be reloaded is hidden: a click would be lost. */
  const show = (/** @type {boolean} */ shown) =>
    (document.documentElement.style.visibility = shown ? "" : "hidden");

  const giveUp = () => {
    keep(0);
    show(true);
    document.getElementById("card")?.setAttribute("hidden", "");
    document.getElementById("load-failed")?.removeAttribute("hidden");
    document
      .getElementById("load-failed-reload")
      ?.addEventListener("click", () => location.reload());
    addEventListener("online", () => location.reload());
  };

  const retry = () => {
    const count = attempts();
    if (count >= PAUSES.length) {
      giveUp();
      return;
    }
    keep(count + 1);
    setTimeout(() => location.reload(), PAUSES[count]);
  };

  const isNeeded = (/** @type {EventTarget | null} */ target) =>
    (target instanceof HTMLScriptElement && target.type === "module") ||
    (target instanceof HTMLLinkElement && target.relList.contains("stylesheet"));

  // Failures to load do not bubble, so they are captured.
  addEventListener(
    "error",
    ({ target }) => {
      if (!isNeeded(target)) return;
      failed = true;
      show(false);
    },
    true,
  );
  addEventListener("load", () => (failed ? retry() : keep(0)));
})();
