/**
 * The cards of a session of a study: how it ended, what follows, and that leaving is final. Pure.
 * They replace cards that offer another drive or another robot.
 */

import { stopsOf } from "./guide.js";

export const GO_ON_SECONDS = 10; // until the study continues by itself

const GO_ON = { action: "go_on", word: "do.go_on" };
const TO_STUDY = { action: "go_on", word: "do.to_study" };
const ENDS = new Set([
  "completed",
  "timed_out",
  "cancelled",
  "left",
  "connection_lost",
  "connection_refused",
  "robot_fault",
  "stopped_by_operator",
]);
const PRACTICE_OVER = new Set(["completed", "timed_out", "cancelled", "left"]);
/** Buttons that would leave the study lead back to it. Watching is no part of it. */
const INSTEAD = new Map([
  ["home", TO_STUDY],
  ["back", TO_STUDY],
  ["watch", undefined],
]);

/**
 * @param {State} state
 * @param {Card | null} usual the card without a study
 * @returns {Card | null}
 */
export const studyCard = (state, usual) => {
  const { study, leaving } = state;
  if (!study || !usual) {
    return usual;
  }
  if (leaving) {
    return {
      ...usual,
      word: study.kind === "practice" ? "practice.leaving" : "study.leaving",
      values: { next: study.next },
    };
  }
  if (hasEnded(state)) {
    return over(state, endOf(state));
  }
  const [main, other, extra] = [usual.main, usual.other, usual.extra].map(inside);
  return { ...usual, main, other, extra };
};

/**
 * Whether the drive is over: not moved to another tab, nor its turn missed.
 * @param {State} state
 */
export const hasEnded = ({ visit }) =>
  visit.phase === "ended" && visit.reason !== "moved" && visit.reason !== "turn_missed";

/**
 * The outcome, as one of the words that have a card. A visitor who leaves has not completed the
 * task.
 * @param {State} state @returns {string}
 */
const endOf = ({ study, visit, progress }) => {
  const outcome =
    visit.reason === "left"
      ? "left"
      : progress?.outcome || (visit.reason === "idle" ? "timed_out" : visit.reason);
  if (
    outcome === "completed" &&
    !progress?.outcome &&
    stopsOf(study, progress).some(({ number, status }) => number > 0 && status !== "passed")
  ) {
    return "left";
  }
  return ENDS.has(outcome) ? outcome : "other";
};

/** @param {State} state @param {string} end @returns {Card} */
const over = ({ study, endedAt, now }, end) => ({
  word:
    study.kind === "practice" && PRACTICE_OVER.has(end) ? "practice.ended" : `study.ended.${end}`,
  values: { next: study.next },
  countdown:
    endedAt === null
      ? GO_ON_SECONDS
      : Math.min(GO_ON_SECONDS, Math.max(0, Math.ceil(endedAt + GO_ON_SECONDS - now))),
  main: GO_ON,
});

/** @param {{action: string, word: string} | undefined} button */
const inside = (button) =>
  button && INSTEAD.has(button.action) ? INSTEAD.get(button.action) : button;
