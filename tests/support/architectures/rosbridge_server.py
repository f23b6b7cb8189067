"""A rosbridge without ROS behind it: version 2 of the protocol, between its clients, of which the
robot is one.

It carries topics, services and actions of ROS 2 that a client advertises as the real one: by type,
latched if advertised so, without NaN, with a status message for a malformed request. From
rosbridge_suite: a type other than the established one is refused in these words
(rosbridge_library/internal/publishers.py, MultiPublisher; internal/topics.py,
TypeConflictException); a publisher keeps its type for ten seconds after its last client has left
(PublisherManager.unregister_timeout); a message with a field that its type lacks is refused
(internal/message_conversion.py, NonexistentFieldException). rosapi lists the nodes of a topic, and
all clients are one node (rosapi/proxy.py).

The messages of a client are queued and handled in order, while pings are answered beside the queue
(rosbridge_server/websocket_handler.py, IncomingQueue). With `blocking_goals` or `blocking_services`
(send_action_goals_in_new_thread, call_services_in_new_thread: false) the queue waits for each
result. `held` are the `clients` whose queue hangs. As a process: `python -m
tests.support.architectures.rosbridge_server HOST PORT [no-rosapi]`.
"""

import asyncio
import contextlib
import itertools
import json
import math
import sys
import time

from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed

UNREGISTER = 10.0
FIELDS = {
    "geometry_msgs/Twist": {"linear", "angular"},
    "geometry_msgs/TwistStamped": {"header", "twist"},
}


