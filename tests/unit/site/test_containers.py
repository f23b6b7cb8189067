"""The images, the compose files and the Kubernetes manifests start the same processes as systemd's
units, with existing settings and as few rights.
"""

import re

import pytest
from django.conf import settings
from django.core.management import get_commands, load_command_class
from django.urls import resolve

from telepresence_site.serving import APPLICATION, DAPHNE
from tests.support.paths import ROOT
from tests.support.programs.deployed import (
    DEPLOY,
    KUBERNETES,
    OURS,
    compose,
    documents,
    kubernetes,
    kustomization,
    pods,
    units,
)

PLACES = {
    "compose": list(compose("compose.yaml").values()),
    "one": kubernetes("one"),
    "many": kubernetes("many"),
}
ROBOT = compose("robot.compose.yaml")["agent"]
EVERYWHERE = [
    *(pytest.param(one, id=f"{place} {one.name}") for place in PLACES for one in PLACES[place]),
    pytest.param(ROBOT, id="robot"),
    *(pytest.param(one, id=f"turn {one.name}") for one in kubernetes("turn")),
]
FOLDERS = ("one", "many", "turn")
SITE_NAMES = set(
    re.findall(
        r'env\.(?:text|flag|words)\(\s*"(\w+)"',
        (ROOT / "telepresence_site/settings.py").read_text(),
    )
)
# What units do and containers need not: certificates and TLS are the proxy's, Mosquitto is a child.
ONLY_UNITS = {"sh", "systemctl"}
BROKERS = ({"run_broker"}, {"mosquitto_files", "nats-server"})
# read by kustomize from files beside it, which each site makes
SECRETS = {"telepresence.env", "database.env", "broker.env", "turn.env", "redis.env"}


@pytest.mark.parametrize("place", PLACES)
def test_every_process_of_the_units_runs_and_no_other(place):
    wanted = {unit.kind for unit in units().values()} - ONLY_UNITS - {ROBOT.kind}
    ours = {one.kind for one in PLACES[place] if one.image in OURS or one.kind == "nats-server"}
    broker = ours & set.union(*BROKERS)
    assert broker in BROKERS
    assert ours - broker == (wanted - set.union(*BROKERS)) | {"migrate"}


def test_the_robots_file_starts_the_agent_as_its_unit_does():
    unit = units()["telepresence-agent@"]
    plain = [re.sub(r"\$\{(\w+)[:?-]*\}", r"$\1", word) for word in ROBOT.words]
    assert plain[:3] == ["python", *unit.words[1:3]]
    assert [word for word in plain if word.startswith("--")] == [
        word for word in unit.words if word.startswith("--")
    ]
    assert plain[-1] == unit.words[-1] == "$ADAPTER_OPTIONS"


@pytest.mark.parametrize("place", PLACES)
def test_web_processes_are_started_as_the_unit_starts_them(place):
    webs = [one for one in PLACES[place] if one.kind == "daphne"]
    assert len(webs) == (2 if place == "compose" else 1)
    for web in webs:
        assert web.words == ("python", *DAPHNE, "-b", "0.0.0.0", "-p", "8000", APPLICATION)


@pytest.mark.parametrize("one", EVERYWHERE)
def test_a_command_of_the_site_exists_and_takes_its_options(one):
    if "manage.py" not in one.words:
        return
    name, *arguments = one.words[one.words.index("manage.py") + 1 :]
    command = load_command_class(get_commands()[name], name)
    command.create_parser("manage.py", name).parse_args(arguments)


@pytest.mark.parametrize("place", PLACES)
def test_variables_of_our_containers_are_settings(place):
    if place == "compose":
        names = {
            name for one in PLACES[place] if one.image in OURS for name in one.around["environment"]
        }
    else:
        names = variables_of(place)
    assert {"VAR_DIR", "STATIC_ROOT", "MQTT_URL"} <= names <= SITE_NAMES


