/**
 * The timer of the drive page: sends the velocity and emits `tick` twenty times a second, `poll`
 * five times and `second` once.
 */

import { unixNow } from "../lib/clock.js";
import { guarded } from "../lib/errors.js";
import { BEAT_SECONDS, HASTY_SECONDS } from "../protocol/clock_sync.js";
import { TICK_SECONDS } from "../protocol/command_stream.js";

const HURRY = 1.5; // s after a grant in which heartbeats come twice as often

/** @param {Page} page */
export const createScheduler = ({ store, emit, connection, driving }) => {
  let [polledAt, secondAt] = [0, 0];

  const tick = () => {
    const now = unixNow();
    guarded(driving.sendVelocity); // first: no feature can delay it
    emit("tick", now);
    // Heartbeats are more frequent at first, as the robot accepts no command before it has three
    // echoes to judge its age by.
    const isHasty = now < connection.grantedAt() + HURRY;
    if (now - polledAt >= (isHasty ? HASTY_SECONDS : BEAT_SECONDS) - TICK_SECONDS / 2) {
      polledAt = now;
      emit("poll", now);
    }
    if (now - secondAt >= 1) {
      secondAt = now;
      store.update({ now });
      emit("second", now);
    }
  };

  return { begin: () => setInterval(tick, TICK_SECONDS * 1000) };
};
