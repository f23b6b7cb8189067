"""A session as an MCAP file in JSON, which Foxglove plays back like a robot's own recording. The
schemas (experiments/export/texts/mcap_schemas.json) are those of
https://docs.foxglove.dev/docs/sdk/schemas, as far as they are filled in.
"""

import io
import json
import math
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec
from django.utils.translation import gettext_lazy as _
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from experiments.dataset.columns import Columns
from experiments.dataset.records import Dataset, EventRecord, SessionRecord
from experiments.export.format import ExportFormat, File, text_of
from experiments.extraction.events import events_of
from experiments.extraction.sessions import granted
from experiments.models import Drive

FRAME = "map"
INFO = 2  # foxglove.Log's level
NANO = 1_000_000_000
VELOCITY, COMMANDS = ("linear", "angular"), ("commands", "refused", "age_max")
NETWORK = ("round_trip", "loss", "fps", "bitrate", "freezes", "frame_age")

CHANNELS = {
    "/pose": "foxglove.PoseInFrame",  # where the robot was
    "/path": "foxglove.PosesInFrame",  # its driven path, once
    "/course": "foxglove.PosesInFrame",  # the suggested path, once
    "/velocity": "telepresence.Velocity",  # its measured velocity
    "/commands": "telepresence.Commands",  # applied and refused since the previous state
    "/network": "telepresence.Network",  # the visitor's connection
    "/events": "foxglove.Log",
}
Message = tuple[float, str, dict[str, Any]]  # seconds since the grant; topic; content


class McapFormat(ExportFormat):
    label = _("with a Foxglove recording of each session")
    help = "with a Foxglove recording of each session"

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        """Yield the recording of a session; only an identified one has its date."""
        one = self.source
        begin = granted(drive) if one.release.choice.identified else 0.0
        events = events_of([drive], one.release)
        content = recording(one.dataset, session, events, begin=begin)
        yield f"mcap/session-{session.id}.mcap", [content]


def recording(
    dataset: Dataset, session: SessionRecord, events: Iterable[EventRecord], *, begin: float = 0.0
) -> bytes:
    """Return an MCAP file; `begin` is the grant in Unix seconds, or 0 to keep it secret."""
    states, network = dataset.states(session.id), dataset.network(session.id)
    found = [*_once(dataset, session, states), *_of_states(states)]
    found += [*_of_network(network), *_of_events(events)]
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD)
    writer.start(profile="", library="telepresence")
    schemas, channels = json.loads(text_of("mcap_schemas.json")), {}
    for topic, name in CHANNELS.items():
        schema = json.dumps(schemas[name]).encode()
        number = writer.register_schema(name, SchemaEncoding.JSONSchema, schema)
        channels[topic] = writer.register_channel(topic, MessageEncoding.JSON, number)
    names = ("participant", "robot", "condition", "outcome")
    about = {"session": session.id} | {name: getattr(session, name) for name in names}
    writer.add_metadata("session", about | {"study": dataset.study.slug})
    for number, (at, topic, body) in enumerate(sorted(found, key=lambda message: message[0])):
        nanoseconds = round(max(0.0, begin + at) * NANO)
        stamped = {"timestamp": {"sec": nanoseconds // NANO, "nsec": nanoseconds % NANO}} | body
        content = msgspec.json.encode(stamped)
        writer.add_message(channels[topic], nanoseconds, content, nanoseconds, number)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def _once(dataset: Dataset, session: SessionRecord, states: Columns) -> Iterator[Message]:
    course = dataset.course(session)
    if course is not None:
        points = course.path or tuple((stop.x, stop.y) for stop in course.checkpoints)
        yield 0.0, "/course", {"frame_id": FRAME, "poses": [_pose(x, y, 0.0) for x, y in points]}
    rows = states[["x", "y", "theta"]].tolist()
    poses = [_pose(x, y, theta) for x, y, theta in rows if math.isfinite(x + y + theta)]
    yield 0.0, "/path", {"frame_id": FRAME, "poses": poses}


def _pose(x: float, y: float, theta: float) -> dict[str, Any]:
    half = theta / 2.0
    return {
        "position": {"x": x, "y": y, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)},
    }


def _of_states(states: Columns) -> Iterator[Message]:
    """Yield states by the server's clock, as events are."""
    names = ["stamp", "clock_offset", "x", "y", "theta", *VELOCITY, *COMMANDS]
    for stamp, offset, x, y, theta, *rest in states[names].tolist():
        at = stamp - (offset if math.isfinite(offset) else 0.0)
        if math.isfinite(x + y + theta):
            yield at, "/pose", {"frame_id": FRAME, "pose": _pose(x, y, theta)}
        yield at, "/velocity", _named(VELOCITY, rest)
        yield at, "/commands", _named(COMMANDS, rest[len(VELOCITY) :])


def _of_network(network: Columns) -> Iterator[Message]:
    for at, *rest in network[["stamp", *NETWORK]].tolist():
        yield at, "/network", _named(NETWORK, rest)


def _of_events(events: Iterable[EventRecord]) -> Iterator[Message]:
    for event in events:
        data = json.dumps(event.data, ensure_ascii=False) if event.data else ""
        body = {"level": INFO, "message": f"{event.type} {data}".rstrip(), "name": event.source}
        yield event.stamp, "/events", body | {"file": "", "line": 0}


def _named(names: Iterable[str], values: Iterable[float]) -> dict[str, float | None]:
    found = zip(names, values, strict=False)
    return {name: value if math.isfinite(value) else None for name, value in found}
