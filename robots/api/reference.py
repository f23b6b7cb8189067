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

This page describes the messages between robots, servers and pages. Together with
[robot-api.schema.json](robot-api.schema.json), it is enough to write an agent in any language.

## Ground rules

- A robot opens one outgoing MQTT connection, with the user name and the token that its owner got
  from the site. It accepts no incoming connection.
- Topics are `{root}/<robot>/<suffix>`. A robot writes only its own outputs and reads only its own
  inputs; its name is made of lower-case letters, digits and hyphens.
- A message is a JSON object in UTF-8 with names in camelCase. Fields at their default may be left
  out. Unknown fields are ignored.
- Metres, radians, seconds; x forward, y left, angles counter-clockwise. `stamp` is Unix time in
  seconds by the sender's own clock.
- A message that is malformed, too large, out of range or in the wrong direction is counted and
  dropped. It never ends a connection.
- On the data channel `control` (unordered, no retransmission) and on the page's WebSocket a frame
  is the suffix, a newline, and the same JSON.
- An agent connects with a clean session, publishes `connection` and `factsheet` after each connect,
  sets CONNECTIONBROKEN as its last will, and publishes ONLINE again when its own `connection` topic
  says that it is not online.

## What an agent must do by itself

When in doubt, stop. The robot's own agent decides what moves the robot, because everything between
it and the driver can fail or lie. Our agent is tested against these rules. Count each refused
command in `refused` of the next `state`, by the word in parentheses. The numbers are those of our
agent; those of the factsheet's `limits` are the robot's.

### Who drives

- A lease is valid for `ttl` seconds *from its receipt*, by a monotonic clock. A greater `renewal`
  of the same session and epoch renews it. An empty message ends it at once.
- A copy that the broker delivers from its store (retain = 1) announces the session that is about to
  be driven, and never permits driving.
- An older copy changes nothing (`old_lease`): a lower `renewal`, or a lower epoch. A lower epoch
  counts only when no lease is live and its `stamp` is newer than that of every earlier lease.
  Remember the newest session, epoch, renewal and stamp across a restart.
- The epoch is a fencing token: the server counts it up in its database whenever the lease changes
  hands, and never down, also when another of its processes takes over. So a process of the server
  that was suspended and resumes cannot return a robot to an earlier driver. A takeover by another
  process alone changes neither session nor epoch, only `renewal`, and the drive continues.
- A repeated renewal can lower limits. The new limits apply at once, and the lease is not extended.
- A lease of another session or epoch ends the old driver's last velocity and navigation. The new
  driver begins when the robot is measured to be at a standstill.
- Every `state` names session and epoch. After the last state of a session, publish the event
  `session_closed` with the state's `seq` as `lastSeq`.

### Velocities

A velocity moves the robot only if it passes all of these checks, in this order:

1. It does not come from the broker's store (`retained`), and it is a valid message (`malformed`,
   `oversized`, `unknown_topic`, `wrong_direction`, `not_from_server`).
2. A lease is live (`no_lease`), and session and epoch are its own (`wrong_session`, `wrong_epoch`).
   On a data channel, the peer of that channel must be the lease's peer (`observer`), whatever the
   message claims.
3. The lease allows this input method and transport (`not_allowed`).
4. `seq` is greater than every `seq` of this session and epoch that was accepted, and than that of
   the driver's own stop (`old_seq`). A velocity that a newer one overtakes before you read it is
   dropped (`replaced`, `too_many`).
5. Three echoes have shown the offset of the sender's clock (`clock_unknown`). Its age by that clock
   is less than `commandAge` of the lease, or of the limits if the lease has none; it is never more
   than `commandAgeCeiling` (`stale`), and not negative by more than 0.05 s and half of the round
   trip, at most 0.25 s (`future`).
6. Unless `video` of the lease is `none`, it names a video frame (`no_frame`) that is younger than
   `frameAge`, by the same rule (`frame_stale`), and not from the future by more than 0.1 s
   (`frame_future`).
