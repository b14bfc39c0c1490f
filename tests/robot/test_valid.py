"""Pins valid robots: allowed changes and resulting masses, rejected changes, robots from files and mappings."""

import copy
import pickle
from dataclasses import replace

import pytest
from support.robots import LONG, OTHER, ROBOTS

from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.payload import Payload
from spidar_gym.robot.spec import PARTS

DENSITY = 16.0 / 15.2108
"""Ratio of the described mass to the sum of the parts' masses, which is rounded."""


def test_longer_links_are_heavier_by_their_length():
    more = 4 * 0.2 * PARTS["outer_link"].mass * DENSITY
    assert LONG.total_mass == pytest.approx(16.0 + more, rel=1e-5)
    assert LONG.bodies["inner_link"] == ROBOT.bodies["inner_link"]
    assert LONG.diameter == pytest.approx(ROBOT.diameter + 0.4 * ROBOT.pitch_to_foot)


def test_a_part_has_the_specified_mass():
    heavy = RobotSpec.parse({"part_masses": {"battery": 0.6}})
    assert heavy.total_mass == pytest.approx(16.0 + 8 * (0.6 - PARTS["battery"].mass * DENSITY), rel=1e-5)
    assert heavy.part_masses == (("battery", 0.6),)
    assert OTHER.part_masses == heavy.part_masses


def test_another_described_mass_scales_all_parts():
    light = RobotSpec(described_mass=15.0)
    assert light.total_mass == 15.0
    assert light.bodies["torso"].mass == pytest.approx(15.0 / 16.0 * ROBOT.bodies["torso"].mass)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_is_a_value(name):
    robot = ROBOTS[name]
    assert robot == replace(robot) == copy.deepcopy(robot) == pickle.loads(pickle.dumps(robot))
    assert hash(robot) == hash(replace(robot))
    assert robot != ROBOT
    with pytest.raises(AttributeError):
        robot.max_thrust = 50.0


def test_a_robot_comes_from_a_mapping_or_a_file(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(
        """pitch_to_foot = 0.6138
duct_z = [-0.03, 0.04]
max_thrust = 45
[part_masses]
battery = 0.5
[[payloads]]
body = "link2"
mass = 0.1
position = [0.3, 0.0, 0.05]
""",
        encoding="utf-8",
    )
    own = RobotSpec.parse(path)
    assert own == RobotSpec.parse(str(path)) == RobotSpec.parse(own)
    assert own == RobotSpec(
        pitch_to_foot=0.6138, duct_z=(-0.03, 0.04), max_thrust=45.0, part_masses={"battery": 0.5},
        payloads=(Payload("link2", 0.1, (0.3, 0.0, 0.05)),),
    )  # fmt: skip
    assert RobotSpec.parse(None) is ROBOT
    assert RobotSpec.parse({}) == ROBOT


@pytest.mark.parametrize(
    ("numbers", "kind", "words"),
    [
        ({"legs": 6}, InvalidValueError, "legs = 6 is not valid; expected no such entry: every robot has 4 legs"),
        ({"n_links": 6}, InvalidValueError, "links = 6 .* every robot has 8 links"),
        ({"pitch_to_fot": 0.6}, UnknownNameError, "valid: described_mass, .*; did you mean pitch_to_foot"),
        ({"max_thrust": 20.0}, InvalidValueError, "at least 24.52 N: a robot of 16 kg weighs 157 N"),
        ({"pitch_to_foot": 0.3, "roll_axis_x": 0.2, "outer_battery": [0.5, 0.0, 0.0]}, InvalidValueError,
         "outer_battery = .* within 0 … 0.3 m"),
        ({"pitch_to_foot": 0.08, "roll_axis_x": 0.05, "outer_battery": [0.05, 0.0, 0.0]}, InvalidValueError,
         "pitch_to_foot = 0.08 .* above 0.0928 m, or the feet do not reach the floor"),
        ({"roll_axis_x": 0.6}, InvalidValueError, "below 0.5115 m, the shorter one's length"),
        ({"duct_offset_y": 0.05}, InvalidValueError, "at least 0.0825 m, or the two ducts of a module overlap"),
        ({"propeller_radius": 0.1}, InvalidValueError, "at most the duct's 0.0825 m"),
        ({"joint_limit": 1.7}, InvalidValueError, "joint_limit = 1.7 .* at most π/2"),
        ({"joint_stop": 1.0}, InvalidValueError, "joint_stop = 1.0 .* within joint_limit … π"),
        ({"peg_length": 0.002}, InvalidValueError, "peg_length = 0.002 .* so that pegs reach below the torso"),
        ({"foot_radius": -0.01}, InvalidValueError, "foot_radius = -0.01 .* a number above 0"),
        ({"torso_radius": float("nan")}, InvalidValueError, "torso_radius = nan .* a finite number"),
        ({"idle_thrust": 30.0}, InvalidValueError, "idle_thrust = 30.0 .* below the 19.62 N"),
        ({"duct_z": [0.1, 0.0]}, InvalidValueError, "duct_z = .* the lower end before the upper one"),
        ({"duct_z": [0.1]}, InvalidValueError, "duct_z = .* 2 finite numbers"),
        ({"max_thrust": "strong"}, InvalidValueError, "max_thrust = 'strong' .* a finite number"),
        ({"part_masses": {"motor": 1.0}}, UnknownNameError, "unknown part 'motor'; valid: torso, flight_controller"),
        ({"part_masses": {"foot": -1.0}}, InvalidValueError, r"part_masses: foot = -1.0 .* a number above 0 \[kg\]"),
        ({"part_masses": 3}, InvalidValueError, r"part_masses = 3 .* masses \[kg\] by part"),
        ({"payloads": [{"mass": 1.0}]}, InvalidValueError, "payload = .* body among body, mass, position"),
        ({"payloads": [{"body": "torso", "mass": 1.0, "colour": 1}]}, UnknownNameError, "unknown number of a payload"),
        ({"payloads": 1}, InvalidValueError, "payloads = 1 .* a list of tables"),
        ("nowhere.toml", SpidarError, "robot: nowhere.toml cannot be read: .*; valid: a TOML file"),
        (3, InvalidValueError, "robot = 3 .* a dictionary"),
    ],
)  # fmt: skip
def test_what_is_no_robot_is_refused_in_one_line(numbers, kind, words):
    with pytest.raises(kind, match=words) as refusal:
        RobotSpec.parse(numbers)
    assert "\n" not in str(refusal.value)
