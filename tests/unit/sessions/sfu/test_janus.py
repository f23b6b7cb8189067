"""The client of Janus, with a socket in memory."""

import asyncio

import msgspec
import pytest
from websockets.exceptions import ConnectionClosedOK

from sessions.sfu import janus
from sessions.sfu.janus import DETACHED, UP, JanusError, JanusLostError, JanusSession


class Socket:
    """A ClientConnection of websockets: what it brings is put into `incoming`, None for its end."""

    def __init__(self):
        self.sent, self.incoming, self.error = [], asyncio.Queue(), None

    async def send(self, frame):
        if self.error is not None:
            raise self.error
        self.sent.append(msgspec.json.decode(frame))

    def __aiter__(self):
        return self

    async def __anext__(self):
        frame = await self.incoming.get()
        if frame is None:
            raise StopAsyncIteration
        return frame

    def say(self, message, **fields):
        """Have Janus say something; with `to`, as the answer to that request."""
        to = fields.pop("to", None)
        names = {} if to is None else {"transaction": self.sent[to]["transaction"]}
        self.incoming.put_nowait(msgspec.json.encode({"janus": message, **names, **fields}))


@pytest.fixture
async def socket():
    return Socket()


@pytest.fixture
async def session(socket):
    made = JanusSession(socket, "secret")
    listening = asyncio.ensure_future(made.listen())
    yield made
    socket.incoming.put_nowait(None)
    await listening


async def asked(socket, count=1):
    while len(socket.sent) < count:
        await asyncio.sleep(0)


async def test_an_answer_is_the_one_that_names_the_request_and_not_its_acknowledgement(
    session, socket
):
    one, two = (asyncio.ensure_future(session.request("message", n)) for n in (1, 2))
    await asked(socket, 2)
    socket.say("ack", to=0)
    socket.say("event", to=1, of="two")
    socket.say("event", to=0, of="one")
    assert ((await one)["of"], (await two)["of"]) == ("one", "two")
    assert {message["apisecret"] for message in socket.sent} == {"secret"}


async def test_a_refused_request_raises_the_error_of_janus(session, socket):
    request = asyncio.ensure_future(session.request("attach"))
    await asked(socket)
    socket.say("error", to=0, error={"code": 403, "reason": "Unauthorized"})
    with pytest.raises(JanusError, match="Unauthorized") as refused:
        await request
    assert refused.value.code == 403


@pytest.mark.parametrize("end", [None, b"{ no JSON"])
async def test_a_waiting_request_fails_when_the_connection_ends(session, socket, end):
    requests = [asyncio.ensure_future(session.request("message", n)) for n in (1, 2)]
    await asked(socket, 2)
    socket.say("event", to=0)
    socket.incoming.put_nowait(end)
    await session.closed.wait()
    answered, lost = await asyncio.gather(*requests, return_exceptions=True)
    assert answered["janus"] == "event"
    assert isinstance(lost, JanusLostError)
    with pytest.raises(JanusLostError, match="closed"):
        await session.send("keepalive")
    assert len(socket.sent) == 2


@pytest.mark.parametrize("error", [OSError("reset"), ConnectionClosedOK(None, None)])
async def test_a_request_that_cannot_be_sent_finds_janus_lost(session, socket, error):
    socket.error = error
    with pytest.raises(JanusLostError, match="create"):
        await session.begin()


async def test_a_janus_that_does_not_answer_is_lost(session, monkeypatch):
    monkeypatch.setattr(janus, "ANSWER_SECONDS", 0.0)
    with pytest.raises(JanusLostError, match="no answer to create"):
        await session.begin()


async def test_events_of_a_handle_are_reported_until_it_is_forgotten(session, socket):
    events = []
    attaching = asyncio.ensure_future(session.attach("nosip", lambda *event: events.append(event)))
    await asked(socket)
    socket.say("success", to=0, data={"id": 7})
    handle = await attaching
    socket.say(UP, sender=7)
    socket.say(UP, sender=8)
    socket.say("media", sender=7)
    socket.say(DETACHED, sender=7, reason="gone")
    request = asyncio.ensure_future(session.request("message", 7))
    await asked(socket, 2)
    socket.say("event", to=1)
    await request
    assert events == [(UP, ""), (DETACHED, "gone")]
    session.forget(handle)
    socket.say(UP, sender=7)
    socket.incoming.put_nowait(None)
    await session.closed.wait()
    assert len(events) == 2
