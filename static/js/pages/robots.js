/**
 * The landing page: asks every few seconds how the robots are, while somebody looks, and changes
 * only what changed.
 */

const PERIOD_MS = 5000;
const section = document.querySelector("[data-robots]");
const invitation = document.querySelector("[data-invitation] a");
const stale = section.querySelector("[data-stale]");
const shown = new Map(
  [...section.querySelectorAll("[data-robot]")].map((card) => [card.dataset.robot, card]),
);
let timer = 0;

/**
 * @param {Element} element
 * @param {string} text Write only a change: each write is read out by a screen reader.
 */
function say(element, text) {
  if (element.textContent.trim() !== text) element.textContent = text;
}

/** @param {HTMLElement} card @param {Record<string, any>} robot */
function render(card, robot) {
  card.dataset.state = robot.state;
  card.querySelector("[data-badge]").className = `badge badge--${robot.badge}`;
  say(card.querySelector("[data-badge] [data-text]"), robot.label);
  say(card.querySelector("[data-detail]"), robot.detail);
  card.querySelector("[data-battery]").hidden = !robot.battery;
  const meter = card.querySelector("meter");
  meter.hidden = robot.charge === null;
  meter.value = robot.charge ?? 0;
  say(card.querySelector("[data-battery-text]"), robot.battery);
  const action = card.querySelector("[data-action]");
  action.classList.toggle("button--action", robot.state === "available" && !robot.for_experienced);
  action.href = robot.url;
  say(action, robot.action);
}

/** A robot that came or went needs a card more or less: the server draws it. */
function sameRobots(robots) {
  return robots.length === shown.size && robots.every((robot) => shown.has(robot.name));
}

async function refresh() {
  try {
    const answer = await fetch(section.dataset.robots, {
      headers: { Accept: "application/json" },
      signal: AbortSignal.timeout(PERIOD_MS),
    });
    if (!answer.ok) throw new Error(`robots: ${answer.status}`);
    const { robots, invitation: offered } = await answer.json();
    stale.hidden = true;
    if (!sameRobots(robots)) return location.reload();
    for (const robot of robots) render(shown.get(robot.name), robot);
    invitation.href = offered.url;
    say(invitation, offered.label);
  } catch {
    stale.hidden = false;
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
