"""Plants for the tests of the simulated robot, and commands for them."""

from dataclasses import asdict

import numpy as np

from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, ROBOT
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.recirculation import RecirculationConfig
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.state import Command

HIGH = np.array([0.0, 0.0, 5.0])
VACUUM = AeroConfig(wake=False)
ASKEW = matrix_to_quat(exp(np.array([0.2, -0.1, 0.3])))
NOISE = ActuatorConfig(thrust_noise=0.3)
EDDY = RecirculationConfig(
    flow_xy=0.02, flow_z=0.05, turn_xy=0.04, turn_z=0.01, mean_flow=np.array([0.01, -0.01, 0.02]),
    mean_turn=np.array([0.0, 0.02, 0.01]), near=1.5,
)  # fmt: skip
"""Recirculation of all kinds."""
STORM = Disturbances(wind=4.0, push=30.0)
EVERYTHING = ActuatorConfig(
    thrust_noise=0.3, delay=0.0275, vectoring_delay=0.01, backlash=0.01, spin_down=0.6, battery=True,
    joint_friction=0.2, thrust_tilt=np.full((8, 2), 0.02), joint_offset=np.full(16, 0.01),
    vectoring_offset=np.full((8, 2), -0.01), servo_speed=np.linspace(0.85, 1.15, 16), jitter=0.02, loss=0.1,
    vectoring_backlash=0.01, vectoring_friction=0.05, battery_spent=0.7, board_scaling=True,
)  # fmt: skip
ODDITIES: dict[str, tuple[PlantConfig, Disturbances]] = {
    "vacuum": (PlantConfig(aero=VACUUM), Disturbances()),
    "wake": (PlantConfig(), Disturbances()),
    "noise": (PlantConfig(actuators=NOISE), Disturbances()),
    "delay": (PlantConfig(actuators=ActuatorConfig(delay=0.0325)), Disturbances()),
    "vectoring delay": (PlantConfig(actuators=ActuatorConfig(vectoring_delay=0.015)), Disturbances()),
    "backlash": (PlantConfig(actuators=ActuatorConfig(backlash=0.02)), Disturbances()),
    "spin-down": (PlantConfig(actuators=ActuatorConfig(spin_down=0.5), aero=VACUUM), Disturbances()),
    "battery": (PlantConfig(actuators=ActuatorConfig(battery=True)), Disturbances()),
    "recirculation": (PlantConfig(recirculation=EDDY), Disturbances()),
    "recirculation in a vacuum": (PlantConfig(aero=VACUUM, recirculation=EDDY), Disturbances()),
    "stacked rotors": (PlantConfig(aero=AeroConfig(stacking_loss=0.1)), Disturbances()),
    "spent battery": (PlantConfig(actuators=ActuatorConfig(battery=True, battery_spent=0.9)), Disturbances()),
    "board": (PlantConfig(actuators=ActuatorConfig(max_thrust=18.0, board_scaling=True)), Disturbances()),
    "servo speed": (PlantConfig(actuators=ActuatorConfig(servo_speed=np.linspace(0.5, 2.0, 16))), Disturbances()),
    "jitter": (PlantConfig(actuators=ActuatorConfig(delay=0.01, vectoring_delay=0.005, jitter=0.06)), Disturbances()),
    "loss": (PlantConfig(actuators=ActuatorConfig(loss=0.4)), Disturbances()),
    "vectoring backlash": (PlantConfig(actuators=ActuatorConfig(vectoring_backlash=0.02)), Disturbances()),
    "vectoring friction": (PlantConfig(actuators=ActuatorConfig(vectoring_friction=0.1)), Disturbances()),
    "wind": (PlantConfig(), Disturbances(wind=4.0)),
    "wind in a vacuum": (PlantConfig(aero=VACUUM), Disturbances(wind=4.0)),
    "pushes": (PlantConfig(), Disturbances(push=30.0)),
    "lost thrust": (PlantConfig(), Disturbances(lost_rotor=3, fault_time=0.1)),
    "lost vectoring": (PlantConfig(), Disturbances(lost_rotor=3, fault="vectoring", fault_time=0.05)),
    "sensors": (PlantConfig(sense=True), Disturbances()),
    "everything": (
        PlantConfig(substeps=7, sense=True, idle_thrust=1.2, actuators=EVERYTHING, recirculation=EDDY),
        STORM,
    ),
}
"""Everything on which a simulated state can depend, one effect at a time and all together."""


def command(thrust=0.0, joints=0.0, vectoring=0.0, limit=7.0) -> Command:
    """A command; numbers stand for equal entries."""
    shapes = ((8,), (8, 2), (16,), (16,))
    values = (thrust, vectoring, joints, limit)
    return Command(*(np.broadcast_to(v, s).astype(float) for v, s in zip(values, shapes, strict=True)))


def floating(
    *, kind=Plant, substeps=10, joint_speed=ROBOT.joint_speed, thrust=None, q=None, vectoring=None, **actuators
):
    """A plant, or one of another kind, at rest without gravity and air."""
    config = ActuatorConfig(**actuators)
    plant = kind(PlantConfig(substeps=substeps, joint_speed=joint_speed, aero=VACUUM, actuators=config))
    plant.model.opt.gravity[:] = 0.0
    rng = np.random.default_rng(0)
    plant.reset(HIGH, joint_position=q, vectoring=vectoring, thrust=thrust, rng=rng)
    return plant


def weightless(**config) -> Plant:
    """A plant at rest without gravity and air."""
    plant = Plant(PlantConfig(aero=VACUUM, **config))
    plant.model.opt.gravity[:] = 0.0
    plant.reset(HIGH)
    return plant


def tumbled(plant: Plant, ticks: int, seed: int = 0) -> list[np.ndarray]:
    """Drive the robot with random thrusts, joints and vectoring angles; the full state after every tick."""
    rng, states = np.random.default_rng(seed), []
    for _ in range(ticks):
        plant.step(command(rng.uniform(0, 15, 8), rng.uniform(-1, 1, 16), rng.uniform(-1, 1, (8, 2))))
        states.append(np.concatenate([plant.data.qpos, plant.data.qvel, plant.data.act]))
    return states


def dropped(**config) -> Plant:
    """A plant above the floor, askew, falling."""
    plant = Plant(PlantConfig(**({"aero": VACUUM} | config)))
    plant.reset(np.array([0.0, 0.0, 0.4]), ASKEW, FORMS["form1"])
    return plant


def witnessed(plant: Plant, ticks: int, seed: int = 0) -> list[np.ndarray]:
    """Drive the robot as `tumbled` does; all observable quantities after every tick."""
    seen = []
    for k in range(ticks):
        motion = tumbled(plant, 1, 100 * seed + k)[0]
        numbers = [plant.power, plant.energy_wh, plant.mean_power, plant.in_contact, plant.state().time]
        parts = [motion, plant.state().joint_torque, numbers, plant.thrust_factor, plant.air_force]
        if plant.record["senses"]:
            parts += [np.ravel(value) for value in asdict(plant.measure()).values()]
        seen.append(np.concatenate(parts))
    return seen
