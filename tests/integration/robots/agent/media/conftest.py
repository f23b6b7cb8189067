"""A media side with a synthetic camera, and pages that close with the test."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable

import pytest

from robots.agent.media import MediaSide
from robots.api.messages import Role
from tests.support.media.loopback_peer import Exchange, LoopbackPage
from tests.support.media.synthetic_camera import SyntheticCamera, SyntheticMicrophone


@pytest.fixture
def camera() -> SyntheticCamera:
    return SyntheticCamera()


@pytest.fixture
def microphone() -> SyntheticMicrophone:
    return SyntheticMicrophone()


@pytest.fixture
async def exchange() -> Exchange:
    return Exchange(asyncio.get_running_loop())


@pytest.fixture
async def media(
    camera: SyntheticCamera, microphone: SyntheticMicrophone, exchange: Exchange
) -> AsyncIterator[MediaSide]:
    side = MediaSide(
        video=camera,
        audio=microphone,
        viewers=3,
        on_command=exchange.on_command,
        reply=exchange.reply,
    )
    side.start()
    yield side
    await asyncio.to_thread(side.close)


@pytest.fixture
async def new_page(media: MediaSide, exchange: Exchange) -> AsyncIterator:
    pages: list[LoopbackPage] = []

    def make(peer: str, *, decode: bool = False) -> LoopbackPage:
        pages.append(LoopbackPage(media, exchange, peer, decode=decode))
        return pages[-1]

    yield make
    for page in pages:
        await page.close()


@pytest.fixture
async def connected(new_page) -> Callable[..., Awaitable[LoopbackPage]]:
    """Return a function that makes a page and connects it; pages do not decode by default."""

    async def make(peer: str, role: Role = "observer", *, decode: bool = False) -> LoopbackPage:
        page = new_page(peer, decode=decode)
        await page.connect(role)
        return page

    return make
