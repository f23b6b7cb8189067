import math
import random
from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from experiments.tasks.engine import TaskEngine
from experiments.tasks.records import (
    FirstFrame,
    PhotoAnswer,
    PhotoFailed,
    PhotoTaken,
    Seen,
    TaskEnded,
    identity,
    order,
    seen,
)
from robots.api.messages import Battery, Pose, State, Velocity
from tests.support.examples import examples
from tests.support.studies.task_drives import (
    BACK,
    BY_ARCHWAY,
    BY_DOOR,
    FIRST,
    HOME,
    SECOND,
    START,
    THERE,
    Drive,
    cues,
    milestones,
    run,
    track,
    whole_drive,
)


def test_states_and_the_first_frame_give_the_events_of_the_whole_task():
    engine = run(whole_drive().records)
    assert milestones(engine) == [
        ("task_started", None),
        ("left_station", 0),
        ("checkpoint", 1),
        ("door_passed", "door"),
        ("checkpoint", 2),
        ("photo_prompt", 2),
        ("dock_contact", 1),
        ("docked", 0),
        ("task_ended", "completed"),
    ]
    result = engine.result
    assert (result.outcome, result.photo) == ("completed", "")
    assert (result.doors, result.doors_missed) == (("door",), ())
    assert len(result.checkpoints) == 2
    assert result.started == pytest.approx(START + 0.25)


def test_the_visitor_is_led_from_step_to_step():
    assert cues(run(whole_drive().records)) == [
        "leave_station",
        "go_to_checkpoint",
        "go_to_checkpoint",
        "photo_ready",
        "photo_turn_right",
        "photo_move",
        "return_home",
        "dock_now",
        "dock_hold",
        "completed",
    ]


def test_docking_ends_the_task_without_the_photo_and_with_a_door_missed():
    engine = run(Drive().go(FIRST, *BY_ARCHWAY, SECOND, *BACK).dock().records)
    assert engine.result.outcome == "completed"
    assert engine.result.doors_missed == ("door",)


def test_a_door_that_the_condition_closes_is_not_missed():
    engine = run(Drive().go(FIRST, *BY_ARCHWAY, SECOND, *BACK).dock().records, track("shut"))
    assert engine.result.doors_missed == ()
    assert engine.result.outcome == "completed"


def test_docking_early_is_an_event_with_the_next_checkpoint_and_ends_nothing():
    drive = Drive().go(FIRST, HOME).dock().see(docked=True)
    engine = run(drive.records)
    assert milestones(engine)[-1] == ("docked_early", 2)
    assert engine.progress.cue.key == "docked_early"
    assert (engine.progress.cue.number, engine.result.outcome) == (2, None)
    drive.go(*THERE[1:], *BACK).dock()
    assert run(drive.records).result.outcome == "completed"


def test_contacts_that_flicker_in_the_station_are_one_docking():
    drive = Drive().go(FIRST, HOME)
    for contact in (True, False, True, False, True):
        drive.x, drive.y = HOME
        drive.see(contact=contact)
    drive.dock()
    for contact in (False, True, False, True):
        drive.see(docked=True, contact=contact)
    assert [event for event, _ in milestones(run(drive.records))].count("docked_early") == 1


def test_a_later_checkpoint_is_out_of_order_once_an_approach_and_does_not_count():
    drive = Drive().go(*BY_ARCHWAY, SECOND, (6.9, 2.1), SECOND)
    engine = run(drive.records)
    assert milestones(engine)[-1] == ("out_of_order", 2)
    assert (engine.progress.cue.key, engine.progress.cue.number) == ("wrong_checkpoint", 1)
    assert engine.result.checkpoints == ()
    drive.go((5.5, 2.0), SECOND)
    assert [event for event, _ in milestones(run(drive.records))].count("out_of_order") == 2


def test_a_checkpoint_is_not_passed_through_a_wall():
    first, second = track().stops
    behind = replace(first, x=4.5, y=2.0, radius=0.8, room=second.room)
    near = track(stops=(behind, second))
    assert run(Drive().go((3.8, 2.0)).records, near).result.checkpoints == ()
    assert len(run(Drive().go(*BY_ARCHWAY, (4.6, 2.0)).records, near).result.checkpoints) == 1


