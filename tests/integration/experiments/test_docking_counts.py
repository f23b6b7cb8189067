"""Docking ends a task when the robot rests on its contacts and the controls are released: from
records, and by driving in simulation.
"""

from dataclasses import replace

from hypothesis import given, settings, strategies as st

from experiments.bots.driver import Driver, Guide, SpeedSetting
from experiments.bots.view import View
from experiments.definition.course import CourseTrack, lay_out
from experiments.definition.shipped import shipped
from experiments.tasks.engine import TaskEngine
from experiments.tasks.records import FirstFrame, Seen, seen
from robots.api.docked import DOCKED, DockReading, DockState, follow
from robots.api.geometry import Pose2D
from robots.api.messages import AppliedCommand, Battery, Pose, State, Velocity
from robots.simulator.physics.drive import STILL
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_plan
from sessions.protocol import Task
from tests.support.studies.task_drives import BACK, HOME, THERE, Drive, cues, milestones, run, track

T = DOCKED.seconds


def almost_home() -> Drive:
    return Drive().go(*THERE, *BACK)


def test_contacts_that_meet_for_half_a_second_end_nothing_and_are_an_attempt():
    drive = almost_home().touch(0.5)
    drive.go((0.9, 2.0))
    engine = run(drive.records)
    assert engine.result.outcome is None
    assert milestones(engine)[-2:] == [("dock_contact", 1), ("dock_contact_lost", 1)]
    assert cues(engine)[-2:] == ["dock_hold", "dock_again"]
    assert engine.progress.cue.target == (track().dock.x, track().dock.y)
    engine = run(drive.go(HOME).dock().records)
    assert engine.result.outcome == "completed"
    assert engine.result.dock_contacts == 2
    assert cues(engine)[-3:] == ["dock_again", "dock_hold", "completed"]


def test_drivers_are_asked_to_release_the_controls_until_they_do():
    engine = run(almost_home().touch(20.0, released=False).records)
    assert (engine.result.outcome, engine.progress.cue.key) == (None, "dock_hold")
    engine = run(almost_home().touch(20.0, released=False).dock().records)
    assert engine.result.outcome == "completed"


def test_a_robot_that_still_rolls_on_its_contacts_is_not_docked():
    assert run(almost_home().touch(20.0, linear=0.1).records).result.outcome is None


def test_a_task_ends_only_when_the_robot_reports_docked():
    drive = almost_home()
    drive.x, drive.y = HOME
    for _ in range(40):
        drive.see(contact=True, docked=False)
    assert run(drive.records).result.outcome is None


def test_a_study_may_ask_for_longer():
    longer = replace(track(), docked=replace(DOCKED, seconds=6.0))
    assert run(almost_home().touch(6.0).records, longer).result.outcome is None
    assert run(almost_home().touch(6.5).records, longer).result.outcome == "completed"


def test_an_older_drive_is_replayed_with_the_rule_of_its_day():
    """Its course was kept without one, and its states have no contact: one state in the station
    ended it.
    """
    drive = almost_home()
    drive.x, drive.y = HOME
    engine = run(drive.see(docked=True).records, replace(track(), docked=None))
    assert [event for event in milestones(engine) if event[0].startswith("dock")] == [("docked", 0)]
    assert cues(engine)[-2:] == ["dock_now", "completed"]


def test_at_the_start_the_robots_own_word_is_enough():
    drive = Drive()
    drive.see(docked=True).see(docked=True)
    assert cues(run(drive.records)) == ["leave_station"]


def rested_until(records: list[Seen], end: float) -> float:
    """For how long, up to a time, every state had contact, standstill and released controls, none
    far from the next.
    """
    since, last = None, None
    for one in sorted(
        (record for record in records if isinstance(record, Seen) and record.at <= end),
        key=lambda one: one.at,
    ):
        rests = (
            one.contact
            and abs(one.linear) <= DOCKED.linear
            and abs(one.angular) <= DOCKED.angular
            and one.released
        )
        broken = since is None or last is None or one.at - last > DOCKED.gap
        since, last = (one.at if broken else since) if rests else None, one.at
    return 0.0 if since is None else end - since


STATE = st.tuples(
    st.sampled_from([0.05, 0.25, 0.25, 0.9, 1.4]),
    st.booleans(),
    st.booleans(),
    st.sampled_from([0.0, 0.0, 0.02, 0.3]),
    st.booleans(),
)


@settings(max_examples=150, deadline=None)
@given(states=st.lists(STATE, max_size=60), seed=st.randoms(use_true_random=False))
def test_no_task_completes_without_resting_on_the_contacts_for_the_required_time(states, seed):
    drive = almost_home()
    drive.x, drive.y = HOME
    for step, contact, docked, linear, released in states:
        drive.see(contact=contact, docked=docked, linear=linear, released=released)
        drive.at += step - 0.25
    drive.dock()
    records = list(drive.records)
    seed.shuffle(records)
    engine = run(records)
    assert engine.result.outcome == "completed"
    assert rested_until(records, engine.result.ended) >= T - 1e-6
    shown = [event for event in engine.events if event.type == "dock_contact"]
    assert len(shown) == engine.result.dock_contacts >= 1


# --- by hand, in simulation -----------------------------------------------------------------------


