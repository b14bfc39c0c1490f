"""Pins given starts of a flight: used unchanged, kept until withdrawn, or refused."""

import json
import math

import gymnasium
import jaxtyping
import numpy as np
import pytest

from spidar_gym.control.allocation.allocator import AllocationStatus, Allocator
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import FORMS
from spidar_gym.so3 import exp, matrix_to_quat
from spidar_gym.tasks.start import FlightStart, FormGoal

HOVER = "spidar_gym/Hover-v0"
Q = [FORMS[name].tolist() for name in ("form1", "form2", "form3")]
START = {
    "goals": [[0.0, 0.0, Q[1]], [0.5, 0.75, Q[0]], [2.0, 9.0, Q[2]]],
    "position": [0.02, -0.01, 0.03], "rotation": [0.03, -0.02, 0.01], "trim": None,
}  # fmt: skip
PULL = np.array([0.0, 0.0, 8.0, 0.0, 0.0, 0.0])
"""Wrench added to that of a control law [N, Nm]."""
PLAIN = {**START, "position": [0.0] * 3, "rotation": [0.0] * 3}


def made(**options):
    return gymnasium.make(HOVER, **options).unwrapped


def begun(env, start, seed=0):
    env.reset(seed=seed, options={"start": start})
    return env


def schedule(env):
    return [[goal.start, goal.deadline, goal.joint_target.tolist()] for goal in env.progress.goals]


def integrals(env):
    found = env.controller.memory.integrals
    return np.concatenate((found.position_w, found.attitude))


# Used unchanged


def test_the_robot_begins_at_the_given_pose_in_the_first_form():
    env = made()
    reference = begun(env, PLAIN).state.position_w.copy()
    assert env.state.quat_wb.tolist() == [1.0, 0.0, 0.0, 0.0]
    # Without a rotation the torso is displaced by the offset alone.
    moved = begun(env, {**PLAIN, "position": START["position"]}).state.position_w
    assert moved - reference == pytest.approx(START["position"], abs=1e-12)
    begun(env, START)
    assert env.state.quat_wb == pytest.approx(matrix_to_quat(exp(np.array(START["rotation"]))), abs=1e-12)
    assert env.state.joint_position.tolist() == Q[1]
    # The offset of the CoG is the given one for any attitude.
    assert -env.truth.error.position_w == pytest.approx(START["position"], abs=1e-9)


def test_the_given_schedule_is_followed():
    env = begun(made(), START)
    assert schedule(env) == START["goals"]
    current = []
    for _ in range(90):
        env.step(np.zeros(6))
        current.append(env.progress.current)
    assert current[18] == 0
    assert current[19] == 1, "0.5 s are 20 ticks"
    assert current[78] == 1
    assert current[79] == 2
    assert env.progress.overdue() == {1}, "the move cannot finish in a quarter of a second"


def test_a_start_from_a_file_is_the_same_as_one_made_of_its_parts():
    parts = FlightStart(
        tuple(FormGoal(start, deadline, np.array(q)) for start, deadline, q in START["goals"]),
        np.array(START["position"]), np.array(START["rotation"]),
    )  # fmt: skip
    assert FlightStart.parse(parts) is parts
    infos = []
    for start in (parts, START, json.loads(json.dumps(START))):
        env = begun(made(), start)
        infos.append([env.step(np.zeros(6))[0].tolist() for _ in range(5)])
    assert infos[0] == infos[1] == infos[2]


def test_a_start_leaves_nothing_of_the_episode_to_the_seed():
    env, flights = made(), []
    for seed in (0, 1):
        begun(env, START, seed)
        flights.append([env.step(np.zeros(6))[0].tolist() for _ in range(5)])
    assert flights[0] == flights[1]


def test_the_integrals_begin_with_the_given_trim():
    env = made(randomization=1.0)
    begun(env, PLAIN, seed=4)
    computed, trim = integrals(env), env.compute_trim()
    assert np.abs(computed).max() > 1e-3
    begun(env, {**PLAIN, "trim": trim.tolist()}, seed=4)
    assert integrals(env) == pytest.approx(computed, rel=1e-9, abs=1e-12)
    begun(env, {**PLAIN, "trim": (0.5 * trim).tolist()}, seed=4)
    assert integrals(env) == pytest.approx(0.5 * computed, rel=1e-9, abs=1e-12)
    begun(env, {**PLAIN, "trim": [0.0] * 6}, seed=4)
    assert integrals(env).tolist() == [0.0] * 6


