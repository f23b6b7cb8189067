/**
 * Keeps the screen on: a phone that turns it off hides the page, which stops the robot. The browser
 * releases the lock when the page is hidden, and may refuse it (a low battery); it is then
 * requested again when the page is next visible.
 */

/**
 * @param {{document: Document, locks: WakeLock | undefined}} browser
 * @returns {(wanted: boolean) => void}
 */
export const createWakeLock = ({ document, locks }) => {
  let wanted = false;
  let asking = false;
  /** @type {WakeLockSentinel | null} */
  let lock = null;

  const settle = async () => {
    if (!locks || asking) {
      return;
    }
    if (!wanted) {
      const held = lock;
      lock = null;
      await held?.release();
    } else if ((lock === null || lock.released) && document.visibilityState === "visible") {
      asking = true;
      lock = await locks.request("screen").catch(() => null);
      asking = false;
      if (!wanted) {
        await settle(); // the drive has ended
      }
    }
  };

  document.addEventListener("visibilitychange", () => void settle());
  return (now) => {
    if (now !== wanted) {
      wanted = now;
      void settle();
    }
  };
};
