"""Held-out conditions, which are never used for training or tuning.

A controller that was tuned or learned on the tracks may perform well on the tracks only. In each held-out condition one
property of the robot deviates in a way that no track has: farther than in any randomised robot, or, on robots of the
calibrated world, beyond the world's range; robots of that world are also on courses. The flights use fixed joint speeds
that no track has. The results are reported (`spidar leaderboard held-out`); tuning and training code never imports this
module.
"""

import hashlib
import json
import math
import zlib
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from typing import Any

import numpy as np

from spidar_gym.arrays import constant
from spidar_gym.benchmark.scenario import Scenario, draw_scenario_from
from spidar_gym.benchmark.track import TRACKS, WORLD, Track
from spidar_gym.envs.registry import COURSE, CRAWL, HOVER
from spidar_gym.errors import require_least, require_name
from spidar_gym.robot import JOINT_NAMES, N_JOINTS, N_LINKS, N_ROTORS, ROBOT
from spidar_gym.robot.spec import Inertial, merge
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig

HELD_OUT = "baselines/held_out.json"
"""Path of the committed results in a checkout."""
COUNT = 20
"""Default number of scenarios per condition."""
DRAWS = 3
"""Number of the split in the seed of the scenarios; no split has it, and the search's scenarios use 2."""

PAYLOAD, PLACE = 0.5, (0.08, 0.06, 0.0)
"""Payload: mass [kg] fixed to the torso, and its position in torso axes [m], 0.1 m off the torso's middle."""
SOFT, STIFFNESS = "joint1_pitch", 0.5
"""Softened servo, and the factor on its stiffness."""
DELAY = 0.045
"""Delay from a command to the actuators [s]."""
WEAK, LOSS = 1, 0.15
"""Weakened module, 1 … 8, and the share of thrust that its left duct lacks."""
WIND = 4.0
"""Mean wind [m/s], turbulent."""


