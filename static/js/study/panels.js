/**
 * What a study shows on the drive page: its panel, its arrow, the window of its photo, its course
 * on the map, and what is read out of them. Fetched by pages of studies alone.
 */

import { clockTime } from "../view/map/dials.js";
import { write } from "../lib/dom.js";
import { unixNow } from "../lib/clock.js";
import { guideFor } from "./guide.js";
import { AnnouncerQueue, roundLeft } from "./announcer_queue.js";
import { drawGround, drawStops, marksFor } from "./course.js";
import { createPanel, sentence } from "./task_panel.js";
import { windowFor } from "./photo.js";
import { createPhotoWindow, photoSentence } from "./photo_window.js";
import { createDirectionArrow } from "./direction_arrow.js";

/**
 * @param {object} page
 * @param {string} page.snapshots where the photos are listed
 * @param {import("../lib/words.js").Words} page.words
 * @param {(id: string) => HTMLElement} page.element
 * @param {import("../view/map/robot_map.js").RobotMap} page.map
 * @param {(action: string) => void} page.act
 * @returns {(state: import("../drive/features.js").State) => void}
 */
export const createStudyPanels = ({ snapshots, words, element, map, act }) => {
  const announcerQueue = new AnnouncerQueue();
  const shows = [
    createPanel(element, words),
    createPhotoWindow(element, words, { list: snapshots, act }),
    createDirectionArrow(element, words, () => map.pose, document.documentElement.lang),
  ];
  let drawn = "";

  /** @param {import("../drive/features.js").State} state */
  const showCourse = ({ study, told }) => {
    const marks = marksFor(study, told);
    const key = JSON.stringify(marks?.stops.map(({ status }) => status));
    if (key !== drawn) {
      drawn = key;
      map.setCourse(
        marks && {
          below: (context, view, paint) => drawGround(context, view, marks, paint),
          above: (context, view, paint) => drawStops(context, view, marks, paint),
        },
      );
    }
  };

  return (state) => {
    shows.forEach((show) => show(state));
    showCourse(state);
    write(
      element("task-said"),
      announcerQueue.hear(spoken(state, words), unixNow()) ?? announcerQueue.said,
    );
  };
};

/**
 * What is read out.
 * @param {import("../drive/features.js").State} state
 * @param {import("../lib/words.js").Words} words
 * @returns {string}
 */
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
