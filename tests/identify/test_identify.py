"""Checks identification: from logs of a bench test and of swinging thrusts to the robot's parameters and its file."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.needs import needs_compiler

import spidar_gym  # noqa: F401 - registers the environments
from spidar_gym.cli.main import main
from spidar_gym.identify.estimate import Estimate, UnfitLogError
from spidar_gym.identify.excitation import excitations_of, excited
from spidar_gym.identify.hovers import lagged
from spidar_gym.identify.identify import identify
from spidar_gym.identify.motion import Dynamics, Motion
from spidar_gym.logs.open import read_log
from spidar_gym.onboard.runner_structs import Excited
from spidar_gym.robot import GRAVITY, N_JOINTS, N_LINKS, ROBOT, RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, randomize
from spidar_gym.sim.worlds import FOLDER, read_world
from spidar_gym.sitl.missions import Mission, bench_mission, thrust_mission
from spidar_gym.sitl.play import play

MASS, DELAY, LAG, DAMPING, FRICTION, SPEED = 16.3, 0.03, 0.05, 1.2, 0.3, 0.19
TRUTH = {
    "body.total_mass": MASS, "actuators.delay": DELAY, "actuators.thrust_lag": LAG, "actuators.joint_kd": DAMPING,
    "actuators.joint_damping": 0.0, "actuators.joint_friction": FRICTION,
    "actuators.joint_speed_factor": SPEED / ROBOT.joint_speed, "actuators.thrust_gain": 0.95,
}  # fmt: skip
GAINS = 0.03
"""Half of the range of the modules' gains."""


