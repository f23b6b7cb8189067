"""Takes a robot as a visitor does, turns it on the spot for two seconds, and leaves.

SESSION=COOKIE turn.py URL ROBOT

The cookie is `sessionid` of a logged-in visitor. It drives over one WebSocket, without WebRTC, as
"A program that drives" in docs/reference/robot-api.md describes. It does not reconnect: when
anything fails it ends, and the robot stops by itself.
"""

import asyncio
import json
import os
import struct
import sys
import time

from websockets.asyncio.client import connect

TICK = 0.05  # s between velocities
SPEED = 0.4  # rad/s
SECONDS = 2.0
PATIENCE = 60.0  # s until the robot turns; another visitor may have it
PICTURE = b"picture\n"


class Driver:
    """Answers what the server sends; `turned` is the time for which the robot has obeyed."""

    def __init__(self, socket):
        self.socket = socket
        self.grant = self.echo = self.frame = None
        self.beats = self.seq = 0
        self.turned = 0.0

    async def send(self, suffix, message):
        await self.socket.send(f"{suffix}\n{json.dumps(message)}")

    async def receive(self):
        """Take the robot, and handle frames until the drive has ended."""
        await self.send("session/take", {})
        async for frame in self.socket:
            if isinstance(frame, bytes):
                (self.frame,) = struct.unpack(">d", frame[len(PICTURE) :][:8])
                await self.ask_for_picture()
                continue
            suffix, _, payload = frame.partition("\n")
            message = json.loads(payload)
            if suffix == "session/granted":
                self.grant = message
                await self.ask_for_picture()
            elif suffix == "session/offered":
                await self.send("session/take", {"session": message["session"]})
            elif suffix == "heartbeat":
                kept = {name: message[name] for name in ("n", "stamp")}
                self.echo = {"peer": "robot", "received": time.time(), **kept}
            elif suffix == "state" and is_turned_by(message):
                self.turned += 0.25  # a state comes four times a second
            elif suffix in {"session/refused", "session/ended"}:
                sys.exit(f"{suffix}: {message.get('reason')}")

    async def ask_for_picture(self):
        seen = {} if self.frame is None else {"seen": self.frame}
        await self.send("command/picture", {"stamp": time.time(), **seen})

    async def drive(self):
        """Send velocities and heartbeats until the robot has turned for SECONDS, then leave."""
        deadline = time.monotonic() + PATIENCE
        while self.turned < SECONDS:
            if time.monotonic() > deadline:
                sys.exit("The robot did not turn.")
            await asyncio.sleep(TICK)
            if self.grant is not None:
                await self.tick(SPEED)
        await self.tick(0.0)
        await self.send("session/leave", {})

    async def tick(self, angular):
        now, grant = time.time(), self.grant
        self.seq += 1
        if self.seq % 2:
            self.beats += 1
            echo = {} if self.echo is None else {"echo": self.echo}
            await self.send("command/heartbeat", {"n": self.beats, "stamp": now, **echo})
        if self.seq % 14 == 0:  # an answer may have been lost
            await self.ask_for_picture()
        velocity = {"session": grant["session"], "epoch": grant["epoch"], "seq": self.seq}
        velocity |= {"stamp": now, "linear": 0.0, "angular": angular, "method": "keyboard"}
        if self.frame is not None:
            velocity["frame"] = self.frame
        await self.send("command/velocity", velocity)


def is_turned_by(state):
    """Tell whether the robot has carried out a turn since its last state."""
    return any(command.get("angular") for command in state.get("applied", ()))


async def main(url, robot):
    address = f"{url.replace('http', 'ws', 1).rstrip('/')}/ws/robots/{robot}/"
    cookie = {"Cookie": f"sessionid={os.environ['SESSION']}"}
    async with connect(address, additional_headers=cookie, origin=url) as socket:
        driver = Driver(socket)
        receiving = asyncio.create_task(driver.receive())
        driving = asyncio.create_task(driver.drive())
        done, _ = await asyncio.wait({receiving, driving}, return_when=asyncio.FIRST_COMPLETED)
        receiving.cancel()
        for task in done:
            task.result()
    print(f"{robot} has turned.")


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
