/** Raised hands and questions of those who watch. The panel is fetched when there is an audience, or the page is a part of one. */

import { backToDriving } from "../lib/dom.js";
import { lazy } from "../lib/lazy.js";
import { roleOf } from "../protocol/session.js";

const newSlice = () => ({
  /** what this page may see of the audience: sessions/protocol.py AudienceState */
  audience: { open: false, moderates: false, raised: false, hands: 0, names: /** @type {string[]} */ ([]), questions: /** @type {import("./panel.js").Question[]} */ ([]) },
  /** whether its panel is open */
  audienceOpen: false,
});

/** Whether there is an audience, or this page is a part of one. @param {import("../drive/features.js").State} state */
export const isOffered = ({ visit, audience, room }) => {
  const role = roleOf(visit);
  return audience.open && role !== "" && (role !== "driver" || room.observers > 0 || audience.hands > 0 || audience.questions.length > 0);
};

/** @param {import("../drive/registry.js").Page} page */
const setUp = (page) => {
  const { store, element } = page;
  const fetchPanel = lazy(async () => (await import("./panel.js")).createPanel(page));
  /** @type {ReturnType<typeof import("./panel.js").createPanel> | null} */
  let panel = null;
  let raisedBefore = false; // the connection was lost, and with it the hand
  element("audience-open").addEventListener("click", () => {
    const { audienceOpen } = store.get();
    store.update({ audienceOpen: !audienceOpen, panel: "" });
    store.flush();
    backToDriving(element); // the space bar is to stop the robot, not to press this again
  });
  return {
    handlers: {
      audience: (/** @type {any} */ audience) => {
        if (raisedBefore && audience.open && !audience.raised) {
          page.connection.send("audience/hand", { raised: true });
        }
        raisedBefore = false;
        store.update({ audience });
      },
      denied: (/** @type {any} */ message) => panel?.denied(message),
    },
    on: {
      socketOpen: () => {
        raisedBefore = store.get().audience.raised;
      },
    },
    render: (/** @type {import("../drive/features.js").State} */ state) => {
      const offered = isOffered(state);
      if (offered && !panel) {
        fetchPanel((it) => {
          panel = it;
          panel.render(store.get(), isOffered(store.get()));
        });
      }
      element("audience-open").hidden = !offered;
      panel?.render(state, offered);
    },
  };
};

/** @type {import("../drive/registry.js").Feature} */
export const audience = { name: "audience", state: newSlice, setUp };
