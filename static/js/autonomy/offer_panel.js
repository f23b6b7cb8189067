/** Shows an offer. */

import { backToDriving, showButton, write } from "../lib/dom.js";
import { offerFor } from "./offer.js";

/**
 * @param {GetElement} element @param {Words} words @param {(action: string) => void} act
 * @returns {(state: State) => void}
 */
export const createOfferPanel = (element, words, act) => {
  const panel = element("offer");
  const bar = element("offer-progress");
  const buttons = [element("offer-main"), element("offer-other")];
  for (const button of buttons) {
    button.addEventListener("click", () => {
      act(button.dataset.action ?? "");
      backToDriving(element);
    });
  }

  return (state) => {
    const offer = offerFor(state);
    panel.hidden = offer === null;
    panel.dataset.word = offer?.word ?? "";
    panel.dataset.tone = offer?.tone ?? "";
    write(element("offer-text"), offer ? words.say(offer.word, offer.values) : "");
    const detail = offer?.detail;
    write(element("offer-detail"), detail ? words.say(detail.word, detail.values) : "");
    const progress = offer?.progress ?? null;
    bar.hidden = progress === null;
    bar.setAttribute("value", String(progress ?? 0));
    [offer?.main, offer?.other].forEach((what, i) => showButton(buttons[i], what, words));
  };
};
