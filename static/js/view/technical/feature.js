/** The figures of the connection, for profiles that show them; fetched when first wanted. */

import { unixNow } from "../../lib/clock.js";
import { lazy } from "../../lib/lazy.js";
import { profileOf } from "../display/profiles.js";

/** @param {State} state */
const isWanted = (state) => profileOf(state).figures && state.visit.phase === "driving";

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store, element, words } = page;
  const panel = lazy(async () =>
    (await import("./panel.js")).createTechnical({ element, words, raw: () => rawOf(page) }),
  );
  let wanted = false;
  return {
    on: {
      changed: (state) => {
        if (isWanted(state) !== wanted) {
          wanted = isWanted(state);
          panel((show) => show(isWanted(store.get())));
        }
      },
    },
  };
};

/** The sources of the figures. @param {Page} page @returns {import("./figures.js").Raw} */
const rawOf = ({
  store,
  connection: { link, clockSync },
  video: { fallback, shown, viewport },
}) => ({
  connection: fallback.on ? null : (link.peer?.connection ?? null),
  state: store.get(),
  trips: {
    datachannel: clockSync.roundTripNow("datachannel", unixNow()),
    mqtt: clockSync.roundTripNow("mqtt", unixNow()),
  },
  glass:
    fallback.on || clockSync.offset === null || shown.stamp === null
      ? null
      : Math.max(0, shown.at + clockSync.offset - shown.stamp),
  size: viewport.size,
});

/** @type {Feature} */
export const technical = { name: "technical", setUp };
