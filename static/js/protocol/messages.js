// Generated from robots/api and sessions/protocol.py by `make docs`; do not edit.

import {
  absent, dictionary, flag, integer, list, matching, nullable, number, object, oneOf, optional,
  scalar, tagged, text, tuple,
} from "./shapes.js";

const id = matching(/^[A-Za-z0-9_-]{1,64}$/);
const name = text(120);
const capability = oneOf("assist", "audio", "call", "dock", "doors", "follow", "goto",
  "localization", "network_lab", "photo", "point", "relocalize", "safety_test", "say", "scan",
  "tilt", "undock", "velocity", "video");
const positive = number(5e-324, 1000);
const Limits = object({ linear: positive, reverse: positive, angular: positive,
  linearAcceleration: positive, angularAcceleration: positive, linearBraking: positive,
  angularBraking: positive, commandAge: optional(positive, 0.25),
  commandAgeCeiling: optional(positive, 1), frameAge: optional(positive, 1),
  frameAgeCeiling: optional(positive, 3), deadman: optional(positive, 0.3) });
const metres = number(-100000, 100000);
const point = tuple(metres, metres);
const radians = number(-7, 7);
const Camera = object({ width: integer(16, 7680), height: integer(16, 4320), fps: positive,
  hfov: number(0.10000000000000002, 3.0999999999999996), x: metres, z: metres,
  pitch: optional(radians, 0) });
const TiltRange = object({ minimum: radians, maximum: radians, home: optional(radians, 0),
  speed: optional(positive, 1) });
const Laser = object({ x: metres, y: optional(metres, 0), theta: optional(radians, 0) });
const Factsheet = object({ name: id, series: name, rca: name, agentVersion: name, boot: id,
  capabilities: list(capability, Infinity), limits: Limits, footprint: list(point, 64, 3),
  camera: absent(Camera), tilt: absent(TiltRange), laser: absent(Laser), mapId: optional(name, ""),
  watchdog: positive, viewers: optional(integer(0, 64), 8), previewsRoutes: optional(flag, false),
  navigationControl: optional(name, ""), adapter: optional(name, ""), driver: optional(name, "") });
const stamp = number(0, 1e+11);
const count = integer(0, 9007199254740991);
const variance = number(-1e+10, 1e+10);
const share = number(0, 1);
const Pose = object({ x: metres, y: metres, theta: radians, covariance: absent(tuple(variance,
  variance, variance, variance, variance, variance)), localized: optional(flag, true),
  score: optional(share, 1) });
const linearSpeed = number(-10, 10);
const angularSpeed = number(-20, 20);
const Velocity = object({ linear: linearSpeed, angular: angularSpeed });
const notNegative = number(0, 1e+06);
const Battery = object({ charge: absent(share), voltage: absent(notNegative),
  charging: optional(nullable(flag), false) });
const mode = oneOf("assisted", "docking", "goto", "manual", "stopped");
const assistLevel = oneOf("off", "slow", "steer");
const Safety = object({ estop: optional(flag, false), estopSource: absent(name),
  collision: optional(flag, false), inhibited: absent(name), stopSeq: absent(count),
  stopId: absent(id), touched: optional(list(oneOf("ahead", "behind", "left", "right"), 4), []),
  button: absent(flag) });
const reason = text(300);
const inputMethod = oneOf("gamepad", "keyboard", "map", "mouse", "script", "stick", "touch");
const way = oneOf("datachannel", "mqtt");
const AppliedCommand = object({ seq: count, stamp, method: inputMethod, way, age: number(-10,
  10000), linear: linearSpeed, angular: angularSpeed, frameAge: absent(linearSpeed),
  asked: absent(Velocity), allowed: absent(Velocity), share: absent(share) });
const CallState = object({ status: oneOf("accepted", "declined", "ringing", "unanswered"),
  audio: optional(flag, false), video: optional(flag, false), volume: optional(share, 1),
  shares: optional(flag, false), shown: absent(flag), audible: absent(flag) });
const KnockState = object({ actionId: id, status: oneOf("answered", "declined", "ringing",
  "unanswered") });
const bitRate = number(1000, 1e+11);
const NetworkLab = object({ delay: optional(notNegative, 0), jitter: optional(notNegative, 0),
  loss: optional(share, 0), reorder: optional(share, 0), bitrate: absent(bitRate),
  seed: optional(count, 0) });
const LabReport = object({ lab: NetworkLab, taken: optional(count, 0), lost: optional(count, 0),
  overflowed: optional(count, 0), reordered: optional(count, 0), waiting: optional(count, 0),
  held: optional(notNegative, 0) });
