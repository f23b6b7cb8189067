"""Writes the reference: `python -m robots.api.reference` from the top of the project.

docs/reference/robot-api.md and its JSON Schema come from the docstrings, the topic table and
robots.api.examples, and so do the golden messages that both languages' tests read. A test compares
all of them with what stands in the tree.
"""

import inspect
import json
import sys
import typing
from pathlib import Path

import msgspec

from robots.api import messages as m
from robots.api import topics
from robots.api.examples import EXAMPLES, MANAGER_STATUS
from robots.api.schema import json_schema

REFERENCE = "docs/reference/robot-api.md"
SCHEMA = "docs/reference/robot-api.schema.json"
GOLDEN = "tests/golden"
_RANGES = (
    ("ge", "≥ {}"),
    ("gt", "> {}"),
    ("le", "≤ {}"),
    ("lt", "< {}"),
    ("min_length", "at least {} long"),
    ("max_length", "at most {} long"),
)

_INTRODUCTION = """\
# Robot API, version {version}

<!-- Written by `python -m robots.api.reference`; change the docstrings instead. -->

What robots, servers and pages say to each other. This page and
[robot-api.schema.json](robot-api.schema.json) are enough to write an agent in any language.

## Ground rules

- A robot dials out: one MQTT connection, with the user name and the token that its owner got from
  the site. Nothing connects to it.
- Topics are `{root}/<robot>/<suffix>`. A robot writes only its own outputs and reads only its own
  inputs; its name is made of lower-case letters, digits and hyphens.
- A message is a JSON object in UTF-8 with names in camelCase. Fields at their default may be left
  out. Unknown fields are ignored.
- Metres, radians, seconds; x forward, y left, angles counter-clockwise. `stamp` is Unix time in
  seconds by the sender's own clock.
- What is malformed, too large, out of range or of the wrong direction is counted and dropped; it
  never ends a connection.
- On the data channel `control` (unordered, no retransmission) and on the page's WebSocket a frame
  is the suffix, a newline, and the same JSON.
- An agent connects with a clean session, publishes `connection` and `factsheet` after each connect,
  names CONNECTIONBROKEN as its last will, and says ONLINE again when it reads on its own
  `connection` topic that it is not.

## What an agent must do by itself

Stop, when in doubt. A velocity command moves the robot only when its session and epoch are those of
a live lease, its seq is newer than every one before, and it is young enough by the clock offset
that heartbeats gave; without a command for the factsheet's `deadman` the robot brakes. `stop` and
`estop` are obeyed from any sender, at any age, under any lease; an `estop` of role `observer`
counts as a `stop`, which the driver can drive on after. A lease lives for `ttl` seconds *from its
receipt*, and a copy that the broker delivers from its store (retain = 1) never permits driving.

`docked` in `state` and the events `docked` and `undocked` mean one thing everywhere: the charging
contacts have met, or the robot has charged, for 2 s without a break while it stood still (at most
0.03 m/s and 0.06 rad/s) and no velocity but zero was asked of its wheels; and the contacts have not
been apart for 0.5 s since. `charger_contact` says whether they meet now. The `dock` action ends
when the robot is docked.

Between two visits there is no lease, and the server orders by itself what makes the robot ready for
the next: `dock`, `tilt` (its home), `relocalize` and `photo`, with role `server`. Such a photo is a
trial of the camera and is not kept. The next visitor is called when the robot says in `state` that
it is docked, localized and charged, has given that picture, and echoes the server's heartbeats.
"""

