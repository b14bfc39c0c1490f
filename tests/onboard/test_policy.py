"""Pins the learned residual onboard: observation and action equal those in the environment, within bounds."""

import hashlib
import re
import subprocess
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from support.needs import needs_compiler
from support.networks import feeling, in_torso_axes, made

from spidar_gym.benchmark.track import CRAWL, HOVER
from spidar_gym.control.crawl.footsteps import Move
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.actions import ACTION_MODES, CRAWL_MODES, TORSO
from spidar_gym.native.compiler import compiler
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.library import Struct, expected_digest, pointer
from spidar_gym.native.recipe import FLAGS, includes, interface_header, seal, sources
from spidar_gym.native.structs import fill
from spidar_gym.onboard.policy import RATE, policy_header
from spidar_gym.policies.artifact import LearnedPolicy, Washout
from spidar_gym.state import NO_RESIDUAL, Residual

pytestmark = needs_compiler
TICKS = 120
OPTIONS = {
    HOVER: {"forms": "independent", "joint_speed": 1.0},
    CRAWL: {"distance": 0.2, "direction": 0.3, "turn": 0.2},
}
NETS = {
    "wrench": {"mode": "residual_wrench", "preset": "tuned"},
    "wrench and joints": {"mode": "residual", "activation": "relu", "output": "tanh", "preset": "paper"},
    "washed wrench and joints": {
        "mode": "residual",
        "preset": "tuned",
        "washout": np.r_[np.full(6, 0.5), np.zeros(17)],
    },
    "rotor forces": {"mode": "residual_force", "output": "tanh", "clip": 2.0},
    "gait and legs": {"env_id": CRAWL, "mode": "residual_gait_force", "activation": "relu", "clip": 3.0, "loud": 0.3},
    "gait": {"env_id": CRAWL, "mode": "residual_gait", "output": "tanh", "preset": "robust"},
}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Return a function: artifact or None → the core with it as a shared library; only the policy is recompiled."""
    folder = tmp_path_factory.mktemp("core")
    (folder / "spidar_interface.h").write_text(interface_header(expected_digest()), encoding="utf-8")
    flags = [*FLAGS, "-fPIC", *includes(folder)]
    (policy,) = (source for source in sources() if source.endswith("policy.c"))
    others = [source for source in sources() if source != policy]
    subprocess.run([*compiler(), *flags, "-c", *others], cwd=folder, check=True)
    objects = sorted(map(str, folder.glob("*.o")))

    def link(artifact, rate=RATE):
        header = policy_header(artifact, rate)
        path = folder / f"{hashlib.sha256(header.encode()).hexdigest()[:16]}.so"
        if not path.exists():
            (folder / "spidar_policy.h").write_text(header, encoding="utf-8")
            own = ["-shared", policy, *objects, "-lm", "-o", str(path)]
            subprocess.run([*compiler(), *flags, *own], check=True)
            seal(path)
        return path

    return link


@pytest.fixture
def core(compiled, monkeypatch):
    """Return a function like `compiled`, after which new controllers load that core."""
    return lambda *artifact: monkeypatch.setenv("SPIDAR_CORE", str(compiled(*artifact)))


def make(net, **options):
    return gymnasium.make(net.env_id, **net.arguments, **OPTIONS[net.env_id], **options).unwrapped


class Learned:
    """The policy of a compiled core and a controller of that core, with the inputs of an environment's policy."""

    def __init__(self, env, controller=None):
        self.env, self.controller = env, controller or env.controller
        self.library = self.controller.library
        names = ("policy", "residual", "robot_state", "reference", "control_state", "preview", "command")
        self.own = {name: Struct(name) for name in names}
        self.library.sp_policy_reset(self["policy"])
        self.action, self.seen = self.own["policy"]["action"], self.own["policy"]["observation"]

    def __getitem__(self, name):
        return self.own[name].pointer

    def look(self, state=None):
        """Store the present state, reference and preview."""
        fill(self.own["robot_state"].record, state or self.env.seen)
        if isinstance(self.controller, CoreFlightController):
            fill(self.own["reference"].record, self.env.reference())
            self.library.sp_compute_state(
                self.controller.room.robot, self["robot_state"], self["reference"], self["control_state"]
            )
            progress, preview = self.env.progress, self.own["preview"].record
            upcoming = progress.next_goal
            preview["joint_target"] = progress.goal.joint_target
            preview["next_form"] = (upcoming or progress.goal).joint_target
            preview["time_to_next"] = 60.0 if upcoming is None else upcoming.start - progress.time

    def act(self):
        """Compute the residual of this tick."""
        if isinstance(self.controller, CoreFlightController):
            self.library.sp_policy_flight(
                self.controller.room.robot, self["policy"], self.controller._flight.pointer, self["robot_state"],
                self["control_state"], self["preview"], self["residual"],
            )  # fmt: skip
        else:
            goal = self.env.progress.goal
            pose = np.array([goal.x, goal.y, goal.yaw])
            self.library.sp_policy_crawl(
                self.controller.room.robot, self["policy"], self.controller._crawl.pointer, self["robot_state"],
                pointer(pose), self["residual"],
            )  # fmt: skip
        return self.own["residual"]

    def command_directly(self):
        """Compute the policy's command, without a controller."""
        if not isinstance(self.controller, CoreFlightController):
            goal = self.env.progress.goal
            pose = np.array([goal.x, goal.y, goal.yaw])
            self.library.sp_policy_crawl_direct(
                self.controller.room.robot, self["policy"], self.controller._crawl.pointer, self["robot_state"],
                pointer(pose), self["command"],
            )  # fmt: skip
            return self.own["command"].record
        self.library.sp_policy_direct(
            self.controller.room.robot, self["policy"], self.controller._flight.pointer, self["robot_state"],
            self["control_state"], self["preview"], self["command"],
        )  # fmt: skip
        return self.own["command"].record

    def command(self, residual):
        """Compute the controller's command with a residual, or without one."""
        given = None if residual is None else residual.pointer
        if isinstance(self.controller, CoreFlightController):
            self.library.sp_flight_step(
                self.controller._flight.pointer, self["robot_state"], self["reference"], given, self["control_state"],
                None, self.controller.room.pointer, self["command"],
            )  # fmt: skip
        else:
            self.library.sp_crawl_step(
                self.controller._crawl.pointer, self["robot_state"], given, self.controller.room.pointer,
                self["command"],
            )  # fmt: skip
        return self.own["command"].record.copy()


