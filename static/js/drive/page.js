/**
 * The drive page: registers its features and connects. Pure modules decide; each feature carries
 * their decisions to the browser. The page connects before all of its features are loaded.
 */

import { KeyDispatcher } from "../input/key_dispatcher.js";
import { Keymap } from "../input/keymap.js";
import { isSupported } from "../protocol/link.js";
import { element, readConfig } from "../lib/dom.js";
import { guarded } from "../lib/errors.js";
import { readWords } from "../lib/words.js";
import { FIRST, LATER, newState } from "./features.js";
import { Registry } from "./registry.js";
import { createScheduler } from "./scheduler.js";
import { recall, recallKeys } from "../lib/storage.js";
import { createStore } from "./store.js";

const AGAIN = 2000; // ms until a feature that did not arrive is fetched again
const FRAME = 100; // ms that a break takes at most: a page out of sight draws no frames
const LINKS = 6; // added at once: the browser handles each before it continues

const config = readConfig();
const keymap = new Keymap(recallKeys(config.who ?? ""));
const labels = keymap.labels();
const words = readWords(labels);
const registry = new Registry();
const given = {
  factsheet: config.factsheet ?? null,
  returnsHome: config.returnsHome ?? false,
  operates: config.operates ?? false,
  hasScreen: config.hasScreen ?? true,
  guest: Boolean(config.signUp),
  practising: Boolean(config.practising) && !config.signUp,
  study: config.study ?? null,
  practice: config.practice ? "off" : "none",
};
if (parent === window) {
  delete element("drive-page").dataset.framed; // not in a frame: the page has its own exits
}
const store = createStore(/** @type {State} */ ({ ...newState(), ...given }));

const page = /** @type {Page} */ ({
  config,
  words,
  element,
  store,
  keys: new KeyDispatcher({ keymap }),
  /** The visitor has chosen keys. @param {Record<string, string[]>} own */
  useKeys: (own) => {
    keymap.use(own);
    Object.assign(labels, keymap.labels());
    keymap.writeHints(document);
  },
  handle: registry.handle.bind(registry),
  emit: registry.emit.bind(registry),
  /** @param {string} action a feature's, or something that happens to the session */
  act: (action) => {
    if (!registry.act(action)) {
      page.session.dispatch({ type: action });
    }
    store.flush();
  },
  begin: () => begin(),
});

/** @param {Feature} feature */
const setUp = (feature) => {
  const parts = feature.setUp(page);
  Object.assign(page, { [feature.name]: parts.api });
  page.keys.addCommands(parts.keys ?? {});
  registry.add(parts);
};

/** The browser handles its visitor's input. */
const turn = () => new Promise((done) => setTimeout(done));

/** The browser also paints. */
const pause = () =>
  new Promise((done) => {
    requestAnimationFrame(() => setTimeout(done));
    setTimeout(done, FRAME);
  });

/**
 * The network may be unavailable just now.
 * @param {typeof LATER[number]} load @returns {Promise<Feature>}
 */
const fetched = (load) =>
  load().catch((error) => {
    if (!(error instanceof TypeError)) {
      throw error;
    }
    return new Promise((again) => setTimeout(again, AGAIN)).then(() => fetched(load));
  });

const setUpFirst = async () => {
  // A press on a button before the rest is set up needs these two.
  FIRST.slice(0, 2).forEach(setUp);
  for (const feature of FIRST.slice(2)) {
    await turn();
    setUp(feature);
  }
  keymap.writeHints(document);
  store.subscribe(() => {
    registry.emit("changed", store.get());
    registry.render(store.get());
  });
};

const setUpLater = async () => {
  await pause();
  const links = [...element("later").content.children];
  while (links.length) {
    document.head.append(...links.splice(0, LINKS));
    await turn();
  }
  for (const load of LATER) {
    const feature = await fetched(load);
    guarded(() => setUp(feature));
    store.update({});
    await pause();
  }
  registry.complete();
  performance.mark("drive:complete");
};

/** Opens the page's connection. */
const begin = () => {
  const address = new URL(location.href);
  const go = address.searchParams.get("go") === "1";
  if (go) {
    // The browser's back and forward buttons must not request the robot again.
    address.searchParams.delete("go");
    history.replaceState(null, "", address);
  }
  const { session, left } = recall(config.robot);
  page.session.begin({ session, takeover: left, go });
  page.connection.socket.open();
  createScheduler(page).begin();
};

window.addEventListener("pageshow", (event) => {
  // A page from the browser's back/forward cache has lost its connections and timers.
  if (event.persisted) {
    location.reload();
  }
});

const start = async () => {
  await setUpFirst();
  await turn();
  if (isSupported()) {
    begin();
  } else {
    page.waiting.lazyPanels(({ explain }) => explain());
  }
  await setUpLater();
};

void start();