const CameraStatus = object({ status: oneOf("failed", "starting"), reason: optional(reason, "") });
const State = object({ stamp, boot: id, seq: count, session: absent(id), epoch: optional(count, 0),
  pose: Pose, velocity: Velocity, battery: Battery, docked: optional(flag, false),
  chargerContact: absent(flag), tilt: absent(radians), mode: optional(mode, "manual"),
  assist: optional(assistLevel, "off"), safety: optional(Safety, {}), errors: optional(list(reason,
  16), []), clearance: absent(notNegative), contacts: optional(count, 0),
  distance: optional(notNegative, 0), visitorSilence: absent(notNegative), viewers: optional(count,
  0), applied: optional(list(AppliedCommand, 64), []), refused: optional(dictionary(count, 64), {}),
  assistWhy: optional(name, ""), assistPoint: absent(point), call: absent(CallState),
  screens: optional(count, 0), knockable: optional(flag, false), knock: absent(KnockState),
  controlNetwork: absent(LabReport), videoNetwork: absent(LabReport),
  cameraStatus: absent(CameraStatus), distanceByPosition: optional(flag, false) });
const PoseUpdate = object({ stamp, pose: Pose, velocity: Velocity, tilt: absent(radians),
  assistWhy: optional(name, ""), assistPoint: absent(point) });
const Scan = object({ stamp, angleMin: radians, angleIncrement: radians, rangeMax: positive,
  ranges: list(nullable(notNegative), 2000) });
const Path = object({ stamp, points: list(point, 2000) });
const RoutePreview = object({ stamp, requestId: id, points: list(point, 500),
  reason: optional(reason, "") });
const Event = object({ stamp, boot: id, seq: count, session: absent(id), epoch: optional(count, 0),
  type: oneOf("adapter_back", "adapter_lost", "charging", "collision", "docked", "door_changed",
  "estop", "estop_cleared", "goal_blocked", "goal_reached", "lease_expired", "lease_taken",
  "localization_found", "localization_lost", "photo", "released", "session_closed", "stopped",
  "undocked"), actionId: absent(id), sha256: absent(text(64)), lastSeq: absent(count),
  detail: optional(reason, "") });
const actionState = oneOf("CANCELLED", "FAILED", "FINISHED", "RUNNING", "WAITING");
const ActionStatus = object({ actionId: id, status: actionState, stamp, type: optional(name, ""),
  reason: optional(reason, ""), result: optional(dictionary(scalar, 16), {}) });
const Words = object({ stamp, actionId: id, session: id, by: oneOf("driver", "screen"),
  who: optional(name, ""), text: text(500, 1), language: optional(text(16), ""),
  aloud: optional(flag, false), receipts: optional(flag, false) });
const wordsState = oneOf("not_spoken", "shown", "spoken");
const Receipt = object({ stamp, actionId: id, session: id, state: wordsState });
const spot = tuple(share, share);
const Pointer = object({ stamp, by: oneOf("driver", "screen"), at: absent(spot) });
const Echo = object({ peer: id, n: count, stamp, received: stamp });
const Heartbeat = object({ n: count, stamp, echoes: optional(list(Echo, 16), []) });
const MediaClock = object({ rtp: integer(0, 4294967295), stamp, rate: optional(integer(1, 1000000),
  90000) });
const Hello = object({ peer: id, stamp, robot: id, online: flag, mayDrive: flag, mayObserve: flag,
  liveElsewhere: optional(flag, false), liveSince: absent(stamp) });
const IceServer = object({ urls: list(reason, 8, 1), username: optional(reason, ""),
  credential: optional(reason, "") });
const LeaseLimits = object({ linear: absent(positive), angular: absent(positive),
  commandAge: absent(positive), frameAge: absent(positive) });
const GrantedTerms = object({ label: optional(name, ""), controllers: absent(list(inputMethod,
  Infinity)), actions: absent(list(name, Infinity)), assist: absent(assistLevel),
  controlWay: optional(oneOf("any", "datachannel", "mqtt"), "any"), interface: optional(name, "")
  });
const Granted = object({ session: id, epoch: count, peer: id, resumed: optional(flag, false),
  turnSeconds: absent(notNegative), iceServers: optional(list(IceServer, Infinity), []),
  limits: optional(LeaseLimits, {}), terms: absent(GrantedTerms) });
const Observing = object({ iceServers: optional(list(IceServer, Infinity), []), sfu: optional(flag,
  false) });
const Refused = object({ reason: oneOf("closed", "disabled", "elsewhere", "ended", "full",
  "not_allowed", "not_invited", "not_trained", "observers_full", "offline", "paused", "private",
  "reserved"), session: absent(id), outcome: optional(name, ""), since: absent(stamp) });
const RoomState = object({ driver: absent(name), driving: optional(flag, false),
  observers: optional(count, 0), waiting: optional(count, 0), pause: optional(reason, ""),
  private: optional(flag, false) });
const questionText = text(280, 1);
const questionState = oneOf("answered", "answering", "declined", "waiting");
const AudienceQuestion = object({ id, text: questionText, state: questionState, who: optional(name,
  ""), own: optional(flag, false) });
