/** The profile of the page (profiles.js), full screen, and a screen that stays on. */

import { recallProfile, rememberProfile } from "../../lib/storage.js";
import { write } from "../../lib/dom.js";
import { createFullScreen } from "./full_screen.js";
import { beginningOf, fixedProfile, nameOf } from "./profiles.js";
import { createWakeLock } from "./wake_lock.js";

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store, config } = page;
  const who = config.who ?? "";
  const keepAwake = createWakeLock({ document, locks: navigator.wakeLock });
  store.update({ profile: recallProfile(who) });

  /** @param {boolean} isContinued whether the session continues after a reload */
  const begin = (isContinued) => {
    const { step, assist } = beginningOf(store.get(), isContinued);
    page.driving.steering.setStep(step);
    if (assist !== null) {
      page.autonomy.assist(assist);
    }
  };

  const renders = [
    createProfiles(page, (name) => {
      rememberProfile(who, name);
      store.update({ profile: name });
      begin(false);
    }),
    createFullScreenButton(page),
  ];
  return {
    on: {
      began: begin,
      changed: ({ visit }) => keepAwake(visit.phase === "driving"),
    },
    render: (state) => renders.forEach((render) => render(state)),
  };
};

/** @param {Page} page @param {(name: string) => void} choose */
const createProfiles = ({ element, words }, choose) => {
  const buttons = Array.from(element("profiles").querySelectorAll("button"));
  for (const button of buttons) {
    button.addEventListener("click", () => choose(button.value));
  }
  let shown = "";
  return (/** @type {State} */ state) => {
    const [name, fixed] = [nameOf(state), fixedProfile(state) !== null];
    if (`${name} ${fixed}` !== shown) {
      shown = `${name} ${fixed}`;
      element("drive-page").dataset.profile = name;
      buttons.forEach((button) => {
        button.disabled = fixed;
        button.setAttribute("aria-pressed", String(button.value === name));
      });
      write(element("profile-text"), words.say(fixed ? "view.fixed" : `view.${name}`));
    }
  };
};

/** @param {Page} page */
const createFullScreenButton = ({ element, words, store, connection, driving }) => {
  const button = element("full-screen");
  const screen = createFullScreen({
    document,
    onLeft: (byButton) => {
      if (!byButton) {
        driving.brake();
      }
      connection.report("full_screen", { on: false });
      store.update({});
    },
  });
  button.addEventListener("click", () => {
    if (!screen.isOn()) {
      connection.report("full_screen", { on: true });
    }
    screen.toggle();
  });
  return () => {
    button.hidden = !screen.exists;
    write(element("full-screen-text"), words.say(screen.isOn() ? "view.less" : "view.full"));
  };
};

/** @type {Feature} */
export const display = { name: "display", setUp };
