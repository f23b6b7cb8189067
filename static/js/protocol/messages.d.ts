// Generated from robots/api and sessions/protocol.py by `make docs`; do not edit.

export interface Factsheet { name: string; series: string; rca: string; agentVersion: string;
  boot: string; capabilities: Array<"assist" | "audio" | "call" | "dock" | "doors" | "follow" |
  "goto" | "localization" | "network_lab" | "photo" | "point" | "relocalize" | "safety_test" | "say"
  | "scan" | "tilt" | "undock" | "velocity" | "video">; limits: Limits; footprint: Array<[number,
  number]>; camera: Camera | null; tilt: TiltRange | null; laser: Laser | null; mapId: string;
  watchdog: number; viewers: number; previewsRoutes: boolean; navigationControl: string;
  adapter: string; driver: string }
export interface Limits { linear: number; reverse: number; angular: number;
  linearAcceleration: number; angularAcceleration: number; linearBraking: number;
  angularBraking: number; commandAge: number; commandAgeCeiling: number; frameAge: number;
  frameAgeCeiling: number; deadman: number }
export interface Camera { width: number; height: number; fps: number; hfov: number; x: number;
  z: number; pitch: number }
export interface TiltRange { minimum: number; maximum: number; home: number; speed: number }
export interface Laser { x: number; y: number; theta: number }
export interface State { stamp: number; boot: string; seq: number; session: string | null;
  epoch: number; pose: Pose; velocity: Velocity; battery: Battery; docked: boolean;
  chargerContact: boolean | null; tilt: number | null; mode: "assisted" | "docking" | "goto" |
  "manual" | "stopped"; assist: "off" | "slow" | "steer"; safety: Safety; errors: Array<string>;
  clearance: number | null; contacts: number; distance: number; visitorSilence: number | null;
  viewers: number; applied: Array<AppliedCommand>; refused: Record<string, number>;
  assistWhy: string; assistPoint: [number, number] | null; call: CallState | null; screens: number;
  knockable: boolean; knock: KnockState | null; controlNetwork: LabReport | null;
  videoNetwork: LabReport | null; cameraStatus: CameraStatus | null; distanceByPosition: boolean }
export interface Pose { x: number; y: number; theta: number; covariance: [number, number, number,
  number, number, number] | null; localized: boolean; score: number }
export interface Velocity { linear: number; angular: number }
export interface Battery { charge: number | null; voltage: number | null; charging: boolean | null }
export interface Safety { estop: boolean; estopSource: string | null; collision: boolean;
  inhibited: string | null; stopSeq: number | null; stopId: string | null; touched: Array<"ahead" |
  "behind" | "left" | "right">; button: boolean | null }
export interface AppliedCommand { seq: number; stamp: number; method: "gamepad" | "keyboard" | "map"
  | "mouse" | "script" | "stick" | "touch"; way: "datachannel" | "mqtt"; age: number;
  linear: number; angular: number; frameAge: number | null; asked: Velocity | null;
  allowed: Velocity | null; share: number | null }
export interface CallState { status: "accepted" | "declined" | "ringing" | "unanswered";
  audio: boolean; video: boolean; volume: number; shares: boolean; shown: boolean | null;
  audible: boolean | null }
export interface KnockState { actionId: string; status: "answered" | "declined" | "ringing" |
  "unanswered" }
export interface LabReport { lab: NetworkLab; taken: number; lost: number; overflowed: number;
  reordered: number; waiting: number; held: number }
export interface NetworkLab { delay: number; jitter: number; loss: number; reorder: number;
  bitrate: number | null; seed: number }
export interface CameraStatus { status: "failed" | "starting"; reason: string }
export interface PoseUpdate { stamp: number; pose: Pose; velocity: Velocity; tilt: number | null;
  assistWhy: string; assistPoint: [number, number] | null }
export interface Scan { stamp: number; angleMin: number; angleIncrement: number; rangeMax: number;
  ranges: Array<number | null> }
export interface Path { stamp: number; points: Array<[number, number]> }
export interface RoutePreview { stamp: number; requestId: string; points: Array<[number, number]>;
  reason: string }
export interface Event { stamp: number; boot: string; seq: number; session: string | null;
  epoch: number; type: "adapter_back" | "adapter_lost" | "charging" | "collision" | "docked" |
  "door_changed" | "estop" | "estop_cleared" | "goal_blocked" | "goal_reached" | "lease_expired" |
  "lease_taken" | "localization_found" | "localization_lost" | "photo" | "released" |
  "session_closed" | "stopped" | "undocked"; actionId: string | null; sha256: string | null;
  lastSeq: number | null; detail: string }
export interface ActionStatus { actionId: string; status: "CANCELLED" | "FAILED" | "FINISHED" |
  "RUNNING" | "WAITING"; stamp: number; type: string; reason: string; result: Record<string, number
  | string | boolean | null> }
export interface Words { stamp: number; actionId: string; session: string; by: "driver" | "screen";
  who: string; text: string; language: string; aloud: boolean; receipts: boolean }
