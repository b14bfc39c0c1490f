"""Pins the onboard core to the Python controller: tree, allocation, flight, crawl, estimator, environments."""

import _ctypes
import ctypes
import subprocess
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from support.cores import CAP, Allocating
from support.needs import needs_compiler
from support.robots import OTHER
from support.states import hardest_demand, random_demands

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.control.allocation.allocator import AllocationStatus, Allocator, AllocatorConfig
from spidar_gym.control.allocation.modes import ALLOCATIONS
from spidar_gym.control.estimator import Estimator, EstimatorConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.presets import RETUNED, TUNED, crawler_config
from spidar_gym.errors import InvalidValueError, MissingDependencyError, StaleAssetError, UnknownNameError
from spidar_gym.model.dynamics import Model, Snapshot
from spidar_gym.native.compiler import compiler
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.library import Struct, load_core, pointer
from spidar_gym.native.recipe import seal
from spidar_gym.native.robot import robot
from spidar_gym.native.structs import fill
from spidar_gym.robot import ROBOT
from spidar_gym.so3 import exp

HOVER, CRAWL = "spidar_gym/Hover-v0", "spidar_gym/Crawl-v0"


@pytest.fixture(scope="module")
def library():
    return load_core()


def make(name=HOVER, **options):
    return gymnasium.make(name, **options).unwrapped


@pytest.mark.parametrize("spec", [ROBOT, OTHER], ids=["nominal", "own"])
def test_the_tree_is_that_of_pinocchio(library, spec):
    rng, seen, worst, known = np.random.default_rng(0), Struct("snapshot"), 0.0, Model(spec)
    for _ in range(200):
        q, vectoring, R = rng.uniform(-1.5, 1.5, 16), rng.uniform(-3.0, 3.0, (8, 2)), exp(rng.normal(size=3))
        library.sp_snapshot_at(pointer(robot(spec)), pointer(q), pointer(R), pointer(vectoring), seen.pointer)
        snapshot, feet = known.stance(q, R, vectoring)
        expected = {name: getattr(snapshot, name) for name in Snapshot.__dataclass_fields__ if name != "robot"}
        expected |= {"feet_b": feet.position_b, "J_foot": feet.J}
        for name, value in expected.items():
            worst = max(worst, float(np.abs(np.reshape(value, -1) - np.reshape(seen[name], -1)).max()))
    assert 0.0 < worst < 1e-12


@pytest.mark.parametrize("hard", [False, True])
def test_allocations_are_those_of_the_python_allocator(library, hard):
    readable, compiled = Allocator(ALLOCATIONS["paper"], AllocatorConfig(max_iter=CAP)), Allocating(library)
    errors, statuses = [], set()
    for demand in random_demands(np.random.default_rng(1), 400, hard):
        expected, found = readable.allocate(demand, "flight", np.zeros((8, 3))), compiled(demand)
        assert found.status is expected.status
        errors.append(np.abs(found.forces_l - expected.forces_l).max())
        assert found.slack == pytest.approx(expected.slack, abs=1e-9)
        statuses.add(str(found.status))
    assert np.percentile(errors, 99) < 1e-6
    assert np.max(errors) < (1e-3 if hard else 1e-4)
    assert statuses == {"closed_form", "solved", "projected", *(["softened"] if hard else [])}


@pytest.mark.parametrize("preset", ALLOCATIONS)
def test_within_the_spheres_both_find_the_same_or_prove_infeasibility(library, preset):
    readable = Allocator(ALLOCATIONS[preset], AllocatorConfig(max_iter=CAP))
    compiled, projecting = Allocating(library, preset=preset), Allocating(library)  # answers are views
    rng, seen, none = np.random.default_rng(7), [], np.zeros((8, 3))
    for _ in range(120):
        demand, wish = hardest_demand(rng, preset), rng.uniform(-60.0, 60.0, (8, 3))
        for expected, found in (
            (readable.allocate(demand, "flight", none), compiled(demand)),
            (readable.project(demand, wish, none), projecting.project(demand, wish)),
        ):
            seen.append(found.status)
            assert (found.status, found.iterations) == (expected.status, expected.iterations)
            np.testing.assert_allclose(found.forces_l, expected.forces_l, rtol=0, atol=1e-6)
            assert found.slack == pytest.approx(expected.slack, abs=1e-8)
    assert min(seen.count(AllocationStatus.PROJECTED), seen.count(AllocationStatus.SOFTENED)) > 20


