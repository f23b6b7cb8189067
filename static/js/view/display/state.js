/** The slice of the page's state about how the page is looked at. */

export const newSlice = () => ({
  /** the profile that the visitor chose, null as long as it is not: profiles.js */
  profile: /** @type {string | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