def test_a_checkpoint_between_two_states_is_passed():
    drive = Drive()
    drive.speed = 1.9
    first, second = track().stops
    small = replace(first, x=2.0, y=1.66, radius=0.1, room=())
    engine = run(drive.go((3.5, 1.3)).records, track(stops=(small, second)))
    assert len(engine.result.checkpoints) == 1


def test_a_robot_that_is_put_elsewhere_has_passed_no_door_on_the_way():
    drive = Drive().go((3.4, 0.9))
    drive.x, drive.y = 7.5, 0.9
    assert ("door_passed", "door") not in milestones(run(drive.see().records))


def test_a_robot_that_turns_round_in_the_doorway_has_not_passed_the_door():
    engine = run(Drive().go(BY_DOOR[0], (4.2, 0.9), BY_DOOR[0]).records)
    assert ("door_passed", "door") not in milestones(engine)
    back_and_forth = ((4.05, 0.9), (4.15, 0.9)) * 2
    trembling = Drive().go(BY_DOOR[0], *back_and_forth, BY_DOOR[1])
    assert milestones(run(trembling.records)).count(("door_passed", "door")) == 1


def test_a_place_of_which_the_robot_is_not_sure_passes_nothing():
    drive = Drive()
    drive.x, drive.y = FIRST
    for _ in range(8):
        drive.see(localized=False)
    engine = run(drive.records)
    assert engine.result.checkpoints == ()
    assert engine.progress.cue.key == "lost"


# --- the photo ------------------------------------------------------------------------------------


def at_the_mirror() -> Drive:
    return Drive().go(*THERE)


def test_the_photo_window_opens_by_itself_and_hints_which_way_to_turn():
    drive = at_the_mirror()
    assert run(drive.turn(-1.5).records).progress.cue.key == "photo_turn_left"
    assert run(drive.turn(1.5).records).progress.cue.key == "photo_turn_right"
    assert run(drive.turn(0.0).records).progress.cue.key == "photo_ready"


def test_the_hint_does_not_flicker_at_the_edge_of_the_view():
    drive = at_the_mirror().turn(0.55).turn(0.62).turn(0.58).turn(0.65)
    assert cues(run(drive.records))[-1] == "photo_ready"
    assert cues(run(drive.turn(0.75).records))[-1] == "photo_turn_right"


def test_a_robot_beside_the_mirror_gets_the_cue_to_move():
    drive = at_the_mirror().go((7.0, 3.1)).turn(0.0)
    assert run(drive.records).progress.cue.key == "photo_move"


@pytest.mark.parametrize(("theta", "sees"), [(0.0, True), (math.pi, False)])
def test_a_photo_is_kept_whatever_it_shows_and_the_facing_is_a_fact(theta, sees):
    drive = at_the_mirror().turn(theta)
    drive.say(PhotoTaken(drive.at, "photo")).see().say(PhotoAnswer(drive.at, "keep", "keep")).see()
    engine = run(drive.records)
    taken = next(event for event in engine.events if event.type == "photo_taken")
    assert taken.sight.sees is sees
    assert taken.data()["facing"]["distance"] == pytest.approx(1.0, abs=0.01)
    assert milestones(engine)[-1] == ("photo_kept", "photo")
    assert engine.result.photo == "kept"
    assert engine.progress.cue.key == "return_home"


def test_again_asks_for_another_photo_and_skip_ends_the_asking():
    drive = at_the_mirror().turn(0.0)
    drive.say(PhotoTaken(drive.at, "one")).see()
    assert run(drive.records).progress.cue.key == "photo_review"
    drive.say(PhotoAnswer(drive.at, "a", "again")).see()
    assert run(drive.records).progress.cue.key == "photo_ready"
    drive.say(PhotoAnswer(drive.at, "b", "skip")).see()
    engine = run(drive.records)
    assert milestones(engine)[-2:] == [("photo_again", "one"), ("photo_skipped", None)]
    assert engine.result.photo == "skipped"
    assert engine.progress.cue.key == "return_home"


def test_a_photo_can_be_kept_only_once_taken_and_skipped_only_once_prompted():
    drive = Drive()
    drive.say(PhotoAnswer(drive.at, "early", "skip")).go(*THERE)
    drive.say(PhotoAnswer(drive.at, "keep", "keep")).see()
    engine = run(drive.records)
    assert engine.result.photo == ""
    assert not any(event.type in {"photo_kept", "photo_skipped"} for event in engine.events)


