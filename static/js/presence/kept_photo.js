/** A photo that the visitor takes to keep: requested, shown, and offered for download. */

import { ask, heard, pursue } from "../protocol/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { write } from "../lib/dom.js";
import { freshId } from "../lib/ids.js";
import { Snapshots } from "../study/snapshots.js";

export class KeptPhoto {
  /** @param {Page} page */
  constructor(page) {
    this.page = page;
    this.snapshots = new Snapshots({
      list: page.config.snapshots,
      onFound: (_, url) => page.store.update({ keptPhotoUrl: url }),
    });
  }

  take() {
    const { store, driving } = this.page;
    const { keptPhoto } = store.get();
    if (keptPhoto === null || keptPhoto.endedAt !== null) {
      const action = ask({ type: "photo" }, freshId("photo-"), unixNow());
      store.update({ keptPhoto: action, keptPhotoUrl: "" });
      driving.sendAction(action);
    }
  }

  close() {
    this.page.store.update({ keptPhoto: null, keptPhotoUrl: "" });
    this.snapshots.want("");
  }

  /** @param {Parameters<typeof heard>[1]} message */
  received(message) {
    const { keptPhoto } = this.page.store.get();
    if (keptPhoto?.id === message.actionId) {
      const action = heard(keptPhoto, message, unixNow());
      this.page.store.update({ keptPhoto: action });
      if (action?.status === "FINISHED") {
        this.snapshots.want(action.id);
      }
    }
  }

  /** @param {number} now */
  poll(now) {
    const { store, driving } = this.page;
    const { keptPhoto } = store.get();
    if (keptPhoto?.status === "ASKED") {
      const next = pursue(keptPhoto, now, driving.sendAction);
      if (next !== keptPhoto) {
        store.update({ keptPhoto: next });
      }
    }
  }

  /** @param {State} state */
  render(state) {
    const { element, words, config } = this.page;
    const { keptPhoto: photo, keptPhotoUrl: url } = state;
    const done = photo?.status === "FINISHED" || url !== "";
    element("kept").hidden = photo === null;
    const key = !photo
      ? ""
      : photo.status === "FAILED"
        ? "kept.failed"
        : url
          ? "kept.here"
          : done
            ? "kept.coming"
            : "kept.taking";
    write(element("kept-text"), key && words.say(key));
    const image = /** @type {HTMLImageElement} */ (element("kept-picture"));
    const link = /** @type {HTMLAnchorElement} */ (element("kept-download"));
    image.hidden = link.hidden = url === "";
    if (url && image.getAttribute("src") !== url) {
      image.src = link.href = url;
      link.download = `${config.robot}.jpg`;
    }
  }
}