def test_an_allocation_does_not_depend_on_those_before_it(library):
    demands, compiled = random_demands(np.random.default_rng(2), 60, True), Allocating(library)
    forwards = [compiled(demand).forces_l.copy() for demand in demands]
    backwards = [compiled(demand).forces_l.copy() for demand in reversed(demands)]
    np.testing.assert_array_equal(forwards, backwards[::-1])


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_a_demand_that_is_not_finite_keeps_the_last_forces_for_one_tick(library, poison):
    compiled, previous = Allocating(library), np.full((8, 3), 5.0)
    good = random_demands(np.random.default_rng(3), 1, True)[0]
    before = compiled(good).forces_l.copy()
    for name in ("wrench", "thrust_map", "torque_map", "gravity_torque"):
        value = getattr(good, name).copy()
        value.reshape(-1)[3] = poison
        answer = compiled(replace(good, **{name: value}), previous)
        assert str(answer.status) == "held"
        np.testing.assert_array_equal(answer.forces_l, previous)
        np.testing.assert_array_equal(compiled(good).forces_l, before)


def test_an_infeasible_demand_is_softened_and_stays_within_its_bounds(library):
    compiled = Allocating(library)
    for demand in random_demands(np.random.default_rng(4), 20, True):
        answer = compiled(replace(demand, wrench=demand.wrench * 9.0))
        assert str(answer.status) in ("softened", "held")
        assert np.isfinite(answer.forces_l).all()
        assert np.linalg.norm(answer.forces_l, axis=1).max() <= 42.0 + 1e-9


ALL = replace(RETUNED, compensation=replace(RETUNED.compensation, observer_beyond=True))
FLIGHTS = {
    "paper": {"preset": "paper", "forms": "paper"},
    "as flown, stacked": {"preset": "as_flown", "forms": "narrow"},
    "quasi-static": {"preset": "as_flown_quasi", "forms": "independent", "joint_speed": 1.0},
    "quasi-static, sensors": {"preset": "as_flown_quasi", "forms": "paper", "sensors": True, "randomization": 1.0},
    "quasi-static, every compensation": {"controller": replace(ALL, motion="quasi_static"), "forms": "independent"},
    "tuned, fast": {"preset": "tuned", "forms": "independent", "joint_speed": 1.0},
    "every compensation": {"controller": ALL, "forms": "independent", "joint_speed": 1.0},
    "unrestricted": {"preset": "paper", "forms": "form3", "avoid_interference": False},
    "retuned, fast": {"preset": "retuned", "forms": "independent", "joint_speed": 1.0},
    "retuned, a random robot": {"preset": "retuned", "forms": "independent", "sensors": True, "randomization": 1.0},
    "a random robot": {"preset": "tuned", "forms": "independent", "sensors": True, "randomization": 1.0},
    "observed motion": {"controller": replace(TUNED, motion="observed"), "forms": "independent", "joint_speed": 1.0},
    "observed motion, a random robot": {
        "controller": replace(ControllerConfig(), motion="observed"),
        "forms": "independent",
        "sensors": True,
        "randomization": 1.0,
    },
    "a lost rotor": {"forms": "form3", "disturbances": {"lost_rotor": 2, "fault_time": 0.5}},
    "a stuck rotor": {"forms": "form2", "disturbances": {"lost_rotor": 3, "fault": "vectoring", "fault_time": 0.5}},
}


def corrected(count):
    """Return a crawler that corrects what it has missed."""
    config = crawler_config("robust_retuned")
    return replace(config, gait=replace(config.gait, corrections=count))


QUASI = {"forms": "independent", "joint_speed": 1.0, "preset": "as_flown_quasi"}
CRAWLS = {
    "published": {"preset": "published"},
    "overlapped": {"preset": "overlapped", "turn": 0.3},
    "robust, random": {"preset": "robust", "sensors": True, "randomization": 0.5},
    "corrections, fast": {
        "controller": corrected(2),
        "sensors": True,
        "randomization": "calibrated_1",
        "distance": 0.3,
        "joint_speed": 0.8,
    },
}


