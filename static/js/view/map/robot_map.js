/**
 * The map: floor plan, path driven, path ahead, what the laser sees, where the robot is and where
 * it shall go. Two canvases in one: the still part is drawn once a view into a picture of its own,
 * the robot over it whenever it moves. Sharp at any density of the screen and any zoom: nothing is
 * scaled, everything is redrawn.
 *
 * Tests read on the canvas where the marker was drawn: data-marker-x and -y in
 * CSS pixels from its corner, data-marker-stamp the stamp of that pose, data-view-x, -y, -scale,
 * -turn the transform of transform.js.
 */

import { createPaint } from "../../lib/colours.js";
import { mapFromRobot } from "../../lib/transforms.js";
import { boundsOfSite, drawFloorPlan } from "./floor_plan.js";
import { drawAim, drawObstacle, drawPoints, drawUncertainty, scanPoints } from "./layers.js";
import { Trail } from "./trail.js";
import { ALL, moved, viewOf, zoomed } from "./pan_zoom.js";
import { toScreen, toWorld } from "./transform.js";

/**
 * @typedef {{x: number, y: number, theta: number, localized: boolean,
 *   covariance?: number[] | null}} Pose
 */

const CLOCK_STEP = 5; // s
// custom properties of map.css, behind --map-
const COLOURS = [
  ...["floor", "wall", "furniture", "door", "dock", "name", "trail", "path", "laser", "obstacle"],
  ...["robot", "lost", "edge", "zone", "route", "next", "passed"],
];
const SMALLEST_ROBOT = 9; // CSS pixels from the marker's middle to its tip

