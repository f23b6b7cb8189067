/**
 * Which region's relays a page uses. The server names the relays of each region as one entry; the
 * page measures the round trip to each, once, and takes the nearest. The robot does the same for
 * its side, so that a path over relays is never much longer than a direct one.
 */

import { unixNow } from "../lib/clock.js";
import { isRelay } from "./peer.js";

const PATIENCE_S = 0.4; // a relay that answers later than this is far, or behind a firewall

/** @param {RTCIceServer} server @returns {string[]} */
const urlsOf = (server) => [server.urls].flat();

/**
 * A relay answers the question for one's address, too, without credentials, where datagrams pass.
 * @param {RTCIceServer} server @returns {string | null}
 */
export const questionFor = (server) => {
  const url = urlsOf(server).find((one) => /^turn:/.test(one) && !/transport=tcp/.test(one));
  return url ? `stun:${url.slice("turn:".length).split("?")[0]}` : null;
};

/**
 * @param {string} url of an address server
 * @returns {Promise<number>} s, infinite where none answers
 */
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
        // Where one's own address is a public one, the answer brings no new candidate, but ends the
        // search.
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
    if (!url) {
      return Promise.resolve(Infinity);
    }
    if (!known.has(url)) {
      known.set(url, measure(url));
    }
    return /** @type {Promise<number>} */ (known.get(url));
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