def beside(env):
    """Return a controller of the core with the initial state of the environment's controller."""
    if env.spec is None or env.spec.id != CRAWL:
        controller = CoreFlightController(env.controller.config)
        controller.reset(env.seen, env.progress.goal.joint_target, env.trim)
    else:
        controller = CoreCrawler(env.controller.config)
        controller.reset(env.seen, [Move(Pose2(*env.way))])
    return controller


def toward(wish, last):
    """Return the next action: as near to the requested one as the rate limit allows."""
    step = RATE / CONTROL_RATE
    return np.clip(wish.astype(float), last - step, last + step)


def residual_of(net, action):
    """Return the environment's residual of an action, as the core's struct."""
    struct = Struct("residual")
    modes = CRAWL_MODES if net.env_id == CRAWL else ACTION_MODES
    adds = modes[net.arguments["action_mode"]].residual
    fill(struct.record, adds(action))
    return struct


def apart(a, b):
    """Return the largest difference of two structs of numbers."""
    return max(float(np.abs(np.asarray(a[name], float) - np.asarray(b[name], float)).max()) for name in a.dtype.names)


@pytest.mark.parametrize("options", NETS.values(), ids=NETS)
def test_observation_and_action_of_the_core_are_those_of_environment_and_network(core, options):
    net = made(**options)
    core(net)
    env = make(net, control="core")
    observation, _ = env.reset(seed=3)
    learned, size, action = Learned(env), len(net.biases[-1]), np.zeros(len(net.biases[-1]))
    seen, answered, residuals, actions, limited, shown = [], [], [], [], [], []
    washout, faded = Washout(net.washout), []
    for _ in range(TICKS):
        learned.look()
        residual = learned.act()
        answer = net.act(observation)
        wish = washout(answer)
        action = toward(wish, action)
        difference = np.abs(learned.seen[: len(observation)] - observation)
        seen.append(difference[:-size].max())
        assert difference[-size:].max() < 1e-5, "the last action, which each computed itself"
        answered.append(np.abs(learned.action[:size] - action).max())
        residuals.append(apart(residual.record, residual_of(net, action).record))
        actions.append(action)
        limited.append(np.abs(wish - action).max() > 1e-6)
        faded.append(np.abs(answer - wish).max())
        shown.append(observation)
        observation, _, terminated, _, info = env.step(action)
        assert not terminated, info["failure"]
    print(f"\nobservation {max(seen):.1e}, action {max(answered):.1e}, residual {max(residuals):.1e}")
    assert max(seen) < 1e-6
    assert max(answered) < 1e-5
    assert max(residuals) < 1e-5 * 34.0
    # Observations and actions varied.
    assert np.ptp(actions, axis=0).min() > 0.02
    assert 0 < np.sum(limited) < TICKS
    assert max(faded) > 0.3 if net.washout.any() else not any(faded)
    assert np.mean(np.ptp(shown, axis=0) > 0.0) > 0.6
    if net.env_id == HOVER:
        assert len({goal.tobytes() for goal in np.array(shown)[:, -size - 17 : -size - 1]}) > 1, "the plan went on"


