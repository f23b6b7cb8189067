/** Over and around the video: the card, the bar on top, the buttons, and announcements. */

import { offerFor } from "../../autonomy/offer.js";
import { write } from "../../lib/dom.js";
import { roleOf } from "../../protocol/session.js";
import { alertFor } from "./alert.js";
import { cardFor } from "./card.js";
import { CardPanel, textOf } from "./card_panel.js";
import { createControls } from "./controls.js";
import { createReadings } from "./readings.js";

/** @type {Feature["setUp"]} */
const setUp = ({ words, element, act }) => {
  const root = element("drive-page");
  const panel = new CardPanel({ element, words, onAction: act });
  const renders = [
    createReadings(element, words),
    createControls(element, words, act),
    createAnnouncer(element("announcer"), words),
  ];

  return {
    api: { alertFor, cardFor },
    render: (state) => {
      const { visit, transport } = state;
      const { phase, link } = visit;
      Object.assign(root.dataset, { phase, link, role: roleOf(visit), transport });
      root.toggleAttribute("data-playing", state.playing);
      root.toggleAttribute("data-slow", state.slow);
      const isFrozen = state.slow ? !state.playing : link === "lost";
      root.toggleAttribute("data-frozen", roleOf(visit) !== "" && isFrozen);
      panel.show(cardFor(state));
      renders.forEach((render) => render(state));
    },
  };
};

/**
 * Announces the card, the alert and the offer to screen readers, once each.
 * @param {HTMLElement} element an aria-live region
 * @param {Words} words
 */
const createAnnouncer = (element, words) => {
  let said = "";
  return (/** @type {State} */ state) => {
    const card = cardFor(state);
    const alert = alertFor(state);
    const offer = offerFor(state);
    // without values, which change every second
    const names = [card?.word, alert?.word, offer?.word, offer?.detail?.word];
    const key = [...names, card?.values?.place].join("|");
    if (key !== said) {
      said = key;
      const lines = [alert, offer, offer?.detail].map(
        (one) => one && words.say(one.word, one.values),
      );
      const title = card && words.say(`${card.word}.title`, card.values);
      write(element, [...lines, title, card && textOf(card, words)].filter(Boolean).join(" "));
    }
  };
};

/** @type {Feature} */
export const hud = { name: "hud", setUp };
