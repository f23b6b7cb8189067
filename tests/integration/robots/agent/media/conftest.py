"""A media side with a synthetic camera, and pages that close with the test."""

from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial

import pytest

from robots.agent.media import MediaSide
from robots.api.messages import Role
from tests.support.media.loopback_peer import Exchange, LoopbackPage, MediaRig
from tests.support.media.synthetic_camera import SyntheticCamera, SyntheticMicrophone


@pytest.fixture
def camera() -> SyntheticCamera:
    return SyntheticCamera()


@pytest.fixture
def microphone() -> SyntheticMicrophone:
    return SyntheticMicrophone()


@pytest.fixture
async def rig(camera: SyntheticCamera, microphone: SyntheticMicrophone) -> AsyncIterator[MediaRig]:
    async with MediaRig(video=camera, audio=microphone) as rig:
        yield rig


@pytest.fixture
def exchange(rig: MediaRig) -> Exchange:
    return rig.exchange


@pytest.fixture
def media(rig: MediaRig) -> MediaSide:
    return rig.media


@pytest.fixture
def new_page(rig: MediaRig) -> Callable[..., LoopbackPage]:
    return partial(rig.page, decode=False)


@pytest.fixture
async def connected(new_page) -> Callable[..., Awaitable[LoopbackPage]]:
    """Return a function that makes a page and connects it; pages do not decode by default."""

    async def make(peer: str, role: Role = "observer", *, decode: bool = False) -> LoopbackPage:
        page = new_page(peer, decode=decode)
        await page.connect(role)
        return page

    return make