def test_outputs_that_a_network_does_not_use_are_not_in_the_core():
    said, silent = (re.search(r"SIZES \{.*, (\d+)\}", policy_header(in_torso_axes(joints=j)))[1] for j in (True, False))
    assert (said, silent) == ("40", "24")


@pytest.mark.parametrize(
    ("net", "least"),
    [
        (in_torso_axes(), 40),
        (in_torso_axes(joints=False), 40),
        (made(mode="direct", loud=0.2), 10),
        (made(mode="direct", output="tanh"), 8),
    ],
    ids=["torso axes, traces, skip", "torso axes without joints", "clipped", "squashed"],
)
def test_a_policy_without_a_controller_flies_as_in_its_environment(core, net, least):
    core(net)
    env = make(net, control="core")
    observation, _ = env.reset(seed=3)
    learned, policy = Learned(env, beside(env)), LearnedPolicy(net)
    policy.reset(0)
    seen, answered, actions = [], [], []
    for _ in range(TICKS):
        learned.look()
        found = learned.command_directly()
        action = policy.act(observation)
        seen.append(np.abs(learned.seen[: len(observation)] - observation).max())
        answered.append(np.abs(learned.action[: len(action)] - action))
        answered[-1][8:24] = np.minimum(answered[-1][8:24], 2.0 - answered[-1][8:24])  # angles, in half turns
        actions.append(action)
        # Both continue from the same action, because differences do not decay in a flight without a controller.
        observation, _, terminated, _, _ = env.step(learned.action[: len(action)].astype(np.float32))
        expected = Struct("command")
        fill(expected.record, env.command)
        assert apart(found, expected.record) < 1e-12
        if terminated:
            break
    print(f"\n{len(seen)} ticks: observation {max(seen):.1e}, action {np.max(answered):.1e}")
    assert len(seen) >= least
    assert max(seen) < 1e-6
    assert np.max(answered) < 1e-5
    assert np.ptp(actions, axis=0).max() > 0.05


@pytest.mark.parametrize("env_id", [HOVER, CRAWL])
@pytest.mark.parametrize("hold", [1, 5])
def test_a_policy_in_torso_axes_commands_as_in_its_environment_and_holds_its_decisions(core, env_id, hold):
    arguments = {"action_mode": TORSO, "action_scale": {"force": 4.0, "joint": 0.2}, "hold": hold}
    net = made(env_id, TORSO, loud=0.2)
    net = replace(
        net, arguments={**arguments, "observation": "scaled"}, mean=0.0 * net.mean, variance=25.0 + 0.0 * net.mean
    )
    core(net)
    env = make(net, control="core", sensors=True)
    # Its physics and controller decide in every tick, as the robot does; it only repeats each action.
    arguments["hold"] = 1
    each = gymnasium.make(env_id, **arguments, **OPTIONS[env_id], sensors=True).unwrapped
    observation, _ = env.reset(seed=3)
    each.reset(seed=3)
    learned, worst, seen, actions = Learned(each, beside(each)), 0.0, [], []
    for k in range(100):
        learned.look()
        found = learned.command_directly()
        if k % hold == 0:
            seen.append(np.abs(learned.seen[: len(env._gain)] * env._gain - observation).max())
            action = net.act(observation)
            assert np.abs(learned.action - action).max() < 1e-5
            actions.append(learned.action.copy())
            observation, _, terminated, _, _ = env.step(learned.action.astype(np.float32))
        assert np.array_equal(learned.action, actions[-1])
        each.step(learned.action.astype(np.float32))
        expected = Struct("command")
        fill(expected.record, each.command)
        worst = max(worst, apart(found, expected.record))
        if terminated:
            break
    print(f"\n{k + 1} ticks: observation {max(seen):.1e}, command {worst:.1e}")
    assert k >= 20
    assert max(seen) < 1e-5
    assert worst < 1e-6
    assert np.ptp(actions, axis=0).max() > 0.05