7. No emergency stop is latched (`estop`), the base is reached (`fault`), the driver has
   [released the controls](#releasing-the-controls) if this is required (`stopped`), and every
   action of the robot that was cancelled has ended (`unconfirmed`).

An accepted velocity is limited to the lowest of the robot's, the lease's and the assistance's
speeds. From half of the age limit, speeds fall linearly to zero at the limit. Speeds change no
faster than the limits' accelerations and brakings. `applied` has the velocity that the base was
really sent.

If no other velocity is accepted for `deadman` seconds, the robot brakes. So as not to conflict with
a planner, send zeros from the last motion until the robot is measured to be at a standstill (at
most 0.02 m/s and 0.05 rad/s for 0.3 s, unless its profile states other speeds), then nothing. While
the driver waits for that, `safety.inhibited` is `settling`. A zero while the robot drives by itself
has no effect (`navigating`). If the agent itself pauses for longer than `watchdog`, begin again
from zero.

A robot that is measured moving while nothing may move it is sent zeros again, for as long as it
moves, with or without a lease. Within 0.5 s, `errors` contains `runs_on: …`.

`deadman` is at most 1 s, `watchdog` at most 2 s and not below `deadman`. Refuse to start otherwise.

### Stops

- Obey `stop` and `estop` from any sender, at any age, under any lease, before any other message
  that has arrived. Confirm them at once: a `state` with `stopSeq` and `stopId`, the event `stopped`
  or `estop`, and the action's status FINISHED.
- The driver's own stop shares the `seq` of the velocities: no velocity with this or a lower `seq`
  moves the robot any more. The same `actionId` within 3 s is the same stop.
- `estop` latches across a restart of the agent: write it to the disk before you confirm it. An
  `estop` from the role `observer` counts as a `stop`.
- `clear_estop` comes from the broker with role `staff`, `owner` or `screen` and a user
  (`not_from_server`). `screen` clears only what `screen` has latched (`not_yours`), and a stop that
  holds the robot without a lease. The robot's own
  button latches, too: only the owner can clear it (`owner_only`), after it is released
  (`button_pressed`).

### Releasing the controls

A held key must not move the robot unexpectedly. After a lost connection or somebody else's stop,
the robot therefore stays stopped until the driver has released the controls. This is required

- when the connection to the base was lost and has returned;
- when the agent was started in the middle of a drive: the first lease that it sees has a `renewal`
  above 0;
- when another agent has controlled this robot, or a message could not be processed;
- after a stop that is not the driver's own, and after an emergency stop was cleared.

Until then `safety.inhibited` is `stopped`, and velocities other than zero, `tilt` and everything
that moves the robot are refused (`stopped`). Released means one of these:

- a zero velocity of this driver that passes points 1 to 6 above;
- a lease of another session or epoch than the one under which it became required. A lease that
  lapses and is renewed releases nothing;
- 1 s without a velocity other than zero, while the driver's heartbeats arrive on the transport of
  the driver's last velocity, at most 0.5 s apart. A silent network releases nothing.

Without a lease, only a `stop` of somebody else than the driver whose session has just ended keeps
the robot stopped: until a new lease, or a `clear_estop`.

A gap in the driver's own network is not in this list: the robot brakes after `deadman`, and the
next velocity that passes all checks moves it again. Velocities sent during the gap are too old by
then.

### Actions

- Execute an action once: answer a known `actionId` with its last status. An action ends exactly
  once, as FINISHED, FAILED or CANCELLED; a refused action is FAILED, with the word as `reason`.
- The `reason` of an action that moves the robot is an identifier, not a text for people. Pages and
  mail have words in each language for those of our agent, such as `something stands on the goal`,
  `no way leads to the goal on the map`, `blocked: <door> is closed`, `waits for somebody in the
  way`, `the robot could not dock`; the whole list is `REASONS` in `robots/readiness_text.py`. Any
  other `reason` is shown as it is.
- Refuse an action when it comes from the broker's store (`retained`), when it is more than 3 s old
  or from the future by as much (`stale`, `future`; `clock_unknown`), when the robot lacks the
  capability (`unsupported`), and, if it comes from a driver, for the same reasons as a velocity
  (points 2 and 3). `cancel` is never `not_allowed`.
- Without a lease (else `role`, `observer`): `photo`, `relocalize`, `cancel` and `resend_states` for
  roles `staff`, `owner` and `server`; `dock` and `tilt` for `server`; `clear_estop` as above;
  `say`, `confirm_words` and `answer_call` for `screen`. `resend_states`, `clear_estop`,
  `confirm_words` and `answer_call` are never the driver's. On a data channel, the role is that of
  the offer, and the peer identifies the driver.
- An action that moves the robot begins and ends when the robot is measured to be at a standstill.
  It is cancelled by a velocity other than zero, a stop, a lost base, a contact unless it docks, the
  end of the lease, and 2 s after the driver's last heartbeat. The end of the lease does not cancel
  actions from `server`; they are cancelled 2 s after the server's last heartbeat. Motion that
  exceeds a limit by 10 % for 0.5 s ends an action, too (`too_fast`).
- An action is yours until the robot control architecture confirms its end. Repeat the cancel every
  0.5 s until then, also after a connection was lost, let no driver move the robot, and begin no
  other action (`navigation_does_not_end`). Until then `errors` contains `cancel: …`, and the
  status is not CANCELLED.

### Reports

- Publish `state` four times a second, unless the robot is [idle](#idle-robots), and at once for a
  stop. `seq` grows by one with each and
  begins at 1 with each `boot`. Every velocity that reached the base is in `applied` of exactly one
  state.
- Lose nothing of the record while the broker is unavailable: keep states and events, and send them
  in order. Keep the states of ten minutes for `resend_states`.
- Publish `pose` while the robot moves, at most 15 times a second (30 while its head tilts), and
  `heartbeat` five times a second on both transports, with one echo for each peer and transport.
  Echo the server and the peers of the lease (`peer`, `wizard`) each time; where other peers exceed
  the room, they take turns.
- Do not stop a drive when the broker is unavailable: commands on the data channel count until the
  lease ends.
- Leave out what the robot does not know; never guess. A robot that reports nothing for 1 s, or
  invalid values, is lost: report `adapter_lost` in `errors` with the reason, and as an event.

### Idle robots

A robot that nobody needs may be idle. This is optional: an agent that always sends at its full rate
works with every server. Somebody needs the robot

- while it has a lease (one from the broker's store counts), while a page is connected to it, and
  while it moves or an action drives it;
- for 5 s after each of these, after its own start, and after a message that did not come from the
  broker's store: `lease`, `command/velocity`, `command/action`, `command/picture`, and
  `command/heartbeat` unless its `needed` is false.

When the robot is idle, the broker gets no `heartbeat`, `pose`, `scan` and `path` from it, and a
`state`

- 30 s after the last one, and after each connect;
- at most 0.25 s after a change of `session`, `docked`, `chargerContact`, `mode`, `assist`,
  `safety`, `errors`, `viewers`, `call`, `screens`, `knockable`, `knock`, `cameraStatus`,
  `pose.localized` or `battery.charging`, after a contact, and when since the last state `charge`
  has changed by 0.02, `tilt` by 0.03 rad, or the pose by 0.25 m or 15°.

When somebody needs it again, it sends a `state` and a `heartbeat` at once and continues at its full
rate. `seq` has no gap. A server sends `command/heartbeat` at least once a second for every page
that is open at the robot, with the peer `watcher`, and twice a second while the robot has a session
or a queue, or is not ready for its next visitor. A server counts a robot as away after its last
will, or after 45 s without a message. Older servers send a heartbeat twice a second to every robot,
so a robot of theirs is never idle.

After a lost connection, a robot that nobody needs waits for a random time of up to 10 s before it
connects again, then of up to 20 s before each further attempt. A robot that somebody needs, or has
needed in the last two minutes, connects again at once, then after at most 1 s.

### Start, end and a second agent

- Each run has a new `boot`; boots sort by their start time. An agent that reads ONLINE with a
  greater boot on its own `connection` topic stops the robot until the other agent is gone.
- When it ends, an agent brakes, waits for the standstill, then publishes OFFLINE.

### Docked

`docked` in `state` and the events `docked` and `undocked` have the same meaning everywhere: the
charging contacts have met, or the robot has charged, for 2 s without a break, while the robot was
at a standstill (at most 0.03 m/s and 0.06 rad/s) and was sent no velocity other than zero; since
then, the contacts have not been apart for 0.5 s. `charger_contact` states whether they meet now.
The `dock` action ends when the robot is docked.

### Between two visits

Between two visits there is no lease, and the server itself requests the actions that make the robot
ready for the next one: `dock`, `tilt` (to its home), `relocalize` and `photo`, with role `server`.
Such a photo tests the camera and is not kept. The server calls the next visitor when the robot's
`state` says that it is docked, localized and charged, when it has delivered that photo, and when it
echoes the server's heartbeats.
"""

_DRIVING = """\
## A program that drives

A program with the session of a logged-in visitor can drive like our page, over one WebSocket,
without WebRTC. Frames are as above; only pictures are binary.
`tests/support/browsers/document_client.py` is such a program, written from this section.

**The socket** is `wss://<site>/ws/robots/<robot>/`, with the cookie `sessionid` of a logged-in
visitor and the site's own address as `Origin`. Close codes 4401 (logged out), 4403 (not allowed)
and 4404 (no such robot) are final. After any other end, including 4008 (flooded), 4009 (reads too
slowly) and 4010 (replaced by a newer socket of the same program), connect again.

| suffix | from | fields |
| --- | --- | --- |
| `hello` | server | first frame: `peer` (secret, of this connection), `stamp`, `robot`, \
`online`, `mayDrive`, `mayObserve`, `liveElsewhere`, `liveSince` \
(with `liveElsewhere` false: a drive of the visitor that no page drives just now) |
| `session/take` | program | asks for the robot, or takes an offered turn; `session` and `peer` \
of a grant to come back to it; `takeover` |
| `session/granted` | server | `session`, `epoch`, `peer`, `resumed`, `turnSeconds`, \
`iceServers`, `limits`, `terms` |
| `session/queued` | server | `session`, `place` (1 is next), `minutes`, `reason` why a robot \
that nobody drives is not ready |
| `session/offered` | server | `session`, `seconds` in which `session/take` gets the robot; \
may come again for the same turn |
| `session/refused` | server | `reason`, `session`, `outcome` |
| `session/turn_warning` | server | `session`; the turn ends in `remaining` seconds |
| `session/asked_there` | server | `session`; are you there? within `seconds` send a `page/event` \
of type `here` |
| `session/found_there` | server | `session`; your answer has arrived |
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
| `page/direct` | program | `direct`: messages of the robot arrive over a data channel, so most \
need not come here as well |
| `room` | server | `driver`, `driving`, `observers`, `waiting`, `pause` |
| `audience/hand`, `audience/ask` | program | of a page that watches: `raised` raises or lowers a \
hand; a question with `text` |
| `audience/mark`, `audience/lower` | program | of the driver, or an operator who watches: \
`question` becomes `state` (`answering`, `answered`, `declined`); all hands go down |
| `audience` | server | `open`, `moderates`, `raised`, `hands`, `names`, `questions` (`id`, \
`text`, `state`, `who`, `own`): what this page may see |
| `robot` | server | `online`, `reason`: the robot came online or went offline; with the reason \
`server`, the server does not know |
| `server/status` | server | once a second and at every change: `faults`, a list of `part`, \
`then`, `seconds`; see below |
| `session/operator_message` | server | `session`, `text` of somebody who looks after the session |
| `denied` | server | a frame of `suffix` was refused for `reason` |
| `screen` | server | for the robot's own display alone |

The server also passes on `state`, `pose`, `path`, `scan`, `event`, `action`, `heartbeat`, `words`,
`receipt`, `pointer` and binary `picture` frames of the robot, and takes `command/velocity`,
`command/heartbeat`, `command/action`, `command/picture` and `command/point`. The server replaces
the role, session, epoch and peer that a program states in them.

**Driving.** Send `session/take`; on `session/granted` send all of these until `session/ended`:

- `command/heartbeat` five times a second, ten times in the first three seconds: the robot accepts
  no velocity until three echoes let it compute a velocity's age (`clock_unknown`). `n` grows by
  one; `echo` is the robot's last heartbeat with `peer` = `robot`, its `n` and `stamp`, and
  `received`, the time of its arrival by your clock.
- `command/picture`, and again as soon as a picture has arrived, so that one is always on its way.
  The first 8 bytes after `picture` and the newline are the capture stamp (float64, big-endian).
  Without a picture younger than `frameAge` of the lease, or of the factsheet if the lease has none,
  the robot does not move (`no_frame`, `frame_stale`).
- `command/velocity` twenty times a second, with zeros for no motion. `seq` grows by one and
  restarts only with another session or epoch; `stamp` is the time of your clock, `frame` the stamp
  of the newest picture. Discard a velocity that you cannot send now; never queue it.

**To recover as quickly as our page** (in 3 to 7 s, if the killed part is restarted after a second):

1. *Reconnect at once* when the socket ends, then after 0.25 s, doubling up to 1 s and no further,
   each pause shortened at random by up to a half. With longer pauses, a program still waits when
   the server has long returned. An attempt that has not opened within 2 s has failed.
2. *Detect silence.* An open socket delivers `server/status` once a second. After 1.5 s without any
   frame, the web process or the network has failed: tell the user. After 3 s, abandon the socket
   and connect again; a process that was stopped never closes it.
3. *Take again as the same program*: on every new socket, at once and without waiting for `hello`,
   `session/take` with `session` and `peer` of the last grant. The answer has `resumed` and the same
   epoch, and `seq` continues. After `denied` with `unavailable` (the server could not do it), ask
   again after a second. With another epoch, `seq` restarts.
4. *Ask for a picture again* when none has arrived for 0.7 s. A request that was in a broker or an
   agent when it died is lost, and nobody repeats it; after a broker's restart, a program would wait
   for it in vain. Also ask at once when a socket opens, when `robot` says `online`, and when `boot`
   in `state` changes.
5. *Keep sending heartbeats and velocities* while the broker or the agent is unavailable; you do not
   need to start again. After each of the same three signs, send heartbeats ten times a second for
   three seconds: a new agent does not know your clock yet.
6. *Release the controls once* when `safety.inhibited` in `state` is `stopped`: after a restart of
   the agent in the middle of a drive, or after somebody else's stop, the robot stays stopped until
   its driver has sent a zero velocity. A program that only repeats its velocity never moves it
   again.
7. *Check `boot`*: `seq` of states restarts with another `boot`; a lower `seq` of the same boot is a
   repetition.

**Failures** are named in `server/status`: `part` is `broker`, `session_manager`, `database`,
`disk_low`, `disk_full` or `robot` (its computer is silent). `then` is the consequence: `stops`, the
robot stops in `seconds` unless the part returns before; `stopped`, until it returns; `goes_on`,
driving continues; `waits`, nobody drives. If `faults` is empty or left out, all parts work.
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
