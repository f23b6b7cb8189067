"""The page about writing an adapter, executed: its first two blocks pass the conformance suite,
the third adds a camera.
"""

import asyncio
import re
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from robots.agent.adapters import registry
from robots.agent.media.pixels import video_frame
from robots.agent.robot_interface import AdapterError, Frame
from robots.agent.safety.collision_monitor import monitor_of
from tests.support.architectures.adapter_conformance import wait_for
from tests.support.architectures.rca_conformance import RcaConformance, connected
from tests.support.architectures.rca_world import RcaRig
from tests.support.paths import ROOT
from tests.support.patience import patient

PAGE = ROOT / "docs" / "howto" / "write-an-adapter.md"
CAMERA = "\n[camera]\nwidth = 64\nheight = 48\nfps = 30\nhfov = 1.0\nx = 0.1\nz = 0.5\n"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def adapter_of(folder, argument, *, profile_start="", profile_end=""):
    """Return the page's first adapter, with one more argument and a longer profile."""
    source = blocks("python")[0]
    changed = source.replace("options.watchdog)", f"options.watchdog, {argument})")
    assert changed != source
    (folder / "rosie.py").write_text(changed, encoding="utf-8")
    profile = profile_start + blocks("toml")[0] + profile_end
    (folder / "rosie.toml").write_text(profile, encoding="utf-8")
    return registry.create(str(folder / "rosie.py"), str(folder / "rosie.toml"))


class Rosie(RcaRig, asyncio.DatagramProtocol):
    """The base of the page: a simulated rhodon that speaks UDP."""

    series = "rhodon"

    def __init__(self, directory, *, camera=False):
        super().__init__()
        self.port, self.transport, self.peer = 0, None, None
        self.adapter_file, self.profile_file = directory / "rosie.py", directory / "rosie.toml"
        python, toml = blocks("python"), blocks("toml")[0]
        self.adapter_file.write_text("".join(python if camera else python[:1]), encoding="utf-8")
        self.profile_file.write_text(toml + (CAMERA if camera else ""), encoding="utf-8")

    def adapter(self, **options):
        return registry.create(
            str(self.adapter_file),
            str(self.profile_file),
            {"host": "127.0.0.1", "port": str(self.port), **options},
        )

    async def up(self):
        self.transport, _ = await self.loop.create_datagram_endpoint(
            lambda: self, local_addr=("127.0.0.1", self.port)
        )
        self.port = self.transport.get_extra_info("sockname")[1]

    async def down(self):
        self.transport.close()
        self.peer = None

    def connection_made(self, transport):
        pass

    def error_received(self, error):
        self.peer = None

    def datagram_received(self, data, address):
        self.peer = address
        self.world.drive(*map(float, data.split()))

    async def say(self, count):
        if count % 3 == 0 and self.peer:
            sim = self.world.sim
            values = (*sim.odometry, sim.motion.linear, sim.motion.angular, sim.voltage())
            self.transport.sendto(" ".join(f"{value:.5f}" for value in values).encode(), self.peer)


class TestRosie(RcaConformance):
    def make_rig(self, directory):
        return Rosie(directory)


class BlueCamera:
    """The part of cv2.VideoCapture that the page uses: `read` blocks until the next frame and
    returns it as BGR, uint8, or False and None when there is none (modules/videoio,
    VideoCapture::read). It reuses its memory, as `read(image)` and many SDKs do.
    """

    taken = 0
    is_unplugged = False

    def __init__(self, index):
        assert index == 0
        self._bgr = np.zeros((48, 64, 3), np.uint8)

    def read(self):
        time.sleep(0.005)
        if BlueCamera.is_unplugged:
            return False, None
        BlueCamera.taken += 1
        self._bgr[:] = (255, BlueCamera.taken % 100, 0)
        return True, self._bgr

    def release(self):
        self._bgr[:] = 0


