/** Messages to the people there and from them: the panel that lists them, and its field. */

import { isOffered } from "../autonomy/offer.js";
import { ask } from "../autonomy/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { backToDriving, setPressed, write } from "../lib/dom.js";
import { freshId } from "../lib/ids.js";
import { lineOf } from "./message_line.js";

const MOST_LINES = 50;

/** @param {import("../drive/registry.js").Page} page */
export const createMessages = (page) => {
  const { store, words, element, keys } = page;
  const list = element("talk-list");
  let session = "";

  /** Open a panel, at once: the visitor's next key goes to what they have opened. @param {"" | "talk" | "volumes"} panel @param {boolean} [writing] */
  const show = (panel, writing = false) => {
    store.update({ panel, writing, unread: panel === "talk" ? 0 : store.get().unread });
    store.flush();
  };
  const closePanel = () => {
    show("");
    backToDriving(element);
  };
  keys.closes(element("talk"), closePanel, () => show("talk"));
  setUpForm(page, () => show("talk")); // what was said, and what is answered, stays in sight

  const toggleWriting = () => {
    const { writing } = store.get();
    show(writing ? "" : "talk", !writing);
    if (writing) {
      backToDriving(element);
    } else {
      element("talk-field").focus({ preventScroll: true });
    }
  };

  return {
    show,
    closePanel,
    clicks: { "presence-talk": toggleWriting },
    /** @param {{by: string, who: string, text: string}} message */
    received: ({ by, who, text }) => {
      const mine = by === "driver";
      list.append(lineOf({ who: mine ? words.say("presence.you") : who || words.say("presence.they"), text, own: mine }));
      while (list.children.length > MOST_LINES) {
        list.firstElementChild?.remove();
      }
      const { panel, unread } = store.get();
      // What somebody says there is worth seeing at once; the keys go on driving, or stay with the menu that has them.
      const next = mine ? panel : panel || "talk";
      store.update({ panel: next, unread: next === "talk" ? 0 : unread + (mine ? 0 : 1) });
      store.flush(); // what is hidden cannot be scrolled
      list.scrollTop = list.scrollHeight;
    },
    /** @param {import("../drive/features.js").State} state */
    render: (state) => {
      if (state.visit.session && state.visit.session !== session) {
        session = state.visit.session;
        list.replaceChildren();
      }
      const offered = isOffered(state, "say");
      if (!offered && state.panel === "talk") {
        store.update({ panel: "", writing: false });
      }
      renderPanels(page, store.get(), offered);
    },
  };
};

/** @param {import("../drive/registry.js").Page} page @param {import("../drive/features.js").State} state @param {boolean} offered */
const renderPanels = ({ element }, { panel, writing, unread }, offered) => {
  const writes = writing && panel === "talk";
  element("presence-talk").hidden = !offered;
  element("talk").hidden = panel !== "talk" || (!writes && element("talk-list").childElementCount === 0);
  element("talk").toggleAttribute("data-holds-keys", writes);
  element("talk-writing").hidden = !writes;
  element("volumes").hidden = panel !== "volumes";
  setPressed(element("presence-talk"), writes, false);
  setPressed(element("presence-volumes"), panel === "volumes", false);
  element("unread").hidden = unread === 0;
  write(element("unread"), String(unread));
};

/** @param {import("../drive/registry.js").Page} page @param {() => void} onSent */
const setUpForm = ({ element, driving }, onSent) => {
  const input = (/** @type {string} */ id) => /** @type {HTMLInputElement} */ (element(id));
  element("talk-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const field = input("talk-field");
    const text = field.value.trim().slice(0, 500);
    if (text) {
      driving.sendAction(ask({ type: "say", text, aloud: input("talk-aloud").checked, language: document.documentElement.lang }, freshId("say-"), unixNow()));
      field.value = "";
    }
    onSent();
    backToDriving(element);
  });
};
