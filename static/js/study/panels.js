/**
 * What a study shows on the drive page: its panel, its arrow, the window of its photo, its course
 * on the map, and announcements for screen readers. Fetched only by pages of studies.
 */

import { write } from "../lib/dom.js";
import { clockTime, unixNow } from "../lib/clock.js";
import { guideFor } from "./guide.js";
import { AnnouncerQueue, roundLeft } from "./announcer_queue.js";
import { layersOf, marksFor } from "./course.js";
import { createPanel, sentence } from "./task_panel.js";
import { windowFor } from "./photo.js";
import { createPhotoWindow, photoSentence } from "./photo_window.js";
import { createDirectionArrow } from "./direction_arrow.js";

/**
 * @param {object} page @param {string} page.snapshots the address of the list of photos
 * @param {Words} page.words @param {GetElement} page.element
 * @param {import("../view/map/robot_map.js").RobotMap} page.map
 * @param {(action: string) => void} page.act
 */
export const createStudyPanels = ({ snapshots, words, element, map, act }) => {
  const announcerQueue = new AnnouncerQueue();
  const photo = createPhotoWindow(element, words, { list: snapshots, act });
  const renders = [
    createPanel(element, words),
    photo.render,
    createDirectionArrow(element, words, () => map.pose, document.documentElement.lang),
  ];
  let drawn = "";

  /** @param {State} state */
  const showCourse = ({ study, progress }) => {
    const marks = marksFor(study, progress);
    const key = JSON.stringify(marks?.stops.map(({ status }) => status));
    if (key !== drawn) {
      drawn = key;
      map.setCourse(layersOf(marks));
    }
  };

  const render = (/** @type {State} */ state) => {
    renders.forEach((one) => one(state));
    showCourse(state);
    write(
      element("task-said"),
      announcerQueue.hear(spoken(state, words), unixNow()) ?? announcerQueue.said,
    );
  };
  return { changed: photo.changed, render };
};

/** The announcement. @param {State} state @param {Words} words @returns {string} */
const spoken = (state, words) => {
  const guide = guideFor(state);
  if (!guide) {
    return "";
  }
  const left = roundLeft(guide.left);
  const photo = windowFor(state);
  return [
    photo ? photoSentence(photo, words) : sentence(guide, words),
    photo ? "" : guide.place,
    left === null ? "" : words.say("reading.left", { time: clockTime(left) }),
  ]
    .filter(Boolean)
    .join(" ");
};
