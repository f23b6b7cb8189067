/** Types that many scripts name. They are global, so that no script has to import them. */

type Card = import("./view/hud/card.js").Card;
type FloorPlan = import("./view/map/floor_plan.js").FloorPlan;
type Intent = import("./protocol/command_stream.js").Intent;
type KeyDispatcher = import("./input/key_dispatcher.js").KeyDispatcher;
type MapView = import("./view/map/transform.js").View;
type Moment = import("./lib/transforms.js").Moment;
type Peer = import("./protocol/peer.js").Peer;
type RobotAction = import("./protocol/robot_action.js").RobotAction;
type SessionRecord = import("./pages/replay/record.js").SessionRecord;
type State = import("./drive/features.js").State;
type Store = import("./drive/store.js").Store;
type SweptPath = import("./lib/swept_path.js").SweptPath;
type ToPage = import("./protocol/messages.js").ToPage;
type Transport = import("./protocol/clock_sync.js").Transport;
type Visit = import("./protocol/session.js").Visit;
type Words = import("./lib/words.js").Words;

type Canvas2D = CanvasRenderingContext2D;

/** Returns the page's element of an id. */
type GetElement = (id: string) => HTMLElement;

/** x, y: metres, or CSS pixels where a comment says so. */
type Point = [number, number];

/** Where a robot is on the map: metres and radians. */
type Place = { x: number; y: number; theta: number };

/** Colours by name, and `font`: lib/colours.js. */
type Paint = Record<string, string>;

type Handler = import("./input/key_dispatcher.js").KeyHandler;
type PageEventData = Record<string, string | number | boolean | null>;

/** The messages of the drive page by suffix, with the one that is no JSON. */
type Received = ToPage & { picture: { stamp: number; jpeg: Uint8Array } };

/** A part of the drive page: drive/registry.js. */
interface Feature {
    /** under which the others find its `api`: `page[name]` */
    name: string;
    /** its slice of the store; features.js has it for a feature that is loaded later */
    state?: () => object;
    setUp: (page: Page) => FeatureParts;
}

interface FeatureParts {
    /** for other features */
    api?: object;
    handlers?: Handlers;
    actions?: Actions;
    /** by the command of input/keymap.js */
    keys?: Record<string, Handler>;
    /** writes the state into the page's elements, once a frame, and does nothing else */
    render?: (state: State) => void;
    on?: Listeners;
}

/** By the suffix of a message. */
type Handlers = { [S in keyof Received]?: (message: Received[S], transport: Transport) => unknown };
/** By the name in `data-action`. */
type Actions = Record<string, (argument: string) => unknown>;
type Listeners = { [Name in keyof PageEvents]?: (...values: PageEvents[Name]) => unknown };

/** Events of the drive page, and what comes with them. */
interface PageEvents {
    /** before the changed state is rendered */
    changed: [state: State];
    /** twenty times, five times and once a second; Unix time */
    tick: [now: number];
    poll: [now: number];
    second: [now: number];
    phase: [phase: string, before: string];
    /** this page drives: the lease; `began` at the first one of a session, true after a reload */
    granted: [lease: any];
    began: [isContinued: boolean];
    released: [];
    /** the robot has no driver any more */
    freed: [];
    /** a controller asks for a velocity */
    steered: [intent: Intent];
    focusLost: [why: string];
    factsheet: [factsheet: any];
    newRobotState: [state: any];
    socketOpen: [];
    linkOpening: [peer: Peer];
    linkDropping: [];
    linkLost: [];
    linkClosed: [];
    frameShown: [];
}

/** What every feature gets, with the `api` of the other features. */
interface Page {
    /** from the template */
    config: any;
    words: Words;
    element: GetElement;
    store: Store;
    keys: KeyDispatcher;
    useKeys: (own: Record<string, string[]>) => void;
    handle: import("./drive/registry.js").Registry["handle"];
    emit: <Name extends keyof PageEvents>(name: Name, ...values: PageEvents[Name]) => void;
    act: (action: string) => void;
    begin: () => void;
    connection: {
        socket: import("./protocol/socket.js").Socket;
        link: import("./protocol/link.js").Link;
        router: import("./protocol/transport_router.js").TransportRouter;
        clockSync: import("./protocol/clock_sync.js").ClockSync;
        commands: import("./protocol/command_stream.js").CommandStream;
        send: (suffix: string, message: object, options?: { droppable?: boolean }) => boolean;
        /** sends something for the record of the session; whether it was handed to the network */
        report: (type: string, data?: PageEventData, stamp?: number) => boolean;
        grantedAt: () => number;
    };
    session: {
        dispatch: (happening: import("./protocol/session.js").Happening) => void;
        begin: (loaded: { session: string | null; takeover: boolean; go: boolean }) => void;
    };
    video: {
        viewport: import("./view/video/viewport.js").Viewport;
        fallback: import("./view/video/jpeg_fallback.js").JpegFallback;
        shown: import("./view/video/capture_stamp.js").ShownFrame;
        frameStamp: () => number | null;
        frameAge: (now: number) => number | null;
    };
    driving: {
        steering: import("./input/steering.js").Steering;
        brake: () => void;
        sendVelocity: () => void;
        standStill: () => void;
        sendAction: (action: RobotAction) => void;
        sendPointer: (pointer: { stamp: number; at: Point | null }) => unknown;
        askRoute: (request: { requestId: string; x: number; y: number }) => unknown;
    };
    waiting: {
        lazyPanels: (
            use: (
                panels: ReturnType<typeof import("./waiting/lazy_panels.js").createLazyPanels>,
            ) => void,
            missing?: () => void,
        ) => void;
    };
    hud: {
        alertFor: typeof import("./view/hud/alert.js").alertFor;
        cardFor: typeof import("./view/hud/card.js").cardFor;
    };
    map: import("./view/map/robot_map.js").RobotMap;
    autonomy: {
        assist: (level: string) => void;
        mayAim: () => boolean;
        goTo: (point: Point) => void;
        forgetAim: () => void;
    };
}