@pytest.mark.parametrize("name", ["wrench", "washed wrench and joints", "gait and legs"])
def test_controller_and_policy_of_the_core_are_those_of_python(core, name):
    net = made(**NETS[name])
    core(net)
    # The estimator uses the command as the thrust; without it the observations differ, as in the test above.
    env = make(net, control="python", max_iter=300, sensors=True)
    observation, _ = env.reset(seed=5)
    learned, action, worst, moved = Learned(env, beside(env)), np.zeros(len(net.biases[-1])), 0.0, 0.0
    washout = Washout(net.washout)
    expected, plain = Struct("command"), beside(env)
    for _ in range(120):
        learned.look()
        found = learned.command(learned.act())
        action = toward(washout(net.act(observation)), action)
        asked = (env.seen, env.reference()) if net.env_id == HOVER else (env.seen,)
        moved = max(moved, float(np.abs(plain.step(*asked).thrust - found["thrust"]).max()))
        observation = env.step(action)[0]
        fill(expected.record, env.command)
        worst = max(worst, apart(found, expected.record))
    print(f"\ncommand {worst:.1e}, moved {moved:.1e}")
    assert worst < 1e-3
    assert moved > 0.5, "the residual does something"


def test_a_residual_that_remembers_the_external_force_answers_as_in_its_environment(core):
    net = feeling()
    core(net, 1000.0)
    # A randomised robot begins with integrals of either sign.
    env = make(net, control="core", sensors=True, randomization=1.0, disturbances={"wind": 2.0, "push": 20.0})
    observation, _ = env.reset(seed=4)
    learned, policy = Learned(env), LearnedPolicy(net)
    policy.reset(0)
    apart_by, pulls = [], []
    for _ in range(TICKS):
        learned.look()
        learned.act()
        action = policy.act(observation)
        apart_by.append(np.abs(learned.action[:6] - action).max())
        shown = policy.behind.velocity
        np.testing.assert_allclose(learned.own["policy"]["velocity"], shown, atol=1e-6)
        np.testing.assert_allclose(learned.own["policy"]["external"][6:], policy.behind.first, rtol=1e-6)
        pulls.append(learned.own["policy"]["external"].copy())
        observation, _, terminated, _, _ = env.step(learned.action[:6].astype(np.float32))
        assert not terminated
    print(f"\naction {max(apart_by):.1e}, pulls up to {np.abs(pulls).max():.0f} N")
    assert max(apart_by) < 1e-4
    assert pulls[0][6:].min() > 0.0, "absolute values are observed"
    assert np.abs(np.mean(pulls[20:], axis=0)[:3]).max() > 1.0, "wind pulls"
    # Numbers that are not finite are not stored.
    seen = learned.own["policy"]
    before = seen["traces"].copy()
    learned.look(replace(env.seen, velocity_w=np.full(3, np.nan)))
    learned.act()
    assert np.isfinite(seen["traces"]).all()
    assert np.isfinite(seen["external"]).all()
    for _ in range(3):
        learned.look()
        learned.act()
    assert np.isfinite(learned.action).all()
    assert np.abs(seen["traces"] - before).max() < 50.0


def test_bound_and_rate_hold_for_all_outputs_of_the_network(core):
    for output, rate, time in (("clip", 10.0, 0.0), ("tanh", 2.5, 0.0), ("clip", 40.0, 0.5)):
        net = made(scale=1e4, output=output, washout=np.full(6, time))
        core(net, rate)
        env = make(net, control="core")
        env.reset(seed=1)
        learned, rng, last, largest, reached = Learned(env), np.random.default_rng(0), np.zeros(6), 0.0, 0.0
        for _ in range(100):
            learned.look(replace(env.seen, joint_position=rng.normal(size=16), velocity_w=rng.normal(size=3)))
            learned.act()
            action = learned.action[:6].copy()
            largest, reached = max(largest, np.abs(action - last).max()), max(reached, np.abs(action).max())
            last = action
        assert largest == pytest.approx(rate / CONTROL_RATE, abs=1e-12)
        assert reached <= 1.0
        assert reached > 0.99 if rate >= 10.0 else reached > 0.3