_DRIVING = """\
## A program that drives

A program that somebody is signed in with may drive as our page does, over one WebSocket, without
WebRTC. Frames are as above; pictures are the only binary ones. `tests/support/document_client.py`
is such a program, written from this section.

**The socket** is `wss://<site>/ws/robots/<robot>/`, with the cookie `sessionid` of a signed-in
visitor and the site's own address as `Origin`. Close codes 4401 (signed out), 4403 (not allowed)
and 4404 (no such robot) are final. After any other end, 4008 (flooded), 4009 (too slow a reader)
and 4010 (replaced by a newer socket of the same program) among them, connect again.

| suffix | from | fields |
| --- | --- | --- |
| `hello` | server | first frame: `peer` (secret, of this connection), `stamp`, `robot`, \
`online`, `mayDrive`, `mayObserve`, `liveElsewhere` |
| `session/take` | program | asks for the robot, or takes an offered turn; `session` and `peer` \
of a grant to come back to it; `takeover` |
| `session/granted` | server | `session`, `epoch`, `peer`, `resumed`, `turnSeconds`, \
`iceServers`, `limits`, `terms` |
| `session/queued` | server | `session`, `place` (1 is next), `minutes`, `reason` why a robot \
that nobody drives is not ready |
| `session/offered` | server | `session`, `seconds` in which `session/take` gets the robot |
| `session/refused` | server | `reason`, `session` |
| `session/turn_warning` | server | `session`; the turn ends in `remaining` seconds |
| `session/asked_there` | server | `session`; are you there? within `seconds` send a `page/event` \
of type `here` |
| `session/found_there` | server | `session`; it has heard you |
| `session/task` | server | how far a study's task is |
| `session/ended` | server | `session`, `outcome`, `reason` |
| `session/leave` | program | ends the session; `session` and `peer` when it was left while there \
was no connection |
| `session/observe`, `session/observing` | program, server | asks to watch; the answer, with \
`iceServers` |
| `session/assist` | program | `level` of assistance |
| `signal`, `signal/reply` | program, server | a Robot API signal, for WebRTC |
| `page/event`, `page/network` | program | for the record: `stamp`, `type`, `data`; a second of \
the network |
| `page/direct` | program | `direct`: the robot is heard over a data channel, most of it need not \
come here as well |
| `room` | server | `driver`, `driving`, `observers`, `waiting` |
| `robot` | server | `online`, `reason`: the robot came or went; with reason `server` it is the \
server that cannot tell |
| `server/status` | server | once a second and at every change: `faults`, a list of `part`, \
`then`, `seconds`; see below |
| `session/operator_message` | server | `session`, `text` of somebody who looks after the session |
| `denied` | server | a frame of `suffix` was refused for `reason` |
| `screen` | server | for the robot's own display alone |

Besides, the server passes on `state`, `pose`, `path`, `scan`, `event`, `action`, `heartbeat`,
`words`, `pointer` and binary `picture` frames of the robot, and takes `command/velocity`,
`command/heartbeat`, `command/action`, `command/picture` and `command/point`. What a program says of
role, session, epoch or peer in them is replaced.

**Driving.** Send `session/take`; on `session/granted` send all of these until `session/ended`:

- `command/heartbeat` five times a second, ten times in the first three seconds: the robot takes no
  velocity before it has three echoes to judge its age by (`clock_unknown`). `n` grows by one;
  `echo` is the robot's last heartbeat with `peer` = `robot`, its `n` and `stamp`, and `received`,
  when it came by your clock.
- `command/picture`, and again as soon as a picture has come, so that one is on its way. The first 8
  bytes behind `picture` and the newline are the capture stamp (float64, big-endian). Without a
  picture younger than the lease's `frameAge`, else the factsheet's, nothing moves (`no_frame`,
  `frame_stale`).
- `command/velocity` twenty times a second, zeros when nothing is wanted. `seq` grows by one and
  begins anew only with another session or epoch; `stamp` is your clock's, `frame` the stamp of the
  newest picture. One that cannot be sent now is thrown away, never kept.

**To be quick after a failure**, as quick as our page (3 to 7 s with what was killed started again
after a second):

1. *Reconnect at once* when the socket ends, then after 0.25 s, doubling up to 1 s and no further,
   each pause shortened by up to a half by chance. A longer pause is what a program waits for when
   the server is long back. An attempt that has not opened in 2 s has failed.
2. *Hear silence.* An open socket brings `server/status` once a second. After 1.5 s without any
   frame the web process or the network is gone: say so. After 3 s give the socket up and connect
   again; a process that was stopped never closes it.
3. *Take again as the same program*: on every new socket, at once and without waiting for `hello`,
   `session/take` with `session` and `peer` of the last grant. The answer has `resumed` and the same
   epoch, and `seq` goes on. `denied` with `unavailable` (the database is away): ask again after a
   second. With another epoch `seq` begins anew.
4. *Ask for a picture again* when none has come for 0.7 s. A request that was on its way through a
   broker or an agent that died is lost, and nobody repeats it; this is what a program waits for
   after a broker's restart. So ask at once when a socket opens, when `robot` says `online`, and
   when `boot` in `state` changes.
5. *Go on sending heartbeats and velocities* while the broker or the agent is away; nothing has to
   be begun anew. Send heartbeats ten times a second for three seconds after the same three signs: a
   new agent knows nobody's clock.
6. *Let go once* when `safety.inhibited` in `state` is `stopped`: a new agent in the middle of a
   drive, and a stop of somebody else, hold the robot until its driver has sent a zero velocity. A
   program that only repeats its velocity never moves it again.
7. *Believe `boot`*: `seq` of states begins anew with another `boot`; older ones of the same boot
   are repetitions.

**What fails** stands in `server/status`: `part` is `broker`, `session_manager`, `database`,
`disk_low`, `disk_full` or `robot` (its computer says nothing). `then` says what follows: `stops` in
`seconds` unless the part is back before; `stopped`, until it is back; `goes_on`, driving is not
touched; `waits`, nobody drives. All is well when `faults` is empty or left out.
"""