class RosbridgeServer:
    def __init__(
        self,
        host="127.0.0.1",
        port=0,
        *,
        rosapi=True,
        blocking_goals=False,
        blocking_services=False,
    ):
        self.host, self.port, self.rosapi = host, port, rosapi
        self.blocking_goals, self.blocking_services = blocking_goals, blocking_services
        self.clients, self.held = [], set()
        self._server = None
        self.types, self.latched, self._last = {}, set(), {}
        self._publishers = {}  # topic: clients
        self._leaving = {}  # topic: when its publisher is removed
        self._subscribers = {}  # topic: {client: ids}
        self._services, self._actions = {}, {}  # name: client
        self._waiting = {}  # our id: (client, its id)
        self._results = {}  # our id: an event, of calls and goals that block a queue
        self._ids = itertools.count(1)

    @property
    def url(self):
        return f"ws://127.0.0.1:{self.port}"

    async def start(self):
        self._server = await serve(
            self._client, self.host, self.port, max_size=None, compression=None
        )
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self):
        self._server.close(close_connections=False)
        for client in list(self._server.connections):
            client.transport.abort()
        await self._server.wait_closed()
        self._subscribers.clear()
        self._services.clear()
        self._actions.clear()
        self._last.clear()

    async def _client(self, client):
        self.clients.append(client)
        incoming = asyncio.Queue()
        working = asyncio.ensure_future(self._work_off(client, incoming))
        try:
            async for text in client:
                incoming.put_nowait(text)
        except ConnectionClosed:
            pass
        finally:
            working.cancel()
            for table in self._subscribers.values():
                table.pop(client, None)
            for topic in [
                topic for topic, clients in self._publishers.items() if client in clients
            ]:
                self._unregister(client, topic)
            for table in (self._services, self._actions):
                for name in [name for name, owner in table.items() if owner is client]:
                    del table[name]

    async def _work_off(self, client, incoming):
        while True:
            text = await incoming.get()
            while client in self.held:
                await asyncio.sleep(0.01)
            await self._take(client, text)

    async def _take(self, client, text):
        try:
            message = json.loads(text)
            handler = getattr(self, f"_on_{message['op']}")
        except (ValueError, KeyError, AttributeError):
            await self._complain(client, f"unknown operation in {text[:80]!r}")
            return
        await handler(client, message)

    async def _complain(self, client, why, request=None):
        of = {"id": request} if request else {}
        await self._send(client, {"op": "status", "level": "error", "msg": why} | of)

    async def _send(self, client, message):
        with contextlib.suppress(ConnectionClosed):
            await client.send(json.dumps(_json(message)))

    async def _typed(self, client, message, of, op):
        """The first client of a topic sets its type, until its last client has left."""
        self._forget()
        topic, kind = message["topic"], message.get("type")
        if kind is not None and self.types.setdefault(topic, kind) != kind:
            established = f"but it is already established with type {self.types[topic]}"
            await self._complain(
                client, f"{op}: Tried to register topic {topic} with type {kind} {established}", of
            )
            return False
        return True

    def _forget(self):
        now = time.monotonic()
        self._leaving = {topic: at for topic, at in self._leaving.items() if at >= now}
        for topic in list(self.types):
            used = self._publishers.get(topic) or self._subscribers.get(topic)
            if not used and topic not in self._leaving:
                del self.types[topic]

    def _unregister(self, client, topic):
        self._publishers.get(topic, set()).discard(client)
        if not self._publishers.get(topic):
            self._leaving[topic] = time.monotonic() + UNREGISTER

    async def _on_advertise(self, client, message):
        if await self._typed(client, message, message.get("id"), "advertise"):
            self._publishers.setdefault(message["topic"], set()).add(client)
            if message.get("latch"):
                self.latched.add(message["topic"])

    async def _on_unadvertise(self, client, message):
        self._unregister(client, message["topic"])

    async def _on_publish(self, client, message):
        topic = message["topic"]
        if topic not in self.types:
            why = f"publish: Cannot infer topic type for topic {topic} as it is not yet advertised"
            await self._complain(client, why, message.get("id"))
            return
        kind = self.types[topic].replace("/msg/", "/")
        strange = set(message["msg"]) - FIELDS.get(kind, set(message["msg"]))
        if strange:
            why = f"publish: Message type {self.types[topic]} does not have a field {min(strange)}"
            await self._complain(client, why, message.get("id"))
            return
        self._publishers.setdefault(topic, set()).add(client)
        out = {"op": "publish", "topic": topic, "msg": message["msg"]}
        if topic in self.latched:
            self._last[topic] = out
        for subscriber in list(self._subscribers.get(topic, {})):
            await self._send(subscriber, out)

    async def _on_subscribe(self, client, message):
        topic = message["topic"]
        if await self._typed(client, message, message.get("id"), "subscribe"):
            self._subscribers.setdefault(topic, {}).setdefault(client, set()).add(message.get("id"))
            if topic in self._last:
                await self._send(client, self._last[topic])

    async def _on_unsubscribe(self, client, message):
        self._subscribers.get(message["topic"], {}).pop(client, None)

    async def _on_advertise_service(self, client, message):
        self._services[message["service"]] = client

    async def _on_call_service(self, client, message):
        name = message["service"]
        if name in self._services:
            owner = self._services[name]
            await self._pass_on(client, message, owner, blocking=self.blocking_services)
            return
        known = self.rosapi and name.startswith("/rosapi/")
        answer = {"op": "service_response", "service": name, "id": message.get("id")}
        answer["values"] = (
            self._rosapi(name.rpartition("/")[2], message.get("args") or {})
            if known
            else f"Service {name} does not exist"
        )
        await self._send(client, answer | {"result": known})

    def _rosapi(self, name, arguments):
        self._forget()
        if name == "get_param":
            return {"value": json.dumps(not self.blocking_goals)}
        if name == "topics":
            return {"topics": list(self.types), "types": list(self.types.values())}
        table = {"subscribers": self._subscribers, "publishers": self._publishers}[name]
        return {name: ["/rosbridge_websocket"] if table.get(arguments["topic"]) else []}

    async def _on_service_response(self, client, message):
        await self._pass_back(message, last=True)

    async def _on_advertise_action(self, client, message):
        self._actions[message["action"]] = client

    async def _on_send_action_goal(self, client, message):
        name = message["action"]
        if name in self._actions:
            owner = self._actions[name]
            await self._pass_on(client, message, owner, blocking=self.blocking_goals)
            return
        answer = {"op": "action_result", "action": name, "id": message.get("id")}
        answer["values"] = f"Action server {name} is not available"
        await self._send(client, answer | {"status": 6, "result": False})

    async def _on_cancel_action_goal(self, client, message):
        server = self._actions.get(message["action"])
        for ours, waiting in self._waiting.items():
            if server is not None and waiting == (client, message.get("id")):
                await self._send(server, message | {"id": ours})

    async def _on_action_feedback(self, client, message):
        await self._pass_back(message, last=False)

    async def _on_action_result(self, client, message):
        await self._pass_back(message, last=True)

    async def _pass_on(self, client, message, owner, *, blocking):
        ours = f"server:{next(self._ids)}"
        self._waiting[ours] = (client, message.get("id"))
        await self._send(owner, message | {"id": ours})
        if blocking:
            self._results[ours] = asyncio.Event()
            await self._results[ours].wait()

    async def _pass_back(self, message, *, last):
        if last and message["id"] in self._results:
            self._results.pop(message["id"]).set()
        asked = self._waiting.pop(message["id"], None) if last else self._waiting.get(message["id"])
        if asked is not None:
            await self._send(asked[0], message | {"id": asked[1]})


def _json(value):
    if isinstance(value, dict):
        return {key: _json(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_json(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


async def main(host, port, *words):
    await RosbridgeServer(host, port, rosapi="no-rosapi" not in words).start()
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:]))
