"""Pins the health of the simulated robot (motors, servos, battery), and first flights."""

from dataclasses import replace

import numpy as np
import pytest
from support.needs import needs_compiler

from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.margins import LATE, law_of, with_damping, with_lateness
from spidar_gym.native.formulas import max_thrust
from spidar_gym.native.linear import Loop, behind_encoders, linear_law, linear_robot, settle
from spidar_gym.onboard.health import HEALTH_TOPICS, MOTOR_FULL, N_SERVOS, SERVO_STALL
from spidar_gym.robot import FORMS, N_JOINTS, N_ROTORS, ROBOT
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sitl.first_flights import Robots, play_first_flights
from spidar_gym.sitl.health import (
    AMBIENT,
    DUTY_MOST,
    OVERHEAT_BIT,
    STALL_RISE,
    STALL_TORQUE,
    WARM_UP,
    Health,
    motor_duty,
)
from spidar_gym.sitl.robot import Robot

pytestmark = needs_compiler
VOLTAGE, SERVOS, MOTORS = (name for name, _ in HEALTH_TOPICS.values())


def test_the_duty_grows_with_thrust_and_sag_and_is_full_at_the_largest_thrust():
    hover = motor_duty(np.full(N_ROTORS, ROBOT.hover_thrust), 24.0)
    assert 0.73 < hover[0] < 0.82, "73 to 80 % [JSK]"
    for volts in (25.2, 24.2, 23.2, 22.2):
        most = float(motor_duty(np.full(N_ROTORS, max_thrust(volts)), volts)[0])
        assert most == pytest.approx(DUTY_MOST, abs=0.01)
    duties = np.array([motor_duty(np.full(N_ROTORS, thrust), 22.2)[0] for thrust in np.linspace(0.0, 60.0, 200)])
    assert (np.diff(duties) >= 0.0).all()
    assert motor_duty(np.full(N_ROTORS, 20.0), 24.0, armed=False)[0] == 0.5


def test_a_loaded_servo_warms_up_by_its_time_constant_and_reports_load_and_overheating():
    health, torque = Health(), np.zeros(N_JOINTS)
    torque[5] = -0.5 * STALL_TORQUE  # the second joint of link 3: servo 9
    for _ in range(round(WARM_UP / 0.02)):
        health.step(torque, np.zeros((N_ROTORS, 2)), 0.02)
    warm = AMBIENT + 0.25 * STALL_RISE * (1.0 - np.exp(-1.0))
    assert health.temperature[9] == pytest.approx(warm, rel=1e-3)
    assert np.delete(health.temperature, 9) == pytest.approx(AMBIENT)
    said = health.servos(1.0, np.zeros(N_JOINTS), np.zeros((N_ROTORS, 2))).values
    assert said["load"][9] == -SERVO_STALL // 2
    assert not said["error"].any()
    health.temperature[31] = 61.0
    assert health.servos(1.0, torque, np.zeros((N_ROTORS, 2))).values["error"].tolist() == [0] * 31 + [OVERHEAT_BIT]


def test_encoder_counts_are_those_of_the_wire():
    joints, vectoring = np.zeros(N_JOINTS), np.zeros((N_ROTORS, 2))
    joints[0], joints[3], vectoring[1, 0], vectoring[7, 1] = 1.0, 1.0, -1.0, 1.0
    counts = Health().servos(0.0, joints, vectoring).values["angle"]
    assert counts[0] == round(2047 - 1.0 / 7.6699e-4)
    assert counts[5] == round(2047 - 1.0 / 1.534e-3)
    assert counts[6] == round(2047 + 1.0 / 9.20388e-4)
    assert counts[31] == round(2047 - 1.0 / 1.15048e-3)
    assert len(counts) == N_SERVOS


def test_a_battery_that_is_spent_at_the_start_says_so():
    volts = []
    for spent in (0.0, 1.0):
        config = PlantConfig()
        robot = Robot(replace(config, actuators=replace(config.actuators, battery_spent=spent)))
        said = [message for _ in range(40) for message in robot.step()]
        volts.append(next(float(m.values["data"]) for m in said if m.topic == VOLTAGE))
        outputs = next(m.values["motor_value"] for m in said if m.topic == MOTORS)
        assert (outputs == MOTOR_FULL // 2).all(), "disarmed"
    assert volts[0] == pytest.approx(25.2, abs=0.1)
    assert volts[1] == pytest.approx(22.2, abs=0.1)


def test_a_first_flight_with_badly_damped_joints_stays_up():
    (row,) = play_first_flights("socket", ["first_flight"], 1, Robots(damping=0.8))
    assert row["stayed_up"]
    assert row["rms_m"] < 0.06
    assert row["tilt_rad"] < 0.1


def test_joints_with_which_retuned_falls_do_not_throw_the_first_flight_over():
    grows = {}
    for name in ("first_flight", "retuned"):
        hover = settle(law_of(name), FORMS["form2"], PlantConfig())
        law = behind_encoders(linear_law(hover), EstimatorConfig().joint_bandwidth, 1.0 / CONTROL_RATE)
        for damping in (0.4, 0.7):
            loop = Loop(linear_robot(hover, with_damping(with_lateness(PlantConfig(), LATE), damping)), law)
            grows[name, damping] = loop.growing() > 0.0
    assert grows == {
        ("first_flight", 0.4): False, ("first_flight", 0.7): False, ("retuned", 0.4): True, ("retuned", 0.7): True,
    }  # fmt: skip
