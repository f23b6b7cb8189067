/** The display's slice of the page's state. */

export const newSlice = () => ({
  /** the profile that the visitor chose, or null: profiles.js */
  profile: /** @type {string | null} */ (null),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */
