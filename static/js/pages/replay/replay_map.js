/**
 * The path on the floor plan, coloured by time, and the robot's outline where it was. The still
 * part is drawn once a size into a picture of its own. data-marker-x, -y and -t on the canvas tell
 * where the robot was drawn, for tests.
 */

import { createPaint } from "../../lib/colours.js";
import { mapFromRobot } from "../../lib/transforms.js";
import { boundsOfSite, drawFloorPlan } from "../../view/map/floor_plan.js";
import { boundsOf, fit, toScreen } from "../../view/map/transform.js";
import { piecesOf } from "./record.js";

const SHADES = 64; // colours that the time is told with
const SMALLEST = 8; // CSS pixels from the robot's middle to its tip
const COLOURS = ["floor", "wall", "furniture", "door", "dock", "name", "robot", "lost", "edge"];
// petrol at the beginning, apricot at the end
const HUES = { from: [118, 214, 200], to: [255, 138, 60] };

/** @param {number} share of the time @returns {string} */
const shade = (share) => {
  const step = Math.round(Math.min(Math.max(share, 0), 1) * (SHADES - 1)) / (SHADES - 1);
  const hue = HUES.from.map((from, i) => Math.round(from + step * (HUES.to[i] - from)));
  return `rgb(${hue.join(" ")})`;
};

export class ReplayMap {
  /**
   * @param {HTMLCanvasElement} canvas @param {FloorPlan | null} site @param {SessionRecord} record
   * @param {Point[]} footprint m, in the robot's frame
   */
  constructor(canvas, site, record, footprint) {
    this.canvas = canvas;
    this.site = site;
    this.record = record;
    this.footprint = footprint;
    /** @type {CanvasImageSource | null} */
    this.image = null;
    /** @type {MapView | null} */
    this.view = null;
    this.density = 1;
    /** @type {() => any} */
    this.colours = createPaint(canvas, "--map-", COLOURS, "600 12px");
    /** @type {Paint & {robot: string, lost: string, edge: string}} */
    this.paint = /** @type {any} */ ({});
    this.still = document.createElement("canvas");
    this.pieces = piecesOf(record.states);
    /** @type {[import("./record.js").Moment | null, number]} */
    this.shown = [null, 0];
    new ResizeObserver(() => this.#fits() || this.resize()).observe(canvas);
    this.resize();
  }

  /** Whether it is drawn in the size that it has: an observer tells of the first size, too. */
  #fits() {
    const { clientWidth, clientHeight } = this.canvas;
    return (
      this.view?.width === clientWidth &&
      this.view.height === clientHeight &&
      this.density === devicePixelRatio
    );
  }

  /** The image of a site that has no plan of rooms. @param {CanvasImageSource} image */
  showImage(image) {
    this.image = image;
    this.resize();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) {
      return;
    }
    this.density = devicePixelRatio;
    this.view = fit(this.#bounds(), width, height);
    this.paint = this.colours();
    for (const canvas of [this.canvas, this.still]) {
      canvas.width = Math.round(width * this.density);
      canvas.height = Math.round(height * this.density);
    }
    const context = this.still.getContext("2d");
    if (context) {
      this.#drawStill(context);
    }
    this.draw(...this.shown);
  }

  #bounds() {
    const { x, y } = this.record.states;
    return this.site
      ? boundsOfSite(this.site)
      : boundsOf(
          x.length
            ? x.map((each, i) => /** @type {Point} */ ([each, y[i]]))
            : [
                [-1, -1],
                [1, 1],
              ],
        );
  }

  /** @param {Canvas2D} context */
  #drawStill(context) {
    const { states, duration } = this.record;
    if (this.site && this.view) {
      drawFloorPlan(context, this.view, this.density, this.site, this.image, this.paint);
    }
    context.setTransform(this.density, 0, 0, this.density, 0, 0);
    context.lineWidth = 2.5;
    context.lineJoin = context.lineCap = "round";
    for (const [first, last] of this.pieces) {
      this.#drawPiece(context, states, first, last, duration);
    }
  }

  /**
   * One stroke a shade.
   * @param {Canvas2D} context @param {any} states @param {number} first
   * @param {number} last @param {number} duration
   */
  #drawPiece(context, states, first, last, duration) {
    let colour = "";
    for (let i = first; i < last; i += 1) {
      const wanted = shade(states.t[i] / duration);
      if (wanted !== colour) {
        if (colour) {
          context.stroke();
        }
        colour = wanted;
        context.beginPath();
        context.strokeStyle = colour;
        context.moveTo(...this.#at(states.x[i], states.y[i]));
      }
      context.lineTo(...this.#at(states.x[i + 1], states.y[i + 1]));
    }
    context.stroke();
  }

  /** @param {number} x m @param {number} y m @returns {Point} CSS pixels */
  #at(x, y) {
    return this.view ? toScreen(this.view, x, y) : [0, 0];
  }

  /** @param {import("./record.js").Moment | null} moment @param {number} t s */
  draw(moment, t) {
    this.shown = [moment, t];
    const context = this.canvas.getContext("2d");
    if (!context || !this.view) {
      return;
    }
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (this.still.width) {
      context.drawImage(this.still, 0, 0);
    }
    context.setTransform(this.density, 0, 0, this.density, 0, 0);
    if (moment) {
      this.#drawRobot(context, moment);
      const [x, y] = this.#at(moment.x, moment.y);
      Object.assign(this.canvas.dataset, {
        markerX: x.toFixed(2),
        markerY: y.toFixed(2),
        markerT: t.toFixed(3),
      });
    }
  }

  /** @param {Canvas2D} context @param {import("./record.js").Moment} moment */
  #drawRobot(context, moment) {
    const { paint } = this;
    const colour = moment.localized && !moment.stale ? paint.robot : paint.lost;
    if (this.footprint.length) {
      context.beginPath();
      this.footprint.forEach((corner) =>
        context.lineTo(...this.#at(...mapFromRobot(moment, corner))),
      );
      context.closePath();
      context.strokeStyle = colour;
      context.lineWidth = 1.5;
      context.stroke();
    }
    const size = Math.max(SMALLEST, 0.25 * (this.view?.scale ?? 0));
    context.save();
    context.translate(...this.#at(moment.x, moment.y));
    context.rotate(-moment.theta);
    context.beginPath();
    context.moveTo(size, 0);
    context.lineTo(-0.7 * size, 0.65 * size);
    context.lineTo(-0.35 * size, 0);
    context.lineTo(-0.7 * size, -0.65 * size);
    context.closePath();
    context.fillStyle = colour;
    context.strokeStyle = paint.edge;
    context.lineWidth = 2;
    context.stroke();
    context.fill();
    context.restore();
  }
}