def together(name, ticks, actions=None, **options):
    """Run both controllers on the same actions, each in its own environment; return the largest differences."""
    envs = [make(name, max_iter=CAP, control=control, **options) for control in ("python", "core")]
    first = [env.reset(seed=3)[0] for env in envs]
    worst = {"observation": float(np.abs(first[0] - first[1]).max()), "reward": 0.0, "thrust": 0.0, "vectoring": 0.0}
    worst["joints"] = 0.0
    for k in range(ticks):
        action = np.zeros(envs[0].action_space.shape) if actions is None else actions[k]
        (o, r, t, _, info), (p, s, u, _, other) = (env.step(action) for env in envs)
        a, b = (env.command for env in envs)
        worst["observation"] = max(worst["observation"], float(np.abs(o - p).max()))
        worst["reward"] = max(worst["reward"], abs(r - s))
        worst["thrust"] = max(worst["thrust"], float(np.abs(a.thrust - b.thrust).max()))
        on = a.thrust > 1.0
        worst["vectoring"] = max(worst["vectoring"], float(np.abs((a.vectoring - b.vectoring)[on]).max(initial=0.0)))
        worst["joints"] = max(worst["joints"], float(np.abs(a.joint_position - b.joint_position).max()))
        assert info["qp_status"] == other["qp_status"]
        assert info.keys() == other.keys()
        assert t == u
        if t or info.get("finished", False):
            break
    return worst


@pytest.mark.parametrize("options", FLIGHTS.values(), ids=FLIGHTS)
def test_a_flight_is_that_of_the_python_controller(options):
    worst = together(HOVER, 160, **options)
    assert worst["thrust"] < 1e-6
    assert worst["vectoring"] < 1e-6
    assert worst["joints"] < 1e-9
    assert worst["observation"] < 1e-5
    assert worst["reward"] < 1e-9


@pytest.mark.parametrize("control", ["python", "core"])
def test_a_quasi_static_controller_acts_on_other_errors_than_those_that_are_observed_and_rewarded(control):
    quasi, whole = (make(control=control, **{**QUASI, "preset": name}) for name in ("as_flown_quasi", "as_flown"))
    for env in (quasi, whole):
        env.reset(seed=3)
    apart, thrusts = 0.0, 0.0
    for _ in range(40):
        before = quasi.truth.error.velocity_w.copy()
        seen = quasi.step(np.zeros(6))[0]
        whole.step(np.zeros(6))
        used = quasi.controller.last_step.control_state.error.velocity_w
        turned = quasi.truth.R_wb.T @ quasi.truth.error.velocity_w
        np.testing.assert_allclose(seen[3:6], turned, rtol=0, atol=1e-6)
        apart = max(apart, float(np.abs(used - before).max()))
        thrusts = max(thrusts, float(np.abs(quasi.command.thrust - whole.command.thrust).max()))
    assert apart > 1e-3
    assert thrusts > 1e-2


def test_the_flag_fills_padding_so_that_logs_and_missions_keep_their_layout():
    fields = core_layouts()["controller_config"].fields
    assert [fields[name][1] for name in ("allocation", "motion", "joint_speed")] == [0, 4, 8]
    fields = core_layouts()["gait_config"].fields
    assert [fields[name][1] for name in ("stride", "corrections", "max_distance")] == [16, 20, 24]


@pytest.mark.slow
@pytest.mark.parametrize("options", CRAWLS.values(), ids=CRAWLS)
def test_a_crawl_is_that_of_the_python_crawler(options):
    worst = together(CRAWL, 900, **{"distance": 0.15, "direction": 0.5, "turn": 0.0, **options})
    assert worst["thrust"] < 1e-6
    assert worst["vectoring"] < 1e-5
    assert worst["joints"] < 1e-9
    assert worst["reward"] < 1e-6


@pytest.mark.parametrize("mode", ["residual", "residual_wrench", "residual_joint", "residual_force", "direct"])
def test_residuals_in_flight_mean_the_same_in_both(mode):
    size = make(action_mode=mode).action_space.shape[0]
    scale = 0.02 if mode == "direct" else 0.5
    actions = scale * np.random.default_rng(5).uniform(-1.0, 1.0, (40, size))
    worst = together(HOVER, 40, actions, action_mode=mode, forms="independent", joint_speed=0.6)
    assert worst["thrust"] < 1e-6
    assert worst["observation"] < 1e-5


