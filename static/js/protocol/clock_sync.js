/**
 * Heartbeats: five a second on each transport, with echoes. They measure the offset of the robot's
 * clock and the round trip, and show which transport is alive. Pure: times are Unix seconds of the
 * page, given by the caller.
 *
 * The two transports share the robot's echo, so a heartbeat's number tells its transport: even on
 * the data channel, odd on the WebSocket.
 */

/**
 * @typedef {"datachannel" | "mqtt"} Transport
 * @typedef {{n: number, stamp: number, echoes: {peer: string, n: number, stamp: number,
 *   received: number}[]}} RobotHeartbeat
 */

export const BEAT_SECONDS = 0.2;
export const HASTY_SECONDS = BEAT_SECONDS / 2;
const FRESH_SECONDS = 0.5;
const PAST_SECONDS = 3;
const SAMPLES = 10;
const LONGEST_ROUND_TRIP = 10;
const PARITY = { datachannel: 0, mqtt: 1 };

/** @param {number} n @returns {Transport} */
const transportOf = (n) => (n % 2 === 0 ? "datachannel" : "mqtt");

const newTransport = () => ({
  beats: 0,
  heardAt: -Infinity, // when the last heartbeat of the robot arrived
  echoedAt: -Infinity, // when the last echo arrived: the robot receives our heartbeats
  echoed: -1, // the newest of our heartbeats that was echoed
  roundTrips: /** @type {number[]} */ ([]),
  last: /** @type {{n: number, stamp: number, received: number} | null} */ (null),
});

export class ClockSync {
  constructor() {
    /** @type {Record<Transport, ReturnType<typeof newTransport>>} */
    this.transports = { datachannel: newTransport(), mqtt: newTransport() };
    /** @type {{roundTrip: number, offset: number}[]} */
    this.samples = [];
  }

  /** The data channel is a new one. @param {Transport} transport */
  reset(transport) {
    this.transports[transport] = {
      ...newTransport(),
      beats: this.transports[transport].beats,
      echoed: this.transports[transport].echoed,
    };
  }

  /**
   * The next heartbeat to send on a transport.
   * @param {Transport} transport @param {number} now
   * @param {number | null} frameAge seconds since the frame on the screen was taken
   */
  beat(transport, now, frameAge = null) {
    const { last } = this.transports[transport];
    const n = 2 * this.transports[transport].beats++ + PARITY[transport];
    const echo = last && { peer: "robot", n: last.n, stamp: last.stamp, received: last.received };
    return {
      n,
      stamp: now,
      echo: echo ?? undefined,
      frameAge: frameAge === null ? undefined : Math.max(0, frameAge),
    };
  }

  /**
   * Takes a heartbeat of the robot.
   * @param {Transport} transport @param {RobotHeartbeat} beat
   * @param {string | null} peer this page's id @param {number} now
   */
  heard(transport, beat, peer, now) {
    const heard = this.transports[transport];
    heard.heardAt = now;
    heard.last = { n: beat.n, stamp: beat.stamp, received: now };
    for (const echo of beat.echoes) {
      if (echo.peer === peer) {
        this.#echoed(transport, echo, beat.stamp, now);
      }
    }
  }

  /**
   * @param {Transport} transport @param {{n: number, stamp: number, received: number}} echo
   * @param {number} sent @param {number} now
   */
  #echoed(transport, echo, sent, now) {
    const outward = this.transports[transportOf(echo.n)];
    if (echo.n <= outward.echoed || echo.n >= 2 * outward.beats + 2) {
      return;
    }
    outward.echoed = echo.n;
    outward.echoedAt = now;
    const roundTrip = now - echo.stamp - (sent - echo.received);
    if (!(roundTrip >= -0.001 && roundTrip <= LONGEST_ROUND_TRIP)) {
      return;
    }
    // The Network Time Protocol's estimate (RFC 5905, section 8); its error is at most half the
    // round trip.
    this.samples.push({ roundTrip, offset: (echo.received - echo.stamp + (sent - now)) / 2 });
    this.samples.splice(0, this.samples.length - SAMPLES);
    if (transport === transportOf(echo.n)) {
      outward.roundTrips.push(Math.max(0, roundTrip));
      outward.roundTrips.splice(0, outward.roundTrips.length - SAMPLES);
    }
  }

  /**
   * Robot's clock minus the page's, in seconds, by the shortest round trip of the last ten; null
   * while unknown.
   */
  get offset() {
    const [best] = [...this.samples].sort((one, other) => one.roundTrip - other.roundTrip);
    return best?.offset ?? null;
  }

  /** Whether an echo has just arrived. @param {Transport} transport @param {number} now */
  isFresh(transport, now) {
    return now - this.transports[transport].echoedAt < FRESH_SECONDS;
  }

  /** Seconds since the robot's last heartbeat. @param {Transport} transport @param {number} now */
  silence(transport, now) {
    return now - this.transports[transport].heardAt;
  }

  /**
   * Median of the last round trips on a transport, in seconds; null while unknown.
   * @param {Transport} transport @param {number} [least] how many are needed
   */
  roundTrip(transport, least = 1) {
    const sorted = [...this.transports[transport].roundTrips].sort((a, b) => a - b);
    return sorted.length >= least ? sorted[sorted.length >> 1] : null;
  }

  /**
   * The same, but null when no echo has arrived for some seconds.
   * @param {Transport} transport @param {number} now @param {number} [least]
   */
  roundTripNow(transport, now, least) {
    const isPast = now - this.transports[transport].echoedAt > PAST_SECONDS;
    return isPast ? null : this.roundTrip(transport, least);
  }
}
