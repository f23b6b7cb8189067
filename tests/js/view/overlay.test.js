import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { describe, test } from "node:test";

import { Track, along, robotFromMap, mapFromRobot } from "../../../static/js/lib/transforms.js";
import {
  boxOf,
  depthOf,
  fromElement,
  sideOf,
  toElement,
  toFloor,
  toPicture,
} from "../../../static/js/view/overlay/camera_model.js";
import { answerTo } from "../../../static/js/view/overlay/press_answer.js";
import { hidesWall, obstacleBefore } from "../../../static/js/view/overlay/visibility.js";
import {
  arcSteps,
  heldSteps,
  lineSteps,
  reachOf,
  sweep,
} from "../../../static/js/lib/swept_path.js";

const TRUTH = JSON.parse(
  readFileSync(new URL("../../golden/projection.json", import.meta.url), "utf8"),
);
const GIRAFF = TRUTH.giraff;
const LIMITS = {
  linearAcceleration: 0.2,
  linearBraking: 0.8,
  angularAcceleration: 0.4,
  angularBraking: 1.6,
};
const ORIGIN = { x: 0, y: 0, theta: 0, tilt: 0, linear: 0, angular: 0, stamp: 0, localized: true };
const close = (one, other, within) =>
  assert.ok(
    Math.hypot(one[0] - other[0], one[1] - other[1]) <= within,
    `${one} is not within ${within} of ${other}`,
  );

describe("the sides of the video", () => {
  const PICTURE = { width: 640, height: 480 };

  test("are a finger wide at least, and include the bars beside it", () => {
    const wide = boxOf(PICTURE, 1000, 480, "contain"); // 180 px beside it on either side
    assert.deepEqual(
      [20, 200, 230, 500, 770, 800, 999].map((px) => sideOf(wide, PICTURE, px)),
      [1, 1, 0, 0, 0, -1, -1],
    );
  });

  test("are those of the visible part of a cut video", () => {
    const narrow = boxOf(PICTURE, 390, 400, "cover");
    assert.deepEqual(
      [0, 43, 45, 345, 347].map((px) => sideOf(narrow, PICTURE, px)),
      [1, 1, 0, 0, -1],
    );
  });
});

describe("lens", () => {
  for (const [series, { camera, cases }] of Object.entries(TRUTH)) {
    test(`a pixel of ${series} is where its simulator draws it, within 2 cm and 2 %`, () => {
      assert.ok(cases.length >= 250);
      for (const {
        pose: [x, y, theta],
        tilt,
        pixel,
        floor,
      } of cases) {
        const found = mapFromRobot({ x, y, theta }, toFloor(camera, tilt, pixel));
        close(found, floor, 0.02 + 0.02 * Math.hypot(floor[0] - x, floor[1] - y));
        const back = toPicture(camera, tilt, robotFromMap({ x, y, theta }, floor));
        close(back, pixel, 0.5);
      }
    });
  }

  test("there is no floor at the horizon and above, and no depth behind the lens", () => {
    const { pitch, ...level } = GIRAFF.camera;
    assert.equal(pitch, 0, "what is the usual is left out of messages");
    assert.equal(toFloor(level, 0, [320, 240]), null);
    assert.equal(toFloor(level, 0.3, [320, 60]), null);
    assert.ok(toFloor(level, 0.3, [320, 240])[0] > 3);
    assert.ok(depthOf(level, 0, [-1, 0]) < 0);
  });

  test("a video is located in its element, with bars or with cut edges", () => {
    const contained = boxOf({ width: 640, height: 480 }, 1000, 480, "contain");
    assert.deepEqual(contained, { left: 180, top: 0, scale: 1, width: 1000, height: 480 });
    const covering = boxOf({ width: 640, height: 480 }, 1280, 800, "cover");
    assert.deepEqual([covering.left, covering.top, covering.scale], [0, -80, 2]);
    close(fromElement(covering, toElement(covering, [123, 45])), [123, 45], 1e-9);
  });
});

