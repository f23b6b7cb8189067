/**
 * The visit: the page's relation to the robot. Pure: `reduce` takes a visit and an event, and
 * returns the next visit and the effects, which drive/session.js carries out.
 *
 *   connecting → lobby → taking → driving → ended
 *                      ↘ queued → turn ↗
 *                      ↘ watching            refused, closed: with the reason
 *
 * A lost WebSocket changes no phase: the drive continues over the data channel, and `wanted` is
 * requested again. A lost media link changes no phase either: the robot stops by itself, and the
 * page opens links until one connects.
 */

import { isPassing } from "./denials.js";
import { areCredentialsOld } from "./link_health.js";

/**
 * @typedef {"connecting" | "lobby" | "taking" | "queued" | "turn" | "driving" | "watching"
 *   | "elsewhere" | "refused" | "ended" | "closed"} Phase
 *
 * @typedef {object} Visit
 * @property {Phase} phase
 * @property {"connecting" | "open" | "lost"} socket
 * @property {"none" | "connecting" | "live" | "lost"} link the media link to the robot
 * @property {"nothing" | "drive" | "watch"} wanted requested again with a new WebSocket
 * @property {boolean} online whether the robot is connected, as far as the server knows
 * @property {boolean} serverBlind the server has no state of any robot
 * @property {boolean} mayDrive
 * @property {boolean} mayObserve
 * @property {boolean} liveElsewhere the visitor drives this robot on another page
 * @property {number | null} liveSince Unix time; without `liveElsewhere` that page is closed
 * @property {string | null} session the visit's id at the server
 * @property {string | null} peer this page's id while it drives; secret
 * @property {number} epoch of the lease
 * @property {boolean} returning the visitor drove before: on another page, or before a reload
 * @property {boolean} takeover this tab has just left the session, and may take it back
 * @property {boolean} fresh start again without a session when the remembered one is over
 * @property {RTCIceServer[]} iceServers
 * @property {number} iceAt when they arrived, Unix time; they are valid for six hours
 * @property {boolean} sfu whether the page watches through the server's SFU
 * @property {boolean} sfuLost the SFU does not work at the moment
 * @property {{linear: number | null, angular: number | null, frameAge: number | null}} limits of
 *   the lease
 * @property {any} terms of the visit: sessions/protocol.py GrantedTerms; or null
 * @property {number} attempt how many links in a row have failed
 * @property {number} place in the queue, 1 is next
 * @property {number} minutes estimated until the turn
 * @property {string} pause why a free robot is not ready: `returning`, `charging`, `paused` or
 *   `start` (of a study), a colon, and its reason
 * @property {number | null} pressedAt Unix time at which the visitor requested the robot
 * @property {number | null} startBy Unix time until which an offered turn can be accepted
 * @property {number | null} askedUntil Unix time until which the visitor must show activity
 * @property {number | null} signingUntil Unix time until which the page repeats a sign of activity;
 *   null once the server has it
 * @property {number | null} turnEnds Unix time at which the turn ends, once the server has warned
 * @property {{session: string, peer?: string} | null} unsaid a visit that was left without the
 *   server's confirmation
 * @property {boolean} observesAgain whether to request the denied video again during the wait
 * @property {string} reason why it was refused, ended or closed, in one of the server's words
 */

/** @typedef {{type: string} & Record<string, any>} Happening */
/** @typedef {{type: string} & Record<string, any>} Effect */

/** @returns {Visit} */
export const newVisit = () => ({
  phase: "connecting",
  socket: "connecting",
  link: "none",
  wanted: "nothing",
  online: false,
  serverBlind: false,
  mayDrive: false,
  mayObserve: false,
  liveElsewhere: false,
  liveSince: null,
  session: null,
  peer: null,
  epoch: 0,
  returning: false,
  takeover: false,
  fresh: false,
  iceServers: [],
  iceAt: 0,
  sfu: false,
  sfuLost: false,
  limits: { linear: null, angular: null, frameAge: null },
  terms: null,
  attempt: 0,
  place: 0,
  minutes: 0,
  pause: "",
  pressedAt: null,
  startBy: null,
  askedUntil: null,
  signingUntil: null,
  turnEnds: null,
  unsaid: null,
  observesAgain: false,
  reason: "",
});

/**
 * s after a press on "drive" in which an offered turn needs no other press: the visitor before has
 * the robot for a moment longer than the page shows.
 */
const STILL_PRESSED = 5;

/** Close codes after which connecting again is pointless: sessions/protocol.py. */
const FINAL = new Map([
  [4401, "signed_out"],
  [4403, "not_allowed"],
  [4404, "no_such_robot"],
]);

/** @param {string} suffix @param {object} [message] @returns {Effect} */
const send = (suffix, message = {}) => ({ type: "send", suffix, message });
const LET_GO = [{ type: "control", lease: null }, { type: "close_link" }];

