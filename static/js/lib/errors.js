/**
 * An error in one part of a page, which must not stop the others. All boundaries call this.
 * Browsers show it in the console and pass it to the window's "error" listeners, among them
 * drive/error_reports.js.
 * @param {unknown} error
 */
export const noteError = (error) => (globalThis.reportError ?? console.error)(error);

/**
 * Runs one part of a page. The parts that follow run in any case.
 * @template T
 * @param {() => T} part @returns {T | undefined} undefined where it failed
 */
export const guarded = (part) => {
  try {
    return part();
  } catch (error) {
    noteError(error);
    return undefined;
  }
};
