/**
 * Practising with a simulated robot while waiting for a real one: its drive page in a frame over
 * this one, which keeps its place in the queue. When the turn comes the frame is closed.
 */

import { write } from "../lib/dom.js";
import { fetchJson } from "../lib/page_poll.js";

const AGAIN = 1.5; // s between two requests while a robot starts

/**
 * @param {object} options @param {Store} options.store
 * @param {string | null} options.address that assigns a robot, null without one
 * @param {GetElement} options.element @param {Words} options.words
 * @param {(type: string) => boolean} options.report
 */
export const createPractice = ({ store, address, element, words, report }) => {
  const stage = element("practice");
  const frame = /** @type {HTMLIFrameElement} */ (element("practice-frame"));
  let timer = 0;

  /** Without a trace in the history of the browser. @param {string} url */
  const go = (url) => frame.contentWindow?.location.replace(url);
  const waits = () => ["queued", "taking"].includes(store.get().visit.phase);

  const ask = async () => {
    const { url } = await fetchJson(String(address)).catch(() => ({ url: null }));
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
    go("about:blank"); // its page leaves the robot
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
      const values = { place: visit.place, minutes: Math.max(1, Math.ceil(visit.minutes)) };
      write(element("practice-words"), words.say(word, values));
    }
  });

  return {
    practise,
    /** The visitor no longer waits. */
    practice_over: () => store.get().practice !== "none" && end(),
  };
};
