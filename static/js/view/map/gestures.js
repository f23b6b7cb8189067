/**
 * Looking around on the map: wheel, two fingers, a drag with the other mouse button, or with one finger where no point can be chosen; and
 * keys, while the map has the focus.
 */

import { isShortcut } from "../../input/key_dispatcher.js";
import { FOLLOWING } from "./pan_zoom.js";

const STEP = 40; // CSS pixels that a key moves the map
const KEYS = /** @type {Record<string, [number, number]>} */ ({ ArrowUp: [0, STEP], ArrowDown: [0, -STEP], ArrowLeft: [STEP, 0], ArrowRight: [-STEP, 0] });
const ZOOM = 1.3;

/**
 * @param {HTMLElement} canvas
 * @param {object} map
 * @param {(factor: number, px?: number, py?: number) => void} map.zoom
 * @param {(dx: number, dy: number) => void} map.pan
 * @param {() => void} map.all
 * @param {() => boolean} map.mayAim whether one finger, or the first button, chooses a point
 * @param {() => void} map.forgetAim a second finger came: the first one did not choose a point
 */
export const addGestures = (canvas, { zoom, pan, all, mayAim, forgetAim }) => {
  /** @type {Map<number, [number, number]>} */
  const fingers = new Map();
  const place = (/** @type {PointerEvent} */ event) => /** @type {[number, number]} */ ([event.offsetX, event.offsetY]);
  const lift = (/** @type {PointerEvent} */ event) => fingers.delete(event.pointerId);

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-Math.max(-200, Math.min(200, event.deltaY)) / 400), event.offsetX, event.offsetY);
  }, { passive: false });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("mousedown", (event) => event.preventDefault()); // a press does not take the keys away from driving
  canvas.addEventListener("pointerdown", (event) => {
    if (fingers.size < 2 && (event.pointerType !== "mouse" || event.button !== 0 || !mayAim())) {
      fingers.set(event.pointerId, place(event));
      canvas.setPointerCapture(event.pointerId);
    }
    if (fingers.size === 2) {
      forgetAim();
    }
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before || (fingers.size === 1 && event.pointerType !== "mouse" && mayAim())) {
      return;
    }
    const now = place(event);
    fingers.set(event.pointerId, now);
    const [other] = [...fingers].filter(([pointer]) => pointer !== event.pointerId).map(([, where]) => where);
    if (other) {
      const apart = (/** @type {[number, number]} */ [x, y]) => Math.max(20, Math.hypot(x - other[0], y - other[1]));
      zoom(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    }
    const share = fingers.size; // two fingers move the middle between them
    pan((now[0] - before[0]) / share, (now[1] - before[1]) / share);
  });
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("keydown", (event) => {
    if (isShortcut(event)) {
      return; // Ctrl and plus make the page larger, not the map
    }
    const way = KEYS[event.code];
    if (way) {
      pan(...way);
    } else if (event.key === "+" || event.key === "-") {
      zoom(event.key === "+" ? ZOOM : 1 / ZOOM);
    } else if (event.key === "0") {
      all();
    } else {
      return;
    }
    event.preventDefault();
  });
};

/**
 * The buttons of the map, and how large it is.
 * @param {object} page
 * @param {(id: string) => HTMLElement} page.element
 * @param {import("./robot_map.js").RobotMap} page.map
 * @param {ReturnType<typeof import("../../drive/store.js").createStore>} page.store
 * @param {{mayAim: () => boolean, forgetAim: () => void}} page.autonomy
 */
export const createMapControls = ({ element, map, store, autonomy }) => {
  addGestures(element("map"), {
    zoom: (...how) => map.zoom(...how),
    pan: (dx, dy) => {
      map.pan(dx, dy);
      tell();
    },
    all: () => actions.map_all(),
    ...autonomy,
  });

  const tell = () => store.update({ mapFollows: map.look.follows, mapTurns: map.look.turns });

  /** @param {"swapped" | "large"} size */
  const toggle = (size) => () => store.update({ mapSize: store.get().mapSize === size ? "small" : size, mapOpen: true });

  const actions = {
    map_in: () => map.zoom(ZOOM),
    map_out: () => map.zoom(1 / ZOOM),
    map_all: () => {
      map.setLook({ zoom: 1, x: null, y: null, follows: false });
      tell();
    },
    map_follow: () => {
      const follows = !map.look.follows;
      map.setLook({ follows, ...(follows ? { zoom: Math.max(FOLLOWING, map.look.zoom) } : { x: map.view?.x ?? null, y: map.view?.y ?? null }) });
      tell();
    },
    map_turn: () => {
      map.setLook({ turns: !map.look.turns });
      tell();
    },
    map_swap: toggle("swapped"),
    map_large: toggle("large"),
  };

  const buttons = /** @type {HTMLButtonElement[]} */ (Array.from(element("map-tools").querySelectorAll("button")));
  return {
    actions,
    /** @param {import("../../drive/store.js").State} state */
    show: ({ mapFollows, mapTurns, mapSize, mapOpen }) => {
      const pressed = /** @type {Record<string, boolean>} */ ({ map_follow: mapFollows, map_turn: mapTurns, map_swap: mapSize === "swapped", map_large: mapSize === "large" });
      buttons.forEach((button) => {
        const action = button.dataset.action ?? "";
        if (action in pressed) {
          button.setAttribute("aria-pressed", String(pressed[action]));
        }
      });
      element("map-tools").hidden = !mapOpen;
      element("cockpit").dataset.map = mapOpen ? mapSize : "small";
    },
  };
};
