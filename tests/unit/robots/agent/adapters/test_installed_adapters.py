"""Adapters of other packages are entry points, with the same rules for names as ours."""

import argparse
import dataclasses
from pathlib import Path

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.common.robot_profile import load_profile
from robots.agent.adapters.simulator import adapter as simulator
from robots.agent.config import ConfigError, add_arguments, load
from robots.agent.robot_interface import AdapterError
from robots.api import adapter_names
from tests.support.architectures.installed_adapters import install


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of the import path, as site-packages is."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    return folder


def test_an_installed_adapter_is_created_by_its_name(site) -> None:
    install(site, "stranger-robots", "stranger")
    assert "stranger" in adapter_names.known_names()
    assert registry.create("stranger", "giraff").profile.series == "giraff"


def test_the_error_of_an_unknown_adapter_lists_known_ones_and_the_entry_points(site) -> None:
    install(site, "stranger-robots", "stranger")
    with pytest.raises(AdapterError) as caught:
        registry.create("acme", "giraff")
    for word in (*adapter_names.OURS, "stranger", adapter_names.GROUP):
        assert word in str(caught.value)


def test_an_installed_adapter_cannot_have_a_name_of_ours(site, caplog) -> None:
    install(site, "other-moos", "moos", text="def create(profile_name, options):\n    1 / 0\n")
    assert registry.create("moos", "giraff").profile.rca == "MOOS (OpenMORA)"
    adapter_names.installed()
    assert 'adapter_name_taken name=moos package="other-moos 1.0"' in caplog.text


def test_two_packages_with_one_name_are_both_reported(site) -> None:
    install(site, "one-acme", "acme")
    install(site, "two-acme", "acme")
    with pytest.raises(AdapterError, match=r"one-acme 1\.0|two-acme 1\.0"):
        registry.create("acme", "giraff")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("import no_such_sdk\n", "no_such_sdk"),
        ("create = 1 +\n", "invalid syntax"),
        ("made = None\n", "has no create"),
    ],
)
def test_a_package_that_cannot_be_used_is_refused_with_the_reason(site, text, sentence) -> None:
    install(site, f"broken-{len(text)}", "broken", text=text)
    with pytest.raises(AdapterError, match=sentence):
        registry.create("broken", "giraff")


def test_an_adapter_of_ours_that_cannot_be_imported_is_refused(monkeypatch) -> None:
    monkeypatch.setitem(adapter_names.OURS, "ghost", "robots.agent.adapters.no_such_module")
    with pytest.raises(AdapterError, match="cannot be loaded"):
        registry.create("ghost", "giraff")


def test_an_adapter_without_a_watchdog_is_refused(monkeypatch) -> None:
    made = simulator.profile_of

    def without_watchdog(*arguments, **options):
        return dataclasses.replace(made(*arguments, **options), watchdog=0.0)

    monkeypatch.setattr(simulator, "profile_of", without_watchdog)
    with pytest.raises(AdapterError, match="has no watchdog"):
        registry.create("simulator", "giraff")


@pytest.mark.parametrize(
    ("profile", "options", "words"),
    [("r2d2", {}, "giraff, rhodon"), ("giraff", {"sede": "1"}, "no option sede")],
)
def test_the_error_of_a_wrong_name_lists_the_right_ones(profile, options, words) -> None:
    with pytest.raises(AdapterError, match=words):
        registry.create("simulator", profile, options)


def test_listing_names_imports_nothing(site) -> None:
    install(site, "never-imported", "lazy", text="raise RuntimeError('imported')\n")
    assert "lazy" in adapter_names.known_names()


def test_a_profile_may_have_a_table_for_an_installed_adapter(site, tmp_path) -> None:
    shipped = load_profile("giraff")
    assert "moos" in shipped.adapters
    text = (Path(registry.__file__).parent / "profiles" / "giraff.toml").read_text()
    file = tmp_path / "mine.toml"
    file.write_text(f"{text}\n[stranger]\nwatchdog = 0.4\n")
    with pytest.raises(AdapterError, match=r"an unknown section \[stranger\]"):
        registry.create("moos", str(file))
    install(site, "stranger-robots", "stranger")
    assert registry.create("moos", str(file)).profile.series == "giraff"


def test_error_without_an_adapter_lists_installed_ones(site, tmp_path) -> None:
    install(site, "stranger-robots", "stranger")
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    given = vars(parser.parse_args(["acme", "--server", "https://example.org"]))
    with pytest.raises(ConfigError, match="stranger"):
        load({**given, "var": tmp_path}, {"TELEPRESENCE_TOKEN": "t"})
