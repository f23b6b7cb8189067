/**
 * The panel of hands and questions: viewers raise hands and ask, the driver or operator
 * answers. It takes no keys from the driver, and new entries take no focus.
 */

import { backToDriving, make, makeButton, write } from "../lib/dom.js";
import { roleOf } from "../protocol/session.js";

/**
 * What this page may see: sessions/protocol.py AudienceState.
 * @typedef {{open: boolean, moderates: boolean, raised: boolean, hands: number, names: string[],
 *   questions: Question[]}} Audience
 *
 * @typedef {object} Question sessions/protocol.py
 * @property {string} id
 * @property {string} text
 * @property {"waiting" | "answering" | "answered" | "declined"} state
 * @property {string} who
 * @property {boolean} own
 */

const MARKS = /** @type {Record<string, string[]>} */ ({
  waiting: ["answering", "answered", "declined"],
  answering: ["answered"],
  answered: [],
  declined: [],
});
const NOTES = new Set(["rate", "too_many", "full", "closed"]);

/** Whether there is an audience, or this page is a part of one. @param {State} state */
export const isOffered = ({ visit, audience, room }) => {
  const role = roleOf(visit);
  return (
    audience !== null &&
    audience.open &&
    role !== "" &&
    (role !== "driver" || room.observers > 0 || audience.hands > 0 || audience.questions.length > 0)
  );
};

/**
 * Number of hands and questions that wait for the moderator.
 * @param {{moderates: boolean, hands: number, questions: Question[]}} audience
 */
export const countOf = ({ moderates, hands, questions }) =>
  moderates ? hands + questions.filter(({ state }) => state === "waiting").length : 0;

const BETWEEN_NEWS = 10; // s, so that a lively audience does not interrupt everything else

/** Announces to screen readers how many wait, when there are more, but not each of many. */
export class WaitingNews {
  said = 0;
  at = -Infinity;

  /** Whether to announce it now. @param {number} count @param {number} now seconds */
  hear(count, now) {
    this.said = Math.min(this.said, count); // the listener has dealt with some
    const isNews = count > this.said && now - this.at >= BETWEEN_NEWS;
    if (isNews) {
      this.said = count;
      this.at = now;
    }
    return isNews;
  }
}

/**
 * The names of viewers with a raised hand.
 * @param {{hands: number, names: string[]}} audience @param {Words} words @param {string} language
 */
export const handsText = ({ hands, names }, words, language) => {
  const more = hands - names.length;
  const listed = new Intl.ListFormat(language).format([
    ...names.map(words.nameOf),
    ...(more > 0 ? [words.say("audience.more", { n: more })] : []),
  ]);
  return hands
    ? words.say("audience.hands", { n: hands, names: listed })
    : words.say("audience.no_hands");
};

/** @param {Page} page */
export const createPanel = (page) => {
  const { store, element, words, connection, keys } = page;
  const form = createForm(page);
  const list = new QuestionList(element("questions"), words, (question, state) => {
    connection.send("audience/mark", { question, state });
    backToDriving(element);
  });
  const news = new WaitingNews();
  let isOpen = false;
  /** @type {Audience | null} when the connection was lost, and with it the raised hand */
  let before = null;
  const open = (/** @type {boolean} */ wanted) => {
    isOpen = wanted;
    store.update(isOpen ? { panel: "" } : {}); // one of the page's panels at a time
    store.flush();
    backToDriving(element);
  };
  keys.closes(element("audience-panel"), () => open(false));
  element("audience-open").addEventListener("click", () => open(!isOpen));
  element("hand").addEventListener("click", () =>
    connection.send("audience/hand", { raised: !store.get().audience?.raised }),
  );
  element("hands-lower").addEventListener("click", () => {
    connection.send("audience/lower", {});
    backToDriving(element);
  });

  return {
    denied: form.denied,
    reconnected: () => {
      const { audience } = store.get();
      before = audience?.raised ? audience : before;
    },
    changed: (/** @type {State} */ state) => {
      const { audience } = state;
      isOpen &&= isOffered(state) && !state.panel;
      if (audience && before && before !== audience) {
        before = null;
        // also if it seems to be raised: the web process that stored it may have died
        if (audience.open) {
          connection.send("audience/hand", { raised: true });
        }
      }
    },
    render: (/** @type {State} */ state) => {
      const { audience } = state;
      renderPlace(page, roleOf(state.visit) === "driver", isOffered(state), isOpen);
      if (!audience) {
        return;
      }
      renderTexts(page, audience);
      const n = countOf(audience);
      if (news.hear(n, state.now)) {
        write(element("audience-said"), words.say("audience.waiting", { n }));
      }
      form.render(audience.questions);
      list.render(audience.questions, audience.moderates);
    },
  };
};

