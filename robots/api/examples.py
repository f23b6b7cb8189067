"""One example and more of every message: the source of the golden files and of the examples in the
reference.

`least` holds only what must be said, the others say everything. Two languages read these, so a
change here is a change of the contract. Python and JavaScript both decode them in their tests.
"""

from typing import Any

from robots.api import messages as m

_STAMP = 1_766_000_000.25
_SESSION = "0b6c1a52-52f0-4d5c-9f3e-1f0f9d0c7a11"
_POSE = m.Pose(x=3.25, y=-1.5, theta=1.5707963267948966)
_STILL = m.Velocity(linear=0.0, angular=0.0)
_ROLLING = m.Velocity(linear=0.35, angular=-0.2)
_LIMITS = m.Limits(
    linear=0.7,
    reverse=0.3,
    angular=0.7,
    linear_acceleration=0.2,
    angular_acceleration=0.4,
    linear_braking=0.8,
    angular_braking=1.6,
)
_ICE = m.IceServer(
    urls=("stun:stun.example.org:3478", "turn:turn.example.org:3478?transport=tcp"),
    username="1766003600:ana",
    credential="c2VjcmV0",
)
_SURE = m.Pose(
    x=3.25,
    y=-1.5,
    theta=1.5707963267948966,
    covariance=(0.01, 0.0, 0.0, 0.01, 0.0, 0.004),
    localized=False,
    score=0.4,
)

_STATE = m.State(
    stamp=_STAMP,
    boot="b7f3",
    seq=1207,
    session=_SESSION,
    epoch=12,
    pose=_SURE,
    velocity=_ROLLING,
    battery=m.Battery(charge=0.82, voltage=27.4, charging=True),
    docked=True,
    charger_contact=True,
    tilt=0.1,
    mode="assisted",
    assist="slow",
    safety=m.Safety(
        estop=True,
        estop_source="visitor",
        collision=True,
        inhibited="estop",
        stop_seq=41,
        stop_id="stop-9",
        touched=("ahead", "left"),
    ),
    errors=("camera: connection refused",),
    clearance=0.44,
    contacts=1,
    distance=61.5,
    visitor_silence=0.2,
    viewers=2,
    applied=(
        m.AppliedCommand(
            seq=40,
            stamp=_STAMP - 0.1,
            method="keyboard",
            way="datachannel",
            age=0.012,
            linear=0.35,
            angular=-0.2,
            frame_age=0.09,
            asked=m.Velocity(linear=0.5, angular=-0.2),
            allowed=m.Velocity(linear=0.4, angular=-0.2),
            share=0.8,
        ),
    ),
    refused={"stale": 2, "old_seq": 1},
    assist_why="obstacle",
    assist_point=(0.6, -0.1),
    call=m.CallState(status="accepted", audio=True, video=True, volume=0.5, shares=True),
    screens=1,
    knockable=True,
    knock=m.KnockState(action_id="a1", status="answered"),
    control_network=m.LabReport(
        lab=m.NetworkLab(delay=0.1, jitter=0.02, loss=0.01, reorder=0.005, seed=7),
        taken=400,
        lost=5,
        reordered=2,
        waiting=3,
        held=0.101,
    ),
    video_network=m.LabReport(
        lab=m.NetworkLab(bitrate=4e5, seed=8), taken=9000, overflowed=41, held=0.05
    ),
    camera_status=m.CameraStatus(
        status="failed", reason="the camera rtsp://10.0.0.4 cannot be read: connection refused"
    ),
)
_ASKED: dict[str, Any] = {"action_id": "a1", "stamp": _STAMP}
_WHOLE: dict[str, Any] = {**_ASKED, "session": _SESSION, "epoch": 12}