/**
 * @param {Visit} visit @param {Happening} happening @returns {{visit: Visit, effects: Effect[]}}
 */
export const reduce = (visit, happening) => {
  const handler = HANDLERS[happening.type];
  const [changes, effects = []] = handler ? handler(visit, happening) : [{}];
  return { visit: { ...visit, ...changes }, effects };
};

/** @param {Pick<Visit, "phase">} visit */
const waits = ({ phase }) => phase === "queued" || phase === "turn";

/** Whether video was denied to who waits. @param {Visit} visit */
const isWithoutVideo = (visit) => waits(visit) && visit.observesAgain;

/** @param {Visit} visit @returns {Effect} */
const take = (visit) => {
  const message = /** @type {Record<string, unknown>} */ ({});
  if (visit.session) {
    message.session = visit.session;
  }
  if (visit.peer) {
    message.peer = visit.peer;
  }
  if (visit.takeover) {
    message.takeover = true;
  }
  return send("session/take", message);
};

/** @param {Visit} visit @returns {Effect[]} */
const askAgain = (visit) => {
  if (visit.wanted === "drive") {
    // A turn that is offered is accepted by the visitor, never by a reconnection.
    const watching =
      visit.phase === "queued" && visit.link !== "none" ? [send("session/observe")] : [];
    return visit.phase === "turn" ? [] : [take(visit), ...watching];
  }
  return visit.wanted === "watch" ? [send("session/observe")] : [];
};

/** @param {Visit} visit @returns {Effect[]} */
const leaveAgain = ({ unsaid }) => (unsaid ? [send("session/leave", unsaid)] : []);

/** @param {Visit} visit @param {Partial<Visit>} [changes] @returns {[Partial<Visit>, Effect[]]} */
const ask = (visit, changes = {}) => {
  const next = {
    ...visit,
    wanted: /** @type {const} */ ("drive"),
    phase: /** @type {const} */ ("taking"),
    observesAgain: false,
    ...changes,
  };
  return [
    next,
    [{ type: "prepare_link", role: "driver" }, ...(visit.socket === "open" ? [take(next)] : [])],
  ];
};

const OVER = /** @type {const} */ ({
  wanted: "nothing",
  link: "none",
  session: null,
  peer: null,
  takeover: false,
  returning: false,
  startBy: null,
  askedUntil: null,
  signingUntil: null,
  turnEnds: null,
  terms: null,
  sfu: false,
  sfuLost: false,
  attempt: 0,
  observesAgain: false,
  liveElsewhere: false,
  liveSince: null,
});

/**
 * @param {Phase} phase @param {string} reason @param {Effect[]} [more]
 * @returns {[Partial<Visit>, Effect[]]}
 */
const over = (phase, reason, more = []) => [
  { ...OVER, phase, reason },
  [...LET_GO, { type: "forget" }, ...more],
];

