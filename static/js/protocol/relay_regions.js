/**
 * Which region's relays a page uses. Each region is one entry of the ICE servers; the page measures
 * the round trip to each, once, and takes the nearest. The robot does the same for its side, so
 * that a path over relays is never much longer than a direct one.
 */

import { unixNow } from "../lib/clock.js";
import { isRelay } from "./peer.js";

const PATIENCE_S = 0.4; // a relay that answers later than this is far, or behind a firewall

/**
 * The STUN address of a relay, which answers binding requests without credentials; null over TCP.
 * @param {RTCIceServer} server @returns {string | null}
 */
export const questionFor = ({ urls }) => {
  const url = [urls].flat().find((one) => /^turn:/.test(one) && !/transport=tcp/.test(one));
  return url ? `stun:${url.slice("turn:".length).split("?")[0]}` : null;
};

/** @param {string} url of a STUN server @returns {Promise<number>} s, infinite without an answer */
const roundTrip = (url) =>
  new Promise((resolve) => {
    const connection = new RTCPeerConnection({ iceServers: [{ urls: url }] });
    const end = (/** @type {number} */ seconds) => {
      connection.close();
      resolve(seconds);
    };
    setTimeout(end, 1000 * PATIENCE_S, Infinity);
    connection.createDataChannel("round trip");
    connection.onicecandidateerror = () => end(Infinity);
    connection
      .createOffer()
      .then((offer) => {
        const began = unixNow();
        // For a public address, the answer adds no candidate, but ends the gathering.
        connection.onicecandidate = ({ candidate }) =>
          (!candidate || candidate.type === "srflx") && end(unixNow() - began);
        return connection.setLocalDescription(offer);
      })
      .catch(() => end(Infinity));
  });

/** @param {(url: string) => Promise<number>} [measure] */
export const createRelayRegions = (measure = roundTrip) => {
  /** @type {Map<string, Promise<number>>} */
  const known = new Map();
  /** @param {RTCIceServer} server */
  const secondsTo = (server) => {
    const url = questionFor(server);
    const seconds = url ? (known.get(url) ?? measure(url)) : Promise.resolve(Infinity);
    known.set(url ?? "", seconds);
    return seconds;
  };
  return {
    /**
     * The same servers, with the relays of the nearest region alone, if there is more than one
     * region and any answers.
     * @param {RTCIceServer[]} servers @returns {RTCIceServer[] | Promise<RTCIceServer[]>}
     */
    nearest(servers) {
      const regions = servers.filter(isRelay);
      if (regions.length < 2) {
        return servers;
      }
      return Promise.all(regions.map(secondsTo)).then((seconds) => {
        const least = Math.min(...seconds);
        const one = regions[seconds.indexOf(least)];
        return least === Infinity
          ? servers
          : servers.filter((server) => !isRelay(server) || server === one);
      });
    },
  };
};