def test_a_described_robot_begins_without_a_trim_unless_one_is_given():
    env = made()
    assert integrals(begun(env, PLAIN)).tolist() == [0.0] * 6
    begun(env, {**PLAIN, "trim": [0.0, 0.0, 16.0, 0.0, 0.0, 0.0]})
    assert integrals(env)[2] > 0.0
    assert np.delete(integrals(env), 2).tolist() == [0.0] * 5


# Kept until withdrawn


def test_a_start_stays_for_later_episodes_until_it_is_withdrawn():
    env = made(forms="independent")
    drawn = schedule(begun(env, None, seed=7))
    assert drawn != START["goals"]
    begun(env, START)
    env.reset()
    assert schedule(env) == START["goals"]
    env.reset(seed=7)
    assert schedule(env) == START["goals"]
    env.reset(seed=7, options={"disturbances": {}})
    assert schedule(env) == START["goals"]
    env.reset(seed=7, options={"start": None})
    assert schedule(env) == drawn
    env.reset(seed=7)
    assert schedule(env) == drawn


def test_a_refused_start_leaves_the_one_before():
    env = begun(made(), START)
    with pytest.raises(InvalidValueError):
        begun(env, {**START, "goals": []})
    env.reset(seed=0)
    assert schedule(env) == START["goals"]


# Refused


