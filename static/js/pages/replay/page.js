/** The replay's page: wires record, player, map, strips and lists. The record is fetched once. */

import { onPageKey } from "../../input/key_dispatcher.js";
import { element, readConfig } from "../../lib/dom.js";
import { readWords } from "../../lib/words.js";
import { CodingPanel } from "./coding/panel.js";
import { createEventList } from "./event_list.js";
import { ReplayMap } from "./replay_map.js";
import { advance, newPlayer, pressed, seek, setSpeed, toggle } from "./player.js";
import { createReadings } from "./readings.js";
import { momentAt } from "./record.js";
import { drawStrips } from "./strips.js";
import { AXIS, asked, plotWidth, timeAt, written, xOf } from "./timeline.js";

const [config, words] = [readConfig(), readWords()];
const [stage, strips, now] = [element("replay"), element("strips"), element("strips-now")];
const [slider, playing, speed] = [element("slider"), element("play"), element("speed")];
const PRESSED = "button, a, summary, input:not([type=range])"; // they use keys themselves
const sources = new Set(["task", "server", "robot", "page", "lab"]);

class ReplayPage {
  /** @param {SessionRecord} record */
  constructor(record) {
    this.record = record;
    this.map = new ReplayMap(element("replay-map"), config.site, record, config.footprint);
    this.player = newPlayer(record.duration, asked(location.search, record.duration));
    this.list = createEventList(element("events"), record, config.photos, words, (t) =>
      this.update(seek(this.player, t)),
    );
    this.readings = createReadings(element, record, words);
    /** @type {CodingPanel | null} */
    this.coding = null;
    this.tickedAt = 0;
    this.spoken = "";
    this.drawnWidth = 0;
    slider.max = String(record.duration);
    this.#listen();
    // an observer reports the first size, too
    const observer = new ResizeObserver(
      () => strips.clientWidth === this.drawnWidth || this.redraw(),
    );
    observer.observe(strips);
    stage.dataset.state = record.states.t.length ? "ready" : "empty";
    if (config.coding) {
      this.coding = new CodingPanel(element, config.coding, words, {
        now: () => this.player.t,
        seek: (t) => this.update(seek(this.player, t)),
        duration: record.duration,
      });
    }
    this.redraw();
    requestAnimationFrame(() => performance.mark("replay:drawn"));
  }

  /** @param {import("./player.js").Player} next */
  update(next) {
    const begins = next.playing && !this.player.playing;
    this.player = next;
    this.#render();
    if (begins) {
      this.tickedAt = performance.now();
      requestAnimationFrame((at) => this.#tick(at));
    }
  }

  redraw() {
    const { say } = words;
    this.drawnWidth = strips.clientWidth;
    const method = (/** @type {string} */ name) =>
      words.has(`method.${name}`) ? say(`method.${name}`) : name;
    const [fps, loss] = [say("fps"), say("loss")];
    const texts = { speed: say("speed"), trip: say("trip"), fps, loss, method };
    drawStrips(strips, this.record, texts, sources);
    this.#render();
  }

  #render() {
    const { player, record } = this;
    const { t } = player;
    this.map.setMoment(momentAt(record.states, t), t);
    now.style.translate = `${AXIS + xOf(t, record.duration, plotWidth(strips.clientWidth))}px 0`;
    slider.value = String(t);
    const text = written(t);
    if (text !== this.spoken) {
      this.spoken = text;
      const moment = words.say("moment", { t: text, all: written(record.duration) });
      slider.setAttribute("aria-valuetext", moment);
    }
    element("clock").textContent = `${written(t, true)} / ${written(record.duration)}`;
    playing.dataset.playing = String(player.playing);
    playing.setAttribute("aria-label", words.say(player.playing ? "pause" : "play"));
    speed.value = String(player.speed);
    this.readings(t);
    this.list.mark(t);
    this.coding?.mark(t);
    stage.dataset.t = t.toFixed(3);
  }

  /** @param {number} at ms */
  #tick(at) {
    this.update(advance(this.player, Math.max(0, at - this.tickedAt) / 1000));
    this.tickedAt = at;
    if (this.player.playing) {
      requestAnimationFrame((next) => this.#tick(next));
    }
  }

  #listen() {
    slider.addEventListener("input", () => this.update(seek(this.player, Number(slider.value))));
    playing.addEventListener("click", () => this.update(toggle(this.player)));
    speed.addEventListener("change", () => this.update(setSpeed(this.player, Number(speed.value))));
    scrub(strips, (x) => {
      const t = timeAt(x - AXIS, this.record.duration, plotWidth(strips.clientWidth));
      this.update(seek(this.player, t));
    });
    onPageKey(({ target, key, shiftKey }) => {
      const hasOwn = /** @type {Element} */ (target).closest(PRESSED);
      const next = hasOwn ? this.player : pressed(this.player, key, shiftKey);
      const isChanged = next !== this.player;
      if (isChanged) {
        this.update(next);
      }
      return isChanged;
    });
    for (const box of document.querySelectorAll("[data-source]")) {
      box.addEventListener("change", () => {
        const { checked, dataset } = /** @type {HTMLInputElement} */ (box);
        sources[checked ? "add" : "delete"](dataset.source ?? "");
        this.list.show(sources);
        this.redraw();
      });
    }
  }
}

/**
 * Pointer, pen and finger on the strips.
 * @param {HTMLElement} target
 * @param {(x: number) => void} moved CSS pixels from its left edge
 */
const scrub = (target, moved) => {
  const tell = (/** @type {PointerEvent} */ event) =>
    moved(event.clientX - target.getBoundingClientRect().left);
  target.addEventListener("pointerdown", (event) => {
    target.setPointerCapture(event.pointerId);
    tell(event);
  });
  target.addEventListener("pointermove", (event) => {
    if (target.hasPointerCapture(event.pointerId)) {
      tell(event);
    }
  });
};

const load = async () => {
  try {
    // as the page's preload does
    const answer = await fetch(config.data, { credentials: "same-origin" });
    if (!answer.ok) {
      throw new Error(`replay: ${answer.status}`);
    }
    new ReplayPage(await answer.json());
  } catch (error) {
    stage.dataset.state = "failed";
    element("failed-again").addEventListener("click", () => location.reload());
    console.warn(error);
  }
};

load();
