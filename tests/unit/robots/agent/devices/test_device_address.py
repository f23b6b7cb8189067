"""The names of devices and their options."""

import pytest

from robots.agent.devices.device_address import DeviceSetting, DeviceSettingError, read


@pytest.mark.parametrize("words", ["", "none", "  none "])
def test_none_is_a_device_setting(words):
    assert read(words, "camera") is None


def test_a_camera_of_linux_is_named_by_its_file_and_takes_options_of_ffmpeg():
    found = read("/dev/video2 video_size=1280x720 input_format=mjpeg", "camera")
    assert (found.format, found.address, found.live) == ("v4l2", "/dev/video2", True)
    options = {"ts": "abs", "video_size": "1280x720", "framerate": "30", "input_format": "mjpeg"}
    assert found.options == options


def test_an_address_of_the_network_keeps_its_colons_and_its_query():
    address = "rtsp://user:word@10.0.0.4:554/live?channel=1"
    found = read(f"{address} rtsp_transport=udp", "camera")
    assert (found.format, found.address, found.live) == ("", address, True)
    assert found.options["rtsp_transport"] == "udp"


def test_names_with_blanks_and_colons_are_names_of_devices():
    assert read("dshow:video=USB Camera", "camera") == DeviceSetting("video=USB Camera", "dshow")
    assert read(r"C:\films\a talk.mp4", "camera") == DeviceSetting(
        r"C:\films\a talk.mp4", live=False
    )
    assert read("alsa:hw:1,0", "microphone") == DeviceSetting("hw:1,0", "alsa")


def test_files_and_generators_are_not_live():
    assert not read("talk.mp4", "microphone").live
    assert not read("lavfi:testsrc=size=320x240", "camera").live


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ("v4l2:", "camera"),
        ("alsa:default", "camera"),
        ("oss:/dev/dsp", "camera"),
        ("alsa: channels=1", "microphone"),
        ("alsa:default channels=1", "microphone"),
        ("alsa:default buffer=1", "loudspeaker"),
        ("talk.mp4", "loudspeaker"),
        ("v4l2:/dev/video0", "loudspeaker"),
    ],
)
def test_wrong_device_settings_are_refused_with_a_sentence(words, kind):
    with pytest.raises(DeviceSettingError, match=f"^the {kind} |is not a {kind}: "):
        read(words, kind)


@pytest.mark.parametrize(
    ("words", "place"),
    [
        ("rtsp://ana:hunter2@10.0.0.4:554/live?password=hunter2", "rtsp://10.0.0.4:554"),
        ("http://10.0.0.4/user=ana&password=hunter2.mjpg", "http://10.0.0.4"),
        ("rtsp://ana:hun@ter2@[fe80::1]:554/live", "rtsp://[fe80::1]:554"),
        ("/dev/video0", "/dev/video0"),
        ("talk.mp4", "talk.mp4"),
    ],
)
def test_device_name_in_sentences_has_no_password(words, place):
    assert read(words, "camera").place == place