describe("track", () => {
  const said = (stamp, x, tilt = 0, theta = 0) => ({
    stamp,
    pose: { x, y: 0, theta, localized: true },
    velocity: { linear: 1, angular: 0 },
    tilt,
  });

  test("knows whether the angle of the head is known", () => {
    const track = new Track();
    track.add(said(1, 0, null));
    assert.equal(track.at(null).aimed, false);
    track.add(said(1.1, 0, 0));
    assert.equal(track.at(1.05).aimed, true);
  });

  test("has pose and tilt of the time of a frame", () => {
    const track = new Track();
    track.add(said(10, 0, 0.1, 3.1));
    track.add(said(10.2, 0.2, 0.3, -3.1));
    const then = track.at(10.05);
    assert.ok(Math.abs(then.x - 0.05) < 1e-9 && Math.abs(then.tilt - 0.15) < 1e-9);
    assert.ok(Math.abs(Math.cos(then.theta - 3.1208)) > 0.9999, "the shorter way round");
    assert.ok(Math.abs(track.at(10.3).x - 0.1) < 0.001, "carried on by its velocity");
    assert.ok(Math.abs(track.at(99).x + 0.05) < 0.001, "but not for long");
    assert.equal(track.at(null).x, 0.2);
  });

  test("takes each pose once, drops the oldest, restarts when the clock was set", () => {
    const track = new Track();
    for (let i = 0; i < 200; i += 1) {
      track.add(said(10 + i / 30, i));
      track.add(said(10 + i / 30, -1));
    }
    assert.equal(track.moments.length, 90);
    assert.equal(track.newest.x, 199);
    track.add(said(1, 5));
    assert.deepEqual(
      track.moments.map(({ x }) => x),
      [5],
    );
    assert.equal(new Track().at(3), null);
  });
});

describe("the swept path", () => {
  test("an arc ends where driving it ends", () => {
    const [linear, angular] = [0.5, 0.4];
    let place = { x: 0, y: 0, theta: 0 };
    for (let i = 0; i < 3000; i += 1) {
      place = {
        x: place.x + (linear / 1000) * Math.cos(place.theta),
        y: place.y + (linear / 1000) * Math.sin(place.theta),
        theta: place.theta + angular / 1000,
      };
    }
    const end = along({ x: 0, y: 0, theta: 0 }, linear, angular, 3);
    close([end.x, end.y], [place.x, place.y], 0.002);
    const last = arcSteps({ x: 0, y: 0, theta: 0 }, angular / linear, 1.5).at(-1);
    close([last.x, last.y], [end.x, end.y], 1e-9);
  });

  for (const [series, { drives, limits }] of Object.entries(TRUTH)) {
    test(`a held command leads where the simulated ${series} gets, within 10 cm`, () => {
      const own = Object.fromEntries(
        Object.entries(limits).map(([name, value]) => [
          name.replace(/_(.)/g, (_, letter) => letter.toUpperCase()),
          value,
        ]),
      );
      for (const {
        begin: [linear, angular],
        told,
        end,
      } of drives) {
        const last =
          heldSteps(
            { ...ORIGIN, linear, angular },
            { linear: told[0], angular: told[1] },
            own,
            2.5,
          ).at(-1) ?? ORIGIN;
        close([last.x, last.y], end, 0.1);
      }
    });
  }

  test("a robot that turns on the spot sweeps no path", () => {
    assert.deepEqual(heldSteps(ORIGIN, { linear: 0, angular: 0.6 }, LIMITS, 2.5), []);
  });

  test("no corner of the footprint leaves the swept path, straight on and in curves", () => {
    for (const curvature of [-4, -1.2, -0.3, 0, 0.3, 1.2, 4]) {
      const [left, right] = reachOf(GIRAFF.footprint, curvature);
      const radius = curvature ? 1 / curvature : 0;
      for (const [x, y] of GIRAFF.footprint) {
        const aside = curvature
          ? Math.sign(radius) * (Math.abs(radius) - Math.hypot(x, y - radius))
          : y;
        assert.ok(
          aside <= left + 1e-9 && aside >= -right - 1e-9,
          `${curvature}: ${aside} in ${left}, ${right}`,
        );
      }
    }
    assert.deepEqual(reachOf(GIRAFF.footprint, 0), [0.28, 0.28]);
  });

  test("a path ends before an obstacle, and has the clearance beside it", () => {
    const steps = arcSteps(ORIGIN, 0, 3);
    const free = sweep(steps, GIRAFF.footprint, []);
    assert.equal(free.blocked, false);
    assert.ok(Math.abs(free.length - 3) < 1e-9);
    assert.equal(free.slices.at(-1).left[0], 3.32, "its front is before its middle");
    const wall = sweep(steps, GIRAFF.footprint, [[2, 0.1]]);
    assert.equal(wall.blocked, true);
    assert.ok(wall.length > 1.5 && wall.length <= 1.68, `${wall.length}`);
    const post = sweep(steps, GIRAFF.footprint, [[1.5, 0.4]]);
    assert.equal(post.blocked, false);
    assert.ok(Math.abs(Math.min(...post.slices.map(({ clearance }) => clearance)) - 0.12) < 1e-9);
    const back = sweep(arcSteps(ORIGIN, 0, -1), GIRAFF.footprint, [[-0.9, 0]], -1);
    assert.ok(back.blocked && back.length < 0.7);
  });

  test("a followed line is shown from the robot on", () => {
    const steps = lineSteps({ x: 1, y: 0.05, theta: 0 }, [
      [0, 0],
      [1, 0],
      [2, 0],
      [2, 1],
    ]);
    assert.deepEqual(
      steps.map(({ x, y }) => [x, y]),
      [
        [2, 0],
        [2, 1],
      ],
    );
    assert.deepEqual(lineSteps({ x: 0, y: 0, theta: 0 }, []), []);
    assert.equal(sweep([], GIRAFF.footprint, []), null);
  });
});

