/**
 * The map: floor plan, path driven, path ahead, laser points, the robot and its goal. It has two
 * layers: the still one is drawn once for each view, the robot over it whenever it moves. Both are
 * redrawn and never scaled, so that the map is sharp at any zoom and density of the screen.
 *
 * Tests read from the canvas where the marker was drawn: data-marker-x and -y in CSS pixels from
 * its corner, data-marker-stamp the time of that pose, data-view-x, -y, -scale, -turn the transform
 * of transform.js.
 */

import { stroke, fill, trace } from "../../lib/canvas.js";
import { createPaint } from "../../lib/colours.js";
import { loadImage } from "../../lib/dom.js";
import { fetchJson } from "../../lib/page_poll.js";
import { mapFromRobot } from "../../lib/transforms.js";
import { boundsOfSite, drawFloorPlan } from "./floor_plan.js";
import { drawAim, drawObstacle, drawPoints, drawUncertainty, scanPoints } from "./layers.js";
import { Trail } from "./trail.js";
import { ALL, moved, viewOf, zoomed } from "./pan_zoom.js";
import { toScreen, toWorld } from "./transform.js";

/** @typedef {Place & {localized: boolean, covariance?: number[] | null}} Pose */

const CLOCK_STEP = 5; // s
/** @type {Point[]} */
const NO_ROUTE = [];
const PATIENCE_MS = 60_000; // for a floor plan
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
    /** @type {Point[]} that the robot follows by itself */
    this.path = [];
    /** @type {Point[]} to the chosen point */
    this.route = NO_ROUTE;
    /** @type {Point[]} the last sweep of the laser, in the map */
    this.seen = [];
    this.laser = false;
    /** @type {import("./layers.js").Aim | null} the goal, or a position for the robot */
    this.aim = null;
    /**
     * @type {Record<"below" | "above", (context: Canvas2D, view: MapView, paint: Paint) => void>
     *   | null} what a study adds
     */
    this.course = null;
    /** @type {Point | null} of assistance, in the robot's frame */
    this.obstacle = null;
    /** @type {MapView | null} */
    this.view = null;
    this.size = { width: 0, height: 0, tools: 0 }; // CSS pixels
    this.density = 1;
    this.settings = ALL;
    this.drawn = ""; // the view of the still layer
    this.still = document.createElement("canvas");
    this.dirty = false;
    this.released = new AbortController();
    this.observer = new ResizeObserver(() => this.#fits() || this.resize());
    this.observer.observe(canvas);
    this.#watchDensity();
  }

  /** @param {FloorPlan | null} site @param {CanvasImageSource | null} image */
  show(site, image) {
    this.site = site;
    this.image = image;
    this.resize();
  }

  /** Shows a site; the image of one without a plan of rooms follows. @param {FloorPlan} site */
  open(site) {
    this.show(site, null);
    void imageOf(site).then((image) => image && this.show(site, image));
  }

  /**
   * Draws doors as they are.
   * @param {Record<string, string>} states open or closed, by name; a door without one stays as it
   *   is
   */
  setDoors(states) {
    const { site } = this;
    const doors = site?.plan?.doors ?? [];
    const changes = ({ name = "", state = "open" }) => states[name] && states[name] !== state;
    if (site && doors.some(changes)) {
      const moved = doors.map((/** @type {any} */ door) => ({
        ...door,
        state: states[door.name] ?? door.state,
      }));
      this.site = { ...site, plan: { ...site.plan, doors: moved } };
      this.drawn = "";
      this.redraw();
    }
  }

  /** Takes a path that was driven before this map was opened. @param {Iterable<Point>} points */
  setTrail(points) {
    this.trail = new Trail();
    for (const [x, y] of points) {
      this.trail.add(x, y);
    }
    this.redraw();
  }

  /** @param {Pose} pose @param {number} stamp */
  setPose(pose, stamp) {
    // Two transports bring the same poses; a much older one means that the robot's clock was set.
    if (stamp < this.stamp && this.stamp - stamp < CLOCK_STEP) {
      return;
    }
    this.pose = pose;
    this.stamp = stamp;
    if (pose.localized) {
      this.trail.add(pose.x, pose.y);
    }
    this.redraw();
  }

  /** @param {Point[]} points */
  setPath(points) {
    this.path = points;
    this.redraw();
  }

  /**
   * @param {Parameters<typeof scanPoints>[0]} scan
   * @param {{x: number, y?: number, theta?: number} | null} mount null draws none
   */
  setScan(scan, mount) {
    this.seen = this.pose?.localized && mount ? scanPoints(scan, mount, this.pose) : [];
    this.redraw();
  }

  /**
   * @param {{aim: import("./layers.js").Aim | null, route?: Point[], obstacle: Point | null,
   *   laser: boolean}} marks
   */
  setMarks({ aim, route = NO_ROUTE, obstacle, laser }) {
    const isSame = aim === this.aim && route === this.route;
    if (!isSame || obstacle !== this.obstacle || laser !== this.laser) {
      Object.assign(this, { aim, route, obstacle, laser });
      this.redraw();
    }
  }

  /** What a study adds, below and above the driven path. @param {RobotMap["course"]} course */
  setCourse(course) {
    this.course = course;
    this.redraw();
  }

  /**
   * @param {number} px CSS pixels from the canvas's corner @param {number} py
   * @returns {Point | null} metres; null without a map
   */
  worldAt(px, py) {
    return this.view && toWorld(this.view, px, py);
  }

  /**
   * @param {number} x metres @param {number} y
   * @returns {Point | null} CSS pixels from the canvas's corner; null without a map
   */
  screenAt(x, y) {
    return this.view && toScreen(this.view, x, y);
  }

  /** @param {Partial<import("./pan_zoom.js").ViewSettings>} change */
  setSettings(change) {
    this.settings = { ...this.settings, ...change };
    this.redraw();
  }

  /** @param {number} factor @param {number} [px] a fixed point, CSS pixels @param {number} [py] */
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
        this.resize();
        this.#watchDensity();
      },
      { once: true, signal: this.released.signal },
    );
  }

  /** Stops following the size of the canvas and the density of the screen. */
  release() {
    this.released.abort();
    this.observer.disconnect();
  }

  /** Whether it has its size already: an observer reports the first size, too. */
  #fits() {
    const { clientWidth, clientHeight } = this.canvas;
    return clientWidth === this.size.width && clientHeight === this.size.height;
  }

  /** What it shows, null without anything. @returns {import("./transform.js").Bounds | null} */
  get bounds() {
    return this.site && boundsOfSite(this.site);
  }

  /** Reads the size, which it does not with every frame: the browser would lay out the page. */
  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!this.bounds || !width || !height) {
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
    this.redraw();
  }

  #viewNow() {
    const { width, height, tools } = this.size;
    return this.bounds && width
      ? viewOf(this.settings, this.bounds, this.pose, width, height, tools)
      : this.view;
  }

  /** @param {Canvas2D} context @param {MapView} view @param {Paint} paint */
  drawStill(context, view, paint) {
    if (this.site) {
      drawFloorPlan(context, view, this.density, this.site, this.image, paint);
    }
  }

  redraw() {
    if (!this.dirty) {
      this.dirty = true;
      this.frame(() => this.#draw());
    }
  }

  #draw() {
    this.dirty = false;
    const [context, still] = [this.canvas.getContext("2d"), this.still.getContext("2d")];
    if (!context || !still || !this.view) {
      return;
    }
    const paint = this.paint();
    const view = this.#viewNow() ?? this.view;
    this.view = view;
    const key = JSON.stringify(view);
    if (key !== this.drawn) {
      this.drawn = key;
      clear(still);
      this.drawStill(still, view, paint);
    }
    clear(context);
    context.drawImage(this.still, 0, 0);
    context.setTransform(this.density, 0, 0, this.density, 0, 0);
    context.lineJoin = "round";
    context.lineCap = "round";
    this.drawMoving(context, view, paint);
  }

  /** @param {Canvas2D} context in CSS pixels @param {MapView} view @param {Paint} paint */
  drawMoving(context, view, paint) {
    const { pose } = this;
    this.course?.below(context, view, paint);
    this.trail.pieces.forEach((piece) => line(context, view, piece, paint.trail, 2.5, []));
    line(context, view, this.path, paint.path, 3, [6, 5]);
    line(context, view, this.route, paint.path, 3, [2, 5]);
    this.canvas.dataset.route = String(this.route.length);
    this.course?.above(context, view, paint);
    if (this.laser) {
      drawPoints(context, view, this.seen, paint.laser);
    }
    if (pose) {
      const colour = pose.localized ? paint.robot : paint.lost;
      drawUncertainty(context, view, pose, colour);
      const size = Math.max(SMALLEST_ROBOT, 0.34 * view.scale);
      this.drawRobot(context, view, pose, size, colour, paint.edge);
      this.canvas.dataset.markerStamp = String(this.stamp);
    }
    if (this.aim) {
      drawAim(context, view, this.aim, paint.path, paint.edge);
    }
    if (this.obstacle && pose?.localized) {
      drawObstacle(context, view, mapFromRobot(pose, this.obstacle), paint.obstacle);
    }
  }

  /**
   * @param {Canvas2D} context @param {MapView} view @param {Place} pose
   * @param {number} size CSS pixels @param {string} colour @param {string} edge
   */
  drawRobot(context, view, { x, y, theta }, size, colour, edge) {
    const [px, py] = toScreen(view, x, y);
    context.save();
    context.translate(px, py);
    context.rotate(-theta - (view.turn ?? 0));
    context.beginPath();
    context.moveTo(1.25 * size, 0);
    context.lineTo(-0.85 * size, 0.8 * size);
    context.lineTo(-0.45 * size, 0);
    context.lineTo(-0.85 * size, -0.8 * size);
    context.closePath();
    stroke(context, edge, 2);
    fill(context, colour);
    context.restore();
    Object.assign(this.canvas.dataset, {
      markerX: px.toFixed(3),
      markerY: py.toFixed(3),
      markerTheta: theta.toFixed(4),
      viewX: String(view.x),
      viewY: String(view.y),
      viewScale: String(view.scale),
      viewTurn: String(view.turn ?? 0),
    });
  }
}

/** @param {Canvas2D} context */
const clear = (context) => {
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, context.canvas.width, context.canvas.height);
};

/**
 * @param {Canvas2D} context @param {MapView} view @param {Point[]} points
 * @param {string} colour @param {number} width @param {number[]} dash
 */
const line = (context, view, points, colour, width, dash) => {
  if (points.length > 1) {
    trace(
      context,
      points.map(([x, y]) => toScreen(view, x, y)),
    );
    stroke(context, colour, width, dash);
  }
};

/** The image of a site that has no plan of rooms. @param {FloorPlan} site */
const imageOf = async ({ plan, image }) =>
  plan?.rooms?.length || !image ? null : loadImage(image);

/**
 * Fetches a floor plan and, when it has no plan of rooms, its image.
 * @param {string} url @returns {Promise<{site: FloorPlan, image: HTMLImageElement | null}>}
 */
export const loadFloorPlan = async (url) => {
  const site = await fetchJson(url, PATIENCE_MS);
  return { site, image: await imageOf(site) };
};
