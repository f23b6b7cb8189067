/** The landing page: requests the state of the robots every few seconds, and shows what changed. */

import { write } from "../lib/dom.js";
import { fetchJson, find, pollWhileVisible } from "../lib/page_poll.js";

const PERIOD_MS = 5000;
const section = find("[data-robots]");
const invitation = find("[data-invitation] a");
const stale = find("[data-stale]", section);
/** @type {Map<string, HTMLElement>} */
const shown = new Map(
  [...section.querySelectorAll("[data-robot]")].map((card) => [card.dataset.robot, card]),
);

/** @param {HTMLElement} card @param {Record<string, any>} robot */
function render(card, robot) {
  card.dataset.state = robot.state;
  find("[data-badge]", card).className = `badge badge--${robot.badge}`;
  write(find("[data-badge] [data-text]", card), robot.label);
  write(find("[data-detail]", card), robot.detail);
  find("[data-battery]", card).hidden = !robot.battery;
  const meter = find("meter", card);
  meter.hidden = robot.charge === null;
  meter.value = robot.charge ?? 0;
  write(find("[data-battery-text]", card), robot.battery);
  const action = find("[data-action]", card);
  action.classList.toggle("button--action", robot.state === "available" && !robot.for_experienced);
  action.href = robot.url;
  write(action, robot.action);
}

async function refresh() {
  try {
    const { robots, invitation: offered } = await fetchJson(section.dataset.robots);
    stale.hidden = true;
    const cards = robots.map((/** @type {any} */ robot) => shown.get(robot.name));
    // Another number of robots needs other cards, which the server draws.
    if (robots.length !== shown.size || cards.includes(undefined)) return location.reload();
    cards.forEach((/** @type {HTMLElement} */ card, /** @type {number} */ i) =>
      render(card, robots[i]),
    );
    invitation.href = offered.url;
    write(invitation, offered.label);
  } catch {
    stale.hidden = false;
  }
}

pollWhileVisible(refresh, PERIOD_MS);
