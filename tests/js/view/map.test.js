import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { boundsOfSite } from "../../../static/js/view/map/floor_plan.js";
import { ALL, NEAREST, moved, viewOf, zoomed } from "../../../static/js/view/map/pan_zoom.js";
import { Trail } from "../../../static/js/view/map/trail.js";
import {
  boundsOf,
  fit,
  imageTransform,
  toScreen,
  toWorld,
} from "../../../static/js/view/map/transform.js";

const BOUNDS = { left: -0.2, bottom: -0.2, right: 12.2, top: 7.8 };
const close = (actual, expected, tolerance = 1e-9) =>
  actual.forEach((value, i) =>
    assert.ok(Math.abs(value - expected[i]) <= tolerance, `${actual} is not ${expected}`),
  );

test("to the screen and back is the same point", () => {
  const view = fit(BOUNDS, 344, 500);
  for (const point of [
    [0, 0],
    [3.2, 4.6],
    [-7, 30],
  ]) {
    close(toWorld(view, ...toScreen(view, ...point)), point);
  }
});

test("y of the world points up on the screen", () => {
  const view = fit(BOUNDS, 344, 500);
  assert.ok(toScreen(view, 0, 1)[1] < toScreen(view, 0, 0)[1]);
});

test("a fitted view shows everything with its margin, centred and undistorted", () => {
  for (const [width, height] of [
    [344, 500],
    [160, 170],
    [900, 100],
  ]) {
    const view = fit(BOUNDS, width, height, 10);
    const [left, bottom] = toScreen(view, BOUNDS.left, BOUNDS.bottom);
    const [right, top] = toScreen(view, BOUNDS.right, BOUNDS.top);
    assert.ok(
      left >= 10 - 1e-9 &&
        right <= width - 10 + 1e-9 &&
        top >= 10 - 1e-9 &&
        bottom <= height - 10 + 1e-9,
    );
    close([(left + right) / 2, (top + bottom) / 2], [width / 2, height / 2]);
    assert.ok(Math.min(left, height - bottom) <= 10 + 1e-9);
  }
});

test("an empty view without a size is still a view", () => {
  assert.ok(fit({ left: 1, bottom: 1, right: 1, top: 1 }, 0, 0).scale > 0);
});

test("an image of a map is placed as ROS defines, also with a turned origin", () => {
  const view = fit(BOUNDS, 344, 500);
  for (const theta of [0, 0.5, -2]) {
    const map = { resolution: 0.05, origin: [-0.3, -0.4, theta], height: 164 };
    const [a, b, c, d, e, f] = imageTransform(view, map, 2);
    for (const [u, v] of [
      [0, 164],
      [0, 0],
      [252, 37],
    ]) {
      // robots.api.geometry.MapTransform.to_world
      const [right, up] = [u * 0.05, (164 - v) * 0.05];
      const world = [
        -0.3 + right * Math.cos(theta) - up * Math.sin(theta),
        -0.4 + right * Math.sin(theta) + up * Math.cos(theta),
      ];
      close(
        [a * u + c * v + e, b * u + d * v + f],
        toScreen(view, ...world).map((pixel) => 2 * pixel),
        1e-6,
      );
    }
  }
});

test("a site is as large as its rooms, or as its image without a plan", () => {
  const grid = { resolution: 0.5, origin: [1, 2, 0], width: 4, height: 6 };
  assert.deepEqual(
    boundsOfSite({
      ...grid,
      plan: {
        rooms: [
          {
            polygon: [
              [0, 0],
              [3, 0],
              [3, 2],
            ],
          },
        ],
      },
    }),
    { left: 0, bottom: 0, right: 3, top: 2 },
  );
  assert.deepEqual(boundsOfSite({ ...grid, plan: {} }), { left: 1, bottom: 2, right: 3, top: 5 });
  assert.deepEqual(
    boundsOf([
      [1, 5],
      [-2, 3],
    ]),
    { left: -2, bottom: 3, right: 1, top: 5 },
  );
});

test("the trail keeps a point every few centimetres and breaks where the robot jumped", () => {
  const trail = new Trail();
  for (let x = 0; x < 1; x += 0.01) {
    trail.add(x, 0);
  }
  assert.ok(trail.length > 8 && trail.length < 15);
  trail.add(8, 4);
  assert.equal(trail.pieces.length, 2);
});

test("the trail drops its oldest points", () => {
  const trail = new Trail();
  for (let i = 0; i < 5000; i += 1) {
    trail.add(i * 0.1, 0);
  }
  assert.equal(trail.length, 3000);
  assert.ok(Math.abs(trail.pieces[0][0][0] - 200) < 1e-6);
});

describe("moving the map", () => {
  const bounds = { left: 0, right: 12, bottom: 0, top: 8 };
  const robot = { x: 2, y: 3, theta: 0.5 };
  const view = (look) => viewOf({ ...ALL, ...look }, bounds, robot, 400, 300, 48);

  test("a turned map is moved correctly, with the robot's heading up", () => {
    const turned = view({ zoom: 3, follows: true, turns: true });
    assert.deepEqual(toScreen(turned, robot.x, robot.y), [200, 150]);
    const [x, y] = toScreen(
      turned,
      robot.x + Math.cos(robot.theta),
      robot.y + Math.sin(robot.theta),
    );
    assert.ok(Math.abs(x - 200) < 1e-9 && y < 150);
    const [px, py] = toScreen(turned, ...toWorld(turned, 37, 91));
    assert.ok(Math.hypot(px - 37, py - 91) < 1e-9);
  });

  test("zooming keeps the point under the cursor, and ends at the whole map", () => {
    const whole = view({});
    const under = toWorld(whole, 120, 80);
    const nearer = zoomed(ALL, whole, bounds, 2, 120, 80);
    const [px, py] = toScreen(view(nearer), ...under);
    assert.ok(Math.hypot(px - 120, py - 80) < 1e-9);
    assert.equal(zoomed({ ...ALL, ...nearer }, view(nearer), bounds, 1e9).zoom, NEAREST);
    assert.deepEqual(zoomed({ ...ALL, ...nearer }, view(nearer), bounds, 0.01), {
      zoom: 1,
      x: null,
      y: null,
    });
  });

  test("moving the map by hand ends following, and never loses the map", () => {
    const near = view({ zoom: 4, follows: true });
    const there = moved(near, bounds, -30, 0);
    assert.equal(there.follows, false);
    assert.ok(Math.abs(there.x - (robot.x + 30 / near.scale)) < 1e-9);
    assert.deepEqual(moved(near, bounds, 1e6, 1e6), { follows: false, x: 0, y: 8 });
    assert.deepEqual(
      zoomed({ ...ALL, follows: true }, near, bounds, 1.5),
      { zoom: 1.5 },
      "the robot stays in the middle",
    );
  });
});
