/**
 * Messages to the people at the robot and from them: the panel and its field. The list itself is
 * conversation.js, fetched when it is needed.
 */

import { isOffered, mayWriteWaiting } from "../protocol/capabilities.js";
import { ask } from "../protocol/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { backToDriving, setPressed, write } from "../lib/dom.js";
import { freshId } from "../lib/ids.js";
import { lazy } from "../lib/lazy.js";

/** @param {Page} page */
export const createMessages = (page) => {
  const { store, element, keys } = page;
  let session = "";
  const { tell, conversation, poll } = newConversation(page);

  /**
   * Opens a panel at once, for the visitor's next key.
   * @param {"" | "talk" | "volumes" | "help"} panel @param {boolean} [writing]
   */
  const show = (panel, writing = false) => {
    store.update({ panel, writing, unread: panel === "talk" ? 0 : store.get().unread });
    store.flush();
  };
  const closePanel = () => {
    show("");
    backToDriving(element);
  };
  keys.closes(element("talk"), closePanel, () => show("talk"));
  const onSent = (/** @type {RobotAction | null} */ action) => {
    if (action) {
      tell((it) => it.sent(action));
    }
    show("talk"); // the messages stay visible
  };
  setUpForm(page, onSent);

  const toggleWriting = () => {
    const { writing } = store.get();
    show(writing ? "" : "talk", !writing);
    tell(); // fetched before the connection can be lost
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
    received: (/** @type {any} */ message) => tell((it) => it.received(message)),
    answered: (/** @type {any} */ status) => conversation.now?.answered(status),
    confirmed: (/** @type {any} */ receipt) => conversation.now?.confirmed(receipt),
    poll,
    changed: (/** @type {State} */ state) => {
      if (state.visit.session && state.visit.session !== session) {
        session = state.visit.session;
        conversation.now?.clear();
      }
      if (state.panel === "talk" && !mayTalk(state)) {
        store.update({ panel: "", writing: false });
      }
    },
    render: (/** @type {State} */ state) => renderPanels(page, state),
  };
};

/** @param {State} state */
const mayTalk = (state) => isOffered(state, "say") || mayWriteWaiting(state);

/** The conversation, fetched with its first message. @param {Page} page */
const newConversation = (page) => {
  /** @typedef {import("./conversation.js").Conversation} Conversation */
  const conversation = lazy(async () => new (await import("./conversation.js")).Conversation(page));
  /** @type {((it: Conversation) => void)[]} calls in order, while it cannot be fetched */
  const waiting = [];
  const tell = (/** @type {((it: Conversation) => void)[]} */ ...calls) => {
    waiting.push(...calls);
    conversation((it) => waiting.splice(0).forEach((call) => call(it)));
  };
  return {
    tell,
    conversation,
    poll: (/** @type {number} */ now) => (waiting.length ? tell() : conversation.now?.poll(now)),
  };
};

/** @param {Page} page @param {State} state */
const renderPanels = ({ element }, state) => {
  const { panel, writing, unread } = state;
  const writes = writing && panel === "talk";
  element("presence-talk").hidden = !mayTalk(state);
  element("talk").hidden =
    panel !== "talk" || (!writes && element("talk-list").childElementCount === 0);
  element("talk").toggleAttribute("data-holds-keys", writes);
  element("talk-writing").hidden = !writes;
  element("volumes").hidden = panel !== "volumes";
  element("help").hidden = panel !== "help";
  setPressed(element("presence-talk"), writes, false);
  setPressed(element("presence-volumes"), panel === "volumes", false);
  element("unread").hidden = unread === 0;
  write(element("unread"), String(unread));
};

/** @param {Page} page @param {(action: RobotAction | null) => void} onSent */
const setUpForm = ({ element, driving }, onSent) => {
  const input = (/** @type {string} */ id) => /** @type {HTMLInputElement} */ (element(id));
  element("talk-form").addEventListener("submit", (/** @type {Event} */ event) => {
    event.preventDefault();
    const field = input("talk-field");
    const text = field.value.trim().slice(0, 500);
    const [aloud, language] = [input("talk-aloud").checked, document.documentElement.lang];
    const wish = { type: "say", text, aloud, language };
    const action = text ? ask(wish, freshId("say-"), unixNow()) : null;
    if (action) {
      driving.sendAction(action);
      field.value = "";
    }
    onSent(action);
    backToDriving(element);
  });
};
