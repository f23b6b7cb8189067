/**
 * A picture of a session to keep: the map with the driven path, distance and time, and the
 * visitor's photos. Drawn in the browser and not uploaded.
 */

import { loadImage } from "../lib/dom.js";
import { fetchJson } from "../lib/page_poll.js";
import { RobotMap } from "../view/map/robot_map.js";

const WIDTH = 1200; // pixels of the picture
const MARGIN = 40;
const HEAD = 130;
const MAP_HEIGHT = 760;
const PHOTO_WIDTH = (WIDTH - 4 * MARGIN) / 3;
const PHOTO_HEIGHT = (PHOTO_WIDTH * 3) / 4;
const MOST_PHOTOS = 9;

/** @typedef {{session: string, metres: number, minutes: number, trail: Point[][]}} Trip */

/**
 * Draws the picture and has the browser save it.
 * @param {Pick<Page, "config" | "words" | "map">} page @param {Trip} trip
 */
export const saveSouvenir = async ({ config, words, map }, trip) => {
  const photos = await ownPhotos(config.snapshots, trip.session);
  const ground = map.site ? MAP_HEIGHT : 0;
  const rows = Math.ceil(photos.length / 3);
  const canvas = document.createElement("canvas");
  canvas.width = WIDTH;
  canvas.height = HEAD + (ground && ground + MARGIN) + rows * (PHOTO_HEIGHT + MARGIN);
  const context = /** @type {Canvas2D} */ (canvas.getContext("2d"));
  const style = getComputedStyle(document.body);
  context.fillStyle = style.backgroundColor;
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.fillStyle = style.color;
  context.textBaseline = "top";
  context.font = `600 44px ${style.fontFamily}`;
  context.fillText(config.title, MARGIN, 28, WIDTH - 2 * MARGIN);
  context.font = `26px ${style.fontFamily}`;
  const day = new Date().toLocaleDateString(document.documentElement.lang, { dateStyle: "long" });
  const facts = `${day} · ${words.say("souvenir.facts", factsOf(trip))}`;
  context.fillText(facts, MARGIN, 84, WIDTH - 2 * MARGIN);
  if (ground) {
    drawGround(context, map, trip.trail);
  }
  photos.forEach((photo, index) => {
    const x = MARGIN + (index % 3) * (PHOTO_WIDTH + MARGIN);
    const y = HEAD + (ground && ground + MARGIN) + Math.floor(index / 3) * (PHOTO_HEIGHT + MARGIN);
    drawPhoto(context, photo, x, y);
  });
  save(canvas, `${config.robot}.png`);
};

/** The values for the sentence about a trip. @param {Trip} trip */
export const factsOf = ({ metres, minutes }) => ({
  metres: metres < 10 ? metres.toFixed(1) : metres.toFixed(0),
  minutes: Math.max(1, Math.round(minutes)),
});

/** @param {Canvas2D} context @param {RobotMap} map @param {Trip["trail"]} trail */
const drawGround = (context, map, trail) => {
  const canvas = document.createElement("canvas");
  // Out of sight, but in the page, from which a map reads its size and colours.
  const [left, width] = [`${-2 * WIDTH}px`, `${WIDTH - 2 * MARGIN}px`];
  Object.assign(canvas.style, { position: "fixed", left, width, height: `${MAP_HEIGHT}px` });
  map.canvas.parentElement?.append(canvas);
  const ground = new RobotMap({ canvas, frame: (draw) => draw() });
  ground.trail.pieces = trail;
  ground.show(/** @type {FloorPlan} */ (map.site), map.image);
  context.drawImage(canvas, MARGIN, HEAD, WIDTH - 2 * MARGIN, MAP_HEIGHT);
  ground.release();
  canvas.remove();
};

/**
 * As large as its place, cut at the edges.
 * @param {Canvas2D} context @param {HTMLImageElement} photo @param {number} x @param {number} y
 */
const drawPhoto = (context, photo, x, y) => {
  const { naturalWidth: wide, naturalHeight: high } = photo;
  const scale = Math.max(PHOTO_WIDTH / wide, PHOTO_HEIGHT / high);
  const [width, height] = [PHOTO_WIDTH / scale, PHOTO_HEIGHT / scale];
  const cut = /** @type {const} */ ([(wide - width) / 2, (high - height) / 2, width, height]);
  context.drawImage(photo, ...cut, x, y, PHOTO_WIDTH, PHOTO_HEIGHT);
};

/**
 * The photos of a session in order; none without an answer of the server.
 * @param {string} list @param {string} session @returns {Promise<HTMLImageElement[]>}
 */
const ownPhotos = async (list, session) => {
  try {
    const { snapshots } = await fetchJson(list);
    const own = snapshots.filter((/** @type {any} */ one) => one.session === session).reverse();
    const urls = own.slice(0, MOST_PHOTOS).map((/** @type {any} */ { url }) => url);
    return await Promise.all(urls.map(loadImage));
  } catch {
    return []; // a map without photos is better than none
  }
};

/** @param {HTMLCanvasElement} canvas @param {string} name */
const save = (canvas, name) =>
  canvas.toBlob((blob) => {
    if (blob) {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60_000); // a browser may ask for a folder
    }
  });
