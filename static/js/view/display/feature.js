/**
 * How the page is looked at: its profile, the whole screen, a screen that stays lit, and the connection in figures, which is loaded when
 * somebody wants it. console.js calls it; what a profile is stands in profiles.js.
 */

import { lazy } from "../../lib/lazy.js";
import { recallProfile, rememberProfile } from "../../drive/storage.js";
import { createWakeLock } from "./wake_lock.js";
import { write } from "../hud/card_panel.js";
import { createFullScreen } from "./full_screen.js";
import { beginningOf, fixedProfile, nameOf, profileOf } from "./profiles.js";

/**
 * @param {object} page
 * @param {ReturnType<typeof import("../../drive/store.js").createStore>} page.store
 * @param {any} page.config of the page
 * @param {import("../../lib/words.js").Words} page.words
 * @param {(id: string) => HTMLElement} page.element
 * @param {(type: string, data: Record<string, boolean>) => boolean} page.report
 * @param {(step: number) => void} page.setStep
 * @param {(level: string) => void} page.assist
 * @param {() => void} page.brake
 * @param {() => import("../technical/figures.js").Raw} page.raw what the figures are made of
 */
export const createView = ({ store, config, words, element, report, setStep, assist, brake, raw }) => {
  const who = config.who ?? "";
  const buttons = /** @type {HTMLButtonElement[]} */ (Array.from(element("profiles").querySelectorAll("button")));
  const full = /** @type {HTMLButtonElement} */ (element("full-screen"));
  const keepAwake = createWakeLock({ document, locks: navigator.wakeLock });
  const technical = lazy(async () => (await import("../technical/panel.js")).createTechnical({ element, words, raw }));
  let wanted = false; // from the first time that figures are to be shown; when they could not be lazy, from the next
  store.update({ profile: recallProfile(who), suggested: config.suggested ?? null });

  const screen = createFullScreen({
    document,
    onLeft: (byButton) => {
      if (!byButton) {
        brake();
      }
      report("full_screen", { on: false });
      store.update({});
    },
  });

  /** @param {boolean} again */
  const begin = (again) => {
    const first = beginningOf(store.get(), again);
    setStep(first.step);
    if (first.assist !== null) {
      assist(first.assist);
    }
  };

  for (const button of buttons) {
    button.addEventListener("click", () => {
      const name = button.value;
      rememberProfile(who, name);
      store.update({ profile: name });
      begin(false);
    });
  }
  full.addEventListener("click", () => {
    if (!screen.isOn()) {
      report("full_screen", { on: true });
    }
    screen.toggle();
  });

  /** @param {boolean} shown */
  const showFigures = (shown) => {
    wanted ||= shown;
    if (wanted) {
      technical(
        (show) => show(profileOf(store.get()).figures && store.get().visit.phase === "driving"),
        () => (wanted = false),
      );
    }
  };

  let [figures, shownName] = [false, ""];
  return {
    /** @param {boolean} again whether this very visit went on before the page was loaded */
    began: begin,
    /** @param {import("../../drive/store.js").State} state */
    show: (state) => {
      const [name, fixed] = [nameOf(state), fixedProfile(state) !== null];
      if (`${name} ${fixed}` !== shownName) {
        shownName = `${name} ${fixed}`;
        element("cockpit").dataset.profile = name;
        buttons.forEach((button) => {
          button.disabled = fixed;
          button.setAttribute("aria-pressed", String(button.value === name));
        });
        write(element("profile-text"), words.say(fixed ? "view.fixed" : `view.${name}`));
      }
      full.hidden = !screen.exists;
      write(element("full-screen-text"), words.say(screen.isOn() ? "view.less" : "view.full"));
      keepAwake(state.visit.phase === "driving");
      const wanted = profileOf(state).figures && state.visit.phase === "driving";
      if (wanted !== figures) {
        figures = wanted;
        showFigures(wanted);
      }
    },
  };
};