const AudienceState = object({ open: optional(flag, false), moderates: optional(flag, false),
  raised: optional(flag, false), hands: optional(count, 0), names: optional(list(name, 30), []),
  questions: optional(list(AudienceQuestion, 100), []) });
const RobotPresence = object({ online: flag, reason: optional(reason, "") });
const Screen = object({ title: name, titles: optional(dictionary(name, 50), {}),
  session: absent(id), visitor: absent(name), waiting: absent(name), study: optional(flag, false),
  iceServers: optional(list(IceServer, Infinity), []) });
const Denied = object({ suffix: name, reason: name });
const Fault = object({ part: oneOf("broker", "database", "disk_full", "disk_low", "robot",
  "session_manager"), then: oneOf("goes_on", "stopped", "stops", "waits"),
  seconds: absent(notNegative) });
const ServerStatus = object({ faults: optional(list(Fault, 8), []) });
const sdp = text(64000);
const SdpAnswer = object({ type: oneOf("answer"), sdp });
const Candidate = object({ type: oneOf("candidate"), candidate: optional(text(2000), ""),
  sdpMid: absent(text(64)), sdpMLineIndex: absent(integer(0, 64)) });
const Bye = object({ type: oneOf("bye"), reason: optional(reason, "") });
const role = oneOf("driver", "observer", "screen", "wizard");
const SdpOffer = object({ type: oneOf("offer"), sdp, role: optional(role, "observer"),
  session: absent(id), epoch: optional(count, 0), who: optional(name, ""),
  iceServers: optional(list(IceServer, 8), []) });
const Queued = object({ session: id, place: count, minutes: notNegative, reason: optional(reason,
  "") });
const Offered = object({ session: id, seconds: notNegative });
const TurnWarning = object({ session: id, remaining: nullable(notNegative), reason: optional(reason,
  "") });
const PresenceAsked = object({ session: id, seconds: notNegative });
const PresenceConfirmed = object({ session: id });
const Task = object({ session: id, stamp, cue: optional(name, ""), number: absent(count),
  x: absent(metres), y: absent(metres), passed: optional(list(count, 100), []),
  remaining: absent(notNegative), window: optional(oneOf("open", "review", "shut"), "shut"),
  photo: optional(text(64), ""), outcome: optional(name, ""), doors: optional(list(name, 1000), [])
  });
const OperatorMessage = object({ session: id, text: reason });
const Ended = object({ session: id, outcome: name, reason: optional(reason, "") });

export const TO_PAGE = {
  "factsheet": [16384, Factsheet],
  "state": [32768, State],
  "pose": [1024, PoseUpdate],
  "scan": [32768, Scan],
  "path": [65536, Path],
  "route": [16384, RoutePreview],
  "event": [4096, Event],
  "action": [4096, ActionStatus],
  "words": [4096, Words],
  "receipt": [1024, Receipt],
  "pointer": [1024, Pointer],
  "heartbeat": [4096, Heartbeat],
  "media": [1024, MediaClock],
  "hello": [131072, Hello],
  "session/granted": [131072, Granted],
  "session/observing": [131072, Observing],
  "session/refused": [131072, Refused],
  "room": [131072, RoomState],
  "audience": [131072, AudienceState],
  "robot": [131072, RobotPresence],
  "screen": [131072, Screen],
  "denied": [131072, Denied],
  "server/status": [131072, ServerStatus],
  "signal/reply": [131072, tagged("type", { answer: SdpAnswer, candidate: Candidate, bye: Bye,
    offer: SdpOffer })],
  "session/queued": [131072, Queued],
  "session/offered": [131072, Offered],
  "session/turn_warning": [131072, TurnWarning],
  "session/asked_there": [131072, PresenceAsked],
  "session/found_there": [131072, PresenceConfirmed],
  "session/task": [131072, Task],
  "session/operator_message": [131072, OperatorMessage],
  "session/ended": [131072, Ended],
};

export const ON_DATA_CHANNEL = new Set(["state", "pose", "path", "scan", "route", "event", "action",
  "heartbeat", "media", "pointer"]);

export const REASONS = new Set(["door_closed", "doorway", "in_the_way", "all_blocked", "boxed_in",
  "no_way", "goal_taken", "too_narrow", "in_wall", "outside", "still_docked", "behind",
  "dock_failed", "tries_again", "no_dock", "looks_for_dock", "before_dock", "person_stayed",
  "person", "very_close", "waits_for_route", "backs_off", "no_farther", "no_laser", "not_found",
  "lost", "wheels", "navigation_lost", "navigation_failed", "map_changed", "agent_ends", "too_fast",
  "navigation_does_not_end", "offline", "estop", "not_connected", "fault", "network", "no_picture",
  "collision", "no_answer", "stale", "future", "clock_unknown", "heartbeat_lost", "failed",
  "no_lease", "observer", "wrong_session", "wrong_epoch", "lease_changed", "not_driver", "rca"]);
