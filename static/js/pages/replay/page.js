/**
 * The replay's page: wires record, player, map, strips and lists. Nothing is asked of the server
 * but the record, once.
 */

import { isShortcut, openHolder } from "../../input/key_dispatcher.js";
import { readWords } from "../../lib/words.js";
import { CodingPanel } from "./coding/panel.js";
import { createEventList } from "./event_list.js";
import { ReplayMap } from "./replay_map.js";
import { advance, newPlayer, pressed, seek, setSpeed, toggle } from "./player.js";
import { createReadings } from "./readings.js";
import { momentAt } from "./record.js";
import { drawStrips } from "./strips.js";
import { AXIS, asked, plotWidth, timeAt, written, xOf } from "./timeline.js";

const element = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const config = JSON.parse(element("config").textContent);
const words = readWords(element("words"), document.documentElement.lang);
const [stage, strips, now, slider, playing, speed, clock] = [
  "replay",
  "strips",
  "strips-now",
  "slider",
  "play",
  "speed",
  "clock",
].map(element);
const sources = new Set(["task", "server", "robot", "page", "lab"]);

class ReplayPage {
  /** @param {SessionRecord} record */
  constructor(record) {
    this.record = record;
    this.map = new ReplayMap(element("replay-map"), config.site, record, config.footprint);
    loadImage(this.map);
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
    new ResizeObserver(() => strips.clientWidth === this.drawnWidth || this.redraw()).observe(
      strips,
    ); // it tells of the first size, too
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
    drawStrips(
      strips,
      this.record,
      { speed: say("speed"), trip: say("trip"), fps: say("fps"), loss: say("loss"), method },
      sources,
    );
    this.#render();
  }

  #render() {
    const { player, record } = this;
    const { t } = player;
    this.map.draw(momentAt(record.states, t), t);
    now.style.translate = `${AXIS + xOf(t, record.duration, plotWidth(strips.clientWidth))}px 0`;
    slider.value = String(t);
    const text = written(t);
    if (text !== this.spoken) {
      this.spoken = text;
      slider.setAttribute(
        "aria-valuetext",
        words.say("moment", { t: text, all: written(record.duration) }),
      );
    }
    clock.textContent = `${written(t, true)} / ${written(record.duration)}`;
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
    scrub(strips, (x) =>
      this.update(
        seek(this.player, timeAt(x - AXIS, this.record.duration, plotWidth(strips.clientWidth))),
      ),
    );
    document.addEventListener("keydown", (event) => {
      const target = /** @type {Element} */ (event.target);
      if (
        isShortcut(event) ||
        openHolder(document) ||
        target.closest("select, button, a, summary, textarea, input:not([type=range])")
      ) {
        return;
      }
      const next = pressed(this.player, event.key, event.shiftKey);
      if (next !== this.player) {
        event.preventDefault();
        this.update(next);
      }
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

/** A site without a plan of rooms is drawn as its picture. @param {ReplayMap} map */
const loadImage = (map) => {
  if (config.site?.image && !config.site.plan?.rooms?.length) {
    const image = new Image();
    image.addEventListener("load", () => map.showImage(image));
    image.src = config.site.image;
  }
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
