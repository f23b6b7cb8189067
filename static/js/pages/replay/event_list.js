/** Events and photos in order, each a button that seeks to its time. */

import { make, makeButton } from "../../lib/dom.js";
import { lastBefore } from "./record.js";
import { written } from "./timeline.js";

/** @param {string} type @returns {string} */
const plain = (type) => type.replaceAll("_", " ");

/** @typedef {{t: number, source: string, type: string, detail: string, photo: string}} Entry */

/**
 * @param {HTMLElement} list @param {SessionRecord} record
 * @param {{t: number, url: string}[]} photos @param {Words} words @param {(t: number) => void} go
 */
export const createEventList = (list, record, photos, words, go) => {
  /** @type {Entry[]} */
  const entries = [
    ...record.events.map(([t, source, type, detail]) => ({ t, source, type, detail, photo: "" })),
    ...photos.map(({ t, url }) => ({ t, source: "robot", type: "photo", detail: "", photo: url })),
  ].sort((one, other) => one.t - other.t);
  const rows = entries.map((entry) => rowOf(entry, words, go));
  list.replaceChildren(...rows);
  const times = entries.map(({ t }) => t);
  let marked = -1;

  return {
    /** Marks the last event. @param {number} t */
    mark: (t) => {
      const index = lastBefore(times, t);
      if (index !== marked) {
        rows[marked]?.removeAttribute("aria-current");
        rows[index]?.setAttribute("aria-current", "true");
        marked = index;
        reveal(list, rows[index]);
      }
    },
    /** @param {Set<string>} sources */
    show: (sources) =>
      rows.forEach((row, i) => row.toggleAttribute("hidden", !sources.has(entries[i].source))),
  };
};

/** Scrolls only the list. @param {HTMLElement} list @param {HTMLElement | undefined} row */
const reveal = (list, row) => {
  if (row && list.scrollHeight > list.clientHeight) {
    list.scrollTop = row.offsetTop - list.offsetTop - list.clientHeight / 2;
  }
};

/** @param {Entry} entry @param {Words} words @param {(t: number) => void} go */
const rowOf = ({ t, source, type, detail, photo }, words, go) => {
  const row = make("li", "replay-event");
  row.dataset.source = source;
  const button = makeButton("replay-event__button", "", () => go(t));
  const name = words.has(`event.${type}`) ? words.say(`event.${type}`) : plain(type);
  button.append(
    make("span", "replay-event__time numbers", written(t, true)),
    make("span", "replay-event__source", words.say(`source.${source}`)),
    make("span", "replay-event__name", name),
  );
  if (detail) {
    button.append(make("span", "replay-event__detail", plain(detail)));
  }
  if (photo) {
    const picture = make("img", "replay-event__photo");
    button.append(Object.assign(picture, { src: photo, alt: name, loading: "lazy" }));
  }
  row.append(button);
  return row;
};