EXAMPLES: dict[str, dict[str, m.Message]] = {
    "connection": {
        "least": m.Connection(boot="b7f3", state="ONLINE", stamp=_STAMP),
        "broken": m.Connection(
            boot="b7f3", state="CONNECTIONBROKEN", stamp=_STAMP, reason="last will"
        ),
    },
    "factsheet": {
        "least": m.Factsheet(
            name="giraff",
            series="Giraff",
            rca="simulator",
            agent_version="0.1.0",
            boot="b7f3",
            capabilities=("velocity",),
            limits=_LIMITS,
            footprint=((0.3, 0.25), (-0.3, 0.25), (-0.3, -0.25), (0.3, -0.25)),
            watchdog=0.3,
        ),
        "full": m.Factsheet(
            name="giraff",
            series="Giraff",
            rca="simulator",
            agent_version="0.1.0",
            boot="b7f3",
            capabilities=("velocity", "dock", "tilt", "video"),
            limits=_LIMITS,
            footprint=((0.3, 0.25), (-0.3, 0.25), (-0.3, -0.25), (0.3, -0.25)),
            watchdog=0.3,
            viewers=4,
            map_id="office",
            camera=m.Camera(width=640, height=480, fps=30.0, hfov=1.2, x=0.1, z=1.3, pitch=0.35),
            tilt=m.TiltRange(minimum=-0.5, maximum=1.2),
            laser=m.Laser(x=0.22, theta=0.1),
            navigation_control="guarded",
        ),
    },
    "state": {
        "least": m.State(
            stamp=_STAMP, boot="b7f3", seq=0, pose=_POSE, velocity=_STILL, battery=m.Battery()
        ),
        "full": _STATE,
        "charging_unknown": m.State(
            stamp=_STAMP,
            boot="b7f3",
            seq=1,
            pose=_POSE,
            velocity=_STILL,
            battery=m.Battery(charge=0.5, charging=None),
        ),
    },
    "pose": {
        "least": m.PoseUpdate(stamp=_STAMP, pose=_POSE, velocity=_ROLLING),
        "tilted": m.PoseUpdate(stamp=_STAMP, pose=_SURE, velocity=_ROLLING, tilt=-0.2),
        "assisted": m.PoseUpdate(
            stamp=_STAMP,
            pose=_POSE,
            velocity=_ROLLING,
            assist_why="doorway",
            assist_point=(0.8, 0.4),
        ),
    },
    "scan": {
        "full": m.Scan(
            stamp=_STAMP,
            angle_min=-2.0,
            angle_increment=0.01,
            range_max=8.0,
            ranges=(1.25, None, 7.5),
        )
    },
    "path": {
        "least": m.Path(stamp=_STAMP, points=()),
        "full": m.Path(stamp=_STAMP, points=((0.0, 0.0), (1.5, -0.25))),
    },
    "event": {
        "least": m.Event(stamp=_STAMP, boot="b7f3", seq=1208, type="docked"),
        "full": m.Event(
            stamp=_STAMP,
            boot="b7f3",
            seq=1208,
            session=_SESSION,
            epoch=12,
            type="photo",
            action_id="a1",
            sha256="ab" * 32,
            last_seq=1207,
            detail="640x480",
        ),
    },
    "action": {
        "least": m.ActionStatus(action_id="a1", status="RUNNING", stamp=_STAMP),
        "full": m.ActionStatus(
            action_id="a1",
            status="FAILED",
            stamp=_STAMP,
            type="goto",
            reason="no way there",
            result={"metres": 2.5, "tried": True},
        ),
    },
    "words": {
        "least": m.Words(
            stamp=_STAMP, action_id="a1", session=_SESSION, by="screen", text="Hello!"
        ),
        "full": m.Words(
            stamp=_STAMP,
            action_id="a1",
            session=_SESSION,
            by="driver",
            who="Ana",
            text="Hola, ¿qué tal?",
            language="es",
            aloud=True,
            receipts=True,
        ),
    },
    "receipt": {
        "shown": m.Receipt(stamp=_STAMP, action_id="a1", session=_SESSION, state="shown"),
        "spoken": m.Receipt(stamp=_STAMP, action_id="a1", session=_SESSION, state="spoken"),
        "not_spoken": m.Receipt(stamp=_STAMP, action_id="a1", session=_SESSION, state="not_spoken"),
    },
    "pointer": {
        "gone": m.Pointer(stamp=_STAMP, by="screen"),
        "there": m.Pointer(stamp=_STAMP, by="driver", at=(0.25, 0.875)),
    },
    "heartbeat": {
        "least": m.Heartbeat(n=7, stamp=_STAMP),
        "full": m.Heartbeat(
            n=7,
            stamp=_STAMP,
            echoes=(m.Echo(peer="p1", n=31, stamp=_STAMP - 0.5, received=_STAMP - 0.1),),
        ),
    },
    "media": {
        "least": m.MediaClock(rtp=4_294_967_000, stamp=_STAMP),
        "full": m.MediaClock(rtp=12, stamp=_STAMP, rate=48_000),
    },
    "signal/+/reply": {
        "answer": m.SdpAnswer(sdp="v=0\r\n"),
        "candidate": m.Candidate(
            candidate="candidate:1 1 UDP 1 127.0.0.1 9 typ host", sdp_mid="0", sdp_m_line_index=0
        ),
        "bye": m.Bye(reason="full"),
    },
    "lease": {
        "least": m.Lease(session=_SESSION, epoch=12, peer="p1", who="Ana", renewal=0, stamp=_STAMP),
        "full": m.Lease(
            session=_SESSION,
            epoch=12,
            peer="p1",
            who="Ana",
            renewal=3,
            stamp=_STAMP,
            ttl=5.0,
            video="none",
            assist="steer",
            limits=m.LeaseLimits(linear=0.3, angular=0.5, command_age=0.4, frame_age=2.0),
            methods=("keyboard", "touch"),
            ways=("mqtt",),
            actions=("photo", "say"),
        ),
    },
    "config": {
        "least": m.Config(stamp=_STAMP),
        "full": m.Config(
            stamp=_STAMP,
            assist="slow",
            doors={"corridor": "closed"},
            calls="ask",
            control_network=m.NetworkLab(delay=0.1, jitter=0.02, loss=0.01, reorder=0.005, seed=7),
            video_network=m.NetworkLab(bitrate=4e5, seed=8),
            network_session=_SESSION,
        ),
    },
    "floorplan": {
        "least": m.FloorPlanUpdate(
            map_id="office",
            sha256="cd" * 32,
            resolution=0.05,
            origin=(-1.0, -2.0, 0.0),
            image="iVBORw0KGgo=",
        ),
        "full": m.FloorPlanUpdate(
            map_id="office",
            sha256="cd" * 32,
            resolution=0.05,
            origin=(-1.0, -2.0, 0.0),
            image="iVBORw0KGgo=",
            negate=True,
            occupied_thresh=0.7,
            free_thresh=0.2,
            plan={"version": 1, "mapId": "office", "title": "Office"},
        ),
    },
    "command/velocity": {
        "least": m.VelocityCommand(
            session=_SESSION,
            epoch=12,
            seq=40,
            stamp=_STAMP,
            linear=0.35,
            angular=-0.2,
            method="keyboard",
        ),
        "full": m.VelocityCommand(
            session=_SESSION,
            epoch=12,
            seq=41,
            stamp=_STAMP,
            linear=0.35,
            angular=-0.2,
            method="stick",
            frame=_STAMP - 0.05,
        ),
    },
    "command/heartbeat": {
        "least": m.CommandHeartbeat(n=31, stamp=_STAMP),
        "full": m.CommandHeartbeat(
            n=31,
            stamp=_STAMP,
            peer="p1",
            echo=m.Echo(peer="robot", n=7, stamp=_STAMP, received=_STAMP + 0.1),
            frame_age=0.05,
        ),
    },
    "command/action": {
        "goto": m.Goto(**_WHOLE, x=1.0, y=2.0, theta=0.5),
        "goto-place": m.Goto(**_WHOLE, place="kitchen"),
        "follow": m.Follow(**_WHOLE, points=((0.0, 0.0), (1.0, 0.5))),
        "dock": m.Dock(**_WHOLE),
        "undock": m.Undock(**_WHOLE),
        "cancel": m.Cancel(**_WHOLE, target="a0"),
        "stop": m.Stop(**_WHOLE, seq=42),
        "stop-least": m.Stop(**_ASKED),
        "estop": m.EStop(**_WHOLE, detail="a person is in the way"),
        "clear_estop": m.ClearEStop(**_ASKED, role="staff", user="berta"),
        "tilt": m.Tilt(**_WHOLE, angle=0.3),
        "photo": m.Photo(**_WHOLE),
        "relocalize": m.Relocalize(**_WHOLE, x=1.0, y=2.0, theta=0.5),
        "say": m.Say(**_WHOLE, text="Hola, ¿qué tal?", language="es"),
        "say-least": m.Say(**_ASKED, role="screen", text="Hello!", aloud=False),
        "confirm_words": m.ConfirmWords(**_ASKED, role="screen", target="a0", state="shown"),
        "call": m.Call(**_WHOLE, audio=True, video=True, volume=0.5),
        "call-screen": m.Call(**_WHOLE, video=True, shares=True),
        "call-end": m.Call(**_WHOLE, ringing=False),
        "answer_call": m.AnswerCall(**_ASKED, role="screen", accept=True),
        "answer_call-knock": m.AnswerCall(**_ASKED, role="screen", accept=False, knock="a0"),
        "knock": m.Knock(**_WHOLE),
        "resend_states": m.ResendStates(**_ASKED, role="server", boot="b7f3", first=10, last=20),
    },
    "command/picture": {
        "least": m.PictureRequest(stamp=_STAMP),
        "full": m.PictureRequest(stamp=_STAMP, peer="p1", seen=_STAMP - 0.2, round_trip=0.03),
    },
    "command/point": {
        "gone": m.PointCommand(stamp=_STAMP),
        "there": m.PointCommand(stamp=_STAMP, at=(0.25, 0.875), session=_SESSION, epoch=12),
        "at-screen": m.PointCommand(stamp=_STAMP, at=(0.0, 1.0), role="screen", peer="p2"),
    },
    "signal/+": {
        "offer": m.SdpOffer(
            sdp="v=0\r\n", role="driver", session=_SESSION, epoch=12, who="Ana", ice_servers=(_ICE,)
        ),
        "offer-least": m.SdpOffer(sdp="v=0\r\n"),
        "candidate": m.Candidate(),
        "bye": m.Bye(),
        "stay": m.Stay(),
    },
}

MANAGER_STATUS: dict[str, m.ManagerStatus] = {
    "well": m.ManagerStatus(stamp=_STAMP),
    "in trouble": m.ManagerStatus(stamp=_STAMP, faults=("database", "disk_full")),
}
