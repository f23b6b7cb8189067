"""An agent's options reach the simulator that it starts."""

from robots.agent.adapters.simulator.child import end, launch
from robots.simulator import wire
from tests.support.agents.simulators import eventually
from tests.support.agents.truth import Onlooker, SimulatorOperator


def test_agents_options_reach_the_simulator() -> None:
    options = {
        "plan": "clinic",
        "people": "2",
        "door-changes": "2",
        "start": "therapy-room",
        "camera": "no",
        "linger": "20",
    }
    child, address = launch("giraff", options)
    try:
        port = int(address.rpartition(":")[2])
        onlooker, operator = Onlooker(port), SimulatorOperator(port)
        truth = onlooker.truth()
        assert len(truth.people) == 2
        assert (truth.x, truth.y) == (6.1, 5.6)
        rooms = ("waiting", "therapy", "consulting", "treatment", "connecting")
        assert set(truth.doors) == {f"{room}-door" for room in rooms}
        assert eventually(lambda: "closed" in onlooker.truth().doors.values())
        assert operator.wish(wire.SetDoors(dict.fromkeys(truth.doors, "open"))) == ""
        assert eventually(lambda: "closed" not in onlooker.truth().doors.values())
        operator.close()
        onlooker.close()
    finally:
        child.kill()
        end(child)