export interface Receipt { stamp: number; actionId: string; session: string; state: "not_spoken" |
  "shown" | "spoken" }
export interface Pointer { stamp: number; by: "driver" | "screen"; at: [number, number] | null }
export interface Heartbeat { n: number; stamp: number; echoes: Array<Echo> }
export interface Echo { peer: string; n: number; stamp: number; received: number }
export interface MediaClock { rtp: number; stamp: number; rate: number }
export interface Hello { peer: string; stamp: number; robot: string; online: boolean;
  mayDrive: boolean; mayObserve: boolean; liveElsewhere: boolean; liveSince: number | null }
export interface Granted { session: string; epoch: number; peer: string; resumed: boolean;
  turnSeconds: number | null; iceServers: Array<IceServer>; limits: LeaseLimits; terms: GrantedTerms
  | null }
export interface IceServer { urls: Array<string>; username: string; credential: string }
export interface LeaseLimits { linear: number | null; angular: number | null; commandAge: number |
  null; frameAge: number | null }
export interface GrantedTerms { label: string; controllers: Array<"gamepad" | "keyboard" | "map" |
  "mouse" | "script" | "stick" | "touch"> | null; actions: Array<string> | null; assist: "off" |
  "slow" | "steer" | null; controlWay: "any" | "datachannel" | "mqtt"; interface: string }
export interface Observing { iceServers: Array<IceServer>; sfu: boolean }
export interface Refused { reason: "closed" | "disabled" | "elsewhere" | "ended" | "full" |
  "not_allowed" | "not_invited" | "not_trained" | "observers_full" | "offline" | "paused" |
  "private" | "reserved"; session: string | null; outcome: string; since: number | null }
export interface RoomState { driver: string | null; driving: boolean; observers: number;
  waiting: number; pause: string; private: boolean }
export interface AudienceState { open: boolean; moderates: boolean; raised: boolean; hands: number;
  names: Array<string>; questions: Array<AudienceQuestion> }
export interface AudienceQuestion { id: string; text: string; state: "answered" | "answering" |
  "declined" | "waiting"; who: string; own: boolean }
export interface RobotPresence { online: boolean; reason: string }
export interface Screen { title: string; titles: Record<string, string>; session: string | null;
  visitor: string | null; waiting: string | null; study: boolean; iceServers: Array<IceServer> }
export interface Denied { suffix: string; reason: string }
export interface ServerStatus { faults: Array<Fault> }
export interface Fault { part: "broker" | "database" | "disk_full" | "disk_low" | "robot" |
  "session_manager"; then: "goes_on" | "stopped" | "stops" | "waits"; seconds: number | null }
export interface SdpAnswer { type: "answer"; sdp: string }
export interface Candidate { type: "candidate"; candidate: string; sdpMid: string | null;
  sdpMLineIndex: number | null }
export interface Bye { type: "bye"; reason: string }
export interface SdpOffer { type: "offer"; sdp: string; role: "driver" | "observer" | "screen" |
  "wizard"; session: string | null; epoch: number; who: string; iceServers: Array<IceServer> }
export interface Queued { session: string; place: number; minutes: number; reason: string }
export interface Offered { session: string; seconds: number }
export interface TurnWarning { session: string; remaining: number | null; reason: string }
export interface PresenceAsked { session: string; seconds: number }
export interface PresenceConfirmed { session: string }
export interface Task { session: string; stamp: number; cue: string; number: number | null;
  x: number | null; y: number | null; passed: Array<number>; remaining: number | null;
  window: "open" | "review" | "shut"; photo: string; outcome: string; doors: Array<string> }
export interface OperatorMessage { session: string; text: string }
export interface Ended { session: string; outcome: string; reason: string }

/** By suffix. */
export interface ToPage { factsheet: Factsheet; state: State; pose: PoseUpdate; scan: Scan;
  path: Path; route: RoutePreview; event: Event; action: ActionStatus; words: Words;
  receipt: Receipt; pointer: Pointer; heartbeat: Heartbeat; media: MediaClock; hello: Hello;
  "session/granted": Granted; "session/observing": Observing; "session/refused": Refused;
  room: RoomState; audience: AudienceState; robot: RobotPresence; screen: Screen; denied: Denied;
  "server/status": ServerStatus; "signal/reply": SdpAnswer | Candidate | Bye | SdpOffer;
  "session/queued": Queued; "session/offered": Offered; "session/turn_warning": TurnWarning;
  "session/asked_there": PresenceAsked; "session/found_there": PresenceConfirmed;
  "session/task": Task; "session/operator_message": OperatorMessage; "session/ended": Ended }

/** The largest size in bytes, and the shape, of the messages that a page receives. */
export const TO_PAGE: Record<string, [number, import("./shapes.js").Shape]>;
/** The suffixes that a robot's data channel may carry to a page. */
export const ON_DATA_CHANNEL: Set<string>;
/** The codes for which the page has the sentence `reason.<code>`. */
export const REASONS: Set<string>;