export class RobotMap {
  /**
   * @param {{canvas: HTMLCanvasElement, tools?: (canvas: HTMLCanvasElement) => number,
   *   frame?: (callback: () => void) => unknown}} options tools: CSS pixels at its upper edge that
   *   buttons take
   */
  constructor({ canvas, tools = () => 0, frame = (callback) => requestAnimationFrame(callback) }) {
    this.canvas = canvas;
    this.paint = createPaint(canvas, "--map-", COLOURS, "600 12px");
    this.tools = tools;
    this.frame = frame;
    this.trail = new Trail();
    /** @type {FloorPlan | null} */
    this.site = null;
    /** @type {CanvasImageSource | null} */
    this.image = null;
    /** @type {Pose | null} */
    this.pose = null;
    this.stamp = 0;
    /** @type {Point[]} what the robot follows by itself */
    this.path = [];
    /** @type {Point[]} what the laser saw last, in the map */
    this.seen = [];
    this.laser = false;
    /** @type {import("./layers.js").Aim | null} where the robot is to go, or is said to be */
    this.aim = null;
    /**
     * @type {Record<"below" | "above", (context: Canvas2D, view: MapView, paint:
     *   Record<string, string>) => void> | null} what a study adds
     */
    this.course = null;
    /** @type {Point | null} what the assistance minds, in the robot's frame */
    this.obstacle = null;
    /** @type {MapView | null} */
    this.view = null;
    this.size = { width: 0, height: 0, tools: 0 }; // CSS pixels
    this.density = 1;
    /** what part of it is looked at */
    this.settings = ALL;
    this.drawn = ""; // the view that the still part was drawn for
    this.still = document.createElement("canvas");
    this.dirty = false;
    this.released = new AbortController();
    this.observer = new ResizeObserver(() => this.#resize());
    this.observer.observe(canvas);
    this.#watchDensity();
  }

  /** @param {FloorPlan} site @param {CanvasImageSource | null} image */
  show(site, image) {
    this.site = site;
    this.image = image;
    this.#resize();
  }

  /**
   * Draw doors as they are.
   * @param {Record<string, string>} states open or closed, by name; a door without one stays as it
   *   is
   */
  setDoors(states) {
    const { site } = this;
    const doors = site?.plan?.doors ?? [];
    if (
      site &&
      doors.some(
        (/** @type {any} */ { name, state }) => states[name] && states[name] !== (state ?? "open"),
      )
    ) {
      const moved = doors.map((/** @type {any} */ door) => ({
        ...door,
        state: states[door.name] ?? door.state,
      }));
      this.site = { ...site, plan: { ...site.plan, doors: moved } };
      this.drawn = "";
      this.#redraw();
    }
  }

  /** Take a path that was driven before this map was opened. @param {Iterable<Point>} points */
  setTrail(points) {
    this.trail = new Trail();
    for (const [x, y] of points) {
      this.trail.add(x, y);
    }
    this.#redraw();
  }

  /** @param {Pose} pose @param {number} stamp */
  setPose(pose, stamp) {
    // Two ways bring the same poses; much older means that the robot's clock was set.
    if (stamp < this.stamp && this.stamp - stamp < CLOCK_STEP) {
      return;
    }
    this.pose = pose;
    this.stamp = stamp;
    if (pose.localized) {
      this.trail.add(pose.x, pose.y);
    }
    this.#redraw();
  }

  /** @param {Point[]} points */
  setPath(points) {
    this.path = points;
    this.#redraw();
  }

  /**
   * @param {Parameters<typeof scanPoints>[0]} scan
   * @param {{x: number, y?: number, theta?: number} | null} mount null draws none
   */
  setScan(scan, mount) {
    this.seen = this.pose?.localized && mount ? scanPoints(scan, mount, this.pose) : [];
    this.#redraw();
  }

  /**
   * @param {{aim: import("./layers.js").Aim | null, obstacle: Point | null, laser: boolean}} marks
   */
  setMarks({ aim, obstacle, laser }) {
    if (aim !== this.aim || obstacle !== this.obstacle || laser !== this.laser) {
      Object.assign(this, { aim, obstacle, laser });
      this.#redraw();
    }
  }

  /**
   * What a study adds, below and above the path that was driven.
   * @param {RobotMap["course"]} course
   */
  setCourse(course) {
    this.course = course;
    this.#redraw();
  }

  /**
   * @param {number} px CSS pixels from the canvas's corner
   * @param {number} py
   * @returns {Point | null} metres; null before there is a map
   */
  worldAt(px, py) {
    return this.view && toWorld(this.view, px, py);
  }

  /** @param {Partial<import("./pan_zoom.js").ViewSettings>} change */
  setSettings(change) {
    this.settings = { ...this.settings, ...change };
    this.#redraw();
  }

  /**
   * Look nearer or from farther away.
   * @param {number} factor
   * @param {number} [px] what stays where it is, CSS pixels
   * @param {number} [py]
   */
  zoom(factor, px, py) {
    if (this.view && this.site) {
      this.setSettings(zoomed(this.settings, this.view, boundsOfSite(this.site), factor, px, py));
    }
  }

  /** @param {number} dx CSS pixels that the map moves by @param {number} dy */
  pan(dx, dy) {
    if (this.view && this.site) {
      this.setSettings(moved(this.view, boundsOfSite(this.site), dx, dy));
    }
  }

  #watchDensity() {
    const query = matchMedia(`(resolution: ${devicePixelRatio}dppx)`);
    query.addEventListener(
      "change",
      () => {
        this.#resize();
        this.#watchDensity();
      },
      { once: true, signal: this.released.signal },
    );
  }

  /** Stop following the size of the canvas and the density of the screen. */
  release() {
    this.released.abort();
    this.observer.disconnect();
  }