/** @type {Record<string, (visit: Visit, happening: any) => [Partial<Visit>, Effect[]?]>} */
const HANDLERS = {
  /**
   * The page was loaded: `session` from before a reload, `go` when the link says to drive at once.
   */
  loaded: (visit, { session, takeover, go, now }) =>
    session || go
      ? ask(visit, {
          session: session ?? null,
          returning: Boolean(session),
          takeover: Boolean(takeover),
          fresh: Boolean(go),
          pressedAt: go && !session ? now : null,
        })
      : [{}],

  socket_open: (visit) => [{ socket: "open" }, [...leaveAgain(visit), ...askAgain(visit)]],
  socket_lost: () => [{ socket: "lost" }],
  socket_closed: (visit, { code }) => {
    const reason = FINAL.get(code);
    return reason ? over("closed", reason, [{ type: "close_socket" }]) : [{ socket: "lost" }];
  },

  hello: (visit, { message }) => [
    {
      phase: visit.phase === "connecting" ? "lobby" : visit.phase,
      online: message.online,
      serverBlind: false,
      mayDrive: message.mayDrive,
      mayObserve: message.mayObserve,
      liveElsewhere: message.liveElsewhere,
      liveSince: message.liveSince,
    },
  ],

  /** The robot has no driver any more, nor has another page of the visitor's. */
  freed: ({ phase }) => [
    {
      liveElsewhere: false,
      liveSince: null,
      ...(phase === "elsewhere" && { phase: /** @type {const} */ ("lobby") }),
    },
  ],

  "session/granted": (visit, { message, now }) => {
    const kept = message.resumed && visit.epoch === message.epoch && visit.link === "live";
    const lease = {
      session: message.session,
      epoch: message.epoch,
      peer: message.peer,
      limits: message.limits,
    };
    return [
      {
        phase: "driving",
        wanted: "drive",
        session: message.session,
        epoch: message.epoch,
        peer: message.peer,
        limits: message.limits,
        terms: message.terms ?? null,
        iceServers: message.iceServers,
        iceAt: now,
        sfu: false,
        sfuLost: false,
        observesAgain: false,
        link: kept ? "live" : "connecting",
        returning: visit.returning || message.resumed,
        takeover: false,
        fresh: false,
        startBy: null,
        askedUntil: message.resumed ? visit.askedUntil : null,
        reason: "",
      },
      [
        { type: "remember", session: message.session },
        { type: "control", lease },
        ...(kept ? [] : [openLink("driver", message.iceServers, 0)]),
      ],
    ];
  },
  "session/queued": (visit, { message }) => {
    const changes = {
      phase: "queued",
      session: message.session,
      peer: null,
      place: message.place,
      minutes: message.minutes,
      pause: message.reason ?? "",
      startBy: null,
      returning: false,
    };
    // A waiting visitor may watch.
    const first = [
      ...LET_GO,
      { type: "remember", session: message.session },
      ...(visit.mayObserve ? [send("session/observe")] : []),
    ];
    return [
      /** @type {Partial<Visit>} */ (waits(visit) ? changes : { ...changes, link: "none" }),
      waits(visit) ? [] : first,
    ];
  },
  "session/offered": (visit, { message, now }) => {
    const turn = { session: message.session, startBy: now + message.seconds };
    const known = visit.session === message.session;
    if (!(waits(visit) || visit.phase === "taking") || (visit.session && !known)) {
      return [{}]; // no longer waiting, or an offer to another page
    }
    // The server repeats an offer that it cannot know to have arrived.
    if (known && visit.phase !== "queued") {
      return [turn];
    }
    if (visit.pressedAt !== null && now - visit.pressedAt <= STILL_PRESSED) {
      return ask(visit, { ...turn, pressedAt: null });
    }
    return [{ ...turn, phase: "turn" }, [{ type: "call", word: "turn" }]];
  },
  "session/observing": (visit, { message, now }) => {
    if (!waits(visit) && visit.wanted !== "watch") {
      return [{}]; // asked for in line, where the visitor no longer is
    }
    const { iceServers, sfu } = message;
    const changes = {
      iceServers,
      iceAt: now,
      sfu,
      sfuLost: false,
      observesAgain: false,
      link: /** @type {const} */ ("connecting"),
      reason: "",
    };
    return [
      waits(visit) ? changes : { ...changes, phase: "watching", wanted: "watch" },
      [openLink(sfu ? "sfu" : "observer", iceServers, 0)],
    ];
  },
  "session/refused": (visit, { message }) => {
    if (message.reason === "elsewhere") {
      return [
        {
          phase: "elsewhere",
          liveSince: message.since,
          wanted: "nothing",
          session: message.session ?? visit.session,
          peer: null,
          link: "none",
          observesAgain: false,
        },
        LET_GO,
      ];
    }
    if (waits(visit) && ["observers_full", "not_allowed", "private"].includes(message.reason)) {
      // waiting goes on without a picture
      return [{ link: "none", observesAgain: false }, [{ type: "close_link" }]];
    }
    if (message.reason !== "ended") {
      return over(message.reason === "private" ? "lobby" : "refused", message.reason);
    }
    if (visit.fresh) {
      return ask({ ...visit, ...OVER, fresh: false }, { fresh: false });
    }
    return over(
      visit.phase === "driving" ? "ended" : "lobby",
      visit.phase === "driving" ? message.outcome || "connection_lost" : "",
    );
  },
  "session/turn_warning": (_visit, { message, now }) => [{ turnEnds: now + message.remaining }],
  "session/asked_there": (_visit, { message, now }) => [
    { askedUntil: now + message.seconds },
    [{ type: "call", word: "idle" }],
  ],
  "session/found_there": () => [{ askedUntil: null, signingUntil: null }],
  "session/ended": (visit, { message }) => {
    if (visit.session !== message.session) {
      return [visit.unsaid?.session === message.session ? { unsaid: null } : {}];
    }
    const missed = visit.phase === "turn" && message.outcome !== "stopped_by_operator";
    return over(
      "ended",
      missed ? "turn_missed" : message.reason === "idle" ? "idle" : message.outcome,
    );
  },
  robot: (visit, { message, now }) => {
    const back = message.online && !visit.online && visit.link === "lost";
    return [
      { online: message.online, serverBlind: !message.online && message.reason === "server" },
      back && roleOf(visit) ? reopenLink(visit, 0, now) : [],
    ];
  },
  "signal/reply": (visit, { message }) => {
    if (message.type === "bye" && message.reason === "sfu_lost") {
      return [{ sfuLost: true }];
    }
    if (message.type !== "bye" || message.reason !== "full" || visit.phase === "driving") {
      return [{}];
    }
    return visit.phase === "watching"
      ? over("refused", "observers_full")
      : [{ link: "none" }, [{ type: "close_link" }]];
  },

  /** The server has not answered for a while, or could not do it just then. */
  no_answer: (visit) => [
    {},
    visit.socket === "open"
      ? [
          ...leaveAgain(visit),
          ...(visit.phase === "taking" ? askAgain(visit) : []),
          ...(isWithoutVideo(visit) ? [send("session/observe")] : []),
        ]
      : [],
  ],
  denied: (visit, { message }) => {
    if (message.suffix === "session/leave") {
      return [isPassing(message) ? {} : { unsaid: null }];
    }
    return [
      message.suffix === "session/observe" && waits(visit)
        ? { observesAgain: isPassing(message) }
        : {},
    ];
  },

  drive: (visit, { now }) =>
    ask(visit, {
      session: null,
      peer: null,
      takeover: false,
      returning: false,
      reason: "",
      pressedAt: now,
    }),
  here: ({ askedUntil, signingUntil }) => [
    { askedUntil: null, signingUntil: askedUntil ?? signingUntil },
  ],
  take_over: (visit) => ask(visit, { peer: null, takeover: true, returning: true, reason: "" }),
  start: (visit) => ask(visit),
  watch: (visit) => [
    { phase: "taking", wanted: "watch", reason: "" },
    [
      { type: "prepare_link", role: "observer" },
      ...(visit.socket === "open" ? [send("session/observe")] : []),
    ],
  ],
  leave: (visit) => {
    const drove = visit.phase === "driving";
    const { session, peer } = visit;
    const unsaid = session ? { session, ...(peer ? { peer } : {}) } : null;
    const [changes, effects = []] = over(drove ? "ended" : "lobby", drove ? "left" : "");
    // A connection that is lost, or that is dead and does not know it yet, says so when it is back.
    return [
      { ...changes, unsaid },
      visit.socket === "open" ? [...effects, send("session/leave", unsaid ?? {})] : effects,
    ];
  },
  back: (visit) =>
    ["ended", "refused", "elsewhere"].includes(visit.phase) ? over("lobby", "") : [{}],
  turn_missed: (visit) =>
    visit.phase === "turn" ? over("ended", "turn_missed", [send("session/leave")]) : [{}],

  link_live: (visit) => (roleOf(visit) ? [{ link: "live", attempt: 0, sfuLost: false }] : [{}]),
  link_lost: (visit, { now }) => {
    if (!roleOf(visit) || visit.link === "none") {
      return [{}];
    }
    return [{ link: "lost", attempt: visit.attempt + 1 }, reopenLink(visit, visit.attempt, now)];
  },
};