@pytest.mark.parametrize("mode", ["residual_gait", "residual_gait_force", "residual_wrench", "residual_force"])
def test_residuals_on_the_ground_mean_the_same_in_both(mode):
    size = make(CRAWL, action_mode=mode).action_space.shape[0]
    actions = 0.3 * np.random.default_rng(6).uniform(-1.0, 1.0, (60, size))
    worst = together(CRAWL, 60, actions, action_mode=mode, distance=0.15, direction=0.0, turn=0.0)
    assert worst["thrust"] < 1e-6
    assert worst["observation"] < 1e-5


def test_the_estimators_agree(library):
    env, readable, state, measured = make(sensors=True), Estimator(), Struct("robot_state"), Struct("measurement")
    env.reset(seed=2)
    memory, config, out = Struct("estimator"), Struct("estimator_config"), Struct("robot_state")
    fill(config.record, EstimatorConfig())
    library.sp_estimator_init(memory.pointer, config.pointer)
    fill(state.record, env.state)
    library.sp_estimator_reset(pointer(robot()), memory.pointer, state.pointer)
    readable.reset(env.state)
    worst = 0.0
    for _ in range(200):
        env.plant.step(env.controller.step(env.seen, env.reference()))
        measurement = env.plant.measure()
        fill(measured.record, measurement)
        thrust = np.full(8, 20.0)
        expected = readable.update(measurement, thrust)
        library.sp_estimator_update(pointer(robot()), memory.pointer, measured.pointer, pointer(thrust), out.pointer)
        for name, view in out.views.items():
            worst = max(worst, float(np.abs(np.reshape(getattr(expected, name), -1) - np.reshape(view, -1)).max()))
    assert worst < 1e-9


def test_two_environments_do_not_share_a_core():
    def flown(envs):
        trace = []
        for env in envs:
            env.reset(seed=1)
        for _ in range(30):
            trace.append([env.step(np.zeros(6))[0] for env in envs])
        return np.array(trace)

    alone = flown([make(control="core", forms="narrow")])
    both = flown([make(control="core", forms="narrow"), make(control="core", forms="independent", joint_speed=1.0)])
    np.testing.assert_array_equal(alone[:, 0], both[:, 0])


@pytest.mark.parametrize("name", [HOVER, CRAWL])
def test_gymnasiums_checker_is_silent_and_the_same_seed_gives_the_same_bits(name):
    env = make(name, control="core")
    check_env(env, skip_render_check=True)
    traces = []
    for _ in range(2):
        first = env.reset(seed=8)[0]
        traces.append([first, *(env.step(np.zeros(env.action_space.shape))[0] for _ in range(20))])
    np.testing.assert_array_equal(*traces)


def test_a_core_that_is_missing_is_refused(monkeypatch, tmp_path):
    monkeypatch.setenv("SPIDAR_CORE", str(tmp_path / "none.so"))
    with pytest.raises(MissingDependencyError, match="spidar assets"):
        CoreFlightController()


@needs_compiler
def test_a_core_of_another_interface_is_refused(monkeypatch, tmp_path):
    monkeypatch.setenv("SPIDAR_CORE", str(tmp_path / "libspidar.so"))
    (tmp_path / "old.c").write_text('const char *sp_interface(void) { return "old"; }\n')
    run = [*compiler(), "-shared", "-fPIC", "old.c", "-o", "libspidar.so"]
    subprocess.run(run, cwd=tmp_path, check=True)
    seal(tmp_path / "libspidar.so")
    assert ctypes.CDLL(str(tmp_path / "libspidar.so")).sp_interface() != 0, "it must load: its interface is refused"
    with pytest.raises(StaleAssetError, match="spidar assets"):
        CoreFlightController()


def test_unknown_controls_and_allocators_for_the_core_are_refused():
    for name in (HOVER, CRAWL):
        with pytest.raises(UnknownNameError, match="python, core"):
            make(name, control="c")
    with pytest.raises(InvalidValueError, match="the core has its own"):
        make(control="core", allocator=Allocator)


def test_the_library_releases_the_interpreter():
    function = load_core().sp_allocate
    assert not function._flags_ & _ctypes.FUNCFLAG_PYTHONAPI, "functions of a PyDLL block other threads"
