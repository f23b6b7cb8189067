/** A robot's page in the administration: shows the robot's state every two seconds. */

import { write } from "../../lib/dom.js";
import { fetchJson, find, pollWhileVisible } from "../../lib/page_poll.js";

const PERIOD_MS = 2000;
const section = find("#robot-overview");
const part = (/** @type {string} */ name) => find(`[data-${name}]`, section);

/** The robot has connected for the first time: its owner may show it to visitors. */
function welcome() {
  section.dataset.connected = "true";
  part("waiting").hidden = true;
  part("arrived").hidden = false;
  part("wait").dataset.done = "";
  const screen = part("screen");
  if (screen) screen.hidden = false;
  const shown = find("input[name=shown_to_visitors]");
  if (shown) shown.disabled = false;
}

/** The one-time command was used or replaced: the one that starts the agent again stays. */
function spend() {
  delete section.dataset.enrolment;
  for (const once of section.querySelectorAll("[data-once]")) once.remove();
  part("afterwards").hidden = false;
}

/**
 * The settings below show the same state; a field that this person may not see is not there.
 * @param {Record<string, string>} fields
 */
function renderFields(fields) {
  for (const [name, text] of Object.entries(fields)) {
    const field = find(`.field-${name} .readonly`);
    if (field) write(field.querySelector("[data-state]") ?? field, text);
  }
}

/** @param {Record<string, any>} status robots.owner_status.OwnerStatus */
function render(status) {
  part("state").dataset.tone = status.tone;
  write(part("label"), status.label);
  write(part("sentence"), status.sentence);
  write(part("battery"), status.battery || "–");
  write(part("agent"), status.agent || "–");
  renderFields(status.fields);
  const made = section.dataset.enrolment;
  if (made && made !== status.enrolment && status.enrolled) spend();
  if (status.connected && section.dataset.connected === "false") welcome();
}

async function refresh() {
  try {
    render(await fetchJson(section.dataset.status));
  } catch {
    // the site is unavailable for a moment: the page keeps the last state
  }
}

if (section) pollWhileVisible(refresh, PERIOD_MS);
