/** A rehearsal's page: requests its progress every few seconds, and loads the report at the end. */

import { write } from "../../lib/dom.js";
import { find, pollWhileVisible } from "../../lib/page_poll.js";

const PERIOD_MS = 3000;
const section = find("[data-rehearsal]");
const text = find("[data-text]", section);
const bar = find("[data-bots]", section);

async function refresh() {
  try {
    const answer = await fetch(section.dataset.rehearsal, {
      headers: { Accept: "application/json" },
      signal: AbortSignal.timeout(PERIOD_MS),
    });
    if (!answer.ok) throw new Error(`rehearsal: ${answer.status}`);
    const state = await answer.json();
    if (!state.live) return location.reload();
    write(text, state.text);
    bar.max = state.progress.of_bots ?? 1;
    bar.value = state.progress.bots ?? 0;
  } catch {
    // the site is unavailable for a moment: what is shown stays
  }
}

pollWhileVisible(refresh, PERIOD_MS);
