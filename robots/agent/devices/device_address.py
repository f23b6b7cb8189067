"""Names of cameras, microphones and loudspeakers: `[FORMAT:]ADDRESS [NAME=VALUE …]`, in FFmpeg's
terms.

    /dev/video0                                    a camera of Linux
    v4l2:/dev/video0 video_size=1280x720 input_format=mjpeg
    rtsp://192.168.1.40/stream rtsp_transport=tcp  a camera of the network
    alsa:default                                   microphone or loudspeaker of Linux (alsa.py)
    dshow:video=USB Camera                         a camera of Windows
    talk.mp4                                       a file, played repeatedly in real time

The options are passed to FFmpeg unchanged (https://ffmpeg.org/ffmpeg-devices.html).
"""

import re
from dataclasses import dataclass, field
from typing import Literal
from urllib.parse import urlsplit

Kind = Literal["camera", "microphone", "loudspeaker"]

DEVICES = frozenset({"v4l2", "alsa", "oss", "dshow", "avfoundation", "fbdev", "x11grab", "gdigrab"})
SOUND = frozenset({"alsa", "oss"})
ALSA = "alsa"
GENERATORS = frozenset({"lavfi"})
SCHEME = re.compile(r"^(rtsps?|rtmps?|https?|udp|tcp|rtp|srt)://", re.IGNORECASE)
OPTION = re.compile(r"(?:\s+([a-z][a-z0-9_]*)=(\S+))$")
LOW_DELAY = {"fflags": "nobuffer", "flags": "low_delay"}
DEFAULTS: dict[str, dict[str, str]] = {
    # the driver's clock has the time of an image; otherwise only its arrival is known
    "v4l2": {"ts": "abs", "video_size": "640x480", "framerate": "30"},
    # A camera describes its stream before it sends it: analysing 0.1 s (in microseconds) and 100 kB
    # is enough; FFmpeg's own 5 s take 2.
    "rtsp": {
        **LOW_DELAY,
        "rtsp_transport": "tcp",
        "analyzeduration": "100000",
        "probesize": "100000",
    },
    "http": LOW_DELAY,
}


class DeviceSettingError(ValueError):
    """An invalid name of a device; one sentence for the robot's owner."""


@dataclass(frozen=True)
class DeviceSetting:
    """One device: FFmpeg's `format`; `live` sources set their own pace and cannot restart."""

    address: str
    format: str = ""
    options: dict[str, str] = field(default_factory=dict)
    live: bool = True

    @property
    def place(self) -> str:
        """The name for sentences that visitors may read: an address without password, path and
        query.
        """
        if not SCHEME.match(self.address):
            return self.address
        parts = urlsplit(self.address)
        return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}"


def read(words: str, kind: Kind) -> DeviceSetting | None:
    """Return the device of `words`, None for "" and `none`; raises DeviceSettingError."""
    rest, options = _options(words.strip())
    if rest in {"", "none"}:
        return None
    known = DEVICES | GENERATORS
    before, colon, after = rest.partition(":")
    form, address = (before, after) if colon and before in known else ("", rest)
    if not form and rest.startswith("/dev/video"):
        form = "v4l2"
    if not address:
        raise DeviceSettingError(f"the {kind} {words!r} has no address after {form}:")
    if kind == "loudspeaker" and form != ALSA:
        wanted = "use alsa:default, or another ALSA device"
        raise DeviceSettingError(f"{words!r} is not a loudspeaker: {wanted}")
    if kind == "camera" and form in SOUND:
        raise DeviceSettingError(f"{words!r} is not a camera: {form} has sound only")
    if form == ALSA and options:
        raise DeviceSettingError(
            f"the {kind} {words!r} does not accept {', '.join(sorted(options))}: "
            "rate and channels are converted automatically"
        )
    found = SCHEME.match(address)
    live = form in DEVICES or (not form and found is not None)
    protocol = found.group(1).lower().rstrip("s") if found else ""
    usual = DEFAULTS.get(form or protocol, {}) if kind == "camera" else {}
    return DeviceSetting(address, form, {**usual, **options}, live)


def _options(words: str) -> tuple[str, dict[str, str]]:
    """Return the text before the options, and these; an address may contain blanks."""
    options: dict[str, str] = {}
    while found := OPTION.search(words):
        options[found.group(1)] = found.group(2)
        words = words[: found.start()]
    return words.strip(), options
