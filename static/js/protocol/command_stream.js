/**
 * The messages that move and stop the robot. Pure: transport_router.js sends them.
 *
 * Velocities are sent at once when the visitor starts, releases or reverses, and twenty times a
 * second during a drive. After a release a few zeros follow, because a message may be lost, then
 * none. Stop and e-stop are repeated every 50 ms until the robot echoes them; no velocity is sent
 * until then. One counter numbers all messages on all transports.
 */

export const TICK_SECONDS = 0.05;
const ZEROS = 3;
const UNCONFIRMED_SECONDS = 1;
const EAGER_SECONDS = 10; // in which a stop is repeated with every tick
const PATIENT_SECONDS = 1; // between two repetitions after that

/**
 * @typedef {{linear: number, angular: number, method: string}} Intent m/s, rad/s, and the
 *   controller's name
 * @typedef {{session: string, epoch: number}} Binding
 */

const NONE = Object.freeze({ linear: 0, angular: 0, method: "keyboard" });

export class CommandStream {
  /** @param {{freshId: () => string}} options */
  constructor({ freshId }) {
    this.freshId = freshId;
    /** @type {Binding | null} */
    this.binding = null;
    this.seq = 0;
    /** @type {Intent} */
    this.intent = NONE;
    this.zeros = 0;
    /**
     * @type {{message: Record<string, any>, since: number, askedAt: number, sentAt: number} | null}
     */
    this.pending = null;
  }

  /** Takes a lease. Its numbers start at 1, unless it is the same one. @param {Binding} binding */
  bind(binding) {
    if (binding.epoch !== this.binding?.epoch || binding.session !== this.binding?.session) {
      this.seq = 0;
      this.#rest();
    }
    this.binding = { session: binding.session, epoch: binding.epoch };
  }

  unbind() {
    this.binding = null;
    this.#rest();
  }

  /** @param {Intent} intent @returns {boolean} whether to send it now, not with the next tick */
  intend(intent) {
    if (!this.binding || this.pending) {
      return false;
    }
    const before = this.intent;
    this.intent = intent;
    if (isZero(intent)) {
      this.zeros = isZero(before) ? this.zeros : ZEROS;
      return !isZero(before);
    }
    this.zeros = 0;
    return (
      isZero(before) ||
      Math.sign(before.linear) !== Math.sign(intent.linear) ||
      Math.sign(before.angular) !== Math.sign(intent.angular)
    );
  }

  /**
   * The velocity to send now, or null.
   * @param {number} now @param {number | null} frame capture stamp of the picture on the screen
   */
  velocity(now, frame) {
    if (!this.binding || this.pending || (isZero(this.intent) && this.zeros === 0)) {
      return null;
    }
    if (isZero(this.intent)) {
      this.zeros -= 1;
    }
    const seq = this.#next();
    return { ...this.binding, ...this.intent, seq, stamp: now, frame: frame ?? undefined };
  }

  /**
   * Brake. A stop needs no lease.
   * @param {number} now @param {"stop" | "estop"} [type]
   * @param {boolean} [isAsked] whether the driver pressed it; false when the page stops the robot
   * @returns {Record<string, any>} the first copy of the action; `repeat` gives the others
   */
  stop(now, type = "stop", isAsked = true) {
    this.#rest();
    const askedAt = isAsked ? now : Infinity;
    if (this.pending && !(type === "estop" && this.pending.message.type === "stop")) {
      this.pending.askedAt = Math.min(this.pending.askedAt, askedAt);
      return this.#copy(now);
    }
    const message = {
      type,
      actionId: this.freshId(),
      ...this.binding,
      ...(type === "stop" ? { seq: this.#next() } : {}),
    };
    this.pending = { message, since: now, askedAt, sentAt: now };
    return this.#copy(now);
  }

  /** The stop to repeat now, or null. @param {number} now */
  repeat(now) {
    if (
      !this.pending ||
      (now - this.pending.since > EAGER_SECONDS && now - this.pending.sentAt < PATIENT_SECONDS)
    ) {
      return null;
    }
    this.pending.sentAt = now;
    return this.#copy(now);
  }

  /** Stops repeating. */
  giveUp() {
    this.pending = null;
  }

  /** Whether the echo of a stop that the driver pressed is overdue. @param {number} now */
  isUnconfirmed(now) {
    return this.pending !== null && now - this.pending.askedAt > UNCONFIRMED_SECONDS;
  }

  /**
   * Takes a state of the robot, which may echo the stop.
   * @param {{epoch: number, safety: {estop: boolean, stopId: string | null,
   *   stopSeq: number | null}}} state
   */
  heardState({ epoch, safety }) {
    const message = this.pending?.message;
    if (!message) {
      return;
    }
    const echoed =
      message.type === "estop"
        ? safety.estop
        : safety.stopSeq === message.seq && epoch === message.epoch;
    if (echoed || safety.stopId === message.actionId) {
      this.pending = null;
    }
  }

  /** @param {{actionId: string, status: string}} action */
  heardAction({ actionId, status }) {
    if (actionId === this.pending?.message.actionId && status === "FINISHED") {
      this.pending = null;
    }
  }

  #rest() {
    this.intent = NONE;
    this.zeros = 0;
  }

  #next() {
    this.seq += 1;
    return this.seq;
  }

  /** @param {number} now */
  #copy(now) {
    return { ...this.pending?.message, stamp: now };
  }
}

/** @param {Intent} intent */
const isZero = ({ linear, angular }) => linear === 0 && angular === 0;
