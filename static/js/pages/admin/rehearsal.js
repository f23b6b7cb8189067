/** A rehearsal's page: requests its progress every few seconds, and loads the report at the end. */

import { write } from "../../lib/dom.js";
import { fetchJson, find, pollWhileVisible } from "../../lib/page_poll.js";

const PERIOD_MS = 3000;
const section = find("[data-rehearsal]");
const text = find("[data-text]", section);
const bar = find("[data-bots]", section);

async function refresh() {
  try {
    const state = await fetchJson(section.dataset.rehearsal);
    if (!state.live) return location.reload();
    write(text, state.text);
    bar.max = state.progress.of_bots ?? 1;
    bar.value = state.progress.bots ?? 0;
  } catch {
    // the site is unavailable for a moment: the page keeps the last state
  }
}

pollWhileVisible(refresh, PERIOD_MS);
