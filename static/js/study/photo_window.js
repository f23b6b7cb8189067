/** Shows the window of the photo. */

import { backToDriving, write } from "../lib/dom.js";
import { windowFor } from "./photo.js";
import { Snapshots } from "./snapshots.js";

/**
 * @param {GetElement} element @param {Words} words
 * @param {{list: string, act: (action: string) => void}} options
 */
export const createPhotoWindow = (element, words, { list, act }) => {
  const panel = element("photo");
  const image = /** @type {HTMLImageElement} */ (element("photo-picture"));
  const buttons = /** @type {HTMLButtonElement[]} */ (Array.from(panel.querySelectorAll("button")));
  const snapshots = new Snapshots({
    list,
    onFound: (_, url) => {
      image.src = url;
      image.hidden = false;
    },
  });
  for (const button of buttons) {
    button.addEventListener("click", () => {
      act(button.dataset.action ?? "");
      backToDriving(element);
    });
  }
  let shown = "";

  const changed = (/** @type {State} */ state) => snapshots.want(windowFor(state)?.photo ?? "");
  const render = (/** @type {State} */ state) => {
    const what = windowFor(state);
    panel.hidden = what === null;
    panel.dataset.mode = what?.mode ?? "";
    panel.toggleAttribute("data-busy", what?.busy ?? false);
    write(element("photo-text"), what ? photoSentence(what, words) : "");
    for (const button of buttons) {
      button.hidden = !(button.dataset.in ?? "").split(" ").includes(what?.mode ?? "");
      button.disabled = what?.busy ?? true;
    }
    if (shown !== (what?.photo ?? "")) {
      shown = what?.photo ?? "";
      image.hidden = true;
      image.removeAttribute("src");
    }
    element("photo-wait").hidden = what?.mode !== "review" || !image.hidden;
  };
  return { changed, render };
};

/**
 * General for a newer server's cue.
 * @param {import("./photo.js").Window} what @param {Words} words
 */
export const photoSentence = ({ word }, words) => words.say(words.has(word) ? word : "photo.other");
