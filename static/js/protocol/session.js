/**
 * The page's relation to the robot, a visit. Pure: `reduce` takes a visit and an event, and returns
 * the next visit and the effects, which drive/session.js carries out.
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
 */

const number = /** @type {number | null} */ (null);
const text = /** @type {string | null} */ (null);

export const newVisit = () => ({
  phase: /** @type {Phase} */ ("connecting"),
  socket: /** @type {"connecting" | "open" | "lost"} */ ("connecting"),
  /** the media link to the robot */
  link: /** @type {"none" | "connecting" | "live" | "lost"} */ ("none"),
  /** requested again with a new WebSocket */
  wanted: /** @type {"nothing" | "drive" | "watch"} */ ("nothing"),
  /** whether the robot is connected, as far as the server knows */
  online: false,
  /** the server has no state of any robot */
  serverBlind: false,
  mayDrive: false,
  mayObserve: false,
  /** the visitor drives this robot on another page */
  liveElsewhere: false,
  /** Unix time; without `liveElsewhere` that page is closed */
  liveSince: number,
  /** the session's id at the server */
  session: text,
  /** this page's id while it drives; secret */
  peer: text,
  /** of the lease */
  epoch: 0,
  /** the visitor drove before: on another page, or before a reload */
  returning: false,
  /** this tab has just left the session, and may take it back */
  takeover: false,
  /** start again without a session when the stored one has ended */
  fresh: false,
  iceServers: /** @type {RTCIceServer[]} */ ([]),
  /** when they arrived, Unix time; they are valid for six hours */
  iceAt: 0,
  /** whether the page watches through the server's SFU */
  sfu: false,
  /** the SFU does not work at the moment */
  sfuLost: false,
  /** of the lease */
  limits: { linear: number, angular: number, frameAge: number },
  /** of the session: sessions/protocol.py GrantedTerms; or null */
  terms: /** @type {any} */ (null),
  /** how many links in a row have failed */
  attempt: 0,
  /** in the queue, 1 is next */
  place: 0,
  /** estimated until the turn */
  minutes: 0,
  /** why a free robot is not ready: view/hud/pause.js */
  pause: "",
  /** Unix time at which the visitor requested the robot */
  pressedAt: number,
  /** Unix time until which an offered turn can be accepted */
  startBy: number,
  /** Unix time until which the visitor must show activity */
  askedUntil: number,
  /** Unix time until which a sign of activity is repeated; null once the server has it */
  signingUntil: number,
  /** Unix time at which the turn ends, once the server has warned */
  turnEnds: number,
  /** why it ends then, other than for the next visitor: `maintenance` */
  turnReason: "",
  /** a session that was left without the server's confirmation */
  unsaid: /** @type {{session: string, peer?: string} | null} */ (null),
  /** whether to request the denied video again during the wait */
  observesAgain: false,
  /** why it was refused, ended or closed, in one of the server's words */
  reason: "",
});

/**
 * @typedef {ReturnType<typeof newVisit>} Visit
 * @typedef {{type: string} & Record<string, any>} Happening
 * @typedef {{type: string} & Record<string, any>} Effect
 */

/**
 * s after a press on "drive" in which an offered turn needs no other press: the driver before keeps
 * the robot for a moment longer than the page shows.
 */
const STILL_PRESSED = 5;

/** Close codes after which connecting again is pointless: sessions/protocol.py. */
const FINAL = new Map([
  [4401, "signed_out"],
  [4403, "not_allowed"],
  [4404, "no_such_robot"],
]);

/** The reasons of an end that the page shows in place of the outcome. */
const OWN_WORDS = new Set(["idle", "maintenance"]);

/** @param {string} suffix @param {object} [message] @returns {Effect} */
const send = (suffix, message = {}) => ({ type: "send", suffix, message });
const RELEASE = [{ type: "control", lease: null }, { type: "close_link" }];

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

/** Whether video was denied to a waiting visitor. @param {Visit} visit */
const isWithoutVideo = (visit) => waits(visit) && visit.observesAgain;

/** @param {Visit} visit @returns {Effect} */
const take = ({ session, peer, takeover }) =>
  send("session/take", {
    ...(session && { session }),
    ...(peer && { peer }),
    ...(takeover && { takeover }),
  });

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
  [...RELEASE, { type: "forget" }, ...more],
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
    const { session, epoch, peer, limits, resumed, iceServers } = message;
    const kept = resumed && visit.epoch === epoch && visit.link === "live";
    const lease = { session, epoch, peer, limits };
    return [
      {
        ...lease,
        phase: "driving",
        wanted: "drive",
        terms: message.terms ?? null,
        iceServers,
        iceAt: now,
        sfu: false,
        sfuLost: false,
        observesAgain: false,
        link: kept ? "live" : "connecting",
        returning: visit.returning || resumed,
        takeover: false,
        fresh: false,
        startBy: null,
        askedUntil: resumed ? visit.askedUntil : null,
        reason: "",
      },
      [
        { type: "remember", session },
        { type: "control", lease },
        ...(kept ? [] : [openLink("driver", iceServers, 0)]),
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
    const first = [
      ...RELEASE,
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
    // The server repeats an offer, as it does not know whether it has arrived.
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
      return [{}]; // requested in the queue, which the visitor has left
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
        RELEASE,
      ];
    }
    if (waits(visit) && ["observers_full", "not_allowed", "private"].includes(message.reason)) {
      // the visitor waits without video
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
  "session/turn_warning": (_visit, { message: { remaining, reason }, now }) => [
    { turnEnds: remaining === null ? null : now + remaining, turnReason: reason ?? "" },
  ],
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
      missed ? "turn_missed" : OWN_WORDS.has(message.reason) ? message.reason : message.outcome,
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
    // Repeated by the next connection: this one may be dead without an event.
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
 * Opens the link again, and requests new credentials where the relay may no longer accept the old
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

/** Whether the page has to repeat a request. @param {Visit} visit */
export const awaitsAnswer = (visit) =>
  visit.phase === "taking" || visit.unsaid !== null || isWithoutVideo(visit);

/**
 * Whether to repeat a sign of activity: until the server has it, or no longer waits for it.
 * @param {Visit} visit @param {number} now Unix time
 */
export const isSigning = ({ phase, signingUntil }, now) =>
  phase === "driving" && signingUntil !== null && now < signingUntil;

/**
 * The page's role to the robot: a waiting visitor watches, if the server allows it.
 * @param {Visit} visit @returns {"driver" | "observer" | ""}
 */
export const roleOf = ({ phase, link }) => {
  if (phase === "driving") {
    return "driver";
  }
  return phase === "watching" || (waits({ phase }) && link !== "none") ? "observer" : "";
};

/** @param {Visit} visit @returns {"driver" | "observer" | "sfu" | ""} */
const linkRoleOf = (visit) => (roleOf(visit) === "observer" && visit.sfu ? "sfu" : roleOf(visit));
