/**
 * The page's words for the robot's reasons not to continue. Pure. The phrases are identifiers
 * (docs/reference/robot-api.md): those of robots/agent/navigation, which robots/readiness_text.py
 * puts into words for lists and mail (tests/golden/reasons.json compares the two), and those of its
 * safety kernel. An unknown phrase is shown as it is.
 */

/** @type {[RegExp, string, string?][]} pattern, word, and the name of the pattern's group */
const KNOWN = [
  [
    /^the charging station cannot be reached: (?:blocked: )?(?!.* and )(.*) is closed$/,
    "reason.door_closed",
    "door",
  ],
  [/^blocked: (?!.* and )(.*) is closed$/, "reason.door_closed", "door"],
  [/^(?:.*: )?something stands in the doorway \(([^)]*)\)$/, "reason.doorway", "door"],
  [
    /^(?!.* and )(?:.*: )?something stands in the way at \([^)]*\) in ([^:]*?)$/,
    "reason.in_the_way",
    "room",
  ],
  [/blocked: /, "reason.blocked"],
  [/boxed in/, "reason.boxed_in"],
  [/no way leads/, "reason.no_way"],
  [/something stands on the goal/, "reason.goal_taken"],
  [/too narrow/, "reason.narrow"],
  [/lies in a wall/, "reason.in_wall"],
  [/lies outside/, "reason.outside"],
  [/still in its charging station/, "reason.still_docked"],
  [/stands behind the robot/, "reason.behind"],
  [/could not dock/, "reason.dock_failed"],
  [/no charging station for/, "reason.no_dock"],
  [/looks for the charging station/, "reason.looks_for_dock"],
  [/stands before the charging station/, "reason.before_dock"],
  [/tries again$|backs out$/, "reason.tries_again"],
  [/somebody has stood in the way/, "reason.somebody_stayed"],
  [/waits for somebody in the way/, "reason.somebody"],
  [/something stands very close/, "reason.very_close"],
  [/waits, because no way is free/, "reason.waits"],
  [/backs off/, "reason.backs_off"],
  [/gets no farther/, "reason.no_farther"],
  [/the laser\b/, "reason.laser"],
  [/has not found itself/, "reason.not_found"],
  [/lost where it is|does not know where it is/, "reason.lost"],
  [/wheels do not turn/, "reason.wheels"],
  [
    /^navigation\b|navigation was lost|the map has changed|the robot was lost|the agent ends/,
    "reason.navigation",
  ],
  [/^too_fast$/, "reason.too_fast"],
  [/^navigation_does_not_end$/, "reason.does_not_end"],
  [/^estop$/, "reason.estop"],
  [/^collision$/, "stuck.contact"],
  [/^no_picture$/, "reason.camera"],
  [/^network$/, "reason.network"],
  [/^fault$/, "reason.fault"],
  [/^(?:not_connected|the robot control architecture is not connected)$/, "reason.not_connected"],
  [/^(?:no_answer|stale|clock_unknown|heartbeat_lost|future|failed|offline)$/, "reason.connection"],
  [/^(?:no_lease|observer|wrong_session|wrong_epoch|lease_changed)$/, "reason.not_yours"],
];

/**
 * @param {string} reason
 * @returns {{word: string, values?: Record<string, string>} | null} null when there is no reason
 */
export const reasonFor = (reason) => {
  if (!reason) {
    return null;
  }
  for (const [pattern, word, name] of KNOWN) {
    const match = pattern.exec(reason);
    if (match) {
      return name ? { word, values: { [name]: match[1] } } : { word };
    }
  }
  return { word: "reason.other", values: { reason: reason.replace(/\.$/, "") } };
};
