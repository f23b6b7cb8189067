"""The agent: runs adapter, control loop, broker link and media side, and restarts them after a
failure.

It is one of the project's two supervisors and contains only what must survive every fault. After a
fault the base is stopped first: by the control loop while it runs, otherwise by the base's
watchdog.
"""

import logging
import os
import random
import secrets
import signal
import sys
import threading
import time
from argparse import ArgumentParser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import FrameType
from typing import Any

import structlog

from robots.agent.adapters import registry
from robots.agent.broker_link.broker_discovery import broker_urls, tls_context
from robots.agent.broker_link.enrolment import enrol_if_asked, keep_renewing
from robots.agent.broker_link.mqtt import Endpoint, MqttLink
from robots.agent.config import AgentConfig, ConfigError, add_arguments, load
from robots.agent.control.loop import ControlLoop
from robots.agent.control.publisher import Media
from robots.agent.control.robot_check import check_robot, say_line
from robots.agent.devices.equipment import Equipment, equipment_of
from robots.agent.media import MediaSide
from robots.agent.robot_interface import Adapter, AdapterError, PreviewsRoutes
from robots.agent.safety.obstacle_sources import sources_of
from robots.agent.store import Store
from robots.agent.thread_priority import SECOND, set_nice
from robots.agent.timing import Backoff
from robots.agent.watchdog import HANG_S, HangDetector, Systemd, end_process
from robots.api.messages import Capability, Factsheet
from robots.process import logs
from robots.process.interpreter import set_up_for_latency
from telepresence import __version__

log = structlog.stdlib.get_logger(__name__)

LAST_SECONDS = 5.0  # after a second Ctrl-C, until the process ends whatever it waits for
POLL_INTERVAL_S = 0.2  # between two checks of the control thread and of signals

MakeAdapter = Callable[[AgentConfig], Adapter]
MakeMedia = Callable[[Equipment, AgentConfig, ControlLoop], Media]


def _adapter(config: AgentConfig) -> Adapter:
    memory = config.var / "agent" / config.robot / "pose.json"
    adapter = registry.create(config.adapter, config.profile, config.options)
    return registry.autonomous(adapter, config.plan, memory)


def _media(equipment: Equipment, config: AgentConfig, control: ControlLoop) -> Media:
    return MediaSide(
        video=equipment.video,
        audio=equipment.audio,
        viewers=config.viewers,
        on_command=control.receive,
        reply=control.reply,
        on_picture=control.publish_picture,
        outputs=equipment.outputs,
        trust=tls_context(config.ca) if config.ca else None,
    )


class Agent:
    """One robot's agent. `run` blocks; `stop` may be called from any thread, and from a signal
    handler. `rng` spreads the attempts of many robots to connect.
    """

    def __init__(
        self,
        config: AgentConfig,
        *,
        make_adapter: MakeAdapter = _adapter,
        make_media: MakeMedia = _media,
        rng: random.Random | None = None,
    ) -> None:
        self._config, self._make_adapter, self._make_media = config, make_adapter, make_media
        self._rng = rng or random.Random()
        self._stopping = threading.Event()
        self._systemd = Systemd()
        self._link: MqttLink | None = None
        self._store = Store(config.var / "agent" / config.robot)

    def stop(self) -> None:
        self._stopping.set()

    def run(self, built: Callable[[], None] = lambda: None) -> None:
        """Serve the robot until `stop`; `built` is called for each run when everything is loaded,
        before the robot can be driven. Raises ConfigError with one sentence.
        """
        self._systemd.ready()
        self._prepare_store()
        urls = broker_urls(self._config, Backoff(self._rng, first=1.0, longest=30.0), self._pause)
        if urls is None:
            return
        self._endpoints(urls)  # a wrong one fails at once
        backoff = Backoff(self._rng, first=1.0, longest=30.0)
        threading.Thread(
            target=keep_renewing,
            args=(self._config, self._renewed, self._stopping.wait),
            name="credentials",
            daemon=True,
        ).start()
        while not self._stopping.is_set():
            began = time.monotonic()
            try:
                self._serve(self._endpoints(urls), built)
            except ConfigError:
                raise
            except AdapterError as error:
                raise ConfigError(str(error)) from error
            except Exception:  # this is the supervisor: an unreachable robot must recover
                log.exception("agent_crashed", robot=self._config.robot)
            if not self._stopping.is_set():
                wait = backoff.failed(time.monotonic() - began)
                log.warning("agent_restarted", robot=self._config.robot, after=round(wait, 1))
                self._pause(wait)

    def _pause(self, seconds: float) -> bool:
        """Wait, and return whether the agent is to end."""
        self._systemd.alive()
        return self._stopping.wait(seconds)

    def _serve(self, endpoints: tuple[Endpoint, ...], built: Callable[[], None]) -> None:
        """Run once (one boot), until `stop`, or until the control or media thread has ended."""
        adapter = self._make_adapter(self._config)
        equipment = equipment_of(adapter, self._config)
        boot = new_boot(time.time())
        sheet = factsheet_of(adapter, equipment, self._config, boot)
        link = self._link = MqttLink(endpoints[0], sheet, rng=self._rng, others=endpoints[1:])
        control = ControlLoop(
            adapter=adapter,
            capabilities=frozenset(sheet.capabilities),
            link=link,
            store=self._store,
            boot=boot,
            rng=self._rng,
            networks=self._config.networks,
        )
        media = self._make_media(equipment, self._config, control)
        media.start()
        built()
        try:
            control.start(media)
            config = self._config
            log.info("agent_started", robot=config.robot, adapter=config.adapter, boot=boot)
            hangs = HangDetector(round(HANG_S / POLL_INTERVAL_S))
            while not (self._stopping.is_set() or media.ended or control.wait(POLL_INTERVAL_S)):
                if hangs.look(control.ticks):
                    end_process(control.thread, "control")
                self._systemd.alive()
        finally:
            control.close()
            media.close()
            log.info("agent_ended", robot=self._config.robot, boot=boot, failed=control.failed)

    def _prepare_store(self) -> None:
        try:
            self._store.prepare()
            if self._config.clear_estop:
                self._store.keep_latch(None)
        except OSError as error:
            problem = f"the agent cannot store an emergency stop in {self._config.var}"
            raise ConfigError(f"{problem}: {error.strerror or error}") from error

    def _renewed(self, lines: dict[str, str]) -> None:
        """Use new credentials from the next connection on."""
        self._config = replace(
            self._config, token=lines["token"], user=lines.get("user", self._config.robot)
        )
        if self._link is not None:
            self._link.credentials_changed(self._config.user, lines["token"])

    def _endpoints(self, urls: tuple[str, ...]) -> tuple[Endpoint, ...]:
        config = self._config
        user = (config.user or config.robot) if config.token else None
        try:
            return tuple(Endpoint.of(url, user, config.token, config.ca) for url in urls)
        except ConfigError:
            raise
        except ValueError as error:
            given = f"given by {config.server}: correct MQTT_PUBLIC_URL there"
            if config.mqtt_url:
                given = "set by --mqtt, TELEPRESENCE_MQTT_URL, or mqtt_url in the credentials file"
            raise ConfigError(f"{error} ({given})") from error


