"""Options of an agent reach the simulated robot that it starts."""

from robots.agent.adapters.simulator.child import end, launch
from robots.agent.simulator import wire
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
        onlooker = Onlooker(int(address.rpartition(":")[2]))
        truth = onlooker.truth()
        assert len(truth.people) == 2
        assert (truth.x, truth.y) == (6.1, 5.6)
        assert set(truth.doors) == {
            "waiting-door",
            "therapy-door",
            "consulting-door",
            "treatment-door",
            "connecting-door",
        }
        assert eventually(lambda: "closed" in onlooker.truth().doors.values())
        fault = SimulatorOperator(int(address.rpartition(":")[2]))
        assert fault.wish(wire.SetDoors(dict.fromkeys(truth.doors, "open"))) == ""
        assert eventually(lambda: "closed" not in onlooker.truth().doors.values())
        fault.close()
        onlooker.close()
    finally:
        child.kill()
        end(child)
