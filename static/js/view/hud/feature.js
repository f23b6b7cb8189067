/**
 * What lies over and round the video: the card, the bar on top, the dials, the buttons, and what screen readers are told.
 */

import { roleOf } from "../../protocol/session.js";
import { createAnnouncer } from "./announcer.js";
import { cardFor } from "./card.js";
import { CardPanel } from "./card_panel.js";
import { createControls } from "./controls.js";
import { createDials } from "./dials.js";
import { createReadings } from "./readings.js";

/** @param {import("../../drive/registry.js").Page} page */
const setUp = ({ words, element, act }) => {
  const root = element("drive-page");
  const panel = new CardPanel({ element: element("card"), words, onAction: act });
  const renders = [
    createReadings(element, words),
    createDials(element, document.documentElement.lang),
    createControls(element, words, act),
    createAnnouncer(element("announcer"), words),
  ];

  return {
    render: (/** @type {any} */ state) => {
      const { visit } = state;
      Object.assign(root.dataset, { phase: visit.phase, link: visit.link, role: roleOf(visit), transport: state.transport });
      root.toggleAttribute("data-playing", state.playing);
      root.toggleAttribute("data-slow", state.slow);
      root.toggleAttribute("data-frozen", roleOf(visit) !== "" && (state.slow ? !state.playing : visit.link === "lost"));
      panel.show(cardFor(state));
      renders.forEach((render) => render(state));
    },
  };
};

/** @type {import("../../drive/registry.js").Feature} */
export const hud = { name: "hud", setUp };
