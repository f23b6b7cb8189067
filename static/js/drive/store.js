/**
 * A small store: changes are merged, and subscribers are called once a frame. Each feature has a
 * slice of it.
 * @template {object} State
 * @param {State} initial
 * @param {(callback: () => void) => unknown} [frame]
 */
export const createStore = (initial, frame = (callback) => requestAnimationFrame(callback)) => {
  let state = initial;
  let scheduled = false;
  /** @type {((state: State) => void)[]} */
  const subscribers = [];

  const publish = () => {
    if (scheduled) {
      scheduled = false;
      subscribers.forEach((subscriber) => subscriber(state));
    }
  };

  return {
    get: () => state,
    /** @param {Partial<State>} changes */
    update: (changes) => {
      state = { ...state, ...changes };
      if (!scheduled) {
        scheduled = true;
        frame(publish);
      }
    },
    /** Renders changes now: what a visitor opens is open before their next key. */
    flush: publish,
    /** @param {(state: State) => void} subscriber */
    subscribe: (subscriber) => {
      subscribers.push(subscriber);
    },
  };
};

/** @typedef {ReturnType<typeof createStore<State>>} Store */