def loaded(mass: float, position: tuple[float, float, float]) -> BodyConfig:
    """Return the configuration of the described robot with a point mass on its torso.

    Masses and centres of mass are exact. The torso's inertia about its centre is scaled with the torso's mass and
    ignores the point's position: for 0.5 kg an error of 3e-3 kg m², about a thousandth of the robot's inertia.

    Args:
        mass: Mass of the payload [kg].
        position: Position of the payload, torso axes [m].
    """
    torso = ROBOT.bodies["torso"]
    both = merge(torso, Inertial(mass, position, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    # All masses are scaled to the total mass; `link_mass` cancels this scaling for the links.
    return BodyConfig(
        total_mass=ROBOT.total_mass + mass,
        link_mass=constant(torso.mass / both.mass, N_LINKS),
        torso_com=np.subtract(both.com, torso.com),
    )


def softened(joint: str, factor: float) -> ActuatorConfig:
    """Return the described actuators with the stiffness of one named joint servo scaled."""
    stiffness = np.ones(N_JOINTS)
    stiffness[JOINT_NAMES.index(joint)] = factor
    return ActuatorConfig(servo_stiffness=stiffness)


def weakened(module: int, loss: float) -> ActuatorConfig:
    """Return the described actuators with a module, 1 … 8, whose left duct lacks a share of its thrust.

    The two ducts share the thrust equally. The module therefore lacks half of that share, and the other duct causes a
    torque about x.
    """
    gain, imbalance = np.ones(N_ROTORS), np.zeros(N_ROTORS)
    gain[module - 1] = 1.0 - 0.5 * loss
    imbalance[module - 1] = -0.5 * loss / gain[module - 1]
    return ActuatorConfig(module_gain=gain, duct_imbalance=imbalance)


def _beyond(name: str) -> dict[str, Any]:
    """Return the options of a track with robots of the calibrated world and one effect beyond its range."""
    return {"randomization": {"world": WORLD, **_BEYOND[name]}}


def _calibrated_flight(doc: str, name: str) -> Track:
    """Return a condition of flights, which begin and count as those of the calibrated tracks."""
    track = TRACKS["flight-calibrated"]
    options = {"forms": "independent", "joint_speed": 0.4, **_beyond(name)}
    return Track(doc, HOVER, track.seconds, options, settle=track.settle)


_PAYLOAD = PlantConfig(body=loaded(PAYLOAD, PLACE))
_SERVO = PlantConfig(actuators=softened(SOFT, STIFFNESS))
_DELAY = PlantConfig(actuators=ActuatorConfig(delay=DELAY))
_DUCT = PlantConfig(actuators=weakened(WEAK, LOSS))
_TWICE = {"forms": "independent", "joint_speed": 0.4, "sensors": True}
_FOURFOLD = {"forms": "independent", "joint_speed": 0.8, "sensors": True}
_WIND = {"wind": (WIND, WIND)}
_BEYOND: dict[str, dict[str, Any]] = {
    # Badly damped joints without the dry friction that steadies those of the world.
    "damping": {
        "actuators.joint_kd": (0.35, 0.55), "actuators.joint_damping": (0.0, 0.0),
        "actuators.joint_friction": (0.0, 0.0),
    },
    "delay": {"actuators.delay": (0.08, 0.08), "actuators.thrust_lag": (0.06, 0.06)},
    "eddies": {f"recirculation.{size}": 1.5 for size in ("flow_xy", "flow_z", "turn_xy", "turn_z")},
    "play": {"actuators.vectoring_backlash": (0.015, 0.015)},
    "pegs": {"body.peg_friction": (0.05, 0.1)},
}  # fmt: skip
"""Name → one effect beyond its range in the calibrated world: ranges, or factors on the world's own."""
_WAY = {"distance": (0.2, 0.6), "direction": (-math.pi, math.pi), "turn": (-0.5, 0.5)}

CONDITIONS: dict[str, Track] = {
    "payload-fast2": Track(
        "0.5 kg on the torso, 0.1 m off its middle; legs twice as fast", HOVER, 16.0, {**_TWICE, "plant": _PAYLOAD}
    ),
    "payload-fast4": Track(
        "the same payload; legs four times as fast", HOVER, 12.0, {**_FOURFOLD, "plant": _PAYLOAD}
    ),
    "servo-fast2": Track(
        "the inner pitch servo of leg 1 half as stiff; legs twice as fast", HOVER, 16.0, {**_TWICE, "plant": _SERVO}
    ),
    "servo-fast4": Track("the same servo; legs four times as fast", HOVER, 12.0, {**_FOURFOLD, "plant": _SERVO}),
    "delay-fast2": Track(
        "45 ms from a command to the actuators; legs twice as fast", HOVER, 16.0, {**_TWICE, "plant": _DELAY}
    ),
    "delay-fast4": Track("the same delay; legs four times as fast", HOVER, 12.0, {**_FOURFOLD, "plant": _DELAY}),
    "duct-fast2": Track(
        "the left duct of module 1 with 15 % less thrust; legs twice as fast", HOVER, 16.0, {**_TWICE, "plant": _DUCT}
    ),
    "duct-fast4": Track("the same duct; legs four times as fast", HOVER, 12.0, {**_FOURFOLD, "plant": _DUCT}),
    "wind-fast2": Track(
        "turbulent wind of 4 m/s; legs twice as fast", HOVER, 16.0, _TWICE, disturbances=_WIND
    ),
    "wind-fast4": Track("the same wind; legs four times as fast", HOVER, 12.0, _FOURFOLD, disturbances=_WIND),
    "payload-crawl": Track(
        "the same payload; 0.2 … 0.6 m in any direction", CRAWL, 75.0, {"sensors": True, "plant": _PAYLOAD}, _WAY
    ),
    "servo-crawl": Track(
        "the same servo; 0.2 … 0.6 m in any direction", CRAWL, 75.0, {"sensors": True, "plant": _SERVO}, _WAY
    ),
    "delay-crawl": Track(
        "the same delay; 0.2 … 0.6 m in any direction", CRAWL, 75.0, {"sensors": True, "plant": _DELAY}, _WAY
    ),
    "damping-calibrated": _calibrated_flight(
        "robots of the calibrated world, all with joint damping of 0.35 … 0.55 Nm s/rad and no friction; legs twice as "
        "fast", "damping"
    ),
    "delay-calibrated": _calibrated_flight(
        "robots of the calibrated world, all with 80 ms from a command to the actuators and a thrust lag of 60 ms",
        "delay",
    ),
    "eddies-calibrated": _calibrated_flight(
        "robots of the calibrated world with eddies 1.5 times as large", "eddies"
    ),
    "play-calibrated": _calibrated_flight(
        "robots of the calibrated world, all with 15 mrad of play in the vectoring axes", "play"
    ),
    "damping-calibrated-crawl": Track(
        "the same damping; 0.2 … 0.6 m in any direction", CRAWL, 75.0, _beyond("damping"), _WAY
    ),
    "delay-calibrated-crawl": Track(
        "the same delay and lag; 0.2 … 0.6 m in any direction", CRAWL, 75.0, _beyond("delay"), _WAY
    ),
    "eddies-calibrated-crawl": Track(
        "the same eddies; 0.2 … 0.6 m in any direction", CRAWL, 75.0, _beyond("eddies"), _WAY
    ),
    "pegs-calibrated-crawl": Track(
        "robots of the calibrated world, all with pegs of friction 0.05 … 0.1; 0.2 … 0.6 m in any direction", CRAWL,
        75.0, _beyond("pegs"), _WAY,
    ),
    "course-calibrated": Track(
        "walls, beams, slots, the goal on a plain floor, platform, tiles or slope; robots of the calibrated world",
        COURSE, 300.0, {"randomization": WORLD},
    ),
}  # fmt: skip
"""Conditions by name; all with sensors, flights with independent legs at multiples of the paper's 0.2 rad/s.

A flight's integrals begin at the wrench that the robot needs at rest in the wind, as on the tracks; those of a robot of
the calibrated world begin at zero, and errors count from 10 s, as on the calibrated tracks.
"""


def find_condition(name: str) -> Track:
    """Return a condition by name (`UnknownNameError` lists the valid names)."""
    require_name("condition", name, CONDITIONS)
    return CONDITIONS[name]


@cache
def draw_held_out(name: str, count: int = COUNT) -> tuple[Scenario, ...]:
    """Return the first scenarios of a condition, which are fixed and the same for every policy.

    Raises:
        UnknownNameError: For a condition that does not exist.
        InvalidValueError: For a count below 1.
    """
    condition = find_condition(name)
    require_least(1, scenarios=count)
    rngs = (np.random.Generator(np.random.PCG64([zlib.crc32(name.encode()), DRAWS, k])) for k in range(count))
    return tuple(draw_scenario_from(condition, rng, k) for k, rng in enumerate(rngs))


def scenarios_digest(scenarios: Sequence[Scenario]) -> str:
    """Return the SHA-256 of scenarios."""
    return hashlib.sha256(json.dumps([asdict(one) for one in scenarios], sort_keys=True).encode()).hexdigest()
