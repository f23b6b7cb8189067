/**
 * Practising in a simulated robot while one waits for a real one: its drive page in a frame over
 * this one, which goes on waiting behind it. When the turn comes the frame goes, and leaves its
 * robot.
 */

import { write } from "../lib/dom.js";

const AGAIN = 1.5; // s between two questions while a robot is being made ready

/**
 * @param {object} options @param {Store} options.store
 * @param {string | null} options.address where to ask for a robot, null where there is none
 * @param {GetElement} options.element @param {Words} options.words
 * @param {(type: string) => boolean} options.report
 */
export const createPractice = ({ store, address, element, words, report }) => {
  const stage = element("practice");
  const frame = /** @type {HTMLIFrameElement} */ (element("practice-frame"));
  let timer = 0;

  /**
   * Without a trace in the history: the browser's own way back must not lead into a practice that
   * is over.
   * @param {string} url
   */
  const go = (url) => frame.contentWindow?.location.replace(url);
  const waits = () => ["queued", "taking"].includes(store.get().visit.phase);

  const ask = async () => {
    const url = await whereTo(/** @type {string} */ (address));
    if (store.get().practice !== "starting" || !waits()) {
      end();
    } else if (url === null) {
      timer = window.setTimeout(() => void ask(), AGAIN * 1000);
    } else {
      go(url);
      stage.hidden = false;
      frame.focus();
      store.update({ practice: "on" });
      report("practice_began");
    }
  };

  const end = () => {
    clearTimeout(timer);
    if (!stage.hidden) {
      report("practice_ended");
    }
    stage.hidden = true;
    go("about:blank"); // its page goes, and says so to its robot
    store.update({ practice: "off" });
  };

  const practise = () => {
    clearTimeout(timer);
    store.update({ practice: "starting" });
    void ask();
  };

  window.addEventListener("message", ({ origin, source, data }) => {
    const ours = origin === location.origin && source === frame.contentWindow;
    if (ours && ["practice_over", "practise_again"].includes(data)) {
      end();
      data === "practise_again" && practise();
    }
  });
  element("practice-end").addEventListener("click", end);
  store.subscribe(({ practice, visit }) => {
    if (practice === "on") {
      const next = visit.place > 1 ? "practice.waits" : "practice.next";
      const word = visit.pause ? "practice.paused" : next;
      write(
        element("practice-words"),
        words.say(word, { place: visit.place, minutes: Math.max(1, Math.ceil(visit.minutes)) }),
      );
    }
  });

  return {
    practise,
    /** The turn has come, or the visitor waits no more. */
    practice_over: () => store.get().practice !== "none" && end(),
  };
};

/**
 * @param {string} address
 * @returns {Promise<string | null>} null while none is ready, or the server cannot be asked
 */
const whereTo = async (address) => {
  try {
    const answer = await fetch(address, { headers: { Accept: "application/json" } });
    return answer.ok ? (await answer.json()).url : null;
  } catch {
    return null; // offline for a moment: asked again
  }
};