@pytest.fixture
def opencv(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", SimpleNamespace(VideoCapture=BlueCamera))
    monkeypatch.setattr(BlueCamera, "is_unplugged", False)


def test_page_camera_returns_rgb_frames_in_separate_memory(tmp_path, opencv):
    adapter = Rosie(tmp_path, camera=True).adapter()
    source = adapter.video()
    assert "video" in adapter.profile.capabilities
    assert source is adapter.video()
    for _ in range(2):
        source.start()
        source.start()
        frames = [source.read(patient(5.0)) for _ in range(3)]
        source.stop()
        source.stop()
        assert source.read(0.05) is None
        for frame in frames:
            assert (frame.image.dtype, frame.image.shape) == (np.uint8, (48, 64, 3))
            assert frame.image.flags.c_contiguous
            red, green, blue = frame.image[0, 0]
            assert (red, blue) == (0, 255), "the camera sees blue"
            assert (frame.image[:, :, 1] == green).all()
            assert video_frame(frame).to_ndarray(format="rgb24").shape == (48, 64, 3)
        assert len({int(frame.image[0, 0, 1]) for frame in frames}) == 3, "no memory is shared"
        assert frames[0].stamp < frames[1].stamp < frames[2].stamp
    BlueCamera.is_unplugged = True
    source.start()
    with pytest.raises(AdapterError, match="the camera gives no frames"):
        source.read(patient(5.0))
    source.stop()


async def test_callback_on_a_thread_of_the_sdk_reaches_the_readings(tmp_path, opencv):
    with Rosie(tmp_path, camera=True) as rig:
        adapter = rig.adapter()
        async with connected(adapter):
            for count in (1, 2):
                await asyncio.to_thread(adapter.on_bumper, True)
                await wait_for(adapter, lambda s, count=count: s.contacts == count)
                await asyncio.to_thread(adapter.on_bumper, False)
    closed = adapter._loop = asyncio.new_event_loop()
    closed.close()
    await asyncio.to_thread(adapter.on_bumper, True)


def test_page_states_the_shapes_and_types_of_arrays_that_the_agent_accepts():
    table = PAGE.read_text(encoding="utf-8").partition("### NumPy arrays")[2]
    for row in ("| `uint8` | (height, width, 3) | RGB", "| `int16` | (960,) |", "| (n, 2) |"):
        assert row in table
    tall = Frame(np.zeros((48, 64, 3), np.uint8), 1.0)
    planes = Frame(np.zeros((72, 64), np.uint8), 1.0, "yuv420p")
    assert (planes.width, planes.height) == (tall.width, tall.height) == (64, 48)
    for frame in (tall, planes):
        assert (video_frame(frame).width, video_frame(frame).height) == (64, 48)
    for image in (np.zeros((48, 64, 3), np.float32), np.zeros((48, 64), np.uint8)):
        with pytest.raises(ValueError, match=r"an image of shape \(48, 64.* is not rgb24"):
            video_frame(Frame(image, 1.0))


def test_laser_of_the_page_enables_navigation_and_assistance(tmp_path):
    adapter = registry.autonomous(
        adapter_of(tmp_path, 'own=("scan",)', profile_end="\n[laser]\nx = 0.1\n")
    )
    assert {"goto", "dock"} <= set(adapter.profile.capabilities)
    assert monitor_of(adapter.profile) is not None


def test_sonars_and_bumper_of_the_page_enable_assistance_alone(tmp_path):
    sonars = "\n[[sonars]]\nx = 0.25\ny = 0.0\ntheta = 0.0\n"
    adapter = adapter_of(
        tmp_path,
        'sensors=("sonars", "bumper")',
        profile_start="bumper = true\n",
        profile_end=sonars,
    )
    assert registry.autonomous(adapter) is adapter
    assert monitor_of(adapter.profile) is not None


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("import no_such_library", "no_such_library"),
        ("def create(:", "invalid syntax"),
        ("x = 1", "has no create"),
    ],
)
def test_file_without_an_adapter_is_refused_with_the_reason(tmp_path, text, sentence):
    file = tmp_path / "mine.py"
    file.write_text(text)
    with pytest.raises(AdapterError, match=sentence):
        registry.create(str(file), "giraff")


def test_missing_file_is_named():
    with pytest.raises(AdapterError, match=r"no_such\.py"):
        registry.create("./no_such.py", "giraff")