def variables_of(folder):
    """Return the names in a folder's ConfigMap; each of our processes reads it after the secret."""
    for one in kubernetes(folder):
        if one.image in OURS:
            sources = [
                (kind, one["name"])
                for source in one.around["envFrom"]
                for kind, one in source.items()
            ]
            assert sources == [("secretRef", "telepresence"), ("configMapRef", "telepresence")]
    made = [one for name in ("base", folder) for one in kustomization(name)["configMapGenerator"]]
    lines = [line for one in made if one["name"] == "telepresence" for line in one["literals"]]
    return {line.partition("=")[0] for line in lines}


def test_every_name_of_the_example_environment_is_read_by_the_settings():
    example = (DEPLOY / "telepresence.env.example").read_text()
    assert set(re.findall(r"^(?:# )?([A-Z_]+)=", example, re.MULTILINE)) <= SITE_NAMES


def test_the_proxy_gets_the_variables_of_its_file():
    asked = set(re.findall(r"\{\$(\w+):", (DEPLOY / "proxy/Caddyfile").read_text()))
    services = compose("compose.yaml")
    assert set(services["proxy"].around["environment"]) == asked
    webs = services["proxy"].around["environment"]["WEB"].split()
    assert webs == [f"{name}:8000" for name, one in services.items() if one.kind == "daphne"]
    allowed = services["web-1"].around["environment"]["ALLOWED_HOSTS"].split(",")
    assert {web.partition(":")[0] for web in webs} <= set(allowed)


