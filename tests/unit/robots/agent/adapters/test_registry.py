"""Names of adapters, profiles and options, right and wrong."""

import pytest

from robots.agent.adapters import registry
from robots.agent.robot_interface import AdapterError
from robots.api import adapter_names


def test_every_name_that_is_told_can_be_loaded() -> None:
    assert "simulator" in adapter_names.known_names()
    for profile in ("giraff", "rhodon"):
        assert registry.create("simulator", profile).profile.series == profile


@pytest.mark.parametrize(
    ("adapter", "profile", "options", "words"),
    [
        ("telepathy", "giraff", {}, "simulator"),
        ("simulator", "r2d2", {}, "giraff, rhodon"),
        ("simulator", "giraff", {"plan": "castle"}, "office"),
        ("simulator", "giraff", {"sede": "1"}, "no option sede"),
    ],
)
def test_a_wrong_name_gives_one_sentence_with_the_right_ones(
    adapter: str, profile: str, options: dict[str, str], words: str
) -> None:
    with pytest.raises(AdapterError, match=words):
        registry.create(adapter, profile, options)


def test_an_adapter_whose_libraries_are_missing_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(adapter_names.OURS, "ghost", "robots.agent.adapters.no_such_module")
    with pytest.raises(AdapterError, match="cannot be loaded"):
        registry.create("ghost", "giraff")


def test_an_adapter_without_a_watchdog_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    import dataclasses

    from robots.agent.adapters.simulator import adapter as simulator

    original = simulator.profile_of
    monkeypatch.setattr(
        simulator,
        "profile_of",
        lambda *a, **k: dataclasses.replace(original(*a, **k), watchdog=0.0),
    )
    with pytest.raises(AdapterError, match="watchdog"):
        registry.create("simulator", "giraff")
