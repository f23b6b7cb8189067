import assert from "node:assert/strict";
import { test } from "node:test";

import { createRelayRegions, questionFor } from "../../../static/js/protocol/relay_regions.js";

const STUN = { urls: ["stun:a.example.org"] };
const EU = {
  urls: ["turns:eu.example.org?transport=tcp", "turn:eu.example.org?transport=udp"],
  username: "u",
  credential: "c",
};
const US = { urls: ["turn:us.example.org:3479"], username: "u", credential: "c" };

/** @param {Record<string, number>} seconds */
const regions = (seconds) => {
  const asked = [];
  const measure = async (url) => {
    asked.push(url);
    return seconds[url] ?? Infinity;
  };
  return { asked, ...createRelayRegions(measure) };
};

test("the relays of the nearest region are used, and each is measured once", async () => {
  const { asked, nearest } = regions({
    "stun:eu.example.org": 0.2,
    "stun:us.example.org:3479": 0.1,
  });
  assert.deepEqual(await nearest([STUN, EU, US]), [STUN, US]);
  assert.deepEqual(await nearest([STUN, EU, US]), [STUN, US]);
  assert.deepEqual(asked, ["stun:eu.example.org", "stun:us.example.org:3479"]);
});

test("without any answer over UDP, all regions are used", async () => {
  const { nearest } = regions({});
  assert.deepEqual(await nearest([STUN, EU, US]), [STUN, EU, US]);
});

test("one region, or none, is not measured", () => {
  const { asked, nearest } = regions({});
  const servers = [STUN, EU];
  assert.equal(nearest(servers), servers);
  assert.deepEqual(asked, []);
});

test("a relay is measured over UDP only", () => {
  assert.equal(questionFor(EU), "stun:eu.example.org");
  assert.equal(questionFor({ urls: "turns:eu.example.org" }), null);
  assert.equal(questionFor({ urls: ["turn:eu.example.org?transport=tcp"] }), null);
});