def reference() -> str:
    """Return the reference as Markdown."""
    parts = [
        _INTRODUCTION.format(version=m.VERSION, root=topics.ROOT),
        _DRIVING,
        _topic_table(),
        "## Messages\n",
    ]
    parts += [_topic_section(topic) for topic in (*topics.TABLE, *topics.DATA_CHANNEL_ONLY)]
    parts += ["## Parts\n", *(_class_section(kind, "###") for kind in _parts())]
    parts += [
        "## Between servers\n",
        _class_section(m.ManagerStatus, "###"),
        *(_example(name, status) for name, status in MANAGER_STATUS.items()),
    ]
    return "\n".join(parts).rstrip() + "\n"


def golden_files() -> dict[str, str]:
    """Return name → text of the golden files: one a topic, `{"suffix": …, "messages": {name:
    message}}`.
    """
    named = {**EXAMPLES, "server/manager": MANAGER_STATUS}
    return {
        _file_name(suffix): _json({"suffix": suffix, "messages": msgspec.to_builtins(examples)})
        for suffix, examples in named.items()
    }


def generated_files() -> dict[str, str]:
    """Return path → text of everything that this module writes."""
    golden = {f"{GOLDEN}/{name}": text for name, text in golden_files().items()}
    return {REFERENCE: reference(), SCHEMA: _json(json_schema()), **golden}


def classes(content: object) -> list[type[m.Message]]:
    """Return the message classes that a topic carries."""
    return [
        kind
        for kind in typing.get_args(content) or (content,)
        if inspect.isclass(kind) and issubclass(kind, m.Message)
    ]


def _file_name(suffix: str) -> str:
    return suffix.replace("/+", "").replace("/", "-") + ".json"


