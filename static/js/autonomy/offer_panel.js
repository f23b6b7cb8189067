/** Shows an offer, and hands on which of its buttons was pressed. */

import { backToDriving, write } from "../lib/dom.js";
import { offerFor } from "./offer.js";

/**
 * @param {GetElement} element @param {Words} words @param {(action: string) => void} act
 * @returns {(state: State) => void}
 */
export const createOfferPanel = (element, words, act) => {
  const panel = element("offer");
  const bar = element("offer-progress");
  const buttons = /** @type {HTMLButtonElement[]} */ ([
    element("offer-main"),
    element("offer-other"),
  ]);
  for (const button of buttons) {
    button.addEventListener("click", () => {
      act(button.dataset.action ?? "");
      // The space bar is to stop the robot, not to press this again.
      backToDriving(element);
    });
  }

  return (state) => {
    const offer = offerFor(state);
    panel.hidden = offer === null;
    panel.dataset.word = offer?.word ?? "";
    panel.dataset.tone = offer?.tone ?? "";
    write(element("offer-text"), offer ? words.say(offer.word, offer.values) : "");
    write(
      element("offer-detail"),
      offer?.detail ? words.say(offer.detail.word, offer.detail.values) : "",
    );
    const progress = offer?.progress ?? null;
    bar.hidden = progress === null;
    bar.setAttribute("value", String(progress ?? 0));
    [offer?.main, offer?.other].forEach((what, i) => {
      buttons[i].hidden = !what;
      buttons[i].dataset.action = what?.action ?? "";
      write(buttons[i], what ? words.say(what.word) : "");
    });
  };
};
