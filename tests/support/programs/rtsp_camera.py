"""A network camera made with GStreamer's RTSP server. Runs under the system's Python, which has the
bindings.

    /usr/bin/python3 tests/support/programs/rtsp_camera.py PORT KEY_INTERVAL [USER PASSWORD]

Prints `ready` when it streams. KEY_INTERVAL is the time in seconds between key frames. A client
inside this process keeps the shared stream going, so that, as with a camera, other clients wait for
the next key frame.
"""

import sys

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtsp", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtsp, GstRtspServer

FPS = 15
PIPELINE = (
    "videotestsrc is-live=true pattern=ball !"
    f" video/x-raw,format=I420,width=320,height=240,framerate={FPS}/1 ! x264enc tune=zerolatency"
    " speed-preset=ultrafast bitrate=500 key-int-max={gap} option-string=scenecut=0 ! rtph264pay"
    " name=pay0 pt=96 config-interval=0"
)


def main(port: str, key_interval: str, *credentials: str) -> None:
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(port)
    factory = GstRtspServer.RTSPMediaFactory()
    factory.set_launch("( " + PIPELINE.format(gap=round(float(key_interval) * FPS)) + " )")
    factory.set_shared(True)
    account = ""
    if credentials:
        user, password = credentials
        account = f"user-id={user} user-pw={password}"
        protect(server, factory, user, password)
    server.get_mount_points().add_factory("/stream", factory)
    server.attach(None)
    watcher = Gst.parse_launch(
        f"rtspsrc name=camera location=rtsp://127.0.0.1:{port}/stream protocols=tcp {account} !"
        " fakesink name=sink signal-handoffs=true"
    )
    loop = GLib.MainLoop()
    sink = watcher.get_by_name("sink")

    def report_ready(*_arguments: object) -> None:
        sink.disconnect(handler)
        sys.stdout.write("ready\n")
        sys.stdout.flush()

    handler = sink.connect("handoff", report_ready)
    watcher.set_state(Gst.State.PLAYING)
    loop.run()


def protect(
    server: "GstRtspServer.RTSPServer",
    factory: "GstRtspServer.RTSPMediaFactory",
    user: str,
    password: str,
) -> None:
    auth = GstRtspServer.RTSPAuth()
    auth.set_supported_methods(GstRtsp.RTSPAuthMethod.DIGEST)
    token = GstRtspServer.RTSPToken()
    token.set_string("media.factory.role", "user")
    auth.add_digest(user, password, token)
    server.set_auth(auth)
    permissions = GstRtspServer.RTSPPermissions()
    permissions.add_permission_for_role("user", "media.factory.access", True)
    permissions.add_permission_for_role("user", "media.factory.construct", True)
    factory.set_permissions(permissions)


if __name__ == "__main__":
    main(*sys.argv[1:])