def test_a_photo_that_failed_leaves_the_window_open():
    drive = at_the_mirror().turn(0.0)
    drive.say(PhotoFailed(drive.at, "photo")).see()
    engine = run(drive.records)
    assert milestones(engine)[-1] == ("photo_failed", "photo")
    assert engine.progress.cue.key == "photo_ready"


def test_the_window_closes_when_the_robot_leaves_and_opens_again_when_it_returns():
    drive = at_the_mirror().go((5.0, 3.1))
    assert run(drive.records).progress.cue.key == "return_home"
    engine = run(drive.go(SECOND).records)
    assert [event for event, _ in milestones(engine)].count("photo_prompt") == 2
    assert engine.progress.cue.key.startswith("photo_")


def test_a_course_without_a_mirror_asks_for_no_photo():
    engine = run(whole_drive().records, track(photo=None))
    assert engine.result.photo is None
    assert not any(event.type == "photo_prompt" for event in engine.events)


# --- time and ends --------------------------------------------------------------------------------


def test_time_counts_from_the_first_frame_and_a_reload_does_not_restart_it():
    drive = Drive(frame=False)
    for _ in range(400):
        drive.see(docked=True)
    started = drive.at
    drive.say(FirstFrame(started, "one")).see().say(FirstFrame(started + 60.0, "two"))
    engine = run(drive.records, until=started + 299.0)
    assert engine.result.outcome is None
    engine.advance(started + 300.0)
    assert (engine.result.outcome, engine.result.ended) == ("timed_out", started + 300.0)


def test_the_last_minutes_are_announced_and_shown():
    engine = run(Drive().records)
    began = engine.result.started
    engine.advance(began + 179.0)
    assert engine.remaining() is None
    engine.advance(began + 200.0)
    assert engine.remaining() == pytest.approx(100.0)
    assert milestones(engine)[-1] == ("time_warning", None)


def test_records_after_the_limit_change_nothing():
    drive = Drive().go(*THERE, *BACK)
    drive.at = START + 400.0
    engine = run(drive.dock().records)
    assert engine.result.outcome == "timed_out"
    assert engine.result.ended == pytest.approx(START + 300.25)


@pytest.mark.parametrize(
    "outcome",
    ["connection_refused", "cancelled", "stopped_by_operator", "robot_fault", "connection_lost"],
)
def test_an_end_from_outside_is_the_tasks_outcome_and_nothing_after_it_counts(outcome):
    drive = Drive().go(FIRST)
    drive.say(TaskEnded(drive.at, "end", outcome)).go(*THERE[1:], *BACK).dock()
    engine = run(drive.records)
    assert engine.result.outcome == outcome
    assert milestones(engine)[-1] == ("task_ended", outcome)
    assert len(engine.result.checkpoints) == 1


def test_a_session_that_ends_before_the_first_picture_has_an_outcome_and_no_start():
    engine = run([*Drive(frame=False).records, TaskEnded(START + 9.0, "end", "connection_refused")])
    assert (engine.result.outcome, engine.result.started) == ("connection_refused", None)


def test_an_engine_that_was_fed_with_nothing_waits():
    engine = TaskEngine(track())
    engine.advance(1e9)
    assert (engine.events, engine.result.outcome) == ((), None)
    assert engine.progress.cue.key == "wait_for_picture"


# --- the same in any order ------------------------------------------------------------------------


def busy_drive() -> Drive:
    """A drive in which about everything happens."""
    drive = Drive().go(*BY_ARCHWAY, SECOND, *BACK).dock().go(*THERE).turn(-1.0)
    for photo, answer in (("one", "again"), ("two", "keep")):
        drive.say(PhotoTaken(drive.at, photo)).see().say(PhotoAnswer(drive.at, answer, answer))
        drive.turn(0.1) if answer == "again" else drive.see(localized=False)
    return drive.go(*BACK).dock()


BUSY = busy_drive().records
EXPECTED = run(BUSY)


def test_the_busy_drive_is_as_busy_as_it_should_be():
    types = {event for event, _ in milestones(EXPECTED)}
    assert types >= {"out_of_order", "docked_early", "photo_again", "photo_kept"}
    assert types >= {"door_passed", "task_ended"}
    assert EXPECTED.result.outcome == "completed"


