import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { RoutePreview } from "../../../static/js/protocol/route_preview.js";

const rig = () => {
  const sent = [];
  return { sent, preview: new RoutePreview((request) => sent.push(request)) };
};
const answer = ({ requestId }, ...points) => ({ requestId, points, reason: "" });

describe("a question for a route", () => {
  test("is answered for its point alone, and by its own answer alone", () => {
    const { sent, preview } = rig();
    preview.ask([1, 2], 0);
    assert.deepEqual([sent[0].x, sent[0].y], [1, 2]);
    assert.equal(preview.answerFor([1, 2]), null);
    assert.equal(preview.heard(answer({ requestId: "another" }, [1, 2])), false);
    assert.equal(preview.heard(answer(sent[0], [0, 0], [1, 2])), true);
    assert.equal(preview.answerFor([1.05, 2]).points.length, 2);
    assert.equal(preview.answerFor([2, 2]), null);
  });

  test("is repeated under its id until it is answered", () => {
    const { sent, preview } = rig();
    preview.ask([1, 2], 0);
    preview.tick(0.5);
    assert.equal(sent.length, 1);
    preview.tick(0.8);
    assert.equal(sent[1].requestId, sent[0].requestId);
    preview.heard(answer(sent[0], [1, 2]));
    preview.tick(5);
    assert.equal(sent.length, 2);
  });

  test("is sent at most four times a second while the point moves, the last point surely", () => {
    const { sent, preview } = rig();
    for (let i = 0; i < 10; i += 1) {
      preview.ask([i, 0], i * 0.05);
    }
    assert.equal(sent.length, 2);
    preview.tick(0.6);
    assert.deepEqual([sent.length, sent[2].x], [3, 9]);
  });

  test("is not repeated once it is forgotten", () => {
    const { sent, preview } = rig();
    preview.ask([1, 2], 0);
    preview.forget();
    preview.tick(9);
    assert.equal(sent.length, 1);
    assert.equal(preview.answerFor([1, 2]), null);
  });
});
