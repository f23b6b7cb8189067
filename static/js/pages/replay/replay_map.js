/**
 * The map of a replay: the driven path, coloured by time, and the robot's outline. data-marker-t on
 * the canvas is the time of the marker, for tests.
 */

import { stroke, trace } from "../../lib/canvas.js";
import { mapFromRobot } from "../../lib/transforms.js";
import { RobotMap } from "../../view/map/robot_map.js";
import { boundsOf, toScreen } from "../../view/map/transform.js";
import { piecesOf } from "./record.js";

const SHADES = 64; // colours of the path
const SMALLEST = 6.4; // CSS pixels, of the marker
// petrol at the beginning, apricot at the end
const HUES = { from: [118, 214, 200], to: [255, 138, 60] };

/** @param {number} share of the time @returns {string} */
const shade = (share) => {
  const step = Math.round(Math.min(Math.max(share, 0), 1) * (SHADES - 1)) / (SHADES - 1);
  const hue = HUES.from.map((from, i) => Math.round(from + step * (HUES.to[i] - from)));
  return `rgb(${hue.join(" ")})`;
};

export class ReplayMap extends RobotMap {
  /**
   * @param {HTMLCanvasElement} canvas @param {FloorPlan | null} site @param {SessionRecord} record
   * @param {Point[]} footprint m, in the robot's frame
   */
  constructor(canvas, site, record, footprint) {
    super({ canvas, frame: (draw) => draw() });
    this.record = record;
    this.footprint = footprint;
    this.pieces = piecesOf(record.states);
    /** @type {[import("./record.js").Moment | null, number]} */
    this.shown = [null, 0];
    const { x, y } = record.states;
    const path = x.map((each, i) => /** @type {Point} */ ([each, y[i]]));
    this.area = boundsOf(path.length ? path : EMPTY);
    if (site) {
      this.open(site);
    } else {
      this.resize();
    }
  }

  /** Of the site; without one, of the path. */
  get bounds() {
    return super.bounds ?? this.area;
  }

  /** @param {import("./record.js").Moment | null} moment @param {number} t s */
  setMoment(moment, t) {
    this.shown = [moment, t];
    this.redraw();
  }

  /** @param {Canvas2D} context @param {MapView} view @param {Paint} paint */
  drawStill(context, view, paint) {
    super.drawStill(context, view, paint);
    context.setTransform(this.density, 0, 0, this.density, 0, 0);
    context.lineJoin = context.lineCap = "round";
    for (const [first, last] of this.pieces) {
      this.#drawPiece(context, view, first, last);
    }
  }

  /**
   * One stroke for each shade.
   * @param {Canvas2D} context @param {MapView} view @param {number} first @param {number} last
   */
  #drawPiece(context, view, first, last) {
    const { t, x, y } = this.record.states;
    const colourAt = (/** @type {number} */ i) => shade(t[i] / this.record.duration);
    for (let begin = first, end = first; begin < last; begin = end) {
      const colour = colourAt(begin);
      const points = [toScreen(view, x[begin], y[begin])];
      while (end < last && colourAt(end) === colour) {
        end += 1;
        points.push(toScreen(view, x[end], y[end]));
      }
      trace(context, points);
      stroke(context, colour, 2.5);
    }
  }

  /** @param {Canvas2D} context @param {MapView} view @param {Paint} paint */
  drawMoving(context, view, paint) {
    const [moment, t] = this.shown;
    if (!moment) {
      return;
    }
    const colour = moment.localized && !moment.stale ? paint.robot : paint.lost;
    if (this.footprint.length) {
      trace(
        context,
        this.footprint.map((corner) => toScreen(view, ...mapFromRobot(moment, corner))),
      );
      context.closePath();
      stroke(context, colour, 1.5);
    }
    this.drawRobot(context, view, moment, Math.max(SMALLEST, 0.2 * view.scale), colour, paint.edge);
    this.canvas.dataset.markerT = t.toFixed(3);
  }
}

/** @type {Point[]} the bounds of a record without a state */
const EMPTY = [
  [-1, -1],
  [1, 1],
];
