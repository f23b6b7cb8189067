"""How a camera, a microphone or a loudspeaker is named: `[FORMAT:]ADDRESS [NAME=VALUE …]`, in
FFmpeg's words.

    /dev/video0                                    a camera of Linux
    v4l2:/dev/video0 video_size=1280x720 input_format=mjpeg
    rtsp://192.168.1.40/stream rtsp_transport=tcp  a camera of the network
    alsa:default                                   the microphone, or the loudspeaker, of Linux (see
    alsa.py) dshow:video=USB Camera                         a camera of Windows talk.mp4
    a file, played in real time, over and over

What follows the address is given to FFmpeg as it is (https://ffmpeg.org/ffmpeg-devices.html).
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
DEFAULTS: dict[str, dict[str, str]] = {
    # The driver's clock tells when a picture was taken; without it only its arrival is known.
    "v4l2": {"ts": "abs", "video_size": "640x480", "framerate": "30"},
    # A camera describes its stream before it sends it: 0.1 s (in microseconds) and 100 kB to look
    # into it are enough, FFmpeg's own 5 s cost 2.
    "rtsp": {
        "rtsp_transport": "tcp",
        "fflags": "nobuffer",
        "flags": "low_delay",
        "analyzeduration": "100000",
        "probesize": "100000",
    },
    "http": {"fflags": "nobuffer", "flags": "low_delay"},
}


class DeviceSettingError(ValueError):
    """No device is named like this; the message is one sentence for the robot's owner."""


@dataclass(frozen=True)
class DeviceSetting:
    """One device: FFmpeg's `format`; `live` sources set their own pace and cannot restart."""

    address: str
    format: str = ""
    options: dict[str, str] = field(default_factory=dict)
    live: bool = True

    @property
    def place(self) -> str:
        """Return what sentences call it, which visitors may read: of an address no password, and no
        path or query that may have one in it.
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
        raise DeviceSettingError(
            f"{words!r} is not a loudspeaker: use alsa:default, or another ALSA device"
        )
    if kind == "camera" and form in SOUND:
        raise DeviceSettingError(f"{words!r} is not a camera: {form} has sound only")
    if form == ALSA and options:
        raise DeviceSettingError(
            f"the {kind} {words!r} does not accept {', '.join(sorted(options))}: "
            "rate and channels are converted automatically"
        )
    found = SCHEME.match(address)
    live = form in DEVICES or (not form and found is not None)
    usual = (
        DEFAULTS.get(form or (found.group(1).lower().rstrip("s") if found else ""), {})
        if kind == "camera"
        else {}
    )
    return DeviceSetting(address, form, {**usual, **options}, live)


def _options(words: str) -> tuple[str, dict[str, str]]:
    """Return the text before the options, and these; an address may contain blanks."""
    options: dict[str, str] = {}
    while found := OPTION.search(words):
        options[found.group(1)] = found.group(2)
        words = words[: found.start()]
    return words.strip(), options
