/**
 * Heartbeats: five a second on each way, with echoes. They say how far the robot's clock is from the page's, how long a round trip
 * takes, and which way is alive. Pure: times are Unix seconds of the page, given by the caller.
 *
 * The two ways share the robot's echo, so a beat's number says on which way it left: even on the data channel, odd on the WebSocket.
 */

/** @typedef {"datachannel" | "mqtt"} Way */
/** @typedef {{n: number, stamp: number, echoes: {peer: string, n: number, stamp: number, received: number}[]}} RobotHeartbeat */

export const BEAT_SECONDS = 0.2;
export const HASTY_SECONDS = BEAT_SECONDS / 2; // while they say what cannot wait
const LATE_SECONDS = 0.1; // by which a picture is older than at its best
const FORGOTTEN = 0.0005; // s by which the best may be worse at the next look
const FRESH_SECONDS = 0.5;
const SAMPLES = 10;
const LONGEST_ROUND_TRIP = 10;
const PARITY = { datachannel: 0, mqtt: 1 };

/** @param {number} n @returns {Way} */
const wayOf = (n) => (n % 2 === 0 ? "datachannel" : "mqtt");

/** Whether pictures have become older of late; look often. */
export class AgeTrend {
  constructor() {
    this.best = Infinity;
  }

  /** @param {number | null} age seconds since the picture on the screen was taken */
  look(age) {
    this.best = age === null ? this.best : Math.min(this.best + FORGOTTEN, age);
    return age !== null && age - this.best > LATE_SECONDS;
  }
}

const newWay = () => ({
  beats: 0,
  heardAt: -Infinity, // when the robot was last heard on this way
  echoedAt: -Infinity, // when the robot last proved that it hears us on this way
  echoed: -1, // the newest of our beats that it proved it with
  roundTrips: /** @type {number[]} */ ([]),
  last: /** @type {{n: number, stamp: number, received: number} | null} */ (null),
});

export class ClockSync {
  constructor() {
    /** @type {Record<Way, ReturnType<typeof newWay>>} */
    this.ways = { datachannel: newWay(), mqtt: newWay() };
    /** @type {{roundTrip: number, offset: number}[]} */
    this.samples = [];
  }

  /** A new data channel has heard nothing yet. @param {Way} way */
  reset(way) {
    this.ways[way] = { ...newWay(), beats: this.ways[way].beats, echoed: this.ways[way].echoed };
  }

  /**
   * The next beat to send on a way.
   * @param {Way} way @param {number} now @param {number | null} frameAge seconds since the picture on the screen was taken
   */
  beat(way, now, frameAge = null) {
    const { last } = this.ways[way];
    const n = 2 * this.ways[way].beats++ + PARITY[way];
    const echo = last && { peer: "robot", n: last.n, stamp: last.stamp, received: last.received };
    return { n, stamp: now, echo: echo ?? undefined, frameAge: frameAge === null ? undefined : Math.max(0, frameAge) };
  }

  /**
   * The robot's beat, heard on a way.
   * @param {Way} way @param {RobotHeartbeat} beat @param {string | null} peer this page's id @param {number} now
   */
  heard(way, beat, peer, now) {
    const heard = this.ways[way];
    heard.heardAt = now;
    heard.last = { n: beat.n, stamp: beat.stamp, received: now };
    for (const echo of beat.echoes) {
      if (echo.peer === peer) {
        this.#echoed(way, echo, beat.stamp, now);
      }
    }
  }

  /** @param {Way} way @param {{n: number, stamp: number, received: number}} echo @param {number} sent @param {number} now */
  #echoed(way, echo, sent, now) {
    const outward = this.ways[wayOf(echo.n)];
    if (echo.n <= outward.echoed || echo.n >= 2 * outward.beats + 2) {
      return;
    }
    outward.echoed = echo.n;
    outward.echoedAt = now;
    const roundTrip = now - echo.stamp - (sent - echo.received);
    if (!(roundTrip >= -0.001 && roundTrip <= LONGEST_ROUND_TRIP)) {
      return;
    }
    // The Network Time Protocol's estimate (RFC 5905, section 8); its error is at most half the round trip.
    this.samples.push({ roundTrip, offset: (echo.received - echo.stamp + (sent - now)) / 2 });
    this.samples.splice(0, this.samples.length - SAMPLES);
    if (way === wayOf(echo.n)) {
      outward.roundTrips.push(Math.max(0, roundTrip));
      outward.roundTrips.splice(0, outward.roundTrips.length - SAMPLES);
    }
  }

  /** Robot's clock minus the page's, in seconds, by the least round trip of the last ten; null while unknown. */
  get offset() {
    const best = this.samples.reduce((least, one) => (least && least.roundTrip <= one.roundTrip ? least : one), /** @type {any} */ (null));
    return best ? /** @type {number} */ (best.offset) : null;
  }

  /** Whether the robot has just proved that it hears us on this way. @param {Way} way @param {number} now */
  isFresh(way, now) {
    return now - this.ways[way].echoedAt < FRESH_SECONDS;
  }

  /** Seconds since the robot was heard on a way. @param {Way} way @param {number} now */
  silence(way, now) {
    return now - this.ways[way].heardAt;
  }

  /** Median of the last round trips on a way, in seconds; null while unknown. @param {Way} way */
  roundTrip(way) {
    const sorted = [...this.ways[way].roundTrips].sort((a, b) => a - b);
    return sorted.length ? sorted[sorted.length >> 1] : null;
  }
}
