/** Checks the connection of the drive page: gives an advice, and an entry for the record. */

import { probe } from "./probe.js";
import { advice, forRecord, judge } from "./verdict.js";

/**
 * @param {{socket: string, iceServers: RTCIceServer[], connected: () => boolean}} config
 *   `connected`: the page itself reaches the server
 */
export const examine = async (config) => {
  const found = await probe(config);
  const lines = judge(found, config.iceServers);
  return { advice: advice(lines, config.connected()), record: forRecord(lines, found) };
};