@pytest.mark.parametrize(
    "start",
    [
        5, "form1", [], {}, {"goals": START["goals"]}, {**START, "goals": None}, {**START, "goals": [[0.0, Q[0]]]},
        {**START, "goals": [["now", 0.0, Q[0]]]}, {**START, "goals": [[0.0, 0.0, Q[0][:15]]]},
        {**START, "goals": [[0.0, 0.0, "form1"]]}, {**START, "position": [0.0, 0.0]}, {**START, "position": 0.0},
        {**START, "rotation": [[0.0, 0.0, 0.0]]}, {**START, "rotation": ["a", "b", "c"]}, {**START, "trim": "none"},
        {**START, "trim": [0.0] * 5}, {**START, "trim": 3.0},
    ],
    ids=range(17),
)  # fmt: skip
@pytest.mark.parametrize("checked", [True, False])
def test_an_invalid_start_is_refused_with_the_parts_of_a_valid_one(start, checked, monkeypatch):
    # Users have no type checker, which would refuse wrong shapes first.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", not checked)
    with pytest.raises(InvalidValueError) as refusal:
        begun(made(), start)
    assert all(word in str(refusal.value) for word in ("goals", "16 angles", "position", "rotation", "trim"))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"goals": []}, "at least one goal"),
        ({"goals": [[0.0, 1.0, Q[0]]]}, "deadline 0"),
        ({"goals": [[0.0, 0.0, Q[0]], [2.0, 1.0, Q[1]]]}, "no deadline before its start"),
        ({"goals": [[0.0, 0.0, Q[0]], [2.0, 3.0, Q[1]], [1.0, 4.0, Q[0]]]}, "in order of time"),
        ({"goals": [[0.0, 0.0, [math.nan] * 16]]}, "finite"),
        ({"position": [0.0, math.inf, 0.0]}, "finite"),
        ({"rotation": [math.nan] * 3}, "finite"),
        ({"trim": [math.nan] * 6}, "finite"),
        ({"goals": [[0.0, 0.0, Q[0]], [math.nan, math.nan, Q[1]]]}, "order of time"),
        ({"goals": [[0.0, math.nan, Q[0]]]}, "deadline 0"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_a_start_that_cannot_be_flown_is_refused_with_what_can(changes, words):
    with pytest.raises(InvalidValueError, match=words):
        begun(made(), {**START, **changes})


def test_the_options_of_a_reset_are_named_where_one_does_not_exist():
    with pytest.raises(UnknownNameError, match="start"):
        made().reset(options={"begin": START})


# Forms, allocators and control laws


@pytest.mark.parametrize("seed", range(4))
def test_narrow_forms_restrict_the_inner_rotors_at_least(seed):
    env = made(forms="narrow", perturbation=0.0)
    env.reset(seed=seed)
    for _ in range(3):
        info = env.step(np.zeros(6))[4]
    assert info["restricted_rotors"].sum() >= 4
    assert info["restricted_rotors"][::2].all()


def test_a_custom_allocator_is_called_at_every_tick():
    asked = []

    class Mine(Allocator):
        def allocate(self, demand, mode, previous_l, guess=None):
            asked.append(mode)
            return super().allocate(demand, mode, previous_l, guess)

    flights = []
    for allocator in (Mine, None):
        env = begun(made(allocator=allocator, max_iter=77, control="python"), START)
        flights.append([env.step(np.zeros(6))[0].tolist() for _ in range(6)])
    assert asked == ["flight"] * 6
    assert flights[0] == flights[1]
    assert env.controller.allocator.config.max_iter == 77


def test_the_forces_of_a_custom_allocator_are_commanded():
    class Half(Allocator):
        def allocate(self, demand, mode, previous_l, guess=None):
            f = 0.5 * super().allocate(demand, mode, previous_l, guess).forces_l.reshape(-1)
            return self._answer(demand, f, AllocationStatus.SOLVED, 0, 0.0, 0.0)

    thrust = []
    for allocator in (None, Half):
        env = begun(made(allocator=allocator), PLAIN)
        thrust.append(env.step(np.zeros(6))[4]["thrust_command"])
    assert thrust[1] == pytest.approx(0.5 * thrust[0], rel=1e-6)


def test_the_wrench_of_a_custom_control_law_is_allocated():
    class Heavier(FlightController):
        def compute_wrench(self, state, reference, control_state, joints):
            wrench, *remembered = super().compute_wrench(state, reference, control_state, joints)
            return wrench + PULL, *remembered

    steps = [begun(made(law=law), PLAIN).step(np.zeros(6))[4] for law in (None, Heavier)]
    more = steps[1]["wrench_desired"] - steps[0]["wrench_desired"]
    assert more == pytest.approx(PULL, abs=1e-9)
    assert steps[1]["thrust_command"].sum() > steps[0]["thrust_command"].sum()


def test_an_unchanged_control_law_flies_as_the_papers_does_and_has_a_preview():
    class Same(FlightController):
        """The paper's control law, unchanged."""

    flights, ahead = [], []
    for how in ({"law": Same}, {"control": "python"}):
        env = begun(made(**how), START)
        flights.append([env.step(np.zeros(6))[0].tolist() for _ in range(6)])
        ahead.append(env.controller.preview)
    assert flights[0] == flights[1]
    now, later = ahead[0](0.0), ahead[0](START["goals"][1][0] + 0.01)
    assert now.joint_target.tolist() == START["goals"][0][2]
    assert later.joint_target.tolist() == START["goals"][1][2]
    assert later.position_w.tolist() == now.position_w.tolist()


@pytest.mark.parametrize("control", ["core", "python"])
def test_a_robot_begins_with_the_given_velocities(control):
    start = {**PLAIN, "rotation": [0.1, -0.2, 0.3], "velocity": [0.4, -0.3, 0.2], "omega": [0.5, 0.2, -0.7]}
    env = begun(made(control=control), start)
    error = env.truth.error
    assert -error.velocity_w == pytest.approx(start["velocity"], abs=1e-6)
    assert -error.omega_b == pytest.approx(start["omega"], abs=1e-9)
    # After one tick it has moved by these velocities, except for the effect of the rotors.
    before = env.truth.error.position_w.copy()
    env.step(np.zeros(6))
    moved = before - env.truth.error.position_w
    assert moved == pytest.approx(np.array(start["velocity"]) / 40.0, abs=1.5e-3)
    env.reset(seed=0, options={"start": PLAIN})
    assert np.abs(env.truth.error.velocity_w).max() < 1e-12


def test_a_start_with_velocities_is_the_same_in_a_vector():
    start = {**PLAIN, "velocity": [0.4, -0.3, 0.2], "omega": [0.5, 0.2, -0.7]}
    vector = gymnasium.make_vec(HOVER, num_envs=2).unwrapped
    observations, _ = vector.reset(seed=0, options={"start": [None, start]})
    env = begun(made(), start)
    assert np.array_equal(observations[1], begun_observation(env, start))


def begun_observation(env, start):
    return env.reset(seed=0, options={"start": start})[0]