def new_boot(unix: float) -> str:
    """Return the id of a run of the agent; ids sort by time, which shows the newer agent."""
    return f"{int(unix * 1000):012x}-{secrets.token_hex(4)}"


def capabilities_of(adapter: Adapter, equipment: Equipment) -> tuple[Capability, ...]:
    """Return what the robot can do: the adapter's capabilities, and the agent's own for its devices
    and sensors.
    """
    sees: tuple[Capability, ...] = ("video", "photo") if equipment.video is not None else ()
    hears: tuple[Capability, ...] = ("audio",) if equipment.audio is not None else ()
    own = tuple(name for name in adapter.profile.capabilities if name not in {"video", "audio"})
    assists: tuple[Capability, ...] = ("assist",) if sources_of(adapter.profile) else ()
    always: tuple[Capability, ...] = ("say", "call", "point", "network_lab", "safety_test")
    ours = (*assists, *sees, *hears, *always)
    return (*own, *(name for name in ours if name not in own))


def factsheet_of(
    adapter: Adapter, equipment: Equipment, config: AgentConfig, boot: str
) -> Factsheet:
    """Return the public data of the robot; its camera's only while it has one."""
    profile = adapter.profile
    return Factsheet(
        name=config.robot,
        series=profile.series,
        rca=profile.rca,
        agent_version=__version__,
        boot=boot,
        capabilities=capabilities_of(adapter, equipment),
        limits=profile.limits,
        footprint=profile.footprint,
        camera=profile.camera if equipment.video is not None else None,
        tilt=profile.tilt,
        laser=profile.laser,
        map_id=profile.map_id,
        watchdog=profile.watchdog,
        viewers=config.viewers,
        previews_routes=isinstance(adapter, PreviewsRoutes),
        navigation_control=profile.navigation_control or "",
        adapter=registry.version_of(config.adapter, __version__),
        driver=profile.driver,
    )


def agent_of(arguments: Mapping[str, Any]) -> Agent:
    """Return the agent of command line, environment and credentials file, after enrolling if
    requested. Raises ConfigError with one sentence.
    """
    enrol_if_asked(arguments, check=_check)
    return Agent(load(arguments))


def _check(config: AgentConfig) -> None:
    """Build the robot's side without starting it; raises ConfigError."""
    try:
        equipment_of(_adapter(config), config)
    except AdapterError as error:
        raise ConfigError(str(error)) from error


def run_until_signalled(agent: Agent) -> None:
    """Run an agent in the main thread until SIGINT or SIGTERM; a second one does not wait. Raises
    ConfigError as `Agent.run`.
    """

    def end(number: int, _frame: FrameType | None) -> None:
        signal.signal(number, end_at_once)
        agent.stop()

    def end_at_once(number: int, frame: FrameType | None) -> None:
        # Python waits for every thread, and an interrupted one may never end
        last = threading.Timer(LAST_SECONDS, os._exit, (128 + number,))
        last.daemon = True
        last.start()
        signal.default_int_handler(number, frame)

    for name in ("SIGINT", "SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), end)
    logs.write_in_a_thread()
    threading.excepthook = _log_thread
    set_nice(SECOND)
    agent.run(set_up_for_latency)


def _log_thread(arguments: threading.ExceptHookArgs) -> None:
    thread = arguments.thread.name if arguments.thread else "?"
    log.critical("thread_failed", thread=thread, exc_info=arguments.exc_value)


def main(arguments: Sequence[str] | None = None, *, program: str = "python -m robots.agent") -> int:
    parser = ArgumentParser(
        prog=program,
        description="The agent of a robot: connects it to a telepresence server.",
    )
    add_arguments(parser)
    logging.basicConfig(
        level=logging.INFO,
        format="%(asctime)s %(levelname)s %(name)s %(message)s",
        stream=sys.stderr,
    )
    try:
        given = vars(parser.parse_args(arguments))
        if given["check"]:
            return 0 if check_robot(given, say_line) else 1
        run_until_signalled(agent_of(given))
    except ConfigError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0
