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

Stop, when in doubt. The robot's own agent decides what moves the robot, because everything between
it and the driver can fail or lie. These are the rules that our agent is tested for. Each refused
command is counted in `refused` of the next `state`, by the word in parentheses. Numbers are ours;
those of the factsheet's `limits` are the robot's.

### Who drives

- A lease lives for `ttl` seconds *from its receipt*, by a clock that nobody sets. A greater
  `renewal` of the same session and epoch renews it. An empty message ends it at once.
- A copy that the broker delivers from its store (retain = 1) tells which session is about to be
  driven and never permits driving.
- An older copy changes nothing (`old_lease`): a lower `renewal`, or a lower epoch. A lower epoch
  counts only when no lease is live and its `stamp` is newer than that of every lease before.
  Remember the newest session, epoch, renewal and stamp across a restart.
- A repeated renewal can lower limits. They hold at once, and nothing is prolonged.
- Another session or epoch: the old driver's last velocity and navigation end, and the new driver
  begins with a robot that was measured to stand.
- Every `state` names session and epoch. After the last one of a session, say the event
  `session_closed` with its `seq` as `lastSeq`.

### Velocities

A velocity moves the robot only when it passes all of these, in this order:

1. The broker had not stored it (`retained`), and it is a message (`malformed`, `oversized`,
   `unknown_topic`, `wrong_direction`, `not_from_server`).
2. A lease is live (`no_lease`), and session and epoch are its own (`wrong_session`, `wrong_epoch`).
   On a data channel the peer of that channel must be the lease's (`observer`), whatever the message
   says of itself.
3. The lease allows this input method and transport (`not_allowed`).
4. `seq` is greater than every `seq` of this session and epoch that was accepted, and than that of
   the driver's own stop (`old_seq`). One that is overtaken before it was read is dropped
   (`replaced`, `too_many`).
5. Three echoes have told the sender's clock (`clock_unknown`). Its age by that clock is less than
   the lease's `commandAge`, else the limits' one, and never more than `commandAgeCeiling`
   (`stale`), and not negative by more than 0.05 s and half of the round trip, at most 0.25 s
   (`future`).
6. Unless `video` of the lease is `none`, it names a video frame (`no_frame`) that is younger than
   `frameAge`, by the same rule (`frame_stale`), and not from the future by more than 0.1 s
   (`frame_future`).
