import pytest

from robots.simulator.render.camera import SceneCamera
from tests.support.media.office_camera import office_camera


@pytest.fixture
def camera() -> SceneCamera:
    return office_camera()