@examples(15, thorough=600)
@given(seed=st.integers(0, 2**32 - 1), copies=st.integers(0, 200), held_back=st.integers(0, 120))
def test_repeated_late_and_unordered_records_give_the_same_events_and_outcome(
    seed, copies, held_back
):
    rng = random.Random(seed)
    arriving = list(BUSY) + rng.choices(BUSY, k=copies)
    late = rng.randrange(len(arriving))
    arriving = arriving[:late] + arriving[late + held_back :] + arriving[late : late + held_back]
    engine = TaskEngine(track())
    for index, record in enumerate(arriving):
        engine.feed(record)
        if index % 37 == 0:
            engine.news()  # read in between
    assert engine.events == EXPECTED.events
    assert engine.result == EXPECTED.result


@examples(10, thorough=250)
@given(st.randoms(use_true_random=False))
def test_records_in_any_order_at_all_give_the_same_events_and_outcome(rng):
    shuffled = list(BUSY)
    rng.shuffle(shuffled)
    engine = run(shuffled)
    assert (engine.events, engine.result) == (EXPECTED.events, EXPECTED.result)


@examples(20, thorough=600)
@given(data=st.data())
def test_lost_states_never_bring_a_checkpoint_forward_nor_undo_the_order(data):
    kept = data.draw(st.lists(st.booleans(), min_size=len(BUSY), max_size=len(BUSY)))
    records = zip(BUSY, kept, strict=True)
    engine = run([record for record, keep in records if keep or not isinstance(record, Seen)])
    found = engine.result.checkpoints
    assert list(found) == sorted(found)
    passed = zip(found, EXPECTED.result.checkpoints, strict=False)
    assert all(late >= early for late, early in passed)
    stamps = [event.at for event in engine.events]
    assert stamps == sorted(stamps)


@examples(20, thorough=600)
@given(data=st.data())
def test_every_drive_ends_at_most_once_and_never_after_its_limit(data):
    coordinates = st.tuples(st.floats(0.2, 7.8), st.floats(0.2, 3.8))
    drive = Drive()
    for _ in range(data.draw(st.integers(0, 25))):
        drive.speed = data.draw(st.floats(0.2, 1.5))
        drive.go(data.draw(coordinates))
        if data.draw(st.booleans()):
            drive.dock()
        if data.draw(st.booleans()):
            answer = data.draw(st.sampled_from(["keep", "again", "skip"]))
            drive.say(PhotoAnswer(drive.at, str(drive.seq), answer))
    engine = run(drive.records, until=START + 1e4)
    assert [event.type for event in engine.events].count("task_ended") == 1
    assert engine.result.ended <= engine.result.started + engine.track.limit
    assert engine.events[-1].type in {"task_ended", "cue"}
    assert engine.result == run(drive.records[::-1], until=START + 1e4).result


def test_news_are_handed_out_once():
    engine, got = TaskEngine(track()), []
    for record in sorted(BUSY, key=order):
        engine.feed(record)
        got += engine.news()
    assert tuple(got) == EXPECTED.events
    assert engine.news() == ()


def test_an_event_that_a_late_record_changed_is_news_again():
    drive = Drive().go(FIRST)
    engine = run([record for record in drive.records if not isinstance(record, FirstFrame)])
    engine.news()
    engine.feed(FirstFrame(START + 0.25, "frame"))
    assert ("checkpoint", 1) in [(event.type, event.number) for event in engine.news()]


def test_of_two_copies_with_different_times_the_earlier_counts_whichever_came_first():
    one, other = FirstFrame(START, "frame"), FirstFrame(START + 30.0, "frame")
    assert run([one, other]).result == run([other, one]).result
    assert run([other, one]).result.started == START


def test_a_state_is_put_on_the_servers_clock():
    state = State(
        stamp=105.5,
        boot="b",
        seq=3,
        pose=Pose(x=1.0, y=2.0, theta=0.5, localized=False),
        velocity=Velocity(linear=0.0, angular=0.0),
        battery=Battery(charge=1.0),
        docked=True,
    )
    facts = {"localized": False, "docked": True, "contact": True}
    assert seen(state, 5.0) == Seen(100.5, "b", 3, 1.0, 2.0, 0.5, **facts)
    assert identity(seen(state, 5.0)) == identity(seen(state, 4.0))


def test_ten_minutes_of_states_in_the_worst_order_are_folded_once():
    records = [FirstFrame(0.0, "f"), *(Seen(n / 4.0, "b", n, 0.5, 2.0, 0.0) for n in range(2400))]
    assert run(records[::-1]).events == run(records).events
