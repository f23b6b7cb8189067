"""A rosbridge without ROS behind it: the same protocol (version 2), between its clients.

Topics, services that a client advertises, and actions of ROS 2 that a client advertises are carried as the real one carries them: by
type, latched where it was advertised so, without NaN, with a status message for whoever asks for nonsense. A robot is a client too.
"""

import contextlib
import itertools
import json
import math

from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed


class RosbridgeServer:
    def __init__(self):
        self.port = 0
        self._server = None
        self.types, self.latched, self._last = {}, set(), {}
        self._subscribers = {}  # topic: {client: ids}
        self._services, self._actions = {}, {}  # name: client
        self._waiting = {}  # our id: (client, its id)
        self._ids = itertools.count(1)

    @property
    def url(self):
        return f"ws://127.0.0.1:{self.port}"

    async def start(self):
        self._server = await serve(self._client, "127.0.0.1", self.port, max_size=None, compression=None)
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
        try:
            async for text in client:
                await self._take(client, text)
        except ConnectionClosed:
            pass
        finally:
            for table in self._subscribers.values():
                table.pop(client, None)
            for table in (self._services, self._actions):
                for name in [name for name, owner in table.items() if owner is client]:
                    del table[name]

    async def _take(self, client, text):
        try:
            message = json.loads(text)
            handler = getattr(self, f"_on_{message['op']}")
        except (ValueError, KeyError, AttributeError):
            await self._complain(client, f"unknown operation in {text[:80]!r}")
            return
        await handler(client, message)

    async def _complain(self, client, why, of=None):
        await self._send(client, {"op": "status", "level": "error", "msg": why} | ({"id": of} if of else {}))

    async def _send(self, client, message):
        with contextlib.suppress(ConnectionClosed):
            await client.send(json.dumps(_json(message)))

    async def _typed(self, client, message, of):
        """The type of a topic is fixed by whoever names it first."""
        topic, kind = message["topic"], message.get("type")
        if kind is not None and self.types.setdefault(topic, kind) != kind:
            await self._complain(client, f"{topic} is a {self.types[topic]}, not a {kind}", of)
            return False
        return True

    async def _on_advertise(self, client, message):
        if await self._typed(client, message, message.get("id")) and message.get("latch"):
            self.latched.add(message["topic"])

    async def _on_unadvertise(self, client, message):
        pass

    async def _on_publish(self, client, message):
        topic = message["topic"]
        if topic not in self.types:
            await self._complain(client, f"cannot infer the type of {topic}, which was not advertised", message.get("id"))
            return
        out = {"op": "publish", "topic": topic, "msg": message["msg"]}
        if topic in self.latched:
            self._last[topic] = out
        for subscriber in list(self._subscribers.get(topic, {})):
            await self._send(subscriber, out)

    async def _on_subscribe(self, client, message):
        topic = message["topic"]
        if await self._typed(client, message, message.get("id")):
            self._subscribers.setdefault(topic, {}).setdefault(client, set()).add(message.get("id"))
            if topic in self._last:
                await self._send(client, self._last[topic])

    async def _on_unsubscribe(self, client, message):
        self._subscribers.get(message["topic"], {}).pop(client, None)

    async def _on_advertise_service(self, client, message):
        self._services[message["service"]] = client

    async def _on_call_service(self, client, message):
        name = message["service"]
        if name not in self._services:
            answer = {"op": "service_response", "service": name, "values": f"Service {name} does not exist", "result": False}
            await self._send(client, answer | {"id": message.get("id")})
            return
        await self._pass_on(client, message, self._services[name])

    async def _on_service_response(self, client, message):
        await self._pass_back(message, last=True)

    async def _on_advertise_action(self, client, message):
        self._actions[message["action"]] = client

    async def _on_send_action_goal(self, client, message):
        name = message["action"]
        if name not in self._actions:
            answer = {"op": "action_result", "action": name, "values": f"Action server {name} is not available", "status": 6, "result": False}
            await self._send(client, answer | {"id": message.get("id")})
            return
        await self._pass_on(client, message, self._actions[name])

    async def _on_cancel_action_goal(self, client, message):
        for ours, (owner, theirs) in self._waiting.items():
            if owner is client and theirs == message.get("id") and message["action"] in self._actions:
                await self._send(self._actions[message["action"]], message | {"id": ours})

    async def _on_action_feedback(self, client, message):
        await self._pass_back(message, last=False)

    async def _on_action_result(self, client, message):
        await self._pass_back(message, last=True)

    async def _pass_on(self, client, message, owner):
        ours = f"server:{next(self._ids)}"
        self._waiting[ours] = (client, message.get("id"))
        await self._send(owner, message | {"id": ours})

    async def _pass_back(self, message, *, last):
        asked = self._waiting.pop(message["id"], None) if last else self._waiting.get(message["id"])
        if asked is not None:
            await self._send(asked[0], message | {"id": asked[1]})


def _json(value):
    if isinstance(value, dict):
        return {key: _json(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_json(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
