/** Waits until a simulated robot is ready, and opens its page. */

import { find } from "../lib/page_poll.js";

const AGAIN_MS = 1500;
const LATE_MS = 30000; // a robot starts within a few seconds
const section = find("#try");
const { address, home, csrf } = section.dataset;
const began = performance.now();

async function ask() {
  try {
    const headers = { Accept: "application/json", "X-CSRFToken": csrf };
    const answer = await fetch(address, { method: "POST", headers });
    if (answer.redirected) return location.replace(home); // signed out since
    if (answer.status === 404) return location.reload(); // no trial any more: the page says so
    const { url } = await answer.json();
    if (url) return location.replace(url);
  } catch {
    // no connection for a moment: asked again
  }
  const late = performance.now() - began > LATE_MS;
  find("[data-soon]", section).hidden = late;
  find("[data-late]", section).hidden = !late;
  setTimeout(ask, AGAIN_MS);
}

void ask();
