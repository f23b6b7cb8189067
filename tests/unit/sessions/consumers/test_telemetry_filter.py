"""Messages that a page with a direct connection does not get from the server."""

from sessions.consumers.relay import TelemetryFilter

EVERYTHING = ("state", "pose", "scan", "path", "event", "action", "heartbeat")


def passed_in_8_s(telemetry, **options):
    """Return the suffixes that pass in 8 s, of all suffixes four times a second."""
    return [
        suffix
        for n in range(32)
        for suffix in (*EVERYTHING, "pointer")
        if telemetry.passes(suffix, 0.25 * n, **options)
    ]


def test_a_page_without_a_direct_connection_gets_all_states_and_few_scans_and_poses():
    telemetry = TelemetryFilter()
    passed = [
        suffix
        for n in range(120)
        for suffix in ("state", "event", "heartbeat", "pose", "scan")
        if telemetry.passes(suffix, n / 15)
    ]
    assert all(passed.count(suffix) == 120 for suffix in ("state", "event", "heartbeat"))
    assert 36 <= passed.count("pose") <= 42
    assert passed.count("scan") == 8


def test_a_page_that_watches_through_the_sfu_gets_few_states_and_no_heartbeats():
    telemetry = TelemetryFilter()
    passed = passed_in_8_s(telemetry, by_sfu=True)
    assert passed.count("state") == 4
    assert set(passed) == {"state", "path", "event", "action"}


def test_a_page_with_a_direct_connection_gets_few_states_and_all_reliable_messages():
    telemetry = TelemetryFilter()
    telemetry.direct = True
    passed = passed_in_8_s(telemetry)
    assert passed.count("state") == 4
    assert passed.count("pose") == passed.count("scan") == passed.count("pointer") == 0
    assert passed.count("heartbeat") == 8
    assert all(passed.count(suffix) == 32 for suffix in ("path", "event", "action"))


def test_everything_is_sent_again_when_the_direct_connection_is_silent():
    telemetry = TelemetryFilter()
    telemetry.direct = True
    assert telemetry.passes("state", 1.0)
    assert not telemetry.passes("state", 1.1)
    telemetry.direct = False
    assert all(telemetry.passes(suffix, 1.2) for suffix in ("state", "pose", "scan", "pointer"))