@pytest.mark.parametrize("name", ["wrench", "wrench and joints", "washed wrench and joints", "gait and legs"])
def test_numbers_that_are_not_finite_count_as_zero_and_are_not_stored(core, name):
    net = made(**NETS[name])
    core(net)
    env = make(net, control="core")
    observation, _ = env.reset(seed=2)
    learned, size, poisoned = Learned(env), len(net.biases[-1]), 0
    slow = learned.own["policy"]["slow"]
    keep = 1.0 - Washout(net.washout if net.washout.any() else np.zeros(size)).share
    places = ("position_w", "quat_wb", "omega_b", "joint_position", "joint_velocity", "vectoring")
    for k in range(40):
        good, last, fade = env.seen, learned.action[:size].copy(), keep * slow[:size]
        wild = (np.nan, np.inf, -np.inf, 1e300)[k // 10]
        place = places[k // 2 % len(places)]
        learned.look(good if k % 2 else replace(good, **{place: np.full(np.shape(getattr(good, place)), wild)}))
        residual = learned.act()
        action = learned.action[:size]
        assert np.isfinite(action).all()
        assert np.abs(action).max() <= 1.0
        assert np.abs(action - last).max() <= RATE / CONTROL_RATE + 1e-12
        assert all(np.isfinite(residual[field]).all() for field in residual.views)
        if np.isnan(learned.seen[: len(observation)]).any():
            assert k % 2 == 0, "an invalid state does not affect later ones"
            poisoned += 1
            np.testing.assert_allclose(action, np.clip(-fade, last - 0.25, last + 0.25), atol=1e-12)
        observation = env.step(np.zeros(size))[0]
    assert poisoned > 3


def test_a_network_that_overflows_stays_within_the_bounds(core):
    net = made(scale=1e30, activation="relu")
    core(net)
    env = make(net, control="core")
    env.reset(seed=2)
    learned = Learned(env)
    for _ in range(10):
        learned.look()
        learned.act()
        assert np.abs(learned.action).max() <= 1.0


def silenced(net):
    """Return a policy whose output is 0."""
    last = (0.0 * net.weights[-1], 0.0 * net.biases[-1])
    return replace(net, weights=(*net.weights[:-1], last[0]), biases=(*net.biases[:-1], last[1]))


@pytest.mark.parametrize("name", ["wrench and joints", "rotor forces", "gait and legs"])
@pytest.mark.parametrize("silent", [False, True])
def test_no_policy_and_one_that_is_silent_change_no_bit_of_a_command(core, name, silent):
    net = made(**NETS[name])
    core(silenced(net) if silent else None)
    env = make(net)
    env.reset(seed=4)
    neutral, (learned, plain) = Struct("residual"), (Learned(env, beside(env)) for _ in range(2))
    fill(neutral.record, NO_RESIDUAL)
    for _ in range(60):
        learned.look()
        plain.look()
        residual = learned.act()
        if not silent:
            assert residual.record.tobytes() == neutral.record.tobytes()
        assert learned.command(residual).tobytes() == plain.command(None).tobytes()
        env.step(np.zeros(len(net.biases[-1])))


def test_a_policy_has_its_environments_kind_and_a_zero_residual_elsewhere(core):
    kinds = {}
    for name, net in (
        ("none", None),
        (HOVER, made()),
        (CRAWL, made(CRAWL, "residual_gait")),
        ("direct", in_torso_axes()),
    ):
        core(net)
        for env_id in (HOVER, CRAWL):
            env = gymnasium.make(env_id, control="core").unwrapped
            env.reset(seed=0)
            learned = Learned(env)
            learned.look()
            residual, neutral = learned.act(), Struct("residual")
            fill(neutral.record, NO_RESIDUAL)
            assert (residual.record.tobytes() == neutral.record.tobytes()) == (name != env_id)
            kinds[name] = learned.library.sp_policy_kind()
    assert kinds == {"none": -1, HOVER: 0, CRAWL: 1, "direct": 2}


def test_every_mode_that_adds_to_a_controller_means_the_same_onboard(core):
    """Every mode is run with an action far from 0, which the biases of the last layer alone determine."""
    for env_id, modes in ((HOVER, ACTION_MODES), (CRAWL, CRAWL_MODES)):
        env = gymnasium.make(env_id, control="python").unwrapped
        env.reset(seed=0)
        for mode in (name for name, mode in modes.items() if mode.residual is not None):
            net = silenced(made(env_id, mode))
            bias = np.random.default_rng(1).uniform(-0.9, 0.9, len(net.biases[-1])).astype(np.float32)
            net = replace(net, biases=(*net.biases[:-1], bias))
            core(net, 1000.0)
            learned = Learned(env, beside(env))
            learned.look()
            residual, expected = learned.act().record, residual_of(net, bias.astype(float)).record
            assert apart(residual, expected) == 0.0, mode
            untouched = Struct("residual")
            fill(untouched.record, Residual())
            assert apart(residual, untouched.record) > 0.1
            core(replace(net, arguments={**net.arguments, "action_scale": {"share": 0.5}}), 1000.0)
            learned = Learned(env, beside(env))
            learned.look()
            assert apart(learned.act().record, residual_of(net, 0.5 * bias.astype(float)).record) == 0.0, mode
