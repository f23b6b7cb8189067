"""The contents of a pseudonymous dataset: the fields of each kind of event and message, with their
forms (experiments/extraction/forms.py).

A field that is not listed does not leave. Every new kind of message or event and every new field
needs an entry, such as `withheld`; tests/unit/experiments/extraction/test_allow_list.py fails until
it has one. Ids leave as pseudonyms or not at all, times relative to the grant; hashes, names,
addresses and the counters of a robot's run never leave.

An identified dataset has events as they are stored.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, get_args

import msgspec

from experiments.dataset import states
from experiments.dataset.columns import Column, declared
from experiments.dataset.levels import END_REASONS
from experiments.dataset.records import EventRecord
from experiments.definition.coding import CodingScheme
from experiments.definition.cues import CueKey
from experiments.definition.schema import Outcome
from experiments.extraction.forms import (
    Form,
    Origin,
    Release,
    code,
    door,
    door_state,
    fields,
    in_columns,
    in_words,
    kept,
    number,
    page_word,
    private,
    robot_reason,
    script_step,
    text,
    time,
    withheld,
    words,
)
from robots.api import messages as m
from sessions import protocol as p
from sessions.devices import OTHER as OTHER_DEVICE
from sessions.devices import SYSTEMS, TABLE_3_BROWSERS
from sessions.interfaces import INTERFACES
from sessions.leases.absences import ABSENT, BACK, PAGE_CLOSED
from sessions.leases.fault_side import MANAGER, WEB
from sessions.wizard import leases as wizard
from sessions.wizard.script import Deviation

Fields = Mapping[str, Form]

SIDES = ("ahead", "left", "behind", "right")
LINK_REASONS = (
    *("failed", "no_answer", "no_offer", "no_way", "silent", "unexpected_answer"),
    *("unusable_answer", "bye_failed", "bye_flooded", "bye_full", "bye_lease_changed"),
    *("bye_left", "bye_replaced"),
)
DEVICE_TROUBLES = ("", "busy", "missing", "refused", "unsupported")
# What a check of the connection found, by topic: static/js/pages/check/verdict.js.
CHECKED = words(
    *("bad", "barred", "blocked", "detour", "good", "in_app", "live", "none", "off", "open"),
    *("quick", "slow", "there", "unknown"),
)
# Apps whose browser was recognised: static/js/pages/check/in_app.js.
APPS = words(
    *("Facebook", "Google", "Instagram", "KakaoTalk", "LINE", "LinkedIn", "Pinterest"),
    *("Snapchat", "TikTok", "WeChat", "X", "app"),
)
OS = frozenset({*SYSTEMS, OTHER_DEVICE})
BROWSERS = TABLE_3_BROWSERS | {OTHER_DEVICE}
_actions = words("", *(kind.__struct_config__.tag for kind in get_args(m.AnyAction)))

# --- parts ----------------------------------------------------------------------------------------

POSE = fields({"x": number, "y": number, "theta": number})
# How the robot stands to a mirror: experiments.definition.course.Sight.
FACING = fields({"bearing": number, "distance": number, "before": number, "sees": number})
# `stamp` is when a photo was taken; the others are of a relocalization, a drive, and states that
# were sent again.
RESULT = fields(
    {
        **dict.fromkeys(("x", "y", "theta", "score", "progress"), number),
        **dict.fromkeys(("bytes", "sent", "missing"), number),
        "stamp": time,
    }
)


def _read_by(reader: type[msgspec.Struct]) -> Fields:
    return {one.encode_name: in_columns for one in msgspec.structs.fields(reader)}


# --- messages of the Robot API, and of pages and server -------------------------------------------

# Those that the record of a session is made of. The form of an event's `detail` depends on its
# type, in ROBOT.
_EVENT: Fields = {
    "stamp": time,
    "boot": code,
    "seq": withheld,
    "session": withheld,
    "epoch": withheld,
    "type": words(*get_args(m.Event.__annotations__["type"])),
    "actionId": code,
    "sha256": withheld,
    "lastSeq": withheld,
    "detail": text,
}
MESSAGES: Mapping[type, Fields] = {
    m.Event: _EVENT,
    m.ActionStatus: {
        "actionId": code,
        "status": words(*get_args(m.ActionState)),
        "stamp": time,
        "type": _actions,
        "reason": robot_reason,
        "result": RESULT,
    },
    p.PageEvent: {"stamp": time, "type": withheld, "data": withheld},  # PAGE has its types
    # The fields that are read into columns are those of the classes that read them.
    m.State: {
        **_read_by(states.StoredState),
        **dict.fromkeys(("boot", "session", "epoch", "chargerContact", "assist"), withheld),
        **dict.fromkeys(("safety", "errors", "viewers", "assistWhy", "assistPoint"), withheld),
        **dict.fromkeys(("call", "screens", "controlNetwork", "videoNetwork"), withheld),
        **dict.fromkeys(("cameraStatus", "knock", "knockable"), withheld),
    },
    m.Pose: {**_read_by(states.StoredPose), "covariance": withheld},
    m.Velocity: _read_by(states.StoredVelocity),
    m.Battery: {**_read_by(states.StoredBattery), "voltage": withheld},
    m.AppliedCommand: {
        **_read_by(states.StoredCommand),
        **dict.fromkeys(("seq", "stamp"), withheld),
    },
    p.PageNetwork: {**_read_by(states.StoredSample), "stamp": in_columns, "path": withheld},
    # These are read into words: `facts` and `spell`.
    m.Factsheet: {
        **dict.fromkeys(("series", "rca"), in_columns),
        **dict.fromkeys(("capabilities", "limits", "camera", "tilt", "laser"), in_columns),
        **dict.fromkeys(("agentVersion", "adapter", "driver"), in_columns),
        **dict.fromkeys(("name", "boot", "footprint", "mapId"), withheld),
        **dict.fromkeys(("watchdog", "viewers", "navigationControl"), withheld),
    },
    m.LabReport: {
        "lab": in_columns,
        **dict.fromkeys(("taken", "lost", "overflowed", "reordered"), withheld),
        **dict.fromkeys(("waiting", "held"), withheld),
    },
    m.NetworkLab: {
        **dict.fromkeys(("delay", "jitter", "loss", "reorder", "bitrate"), in_columns),
        "seed": withheld,
    },
    # Notices that the session manager writes into the record.
    p.Offered: {"session": withheld, "seconds": number},
    p.TurnWarning: {"session": withheld, "remaining": number},
    p.PresenceAsked: {"session": withheld, "seconds": number},
    p.PresenceConfirmed: {"session": withheld},
    p.OperatorMessage: {"session": withheld, "text": text},
    p.Ended: {
        "session": withheld,
        "outcome": words(*get_args(Outcome), "moved"),
        "reason": words("", *END_REASONS),
    },
}
# Those that are no part of the record of a session: nothing of them leaves.
KEPT_BACK: frozenset[type] = frozenset(
    {
        *(m.Safety, m.Limits, m.Camera, m.Laser, m.TiltRange, m.CallState, m.CameraStatus),
        *(m.KnockState, m.Receipt),
        *(m.Connection, m.PoseUpdate, m.Scan, m.Path, m.Words, m.Pointer, m.Echo, m.Heartbeat),
        *(m.CommandHeartbeat, m.Lease, m.PointCommand, m.VelocityCommand),
        *(m.MediaClock, m.LeaseLimits, m.Config, m.FloorPlanUpdate, m.IceServer, m.SdpOffer),
        *(m.SdpAnswer, m.Candidate, m.Bye, m.Stay, m.PictureRequest, m.ManagerStatus),
        *get_args(m.AnyAction),
        *(p.Take, p.Observe, p.Leave, p.Assist, p.Direct, p.Hello, p.GrantedTerms, p.Granted),
        *(p.Observing, p.Refused, p.RoomState, p.Screen, p.RobotPresence, p.Fault),
        *(p.ServerStatus, p.Denied, p.Queued, p.Task, p.PageReport, p.WantOffer),
        *(p.RaiseHand, p.AskQuestion, p.MarkQuestion, p.LowerHands),
        *(p.AudienceQuestion, p.AudienceState),
    }
)

# --- events ---------------------------------------------------------------------------------------

NONE: Fields = {}
_LAID_OUT: Fields = {
    "interface": words(*INTERFACES),
    "layout": words("low", "upright", "wide"),
    **dict.fromkeys(("width", "height"), private(number)),
    "touch": number,
    # together they tell devices apart
    **dict.fromkeys(("screen_width", "screen_height", "density"), withheld),
}
_SHOWN: Fields = {"word": page_word, "number": number, "seconds": number}
_DETAILS: Mapping[str, Form] = {
    "collision": words(*SIDES, is_several=True),
    "door_changed": door_state,
    "goal_blocked": robot_reason,
    "goal_reached": words(""),
    "stopped": words(*get_args(m.Action.__annotations__["role"])),
    # these name who it was
    **dict.fromkeys(("estop", "estop_cleared", "lease_taken"), withheld),
}
ROBOT: Mapping[str, Fields] = {
    "action": MESSAGES[m.ActionStatus],
    **{
        kind: {**_EVENT, "detail": _DETAILS.get(kind, text)}
        for kind in get_args(m.Event.__annotations__["type"])
    },
}
_SERVED = {name: MESSAGES[kind] for name, kind in p.NOTICES.items() if kind in MESSAGES}
SERVER: Mapping[str, Fields] = {
    **_SERVED,
    "operator_end": {"reason": text, "user": withheld},
    "operator_message": {"text": text, "user": withheld},
    "states_missing": {"boot": code, "ranges": withheld, "count": number},
    **{key: {"reason": robot_reason} for key in ("robot_not_ready", "staff_called")},
    **{key: {"part": words(WEB, MANAGER), "since": time, "until": time} for key in (ABSENT, BACK)},
    PAGE_CLOSED: {"code": number},
    **dict.fromkeys(("connecting", "driving", "reconnecting", "robot_ready"), NONE),
    # of a hidden operator, who has a pseudonym
    wizard.STEP: {
        "step": script_step,
        "id": code,
        "deviation": words("", *get_args(Deviation)),
        "skipped": number,
        "reason": robot_reason,
        "by": code,
    },
    wizard.LINE: {"id": code, "text": text, "aloud": number, "by": code},
    wizard.BY_HAND: {"method": words(*get_args(m.InputMethod)), "by": code},
    wizard.REACHED: {"id": code, "latency": number, "by": code},
    wizard.TOOK: {"blind": number, "by": code},
    wizard.LEFT: {"by": code},
    wizard.LOST: {"by": code},
    **dict.fromkeys(("first_motion", "turn_limited", "turn_unlimited"), NONE),
}
PAGE: Mapping[str, Fields] = {
    **dict.fromkeys(("blur", "hidden", "pagehide", "here"), NONE),
    **dict.fromkeys(("practice_began", "practice_ended"), NONE),
    **dict.fromkeys(("cue_shown", "alert_shown", "card_shown", "photo_window_shown"), _SHOWN),
    **{key: {"on": number} for key in ("full_screen", "screen_shared", "slow_picture", "sound")},
    **{key: {"on": number, "why": words(*DEVICE_TROUBLES)} for key in ("camera", "microphone")},
    "check": {
        **dict.fromkeys(("server", "picture", "way", "detour"), CHECKED),
        "browser": private(CHECKED),
        **dict.fromkeys(("microphone", "camera", "gamepad", "overall"), CHECKED),
        "roundTrip": number,
        "app": private(APPS),
    },
    "controller": {"method": words(*get_args(m.InputMethod))},
    "first_frame": {"way": words("direct", "server")},
    "gamepad": {"there": number, "stick": words("left", "right")},
    "layout": _LAID_OUT,
    "link_lost": {"why": words(*LINK_REASONS)},
    "map": {"open": number},
    "permission": {
        "name": words("camera", "microphone"),
        "state": words("denied", "granted", "prompt"),
    },
    "photo_answer": {"id": code, "choice": words("again", "keep", "skip"), "photo": code},
    "script_error": {"error": text, "at": text, "times": number},
    "tab": {"hidden": number},
}
_PLACED: Fields = {"number": number, "pose": POSE, "facing": FACING}
_OF_PHOTO: Fields = {**_PLACED, "name": code}
TASK: Mapping[str, Fields] = {
    **dict.fromkeys(("task_started", "time_warning", "checkpoint", "out_of_order"), _PLACED),
    **dict.fromkeys(("left_station", "docked_early", "docked", "photo_prompt"), _PLACED),
    **dict.fromkeys(("dock_contact", "dock_contact_lost"), _PLACED),
    **dict.fromkeys(("photo_taken", "photo_failed"), _OF_PHOTO),
    **dict.fromkeys(("photo_kept", "photo_again", "photo_skipped"), _OF_PHOTO),
    "door_passed": {**_PLACED, "name": door},
    "cue": {**_PLACED, "name": words(*get_args(CueKey))},
    "task_ended": {**_PLACED, "name": words(*get_args(Outcome))},
}
# Markers of other streams (experiments/markers/): a laboratory sends any text.
LAB: Mapping[str, Fields] = {"marker": {"stream": text, "value": text}}
EVENTS = {"robot": ROBOT, "server": SERVER, "page": PAGE, "task": TASK, "lab": LAB}
# A coded event of a replay; `coded` has the forms of the scheme's words.
CODING_EDIT: Fields = {
    **dict.fromkeys(("id", "coding", "event", "version", "is_deleted", "at"), withheld),
    **dict.fromkeys(("begin", "end"), number),
    **dict.fromkeys(("code", "modifiers"), in_columns),
    "comment": text,
}


def coded(scheme: CodingScheme) -> Fields:
    every = (modifier for code in scheme.codes for modifier in code.modifiers)
    modifiers = fields({modifier.name: words(*modifier.values) for modifier in every})
    codes = words(*(code.code for code in scheme.codes))
    return CODING_EDIT | {"code": codes, "modifiers": modifiers}


def released(
    source: str, kind: str, data: Mapping[str, Any], release: Release, origin: Origin
) -> dict[str, Any] | None:
    """Return the part of an event's data that leaves; None when no event of this kind does."""
    if release.choice.identified:
        return dict(data)
    listed = EVENTS.get(source, {}).get(kind)
    return None if listed is None else kept(listed, data, release, origin)


def event_columns() -> tuple[Column, ...]:
    """Return the columns of the events; the levels of a type are its sources and its fields."""
    found: dict[str, list[str]] = {}
    for source, kinds in EVENTS.items():
        for kind, listed in kinds.items():
            found.setdefault(kind, []).append(f"{source}: {in_words(listed)}".removesuffix(": "))
    types = {kind: "; or ".join(parts) for kind, parts in sorted(found.items())}
    columns = declared(EventRecord)
    return tuple(replace(one, levels=types) if one.name == "type" else one for one in columns)


def end_reason(reason: str, release: Release) -> str:
    """Return why a session ended; text of a person only where free text is kept."""
    return reason if release.choice.has_text or reason in END_REASONS else ""


def device(name: str, release: Release, known: frozenset[str]) -> str:
    """Return the word for an operating system or a browser; no public dataset has it."""
    if release.choice.public:
        return ""
    return name if release.choice.identified or name in known else ""
