/**
 * The page of a questionnaire that is only looked at: its controls as participants see them, and
 * nothing saved.
 */

import { keepOrder } from "./ranking.js";
import { addRange } from "./slider.js";

for (const holder of /** @type {NodeListOf<HTMLElement>} */ (
  document.querySelectorAll("[data-slider]")
))
  addRange(holder);
for (const holder of /** @type {NodeListOf<HTMLElement>} */ (
  document.querySelectorAll("[data-ranking]")
))
  keepOrder(holder);
