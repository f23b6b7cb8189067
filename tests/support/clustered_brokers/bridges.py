"""Three Mosquittos joined by bridges: the first is the hub, the others forward everything to it."""

import asyncio
from pathlib import Path

from robots.api.private_files import write_private
from robots.broker import mosquitto
from robots.broker.listeners import Listeners
from robots.broker.permissions import BrokerUser, Permissions
from robots.enrol.credentials import hash_token, new_token
from tests.support.clustered_brokers.node import Node, is_open, program
from tests.support.sessions.site import free_port

HOST = "127.0.0.1"
BRIDGE = "bridge"


class BridgedMosquittos:
    """Users are the same on all three, and one more for the bridges."""

    name = "mosquitto-bridges"

    def __init__(self, read_users, directory: Path, *, nodes=3, poll=0.1):
        self._read_users, self._directory, self._poll = read_users, directory, poll
        self.ports = [free_port() for _ in range(nodes)]
        self.nodes = []
        self._users, self._token = {}, new_token()
        everything = Permissions(("telepresence/#",), ("telepresence/#",))
        self._bridge = BrokerUser(BRIDGE, hash_token(self._token), everything)

    async def start(self, _listeners):
        self._directory.mkdir(parents=True, exist_ok=True)
        self._write(await self._read_users())
        mosquitto_program = program("mosquitto", "mosquitto")
        for number, port in enumerate(self.ports):
            folder = self._folder(number)
            file = folder / "mosquitto.conf"
            text = mosquitto.configuration(Listeners(HOST, port), folder)
            file.write_text(text + (self._to_hub(number) if number else ""))
            self.nodes.append(Node([mosquitto_program, "-c", str(file)], folder / "log"))
            await self.nodes[-1].until(lambda port=port: is_open(HOST, port), "mosquitto")
        hub, count = self.nodes[0], len(self.ports) - 1
        await hub.until(lambda: self._are_joined(hub, count), "the bridges")
        return self.ports[0]

    async def wait(self):
        while True:
            await asyncio.sleep(self._poll)
            users = await self._read_users()
            if users != self._users:
                self._write(users)
                for node in self.nodes:
                    node.reload()

    async def stop(self):
        for node in self.nodes:
            node.kill()
        self.nodes = []

    async def _are_joined(self, hub, count):
        return hub.tail().count(f"u'{BRIDGE}'") >= count

    def _folder(self, number):
        folder = self._directory / f"node-{number}"
        folder.mkdir(exist_ok=True)
        return folder

    def _to_hub(self, number):
        return f"""connection node-{number}
address {HOST}:{self.ports[0]}
topic telepresence/# both 1
remote_username {BRIDGE}
remote_password {self._token}
cleansession false
try_private true
notifications false
restart_timeout 1 2
"""

    def _write(self, users):
        all_users = {**users, BRIDGE: self._bridge}
        for number in range(len(self.ports)):
            folder = self._folder(number)
            write_private(folder / "passwords", mosquitto.password_file(all_users))
            write_private(folder / "permissions", mosquitto.permission_file(all_users))
        self._users = dict(users)