def _json(value: object) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def _topic_table() -> str:
    rows = [
        "## Topics\n",
        "| suffix | direction | QoS | retained | at most | content |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for topic in topics.TABLE:
        way = "robot →" if topic.direction == "from_robot" else "→ robot"
        retained = "yes" if topic.retained else "no"
        rows.append(
            f"| `{topic.suffix}` | {way} | {topic.qos} | {retained} | {topic.limit // topics.KIB}"
            f" KiB | {topic.doc} |"
        )
    rows += [
        f"| `{t.suffix}` | robot → page, data channel only | | | {t.limit // topics.KIB} KiB |"
        f" {t.doc} |"
        for t in topics.DATA_CHANNEL_ONLY
    ]
    return "\n".join(rows) + "\n"


def _topic_section(topic: topics.Topic) -> str:
    head = f"### `{topic.suffix}`\n\n{topic.doc[0].upper()}{topic.doc[1:]}.\n"
    if topic.content is bytes:
        return head + "\nBytes, no JSON.\n"
    body = [_class_section(kind, "####") for kind in classes(topic.content)]
    return "\n".join(
        [
            head,
            *body,
            *(_example(name, message) for name, message in EXAMPLES[topic.suffix].items()),
        ]
    )


def _example(name: str, message: m.Message) -> str:
    return f"Example, {name}:\n\n```json\n{_json(msgspec.to_builtins(message))}```\n"


def _class_section(kind: type[m.Message], heading: str) -> str:
    lines = [
        f"{heading} {kind.__name__}\n",
        inspect.cleandoc(kind.__doc__ or "") + "\n",
        "| field | type | when left out |",
        "| --- | --- | --- |",
    ]
    if tag := kind.__struct_config__.tag:
        lines.append(f'| `{kind.__struct_config__.tag_field}` | `"{tag}"` | required |')
    lines += [_field_row(field) for field in msgspec.structs.fields(kind)]
    return "\n".join(lines) + "\n"


def _field_row(field: msgspec.structs.FieldInfo) -> str:
    default = "required" if field.required else f"`{json.dumps(_default(field))}`"
    return f"| `{field.encode_name}` | {_type_words(field.type)} | {default} |"


def _default(field: msgspec.structs.FieldInfo) -> object:
    made = field.default_factory() if callable(field.default_factory) else field.default
    return msgspec.to_builtins(made)


def _type_words(kind: object) -> str:
    """Return a type as a reader of the table wants it: its name, and its range in words."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return _type_words(arguments[0]) + _range_words(arguments[1])
    if origin is typing.Literal:
        return " \\| ".join(f'`"{word}"`' for word in arguments)
    if origin is tuple:
        many = len(arguments) == 2 and arguments[1] is Ellipsis
        return (
            f"list of {_type_words(arguments[0])}"
            if many
            else f"[{', '.join(_type_words(argument) for argument in arguments)}]"
        )
    if origin is dict:
        return f"object of {_type_words(arguments[1])}"
    if arguments:
        return " or ".join(_type_words(argument) for argument in arguments)
    names = {
        typing.Any: "anything",
        type(None): "null",
        float: "number",
        int: "integer",
        str: "string",
        bool: "true or false",
    }
    return names.get(
        typing.cast("type", kind),
        f"[{getattr(kind, '__name__', kind)}](#{getattr(kind, '__name__', '').lower()})",
    )


def _range_words(meta: msgspec.Meta) -> str:
    words = [
        text.format(_number(value))
        for name, text in _RANGES
        if (value := getattr(meta, name)) is not None
    ]
    if meta.pattern is not None:
        words.append(f"`{meta.pattern}`")
    return f" ({', '.join(words)})" if words else ""


def _number(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"


def _parts() -> list[type[m.Message]]:
    """Return the classes that stand inside messages and are no message of a topic themselves, in
    the order of the module.
    """
    carried = {
        kind
        for topic in (*topics.TABLE, *topics.DATA_CHANNEL_ONLY)
        for kind in classes(topic.content)
    }
    every = [
        kind for kind in vars(m).values() if inspect.isclass(kind) and issubclass(kind, m.Message)
    ]
    return [
        kind
        for kind in every
        if kind not in carried and kind not in {m.Message, m.Action, m.ManagerStatus}
    ]


def main() -> None:
    """Write every generated file below the current directory."""
    for name, text in generated_files().items():
        path = Path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        sys.stdout.write(f"{name}\n")


if __name__ == "__main__":
    main()
