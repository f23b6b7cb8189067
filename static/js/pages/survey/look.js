/** The preview of a questionnaire: its controls as participants see them, without saving. */

import { keepOrder } from "./ranking.js";
import { addRange } from "./slider.js";

/** @param {string} selector @returns {NodeListOf<HTMLElement>} */
const all = (selector) => document.querySelectorAll(selector);
all("[data-slider]").forEach(addRange);
all("[data-ranking]").forEach(keepOrder);
