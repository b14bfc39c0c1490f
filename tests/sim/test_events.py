"""Pins the events between physics steps: their list, order and rates."""

import ast
import inspect

import numpy as np
import pytest
from reference.events import NEVER, every, next_arrival
from reference.plant import EVENTS, Plant
from reference.plant_memory import PlantMemory

from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.state import Command

HIGH = np.array([0.0, 0.0, 3.0])
STILL = AeroConfig(wake=False)


def test_an_event_is_due_at_the_next_multiple_of_its_steps_and_never_at_once():
    due = every(5)
    assert [due(PlantMemory(clock=clock)) for clock in (0, 1, 4, 5, 9)] == [5, 5, 5, 10, 10]


def test_a_delivery_is_due_when_the_first_pending_command_arrives():
    part, values = slice(0, 8), np.zeros(8)
    assert next_arrival(PlantMemory()) == NEVER
    assert next_arrival(PlantMemory(pending=[(7, part, values), (3, part, values)])) == 3


@pytest.mark.parametrize(
    ("config", "disturbances", "needed"),
    [
        (PlantConfig(aero=STILL), {}, ["delivery"]),
        (PlantConfig(), {}, ["delivery", "air"]),
        (PlantConfig(aero=STILL), {"wind": 3.0}, ["delivery", "air"]),
        (PlantConfig(aero=STILL, actuators=ActuatorConfig(thrust_noise=0.1)), {}, ["delivery", "air"]),
        (PlantConfig(aero=STILL, actuators=ActuatorConfig(backlash=0.01)), {}, ["delivery", "asymmetry"]),
        (PlantConfig(aero=STILL, actuators=ActuatorConfig(spin_down=0.5)), {}, ["delivery", "asymmetry"]),
        (
            PlantConfig(aero=STILL, actuators=ActuatorConfig(vectoring_backlash=0.01)),
            {},
            ["delivery", "play"],
        ),
        (PlantConfig(sense=True), {}, ["delivery", "air", "sensors"]),
    ],
)
def test_events_happen_in_order_at_their_rates_where_the_robot_needs_them(monkeypatch, config, disturbances, needed):
    plant, happened = Plant(config), []
    plant.reset(HIGH, disturbances=Disturbances(**disturbances), rng=np.random.default_rng(0))
    assert [event.name for event in plant._events] == needed
    for event in plant._events:
        assert event in EVENTS
    real = plant._events
    plant._events = tuple(
        type(e)(e.name, e.due, lambda p, e=e: (happened.append((p.memory.clock, e.name)), e.run(p)), e.needed)
        for e in real
    )
    plant.step(Command(np.zeros(8), np.zeros((8, 2)), np.zeros(16), np.full(16, 7.0)))
    steps = {"air": 10, "asymmetry": 5, "play": 1, "sensors": 2}
    order = [event.name for event in EVENTS]
    wanted = [(clock, n) for clock in range(1, 11) for n in order if n in steps and clock % steps[n] == 0]
    assert happened == [entry for entry in wanted if entry[1] in needed]
    assert plant.memory.clock * TIMESTEP == pytest.approx(plant.period)


def test_a_plant_has_all_its_attributes_from_the_beginning():
    (kind,) = ast.parse(inspect.getsource(Plant)).body
    assigned = {}
    for method in kind.body:
        if isinstance(method, ast.FunctionDef):
            assigned[method.name] = {
                node.attr
                for node in ast.walk(method)
                if isinstance(node, ast.Attribute)
                and isinstance(node.ctx, ast.Store)
                and ast.unparse(node.value) == "self"
            }
    born = assigned.pop("__init__")
    assert {"memory", "config", "diverged", "_events"} <= born
    assert set().union(*assigned.values()) <= born