/**
 * @param {string} role @param {RTCIceServer[]} iceServers @param {number} attempt @returns {Effect}
 */
const openLink = (role, iceServers, attempt) => ({ type: "open_link", role, iceServers, attempt });

/**
 * Opens the link again, and asks for new credentials where the relay may no longer take the old
 * ones: the answer opens it once more.
 * @param {Visit} visit @param {number} attempt
 * @param {number} now Unix time
 * @returns {Effect[]}
 */
const reopenLink = (visit, attempt, now) => {
  const isOld = areCredentialsOld(visit, now);
  const question = visit.phase === "driving" ? take(visit) : send("session/observe");
  return [
    openLink(linkRoleOf(visit), visit.iceServers, attempt),
    ...(isOld && visit.socket === "open" ? [question] : []),
  ];
};

/** Whether the page has asked for something that it has to ask for again. @param {Visit} visit */
export const awaitsAnswer = (visit) =>
  visit.phase === "taking" || visit.unsaid !== null || isWithoutVideo(visit);

/**
 * Whether a sign that was asked for is given again: until the server has it, or has stopped
 * waiting.
 * @param {Visit} visit
 * @param {number} now Unix time
 */
export const isSigning = ({ phase, signingUntil }, now) =>
  phase === "driving" && signingUntil !== null && now < signingUntil;

/**
 * What the page is to the robot: a waiting visitor watches, if the server allows it.
 * @param {Visit} visit @returns {"driver" | "observer" | ""}
 */
export const roleOf = ({ phase, link }) => {
  if (phase === "driving") {
    return "driver";
  }
  return phase === "watching" || (waits({ phase }) && link !== "none") ? "observer" : "";
};

/**
 * Over which link the page does that.
 * @param {Visit} visit @returns {"driver" | "observer" | "sfu" | ""}
 */
const linkRoleOf = (visit) => (roleOf(visit) === "observer" && visit.sfu ? "sfu" : roleOf(visit));
