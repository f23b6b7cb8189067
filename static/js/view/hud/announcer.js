/**
 * Says to screen readers what others see: the card, the alert and the offer, once each.
 */

import { alertFor } from "./alert.js";
import { cardFor } from "./card.js";
import { write } from "../../lib/dom.js";
import { textOf } from "./card_panel.js";
import { offerFor } from "../../autonomy/offer.js";

/**
 * @param {HTMLElement} element an aria-live region
 * @param {import("../../lib/words.js").Words} words
 */
export const createAnnouncer = (element, words) => {
  let said = "";
  return (/** @type {import("../../drive/features.js").State} */ state) => {
    const card = cardFor(state);
    const alert = alertFor(state);
    const offer = offerFor(state);
    // A count-down is not read out second by second: the sentence is announced when its word changes.
    const key = `${card?.word ?? ""}|${alert?.word ?? ""}|${card?.values?.place ?? ""}|${offer?.word ?? ""}|${offer?.detail?.word ?? ""}`;
    if (key !== said) {
      said = key;
      const lines = [alert, offer, offer?.detail].map((one) => one && words.say(one.word, one.values));
      const sentences = [...lines, card && words.say(`${card.word}.title`, card.values), card && textOf(card, words)];
      write(element, sentences.filter(Boolean).join(" "));
    }
  };
};
