/** Shows the answer to a press beside the pressed point, and not under the finger. */

import { isAnswered } from "../../autonomy/offer.js";
import { placeBeside } from "../../lib/beside.js";
import { backToDriving, showButton, write } from "../../lib/dom.js";

/** The button beside the words. @param {NonNullable<State["pointNote"]>} note */
const offerOf = ({ word, goal }) =>
  goal
    ? { action: "go_around", word: word === "point.around" ? "do.go_around" : "do.go_beside" }
    : undefined;

/** @param {Page} page @returns {(state: State) => void} */
export const createPointNote = ({ element, words, act }) => {
  const [stage, note, button] = ["viewport", "point-note", "point-note-main"].map(element);
  button.addEventListener("click", () => {
    act(button.dataset.action ?? "");
    backToDriving(element);
  });
  let drawn = "";

  return ({ pointNote, now }) => {
    const shown = pointNote && isAnswered({ said: pointNote, now }) ? pointNote : null;
    note.hidden = shown === null;
    note.dataset.word = shown?.word ?? "";
    stage.toggleAttribute("data-noted", shown !== null);
    if (!shown) {
      drawn = "";
      return;
    }
    write(element("point-note-text"), words.say(shown.word, shown.values));
    const isPressed = shown.until === Infinity;
    showButton(button, isPressed ? undefined : offerOf(shown), words);
    const key = [...shown.spot, shown.word, isPressed].join();
    if (key !== drawn) {
      drawn = key;
      placeBeside(note, stage, shown.spot);
    }
  };
};