describe("visibility", () => {
  const plan = {
    walls: [{ start: [0, 2], end: [4, 2] }],
    doors: [{ start: [1, 2.02], end: [2, 2.02] }],
  };

  test("walls hide points, doorways do not", () => {
    assert.equal(hidesWall(plan, [3, 0], [3, 4]), true);
    assert.equal(hidesWall(plan, [1.5, 0], [1.5, 4]), false);
    assert.equal(hidesWall(plan, [1.5, 0], [1.5, 1.5]), false);
    assert.equal(hidesWall(null, [0, 0], [9, 9]), false);
  });

  test("a point beyond an obstacle of the laser is behind it", () => {
    const seen = [
      [2, -0.05],
      [2, 0.02],
      [2, 0.06],
    ];
    assert.ok(Math.abs(obstacleBefore(seen, [3, 0]) - 2) < 0.01);
    assert.equal(obstacleBefore(seen, [1.5, 0]), Infinity);
    assert.equal(obstacleBefore(seen, [2.1, 0]), Infinity);
    assert.equal(obstacleBefore(seen, [3, 1]), Infinity);
    assert.equal(obstacleBefore([], [3, 0]), Infinity);
  });
});

describe("a press that does not lead straight ahead", () => {
  const close = { no: "close", point: [2, 0] };
  const wall = { no: "wall", point: [2, 0], hidden: true };
  const cut = { goal: [1.2, 0], point: [2, 0], cut: true, sweptPath: null };
  const route = (...points) => ({ points: [[0, 0], ...points], reason: "" });

  test("is driven to when the robot has a route to the point", () => {
    assert.deepEqual(answerTo(close, route([1, 1], [2, 0]), ORIGIN), { go: [2, 0] });
    assert.deepEqual(answerTo(cut, route([1, 1], [1.8, 0]), ORIGIN), { go: [1.8, 0] });
  });

  test("is only offered when the route is much longer, or ends beside the point", () => {
    const round = answerTo(close, route([0, 4], [2, 4], [2, 0]), ORIGIN);
    assert.deepEqual(round, { word: "point.around", goal: [2, 0] });
    const beside = { ...route([1.4, 0]), reason: "goal_taken" };
    assert.deepEqual(answerTo(close, beside, ORIGIN), { word: "point.beside", goal: [1.4, 0] });
    assert.deepEqual(answerTo(wall, route([1.9, 0]), ORIGIN).goal, [1.9, 0]);
  });

  test("ends before the obstacle where no route leads to the point", () => {
    for (const found of [null, route([1.4, 0]), { points: [], reason: "no_way" }]) {
      assert.deepEqual(answerTo(cut, found, ORIGIN), { straight: [1.2, 0] });
    }
  });

  test("says why, and offers nothing, where the robot can't go or is already", () => {
    const shut = { points: [], reason: "door_closed: Laboratory door" };
    const said = { word: "reason.door_closed", values: { what: "Laboratory door" }, goal: null };
    assert.deepEqual(answerTo(wall, shut, ORIGIN), said);
    const here = { ...route([0.2, 0]), reason: "goal_taken" };
    assert.deepEqual(answerTo(close, here, ORIGIN), { word: "point.nearest", goal: null });
    assert.deepEqual(answerTo({ no: "sky" }, null, ORIGIN), { word: "point.sky", goal: null });
  });
});