7. No emergency stop is latched (`estop`), the base is reached (`fault`), and the driver has
   [released the controls](#releasing-the-controls) where that is due (`stopped`).

What passes is limited to the least of the robot's, the lease's and the assistance's speeds. From
half of the age limit on, speeds fall linearly to zero at the limit. Speeds change no faster than
the limits' accelerations and brakings.

Without another accepted velocity for `deadman` seconds the robot brakes. Nobody fights a planner:
send zeros from the last motion until the robot was measured to stand (at most 0.02 m/s and
0.05 rad/s for 0.3 s), then nothing. A zero while the robot drives by itself does nothing
(`navigating`). After a pause of the agent itself that is longer than `deadman` or `watchdog`, begin
from zero.

`deadman` is at most 1 s, `watchdog` at most 2 s and not below `deadman`. Refuse to start otherwise.

### Stops

- `stop` and `estop` are obeyed from any sender, at any age, under any lease, before anything else
  that has arrived. Confirm at once: a `state` with `stopSeq` and `stopId`, the event `stopped` or
  `estop`, and the action's status FINISHED.
- The driver's own stop takes its `seq` from the velocities: none with this or a lower one moves the
  robot any more. The same `actionId` within 3 s is the same stop.
- `estop` latches across a restart of the agent: write it to the disk before you confirm it. One of
  role `observer` counts as a `stop`.
- `clear_estop` comes from the broker with role `staff`, `owner` or `screen` and a user
  (`not_from_server`). `screen` clears only what `screen` has latched (`not_yours`). The robot's own
  button latches, too: only the owner clears that (`owner_only`), after it was released
  (`button_pressed`).

### Releasing the controls

A held key must not move the robot by surprise. So after a loss of connection, or a stop of somebody
else, nobody drives on until the driver has released the controls. This is due

- when the connection to the base was lost and is back;
- when the agent was started in the middle of a drive: the first lease that it sees has a `renewal`
  above 0;
- when another agent of this robot has had it, or a message could not be processed;
- after a stop that is not the driver's own, and after an emergency stop was cleared.

Until then `safety.inhibited` is `stopped`, and velocities other than zero, `tilt` and everything
that moves the robot are refused (`stopped`). Released means one of these:

- a zero velocity of this driver that passes points 1 to 6 above;
- a lease of another session or epoch than that under which it became due; without a live lease,
  1 s;
- 1 s without a velocity other than zero, while the driver's heartbeats arrive on the transport of
  the driver's last velocity, at most 0.5 s apart. A silent network has released nothing.

A gap in the driver's own network is not in this list: the robot brakes after `deadman`, and the
next velocity that passes all points drives on. What was sent during the gap is too old by then.

### Actions

- An action is done once: an `actionId` that is known is answered with its last status. It ends
  exactly once, FINISHED, FAILED or CANCELLED; what is refused is FAILED with the word as `reason`.
- It is refused when the broker had stored it (`retained`), when it is more than 3 s old or from the
  future by as much (`stale`, `future`; `clock_unknown`), when the robot lacks the capability
  (`unsupported`), and, from a driver, as a velocity is (points 2 and 3). `cancel` is never
  `not_allowed`.
- Without a lease (else `role`, `observer`): `photo`, `relocalize`, `cancel` and `resend_states` for
  roles `staff`, `owner` and `server`; `dock` and `tilt` for `server`; `clear_estop` as above;
  `say`, `confirm_words` and `answer_call` for `screen`. `resend_states`, `clear_estop`,
  `confirm_words` and `answer_call` are never the driver's. On a data channel the role is that of
  the offer, and its peer tells the driver.
- What moves the robot begins, and is at its end, when the robot was measured to stand. A velocity
  other than zero cancels it, and so do a stop, a lost base, a contact unless it docks, the end of
  the lease, and 2 s after the driver's last heartbeat; the last two not what `server` ordered.

### Reports

- `state` four times a second, and at once for a stop. `seq` grows by one with each and begins at 1
  with each `boot`. Every velocity that reached the base is in `applied` of exactly one state.
- Nothing of the record is lost while the broker is away: keep states and events and send them in
  order. Keep the states of ten minutes for `resend_states`.
- `pose` while something moves, at most 15 times a second. `heartbeat` five times a second on both
  transports, with one echo for each peer and transport.
- A broker that is away stops no drive: commands of the data channel count until the lease ends.
- What the robot does not know is left out, never guessed. A robot that reports nothing for 1 s, or
  nonsense, is lost: `adapter_lost` in `errors` with the reason, and as an event.

### Start, end and a second agent

- Each run has a new `boot`; boots sort by the time of their start. An agent that reads ONLINE of a
  greater boot on its own `connection` topic stops the robot, until that one is gone.
- At its end an agent brakes first, waits for the stand, then says OFFLINE.

### Docked

`docked` in `state` and the events `docked` and `undocked` mean one thing everywhere: the charging
contacts have met, or the robot has charged, for 2 s without a break while it stood still (at most
0.03 m/s and 0.06 rad/s) and no velocity but zero was asked of its wheels; and the contacts have not
been apart for 0.5 s since. `charger_contact` says whether they meet now. The `dock` action ends
when the robot is docked.

### Between two visits

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
`words`, `receipt`, `pointer` and binary `picture` frames of the robot, and takes
`command/velocity`, `command/heartbeat`, `command/action`, `command/picture` and `command/point`.
What a program says of role, session, epoch or peer in them is replaced.

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

**What fails** is named in `server/status`: `part` is `broker`, `session_manager`, `database`,
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
