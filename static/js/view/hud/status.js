/** The connection in one word. Pure. */

import { roleOf } from "../../protocol/session.js";
import { isHeld } from "../../protocol/estop_release.js";
import { betweenVisits } from "./pause.js";
import { standstillOf } from "../../protocol/standstill.js";

const PRESENT = /** @type {Record<string, string>} */ ({
  driving: "status.driving",
  watching: "status.watching",
});

/**
 * @param {State} state @returns {{word: string, tone: "ok" | "slow" | "busy" | "off" | "danger"}}
 */
export const statusFor = ({ visit, room, playing, slow, robot }) => {
  if (roleOf(visit)) {
    if (!visit.online && !visit.serverBlind && visit.link !== "live") {
      return { word: "status.offline", tone: "danger" };
    }
    if (robot?.safety.estop) {
      return { word: "status.estop", tone: "danger" };
    }
    const word = PRESENT[visit.phase];
    if (!word) {
      return { word: "status.waiting", tone: playing ? "ok" : "busy" };
    }
    if (slow && playing) {
      return { word, tone: "slow" };
    }
    if (visit.link === "lost") {
      return { word: "status.reconnecting", tone: "busy" };
    }
    if (visit.link === "live" && playing) {
      return { word, tone: "ok" };
    }
    return { word: "status.connecting", tone: "busy" };
  }
  if (visit.phase === "closed") {
    return { word: "status.closed", tone: "off" };
  }
  if (visit.socket !== "open") {
    const isLost = visit.socket === "lost";
    return { word: isLost ? "status.reconnecting" : "status.connecting", tone: "busy" };
  }
  if (visit.phase === "queued" || visit.phase === "turn") {
    return { word: "status.waiting", tone: "busy" };
  }
  if (visit.online && (visit.liveSince !== null || visit.phase === "elsewhere")) {
    return { word: "status.own", tone: "busy" };
  }
  if (visit.online && room.driver !== null) {
    return { word: "status.busy", tone: "busy" };
  }
  if (!visit.online) {
    return { word: "status.offline", tone: "off" };
  }
  const standstill = standstillOf(robot);
  if (standstill) {
    const isStopped = standstill.startsWith("estop");
    return { word: isStopped ? "status.stopped" : "status.fault", tone: "danger" };
  }
  if (isHeld(robot, room.driver)) {
    return { word: "status.stopped", tone: "off" };
  }
  const why = betweenVisits(room.pause);
  return why ? { word: `status.${why}`, tone: "busy" } : { word: "status.ready", tone: "ok" };
};
