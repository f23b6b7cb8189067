/**
 * What lies over and round the video: the card, the bar on top, the buttons, and what screen
 * readers are told.
 */

import { offerFor } from "../../autonomy/offer.js";
import { write } from "../../lib/dom.js";
import { roleOf } from "../../protocol/session.js";
import { alertFor } from "./alert.js";
import { cardFor } from "./card.js";
import { CardPanel, textOf } from "./card_panel.js";
import { createControls } from "./controls.js";
import { createReadings } from "./readings.js";

/** @param {Page} page */
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
    render: (/** @type {State} */ state) => {
      const { visit } = state;
      Object.assign(root.dataset, {
        phase: visit.phase,
        link: visit.link,
        role: roleOf(visit),
        transport: state.transport,
      });
      root.toggleAttribute("data-playing", state.playing);
      root.toggleAttribute("data-slow", state.slow);
      root.toggleAttribute(
        "data-frozen",
        roleOf(visit) !== "" && (state.slow ? !state.playing : visit.link === "lost"),
      );
      panel.show(cardFor(state));
      renders.forEach((render) => render(state));
    },
  };
};

/**
 * Says to screen readers what others see: the card, the alert and the offer, once each.
 * @param {HTMLElement} element an aria-live region
 * @param {Words} words
 */
const createAnnouncer = (element, words) => {
  let said = "";
  return (/** @type {State} */ state) => {
    const card = cardFor(state);
    const alert = alertFor(state);
    const offer = offerFor(state);
    // A count-down is not read out second by second: the sentence is announced when its word
    // changes.
    const key = [
      card?.word,
      alert?.word,
      card?.values?.place,
      offer?.word,
      offer?.detail?.word,
    ].join("|");
    if (key !== said) {
      said = key;
      const lines = [alert, offer, offer?.detail].map(
        (one) => one && words.say(one.word, one.values),
      );
      const sentences = [
        ...lines,
        card && words.say(`${card.word}.title`, card.values),
        card && textOf(card, words),
      ];
      write(element, sentences.filter(Boolean).join(" "));
    }
  };
};

/** @type {Feature} */
export const hud = { name: "hud", setUp };