  /** Asked for here alone: to ask with every frame would have the browser lay out the page. */
  #resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!this.site || !width || !height) {
      return;
    }
    this.density = devicePixelRatio;
    this.drawn = "";
    this.size = { width, height, tools: this.tools(this.canvas) };
    this.view = this.#viewNow();
    for (const canvas of [this.canvas, this.still]) {
      canvas.width = Math.round(width * this.density);
      canvas.height = Math.round(height * this.density);
    }
    this.#redraw();
  }

  #viewNow() {
    const { width, height, tools } = this.size;
    return this.site && width
      ? viewOf(this.settings, boundsOfSite(this.site), this.pose, width, height, tools)
      : this.view;
  }

  /** @param {Paint} paint */
  #drawStill(paint) {
    const context = this.still.getContext("2d");
    const key = JSON.stringify(this.view);
    if (context && this.view && this.site && key !== this.drawn) {
      this.drawn = key;
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.clearRect(0, 0, this.still.width, this.still.height);
      drawFloorPlan(context, this.view, this.density, this.site, this.image, paint);
    }
  }

  #redraw() {
    if (!this.dirty) {
      this.dirty = true;
      this.frame(() => this.#draw());
    }
  }

  #draw() {
    this.dirty = false;
    const context = this.canvas.getContext("2d");
    if (!context || !this.view) {
      return;
    }
    const paint = this.paint();
    this.view = this.#viewNow() ?? this.view;
    this.#drawStill(paint);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    context.drawImage(this.still, 0, 0);
    context.setTransform(this.density, 0, 0, this.density, 0, 0);
    context.lineJoin = "round";
    context.lineCap = "round";
    this.course?.below(context, this.view, paint);
    this.trail.pieces.forEach((piece) => this.#line(context, piece, paint.trail, 2.5, []));
    this.#line(context, this.path, paint.path, 3, [6, 5]);
    this.course?.above(context, this.view, paint);
    if (this.laser) {
      drawPoints(context, this.view, this.seen, paint.laser);
    }
    if (this.pose) {
      drawUncertainty(
        context,
        this.view,
        this.pose,
        this.pose.localized ? paint.robot : paint.lost,
      );
    }
    this.#marker(context, paint);
    if (this.aim) {
      drawAim(context, this.view, this.aim, paint.path, paint.edge);
    }
    if (this.obstacle && this.pose?.localized) {
      drawObstacle(context, this.view, mapFromRobot(this.pose, this.obstacle), paint.obstacle);
    }
  }

  /**
   * @param {Canvas2D} context @param {Point[]} points
   * @param {string} colour @param {number} width @param {number[]} dash
   */
  #line(context, points, colour, width, dash) {
    if (points.length < 2 || !this.view) {
      return;
    }
    context.beginPath();
    for (const [x, y] of points) {
      context.lineTo(...toScreen(this.view, x, y));
    }
    context.setLineDash(dash);
    context.lineWidth = width;
    context.strokeStyle = colour;
    context.stroke();
    context.setLineDash([]);
  }

  /** @param {Canvas2D} context @param {Paint} paint */
  #marker(context, paint) {
    if (!this.pose || !this.view) {
      return;
    }
    const [x, y] = toScreen(this.view, this.pose.x, this.pose.y);
    const size = Math.max(SMALLEST_ROBOT, 0.34 * this.view.scale);
    context.save();
    context.translate(x, y);
    context.rotate(-this.pose.theta - (this.view.turn ?? 0));
    context.beginPath();
    context.moveTo(1.25 * size, 0);
    context.lineTo(-0.85 * size, 0.8 * size);
    context.lineTo(-0.45 * size, 0);
    context.lineTo(-0.85 * size, -0.8 * size);
    context.closePath();
    context.fillStyle = this.pose.localized ? paint.robot : paint.lost;
    context.strokeStyle = paint.edge;
    context.lineWidth = 2;
    context.stroke();
    context.fill();
    context.restore();
    Object.assign(this.canvas.dataset, {
      markerX: x.toFixed(3),
      markerY: y.toFixed(3),
      markerTheta: this.pose.theta.toFixed(4),
      markerStamp: String(this.stamp),
      viewX: String(this.view.x),
      viewY: String(this.view.y),
      viewScale: String(this.view.scale),
      viewTurn: String(this.view.turn ?? 0),
    });
  }
}

/**
 * Fetch a floor plan and, when it has no plan of rooms, its image.
 * @param {string} url @returns {Promise<{site: FloorPlan, image: HTMLImageElement | null}>}
 */
export const loadFloorPlan = async (url) => {
  const response = await fetch(url, { credentials: "same-origin" });
  if (!response.ok) {
    throw new Error(`floor plan: ${response.status}`);
  }
  const site = await response.json();
  if (site.plan?.rooms?.length || !site.image) {
    return { site, image: null };
  }
  const image = new Image();
  image.src = site.image;
  await image.decode();
  return { site, image };
};