@pytest.mark.parametrize("one", EVERYWHERE)
def test_containers_have_read_only_root_filesystems_and_gain_no_rights(one):
    if one.pod:
        own, whole = one.around["securityContext"], one.pod["securityContext"]
        assert own == {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        assert whole["runAsNonRoot"]
        assert whole["runAsUser"] == whole["runAsGroup"] == whole["fsGroup"] > 0
        assert whole["seccompProfile"] == {"type": "RuntimeDefault"}
        assert one.pod["automountServiceAccountToken"] is False
    else:
        assert one.around["read_only"] is (one.name != "database")
        assert one.around["cap_drop"] == ["ALL"]
        assert one.around["security_opt"] == ["no-new-privileges:true"]
        assert "/tmp" in one.around["tmpfs"]
        assert not one.around.get("cap_add")
        assert not one.around.get("privileged")


def test_both_images_run_as_the_user_of_the_manifests():
    text = (DEPLOY / "Containerfile").read_text()
    users = re.findall(r"^USER (\d+):(\d+)$", text, re.MULTILINE)
    assert users == [("10001", "10001")] * 2
    for folder in FOLDERS:
        for name, pod in pods(folder).items():
            if name not in {"database", "redis"}:
                assert pod["securityContext"]["runAsUser"] == 10001, name


def test_a_process_has_the_same_time_to_end_as_in_its_unit():
    wanted = {
        unit.kind: int(unit.around["TimeoutStopSec"])
        for unit in units().values()
        if "TimeoutStopSec" in unit.around
    }
    assert set(wanted) == {"daphne", "run_session_manager", "run_practice", "robots.agent"}
    for one in [*PLACES["compose"], ROBOT]:
        if one.kind in wanted:
            assert one.around["stop_grace_period"] == f"{wanted[one.kind]}s"
    for one in [*PLACES["one"], *PLACES["many"]]:
        if one.kind in wanted:
            assert one.pod["terminationGracePeriodSeconds"] >= wanted[one.kind]


def test_every_listening_container_has_a_health_check():
    for one in PLACES["compose"]:
        if one.kind in {"daphne", "run_broker", "caddy", "turnserver", "redis-server", ""}:
            assert one.around["healthcheck"]["test"][0] == "CMD", one.name
    for folder in FOLDERS:
        for pod in pods(folder).values():
            for one in pod["containers"]:
                if "ports" in one or pod.get("hostNetwork"):
                    assert {"readinessProbe", "livenessProbe"} <= set(one), one["name"]


def test_probes_of_web_processes_request_existing_pages_of_an_allowed_host():
    asked = [
        PLACES["one"][0].around[probe]["httpGet"] for probe in ("readinessProbe", "livenessProbe")
    ]
    assert [resolve(one["path"]).url_name for one in asked] == ["healthz", "manifest"]
    example = (DEPLOY / "telepresence.env.example").read_text()
    (allowed,) = re.findall(r"^ALLOWED_HOSTS=(.*)$", example, re.MULTILINE)
    for one in asked:
        headers = {header["name"]: header["value"] for header in one["httpHeaders"]}
        assert headers["Host"] in allowed.split(",")
    # a restart does not help while database or broker are away, and would end drives
    assert asked[1]["path"] != "/healthz"


@pytest.mark.parametrize("folder", ["base", *FOLDERS])
def test_kustomize_uses_every_file_of_a_folder(folder):
    directory, what = KUBERNETES / folder, kustomization(folder)
    named = {name for name in what["resources"] if not (directory / name).is_dir()}
    generators = [*what.get("secretGenerator", ()), *what.get("configMapGenerator", ())]
    made = {name for one in generators for key in ("envs", "files") for name in one.get(key, ())}
    there = {path.name for path in directory.iterdir()} - {"kustomization.yaml"} - SECRETS
    assert named | (made - SECRETS) == there
    ignored = (ROOT / ".gitignore").read_text().split()
    assert all(f"/deploy/kubernetes/*/{name}" in ignored for name in made & SECRETS)


@pytest.mark.parametrize("folder", FOLDERS)
def test_services_and_the_ingress_lead_to_ports_that_a_container_opens(folder):
    found = documents(folder)
    services = {one["metadata"]["name"]: one for one in found if one["kind"] == "Service"}
    for service in services.values():
        pod = pods(folder)[service["spec"]["selector"]["app"]]
        opened = {port["name"] for one in pod["containers"] for port in one.get("ports", ())}
        assert {port["targetPort"] for port in service["spec"]["ports"]} <= opened
    for ingress in (one for one in found if one["kind"] == "Ingress"):
        for path in ingress["spec"]["rules"][0]["http"]["paths"]:
            backend = path["backend"]["service"]
            ports = services[backend["name"]]["spec"]["ports"]
            assert backend["port"]["name"] in {port["name"] for port in ports}


def test_our_processes_name_each_node_of_the_broker():
    text = (KUBERNETES / "many/kustomization.yaml").read_text()
    (url,) = re.findall(r"MQTT_URL=(\S+)", text)
    (nodes,) = [
        document
        for document in documents("many")
        if document["kind"] == "StatefulSet" and document["metadata"]["name"] == "broker"
    ]
    place = f"{nodes['spec']['serviceName']}.telepresence.svc.cluster.local"
    numbers = range(nodes["spec"]["replicas"])
    assert url.split(",") == [f"mqtt://broker-{number}.{place}:1883" for number in numbers]
    (routes,) = [
        word for one in PLACES["many"] for word in one.words if word.startswith("--routes=")
    ]
    assert re.findall(r"@broker-(\d)\.brokers:6222", routes) == [str(number) for number in numbers]


def test_a_node_in_kubernetes_has_the_bounds_of_one_on_a_machine():
    def bounds(path):
        text = path.read_text()
        return re.findall(
            r"^ *(?:max_|ping_|write_|ack_|consumer_).*$|max_memory_store.*$", text, re.MULTILINE
        )

    machine = bounds(DEPLOY / "nats/telepresence.conf")
    assert bounds(KUBERNETES / "many/nats.conf") == machine
    assert len(machine) == 9


def test_the_image_has_what_the_site_needs():
    packages = (ROOT / "requirements-server.lock").read_text()
    assert "psycopg-binary==" in packages
    assert "channels-redis==" in packages
    containerfile = (DEPLOY / "Containerfile").read_text()
    assert "-r requirements-server.lock" in containerfile
    # before the packages a pip without known vulnerabilities, after them none
    steps = [containerfile.index(f" {step}") for step in ("-r pip.lock", "-r req", "uninstall")]
    assert steps == sorted(steps)
    assert (DEPLOY / "pip.lock").read_text().startswith("pip==")
    sent = {line[1:] for line in (ROOT / ".dockerignore").read_text().split() if line[0] == "!"}
    assert all((ROOT / name).exists() for name in sent)
    apps = {name.partition(".")[0] for name in settings.INSTALLED_APPS}
    ours = {name for name in apps if (ROOT / name).is_dir()}
    assert ours | {"templates", "static", "locale", "docs/reference", "manage.py"} <= sent
