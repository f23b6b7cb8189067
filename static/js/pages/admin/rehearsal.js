/**
 * A rehearsal's page: asks every few seconds how far it is, while somebody looks, and loads the
 * report when it has ended.
 */

const PERIOD_MS = 3000;
const section = document.querySelector("[data-rehearsal]");
const text = section.querySelector("[data-text]");
const bar = section.querySelector("[data-bots]");
let timer = 0;

async function refresh() {
  try {
    const answer = await fetch(section.dataset.rehearsal, {
      headers: { Accept: "application/json" },
      signal: AbortSignal.timeout(PERIOD_MS),
    });
    if (!answer.ok) throw new Error(`rehearsal: ${answer.status}`);
    const state = await answer.json();
    if (!state.live) return location.reload();
    // each write is read out by a screen reader
    if (text.textContent !== state.text) text.textContent = state.text;
    bar.max = state.progress.of_bots ?? 1;
    bar.value = state.progress.bots ?? 0;
  } catch {
    // the site is away for a moment: what is shown stays
  }
  schedule();
}

function schedule() {
  clearTimeout(timer);
  if (!document.hidden) timer = setTimeout(refresh, PERIOD_MS);
}

document.addEventListener("visibilitychange", () =>
  document.hidden ? clearTimeout(timer) : refresh(),
);
schedule();