class Hands:
    """A driver at the end of the paper's course with a simulated Giraff: 50 steps and 4 states for
    each second of simulated time.
    """

    def __init__(self, start: Pose2D) -> None:
        plan, _ = load_plan("office")
        study = shipped()["exploration"]
        self.track: CourseTrack = replace(
            lay_out(study, study.condition("giraff_open"), plan), stops=(), photo=None
        )
        pose = self.track.dock.compose(start)
        self.sim = Simulation(GIRAFF, plan, seed=3, start=f"{pose.x},{pose.y},{pose.theta}")
        self.engine, self.dock, self.seq = TaskEngine(self.track), DockState(), 0
        self.applied: list[AppliedCommand] = []
        self.engine.feed(FirstFrame(0.0, "first"))

    def steer(self, seconds: float, linear: float = 0.0, angular: float = 0.0) -> None:
        for _ in range(round(seconds / 0.02)):
            self.sim.command(linear, angular)
            self.sim.step(0.02)
            motion, released = self.sim.motion, self.sim.commanded == STILL
            reading = DockReading(
                at=self.sim.time,
                contact=self.sim.docked,
                linear=motion.linear,
                angular=motion.angular,
                released=released,
            )
            self.dock = follow(DOCKED, self.dock, reading)
            if linear or angular:
                command = {
                    "seq": 1,
                    "stamp": self.sim.time,
                    "method": "keyboard",
                    "way": "datachannel",
                    "age": 0.0,
                }
                self.applied = [AppliedCommand(**command, linear=linear, angular=angular)]
            self.seq += 1
            if self.seq % 12 == 0:
                self._say_state()

    def go_home(self, within: float = 120.0) -> None:
        """Do as the cues say, a tenth of a second at a time."""
        driver = Driver(self.sim.plan, Guide(self.track.dock, {}), SpeedSetting(0.5, 0.5))
        until = self.sim.time + within
        while self.engine.progress.outcome is None and self.sim.time < until:
            view = View(pose=self.sim.pose, localized=True)
            view.task = Task(session="s", stamp=0.0, cue=self.engine.progress.cue.key, number=0)
            speed = driver.decide(view, self.sim.time).speed
            self.steer(0.1, speed.linear, speed.angular)

    def _say_state(self) -> None:
        (x, y, theta), motion = self.sim.pose, self.sim.motion
        state = State(
            stamp=self.sim.time,
            boot="b",
            seq=self.seq,
            pose=Pose(x=x, y=y, theta=theta),
            battery=Battery(charge=0.9),
            docked=self.dock.docked,
            charger_contact=self.sim.docked,
            velocity=Velocity(linear=motion.linear, angular=motion.angular),
            applied=tuple(self.applied),
        )
        self.applied = []
        self.engine.feed(seen(state, 0.0))

    def contacts(self) -> int:
        """How many states said that the contacts meet."""
        return sum(
            1 for record in self.engine._records if isinstance(record, Seen) and record.contact
        )


def test_a_robot_that_docks_askew_is_not_done_until_it_rests_in_the_station():
    hands = Hands(Pose2D(-0.5, -0.09, 0.26))  # 15 degrees askew
    hands.steer(8.0, 0.2, -0.15)
    assert 1 <= hands.contacts() <= 7, (
        "the contacts met for less than two seconds, as the visitor slid past"
    )
    assert not hands.sim.docked
    assert hands.engine.result.outcome is None
    assert hands.engine.progress.cue.key == "dock_again"

    hands.go_home()
    result = hands.engine.result
    assert (result.outcome, result.dock_contacts) == ("completed", 2)
    assert hands.sim.docked
    hands.steer(5.0)
    assert hands.sim.docked, "and it stays there"


def test_a_participant_who_drives_straight_in_is_done_two_seconds_after_letting_go():
    hands = Hands(Pose2D(-0.5, 0.02, 0.05))
    while not hands.sim.docked:
        hands.steer(0.02, 0.2)
    hands.steer(3.0, 0.2)
    assert hands.engine.result.outcome is None, "who pushes has not let go"
    hands.steer(1.5)
    assert hands.engine.result.outcome is None
    hands.steer(1.5)
    assert (hands.engine.result.outcome, hands.engine.result.dock_contacts) == ("completed", 1)
    assert hands.dock.docked
    assert hands.sim.docked


def test_contacts_on_springs_do_not_chatter_at_the_edge_of_their_reach():
    edge = GIRAFF.dock.heading
    hands = Hands(Pose2D(-0.06, 0.0, edge - 0.01))
    assert hands.sim.docked
    hands.sim.pose = Pose2D(hands.sim.pose.x, hands.sim.pose.y, hands.sim.pose.theta + 0.03)
    hands.sim.step(0.02)
    assert hands.sim.docked
    hands.sim.pose = Pose2D(hands.sim.pose.x, hands.sim.pose.y, hands.sim.pose.theta + 0.05)
    hands.sim.step(0.02)
    assert not hands.sim.docked
    hands.sim.pose = Pose2D(hands.sim.pose.x, hands.sim.pose.y, hands.sim.pose.theta - 0.05)
    hands.sim.step(0.02)
    assert not hands.sim.docked, "to meet again they have to come nearer than to part"