/** @param {Page} page @param {boolean} driver @param {boolean} offered @param {boolean} isOpen */
const renderPlace = ({ element }, driver, offered, isOpen) => {
  const [box, panel] = [element("audience"), element("audience-panel")];
  const button = element("audience-open");
  const home = element(driver ? "presence" : "audience-place");
  if (box.parentElement !== home) {
    home.append(box);
  }
  box.hidden = button.hidden = !offered;
  panel.hidden = !isOpen;
  panel.toggleAttribute("data-holds-keys", !driver);
  button.setAttribute("aria-expanded", String(isOpen));
  element("asked").classList.toggle("visually-hidden", isOpen); // the list shows it
  element("audience-mine").hidden = driver;
};

/** The field for a question. @param {Page} page */
const createForm = ({ element, words, connection }) => {
  const field = /** @type {HTMLInputElement} */ (element("ask-field"));
  let asked = ""; // on its way to the server
  let note = "audience.hint";
  element("ask-form").addEventListener("submit", (/** @type {Event} */ event) => {
    event.preventDefault();
    const text = field.value.trim();
    if (text) {
      asked = text;
      note = "audience.hint";
      connection.send("audience/ask", { text });
    }
  });
  return {
    /** @param {{suffix: string, reason: string}} message */
    denied: ({ suffix, reason }) => {
      if (suffix === "audience/ask") {
        asked = "";
        note = `audience.denied.${NOTES.has(reason) ? reason : "other"}`;
        write(element("ask-note"), words.say(note));
      }
    },
    /** A question stays in the field until it has arrived. @param {Question[]} questions */
    render: (questions) => {
      const line = asked.split(/\s+/).join(" ");
      const hasArrived = questions.some(
        ({ own, text, state }) => own && text === line && state === "waiting",
      );
      if (asked && hasArrived) {
        field.value = field.value.trim() === asked ? "" : field.value;
        asked = "";
      }
      write(element("ask-note"), words.say(note));
    },
  };
};

/** @param {Page} page @param {Audience} audience */
const renderTexts = ({ element, words }, audience) => {
  const count = countOf(audience);
  element("audience-count").hidden = count === 0;
  write(element("audience-count"), String(count));
  const now = audience.questions.filter(({ state }) => state === "answering");
  const answering = now.map(({ text }) => text).join(" · ");
  element("asked").hidden = answering === "";
  write(element("asked-text"), answering);
  element("hand").setAttribute("aria-pressed", String(audience.raised));
  write(element("hand-text"), words.say(audience.raised ? "audience.lower" : "audience.raise"));
  element("audience-hands").hidden = !audience.moderates;
  element("hands-lower").hidden = audience.hands === 0;
  write(element("hands-text"), handsText(audience, words, document.documentElement.lang));
  element("no-questions").hidden = !audience.moderates || audience.questions.length > 0;
};

/**
 * Its rows stay the same elements while questions change, so that a press hits the right button.
 */
class QuestionList {
  /**
   * @param {HTMLElement} list @param {Words} words
   * @param {(id: string, state: string) => void} mark
   */
  constructor(list, words, mark) {
    this.list = list;
    this.words = words;
    this.mark = mark;
    /** @type {Map<string, HTMLElement>} */
    this.rows = new Map();
  }

  /** @param {Question[]} questions @param {boolean} moderates */
  render(questions, moderates) {
    const ids = new Set(questions.map(({ id }) => id));
    for (const [id, row] of this.rows) {
      if (!ids.has(id)) {
        row.remove();
        this.rows.delete(id);
      }
    }
    questions.forEach((question, place) => {
      const row = this.rows.get(question.id) ?? this.#newRow(question);
      if (this.list.children[place] !== row) {
        this.list.insertBefore(row, this.list.children[place] ?? null);
      }
      this.#show(row, question, moderates);
    });
  }

  /** @param {Question} question */
  #newRow({ id, text }) {
    const row = make("li", "line");
    const [words, buttons] = [make("span", "line__text", text), make("div", "presence__row")];
    words.dir = "auto";
    row.append(
      make("span", "line__who"),
      " ",
      words,
      " ",
      make("span", "audience__state"),
      buttons,
    );
    for (const mark of MARKS.waiting) {
      const word = this.words.say(`audience.do.${mark}`);
      const button = makeButton("button presence__small", word, () => this.mark(id, mark));
      button.dataset.mark = mark;
      buttons.append(button);
    }
    this.rows.set(id, row);
    return row;
  }

  /** @param {HTMLElement} row @param {Question} question @param {boolean} moderates */
  #show(row, { who, own, state }, moderates) {
    const part = (/** @type {string} */ name) =>
      /** @type {HTMLElement} */ (row.querySelector(`.${name}`));
    row.classList.toggle("line--own", own);
    row.dataset.state = state;
    write(part("line__who"), own ? this.words.say("presence.you") : this.words.nameOf(who));
    const isKnown = own || state !== "waiting";
    write(part("audience__state"), isKnown ? this.words.say(`audience.state.${state}`) : "");
    const buttons = part("presence__row");
    buttons.hidden = !moderates || MARKS[state].length === 0;
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (buttons.childNodes)) {
      button.hidden = !MARKS[state].includes(button.dataset.mark ?? "");
    }
  }
}