def robots():
    ranges = {name: (value, value) for name, value in TRUTH.items()}
    return Randomization.parse({**ranges, "actuators.module_gain": (1.0 - GAINS, 1.0 + GAINS)})


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Logs of the tests of one robot, the bench test with 4 s a joint."""
    folder = tmp_path_factory.mktemp("tested")
    for mission in (bench_mission(16.0), thrust_mission()):
        play(mission, seed=5, robots=robots(), log=folder / f"{mission.name}.log")
    return folder


@pytest.fixture(scope="module")
def out(logs):
    paths = [str(logs / name) for name in ("bench.log", "thrust.log")]
    main(["identify", *paths, "--mass", f"{MASS}", "--out", str(logs / "out" / "robot.toml")])
    return logs / "out"


def holds(lines, key, truth, times=1.5):
    """Require the truth within `times` the interval of every line, and every line to be told."""
    own = [line for line in lines if line["parameter"] == key]
    value, low, high = (np.array([line[name] for line in own]) for name in ("value", "low", "high"))
    assert all(line["told"] for line in own)
    assert (abs(value - truth) <= times * 0.5 * (high - low)).all(), key
    return value


@needs_compiler
@pytest.mark.slow
def test_a_flight_without_a_steady_hover_is_refused_before_the_bench_test_is_fitted(logs, monkeypatch):
    monkeypatch.setattr("spidar_gym.identify.identify.fit_servos", None)
    monkeypatch.setattr("spidar_gym.identify.hovers.STILL", 0.0)
    with pytest.raises(UnfitLogError, match="no steady hover of 6 s"):
        identify([(name, read_log(logs / f"{name}.log")) for name in ("bench", "thrust")])


@needs_compiler
@pytest.mark.slow
def test_logs_tell_servos_and_modules(out):
    lines = json.loads((out / "report.json").read_text(encoding="utf-8"))["parameters"]
    gain = randomize(PlantConfig(), np.random.Generator(np.random.PCG64(5)), robots())[0].actuators
    # Numbers of one robot: 1.5 intervals are three standard deviations.
    assert abs(holds(lines, "delay", DELAY)[0] - DELAY) < 0.003
    assert np.allclose(holds(lines, "damping", DAMPING), DAMPING, rtol=0.3)
    holds(lines, "friction", FRICTION)
    holds(lines, "stiffness", ROBOT.joint_kp)
    holds(lines, "speed", SPEED)
    assert np.allclose(holds(lines, "lag", LAG), LAG, atol=0.005)
    truth = gain.thrust_gain * gain.module_gain / MASS
    holds(lines, "gain_over_mass", truth)
    assert holds(lines, "mean_gain_over_mass", truth.mean())[0] == pytest.approx(truth.mean(), rel=0.02)


@needs_compiler
@pytest.mark.slow
def test_what_the_logs_do_not_tell_is_said(out):
    content = json.loads((out / "report.json").read_text(encoding="utf-8"))
    verdicts = {line["parameter"]: line["verdict"] for line in content["parameters"] if not line["told"]}
    assert {"backlash", "zero", "tilt", "torso_com"} <= {*verdicts}
    assert "jig" in verdicts["zero"]
    text = (out / "report.md").read_text(encoding="utf-8")
    assert "Not told by these logs" in text
    ahead = content["one_second_ahead"]["bench"]
    assert np.mean(ahead["identified_rad"]) < 0.6 * np.mean(ahead["described_rad"])
    assert (out / "report.png").stat().st_size > 10_000


@needs_compiler
@pytest.mark.slow
def test_the_file_is_a_world_and_a_robot(out):
    path = out / "robot.toml"
    world, spec = read_world(path), RobotSpec.parse(path)
    assert world.robot == spec
    assert spec.joint_kd == pytest.approx(DAMPING, rel=0.2)
    assert spec.thrust_lag == pytest.approx(LAG, abs=0.005)
    assert spec.total_mass == pytest.approx(MASS, abs=1e-6)
    how = Randomization.parse(path)
    sampled = [randomize(PlantConfig(), np.random.Generator(np.random.PCG64(k)), how)[0] for k in range(20)]
    kd = [robot.actuators.joint_kd for robot in sampled]
    assert 0.0 < np.ptp(kd) < 0.6
    assert abs(np.mean(kd) - DAMPING) < 0.2
    truth = randomize(PlantConfig(), np.random.Generator(np.random.PCG64(5)), robots())[0].actuators
    mean = np.mean([robot.actuators.module_gain for robot in sampled], axis=0)
    assert np.allclose(mean, truth.thrust_gain * truth.module_gain, atol=0.06)
    # Engine and Python sample the same robot, also where the controller knows the identified one.
    for known in (None, path):
        env = gymnasium.make("spidar_gym/Hover-v0", randomization=str(path), robot=known)
        info = env.reset(seed=3)[1]["randomization"]
        assert min(kd) - 0.2 < info["actuators.joint_kd"] < max(kd) + 0.2
        assert 15.0 < info["body.total_mass"] < 17.0
        assert env.get_wrapper_attr("plant").config.actuators.module_gain == pytest.approx(mean, abs=0.1)
        env.close()


@needs_compiler
@pytest.mark.slow
def test_logs_without_a_test_are_refused(logs, capfd):
    record = read_log(logs / "bench.log")
    with pytest.raises(SystemExit) as stop:
        main(["identify", str(logs / "bench.log"), str(logs / "bench.log"), "--out", str(logs / "two" / "robot.toml")])
    assert stop.value.code == 2
    assert "several logs of one test" in capfd.readouterr().err
    assert not list((logs / "two").iterdir())
    with pytest.raises(UnfitLogError, match="bench test"):
        identify([("empty", type(record)("run", {}))])


@needs_compiler
def test_excitations_are_those_of_the_runner(tmp_path):
    lines = (
        "flight as_flown", "form 0 " + " ".join(["0"] * N_JOINTS), "excite joint 2 chirp 1 4 0.02 0.5 2",
        "excite joint 7 square 1 3 0.02 1", "excite joint 8 sine 0.5 3.5 -0.01 1.3", "end 4.5",
    )  # fmt: skip
    play(Mission("excited", "as_flown", "\n".join(lines), 4.5), seed=1, log=tmp_path / "x.log")
    record = read_log(tmp_path / "x.log")
    time, values = excited(record, Excited.JOINT, N_JOINTS)
    reference = record["runner/reference"]
    rows = np.searchsorted(reference.received, time)
    begun = excitations_of(record)[2].start
    late = record["runner/status"].values["mission_time"][-len(time) :] > begun + 0.1
    moved = [1, 6, 7]
    # The legs reach the form before; then the target is the form and the excitations.
    rest = reference.values["joint_target"][rows][:, moved] - values[:, moved]
    settled = np.abs(np.delete(reference.values["joint_target"][rows], moved, axis=1)).max(axis=1) < 1e-9
    assert (settled & late).sum() > 40
    assert np.abs(rest[settled & late]).max() < 1e-9


def test_a_lagged_command_is_the_exact_response():
    rng = np.random.default_rng(3)
    sent, values, lag = np.arange(0.0, 1.0, 0.025), rng.uniform(10.0, 30.0, (40, 8)), rng.uniform(0.02, 0.06, 8)
    time, step = np.arange(0.1, 1.0, 0.01), 1e-5
    state, found = values[0].copy(), []
    for k in range(round(1.0 / step)):
        if k % 1000 == 0 and k * step >= 0.1:
            found.append(state.copy())
        held = values[max(0, np.searchsorted(sent + 0.03, k * step + 1e-9, side="right") - 1)]
        state += step / lag * (held - state)
    assert np.allclose(lagged(time, sent, values, 0.03, lag), found[: len(time)], atol=5e-3)


def test_a_mean_has_the_scatter_of_its_numbers():
    alike = Estimate(np.array([1.0, 1.02, 0.98, 1.0]), np.full(4, 0.02), np.ones(4)).mean()
    apart = Estimate(np.array([1.0, 1.4, 0.6, 1.0]), np.full(4, 0.02), np.ones(4)).mean()
    assert alike.deviation == pytest.approx(0.01)
    assert apart.deviation > 0.25
    assert alike.told
    assert float(apart.value) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ('[values]\n"actuators.module_gain" = [1, 1]', "of the shape"),
        ('[values]\n"actuators.gain" = 1', "valid: "),
        ('[values]\n"actuators.delay" = "late"', "finite numbers"),
        ('[values]\n"actuators.module_gain" = [1, 1, 1, 1, 1, 1, 1, -1]', "above 0"),
        ("[robot]\nthrust_lag = -1", "thrust_lag"),
        ("[robot]\nlag = 1", "valid: "),
    ],
)
def test_wrong_values_of_a_world_are_refused(tmp_path, lines, words):
    text = (FOLDER / "calibrated_1.toml").read_text(encoding="utf-8")
    path = tmp_path / "robot.toml"
    path.write_text(text.replace("[mixtures]", f"{lines}\n[mixtures]", 1), encoding="utf-8")
    with pytest.raises(Exception, match=words) as error:
        Randomization.parse(path)
    assert "\n" not in str(error.value)


def test_a_shifted_centre_of_mass_changes_the_needed_wrench_as_the_regression_assumes():
    rng = np.random.Generator(np.random.PCG64(1))
    n, still = 4, np.zeros((4, 3))
    R_wb = Rotation.random(n, random_state=1).as_matrix()
    motion = Motion(
        0.01 * np.arange(n), R_wb, still, still, R_wb.transpose(0, 2, 1) @ [0.0, 0.0, GRAVITY],
        rng.uniform(-0.5, 0.5, (n, 32)), np.zeros((n, 32)), np.zeros((n, 32)),
    )  # fmt: skip
    config = PlantConfig()
    needed, module, com = Dynamics(config).parts(motion)
    # At rest the robot needs its weight, upwards, and nothing else about its centre of mass.
    assert np.allclose(needed[:, :3], GRAVITY * config.body.total_mass * R_wb[:, 2], atol=1e-9)
    shift = rng.uniform(-0.01, 0.01, (1 + N_LINKS, 3))
    moved = replace(config, body=replace(config.body, torso_com=shift[0], link_com=shift[1:]))
    expected = needed - np.einsum("nwbc,bc->nw", com, shift)
    assert np.allclose(Dynamics(moved).needed(motion), expected, atol=1e-9)
    assert not np.allclose(needed, expected, atol=1e-2)
    # Forces of 1 N along the axes of a module are orthonormal in the torso's axes.
    forces = module[:, :3].transpose(0, 2, 3, 1)
    assert np.allclose(forces @ forces.swapaxes(-1, -2), np.eye(3), atol=1e-12)
