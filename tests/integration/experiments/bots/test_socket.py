import pytest
from websockets.asyncio.server import serve
from websockets.frames import CloseCode

from experiments.bots.socket import Socket, SocketClosed

HEADERS = {"Origin": "http://127.0.0.1", "Cookie": "sessionid=abc"}
SIZES = (0, 5, 125, 126, 65_535, 65_536, 200_000)


async def connected(handler, **options):
    server = await serve(handler, "127.0.0.1", 0, **options)
    port = server.sockets[0].getsockname()[1]
    return server, await Socket.connect(f"http://127.0.0.1:{port}/ws/", HEADERS)


async def test_messages_of_every_size_go_there_and_back_whole():
    async def echo(socket):
        async for message in socket:
            await socket.send(message)
            await socket.send(message.encode())

    server, socket = await connected(echo, max_size=None)
    async with server:
        for size in SIZES:
            socket.send("é" * size)
            assert await socket.receive() == "é" * size
            assert await socket.receive() == ("é" * size).encode()
        await socket.close()


async def test_who_it_is_is_said_with_the_handshake():
    async def tell(socket):
        await socket.send(f"{socket.request.headers['Cookie']} {socket.request.headers['Origin']}")

    server, socket = await connected(tell)
    async with server:
        assert await socket.receive() == "sessionid=abc http://127.0.0.1"
        await socket.close()


async def test_a_message_in_pieces_is_one_and_pings_between_them_are_answered():
    async def pieces(socket):
        async def parts():
            yield "one "
            await (await socket.ping())
            yield "two"

        await socket.send(parts())

    server, socket = await connected(pieces)
    async with server:
        assert await socket.receive() == "one two"
        await socket.close()


async def test_the_end_is_told_with_the_servers_reason():
    async def refuse(socket):
        await socket.close(CloseCode.POLICY_VIOLATION, "no")

    server, socket = await connected(refuse)
    async with server:
        with pytest.raises(SocketClosed) as closed:
            await socket.receive()
        assert closed.value.code == CloseCode.POLICY_VIOLATION


async def test_a_server_that_does_not_want_it_is_told_from_one_that_is_not_there():
    async def nobody(_socket):
        raise AssertionError

    server = await serve(
        nobody,
        "127.0.0.1",
        0,
        process_request=lambda connection, _request: connection.respond(403, "no"),
    )
    port = server.sockets[0].getsockname()[1]
    async with server:
        with pytest.raises(SocketClosed, match="403"):
            await Socket.connect(f"http://127.0.0.1:{port}/ws/", HEADERS)
    with pytest.raises(OSError):
        await Socket.connect(f"http://127.0.0.1:{port}/ws/", HEADERS)


async def test_a_network_that_is_lost_says_no_goodbye():
    codes = []

    async def listen(socket):
        await socket.wait_closed()
        codes.append(socket.close_code)

    server, socket = await connected(listen)
    socket.abort()
    server.close()
    await server.wait_closed()
    assert codes == [CloseCode.ABNORMAL_CLOSURE]
