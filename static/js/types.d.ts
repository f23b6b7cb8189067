/** Types that many scripts name. They are global, so that no script has to import them. */

type Card = import("./view/hud/card.js").Card;
type Feature = import("./drive/registry.js").Feature;
type FloorPlan = import("./view/map/floor_plan.js").FloorPlan;
type Intent = import("./protocol/command_stream.js").Intent;
type KeyDispatcher = import("./input/key_dispatcher.js").KeyDispatcher;
type MapView = import("./view/map/transform.js").View;
type Moment = import("./lib/transforms.js").Moment;
type Page = import("./drive/registry.js").Page;
type Peer = import("./protocol/peer.js").Peer;
type RobotAction = import("./protocol/robot_action.js").RobotAction;
type SessionRecord = import("./pages/replay/record.js").SessionRecord;
type State = import("./drive/features.js").State;
type Store = import("./drive/store.js").Store;
type SweptPath = import("./lib/swept_path.js").SweptPath;
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
