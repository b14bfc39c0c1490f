"""`spidar run`: run episodes of a controller or a policy, and show or record them."""

import math
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro

from spidar_gym import viz
from spidar_gym.arguments import AnyPresetArg, CameraArg, Flag, choice
from spidar_gym.benchmark.scoring import ACT_LIMIT_S
from spidar_gym.console import progress
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import SCHEDULES
from spidar_gym.envs.actions import ACTION_MODES, COURSE_MODES, CRAWL_MODES
from spidar_gym.envs.course_env import CourseEnv
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.grasp_env import GraspEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.observations import OBSERVATIONS
from spidar_gym.envs.registry import COURSE, Entry, environment
from spidar_gym.envs.suite import SUITE, SUITE_IDS, SuiteTask
from spidar_gym.errors import InvalidValueError, require_least, require_name
from spidar_gym.files import output_folder
from spidar_gym.logs.mcap import mcap_library, write_mcap
from spidar_gym.logs.simulation import Recorder
from spidar_gym.native.engine_structs import HEADINGS, PATHS
from spidar_gym.policies.actor import Actor
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import (
    Policy,
    defined_on,
    policy_arguments,
    policy_name,
    require_robot,
    require_spaces,
)
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.policies.rollout import Step, rollout
from spidar_gym.policies.source import ZIP, load_module, split_name
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.ground import TERRAINS
from spidar_gym.sim.renderer import require_display
from spidar_gym.sim.stage import FIXED, VIEWS
from spidar_gym.tasks.course import DECIDE
from spidar_gym.tasks.hover import SEQUENCES

ModeArg = Annotated[str | None, choice({**ACTION_MODES, **CRAWL_MODES, **COURSE_MODES})]
FormsArg = Annotated[str | None, choice(SEQUENCES)]
PathArg = Annotated[str | None, choice(PATHS[1:])]
HeadingArg = Annotated[str | None, choice(HEADINGS)]
ScheduleArg = Annotated[str | None, choice(SCHEDULES)]
ObservationArg = Annotated[str | None, choice(OBSERVATIONS)]
TerrainArg = Annotated[str | None, choice(TERRAINS)]
UNDISTURBED = Disturbances()
COURSE_HOLD, COURSE_PACE = 4, 6.0
"""Control periods per step of a course, and speed of its video as a multiple of real time."""


@dataclass(frozen=True)
class TaskOptions:
    """Arguments of `gym.make` that define the task; only those that are given are passed."""

    preset: AnyPresetArg = None
    """Controller preset; the environment's default if not given."""
    task: str | None = None
    """Custom task, module:Class, instead of the environment's task; its module is imported (hover, path, crawl)."""
    action_mode: ModeArg = None
    """Action mode: the meaning of an action; the environment's default if not given."""
    observation: ObservationArg = None
    """Observation: values available on the robot; goal adds the goal, asymmetric privileged values for a critic."""
    joint_speed: float | None = None
    """Joint speed [rad/s]; the controller's default if not given."""
    forms: FormsArg = None
    """Form sequence (hover and path)."""
    path: PathArg = None
    """Shape of the path (path)."""
    speed: float | None = None
    """Speed along the path [m/s]; sampled if not given (path)."""
    heading: HeadingArg = None
    """Heading on the path: kept, along the path, or mixed, both equally often (path)."""
    distance: float | None = None
    """Distance to the goal [m]; sampled if not given, like --direction and --turn (crawl)."""
    direction: float | None = None
    """Direction of the goal, 0 ahead, 90 to the left [degrees; radians in gymnasium.make] (crawl)."""
    turn: float | None = None
    """Change of heading from start to goal [degrees; radians in gymnasium.make] (crawl)."""
    schedule: ScheduleArg = None
    """Phases of the gait: one after the other, or overlapped (crawl)."""
    friction: float | None = None
    """Sliding friction coefficient of the feet (crawl)."""
    slope: float | None = None
    """Slope of the floor [degrees; radians in gymnasium.make] (crawl)."""
    steps: float | None = None
    """Height of the steps of a floor of tiles or stairs [m] (crawl)."""
    terrain: TerrainArg = None
    """Floor for --steps: tiles of random heights, stairs, or mixed, both equally often (crawl)."""

    @property
    def given(self) -> dict[str, Any]:
        """The given arguments, angles in radians."""
        found = {name: value for name, value in vars(self).items() if value is not None}
        return found | {name: math.radians(found[name]) for name in ("direction", "turn", "slope") if name in found}


def run(
    env_id: tyro.conf.Positional[str] = "spidar_gym/Hover-v0",
    policy: str | None = None,
    against: str | None = None,
    trust: Flag = False,
    episodes: int = 1,
    seed: int = 0,
    task: Annotated[TaskOptions, tyro.conf.arg(name="")] = TaskOptions(),
    seconds: float | None = None,
    wake: bool = True,
    sensors: Flag = False,
    robot: Path | None = None,
    randomization: float | Path = 0.0,
    disturbances: Annotated[Disturbances, tyro.conf.arg(name="")] = UNDISTURBED,
    camera: CameraArg = FIXED,
    out: Path | None = None,
    log: Path | None = None,
    show: Flag = False,
) -> None:
    """Run episodes of a controller or a policy; print errors and success, and show or record the episodes.

    Without --policy all actions are zero, so that the controller acts alone.


    Args:
        env_id: Environment, or a task of the suite such as spidar_suite/Hover-v1, whose episodes are always its own.
        policy: module:Class, a learned policy's artifact, or with --trust a zip of Stable-Baselines3.
            The policy selects its controller.
        against: Second policy, evaluated on the same episodes; the video shows both side by side.
        trust: Load zips saved by Stable-Baselines3. They can run any code: use only files that you trust.
        episodes: Number of episodes.
        seed: Seed of the first episode; it increases by 1 per episode.
        seconds: Length of an episode [s]; the environment's default if not given.
        wake: Simulate the rotors' wakes, which reduce the thrust of other rotors.
        sensors: Pass the controller estimates from noisy sensors instead of the true state.
        robot: TOML file of a custom robot: values of RobotSpec's fields by name.
        randomization: Strength of the domain randomisation, 0 … 1; a TOML file of ranges by field; or a calibrated
            world, calibrated_1, or one kind of its robots, calibrated_1:wake-damped.
        out: Video file to write (.mp4).
        log: Log of one episode to write (.mcap): true state, commands and, with --sensors, samples and estimates.
        show: Show the episodes in a window, which requires a display.
    """
    fixed = SUITE.get(SUITE_IDS.get(env_id, ""))
    env_id = env_id if fixed is None else fixed.env_id
    entry = _check_run(env_id, episodes, seed, camera, seconds, out, show)
    _check_log(log, alone=episodes == 1 and against is None)
    shared: dict[str, Any] = {
        "wake": wake, "sensors": sensors, "disturbances": disturbances, "render_mode": "human" if show else None,
        **({} if robot is None else {"robot": RobotSpec.parse(robot)}),
        **({"randomization": randomization} if fixed is None or randomization else {}),
    }  # fmt: skip
    duration = seconds if seconds is not None else entry.seconds if fixed is None else fixed.seconds
    with ExitStack() as stack:
        players = [
            _player(stack, env_id, fixed, spec, trust, task.given, shared, duration)
            for spec in ((policy,) if against is None else (policy, against))
        ]
        film = None
        if out is not None:
            output_folder(out.parent)
            film = stack.enter_context(viz.Film(out, camera=camera))
        counts = np.zeros((len(players), 3), int)
        for episode in range(episodes):
            takes = []
            for k, player in enumerate(players):
                name = f"{player.name}, " if len(players) > 1 else ""
                steps, take = _episode(player, seed + episode, f"{name}episode {episode + 1}", film is not None, log)
                last = steps[-1].info
                finite = _is_finite(steps[-1].next_observation)
                counts[k] += (not last["failure"], bool(last["is_success"]), bool(finite))
                summary = _summary(steps, player.inner.hold / CONTROL_RATE)
                print(f"{name}episode {episode + 1} (seed {seed + episode}): {summary}")
                takes += [] if take is None else [take]
            if film is not None and takes:
                film.shoot(*takes, frames=partial(progress, unit="frame", desc="video", leave=False))
        stayed = "stayed in the air" if isinstance(players[0].inner, HoverEnv) else "without failure"
        for player, (survived, succeeded, finite) in zip(players, counts.tolist(), strict=True):
            if episodes > 1:
                name = f"{player.name}: " if len(players) > 1 else ""
                print(f"{name}{survived} of {episodes} {stayed}, {succeeded} successful, {finite} with finite values")


def _is_finite(shown: Any) -> bool:  # noqa: ANN401 - an array, or a dictionary of them
    return all(np.isfinite(part).all() for part in (shown.values() if isinstance(shown, dict) else (shown,)))


@dataclass(frozen=True)
class _Player:
    """A policy with its environment."""

    name: str
    env: gymnasium.Env
    actor: Actor

    @property
    def inner(self) -> SpidarEnv:
        """The environment without its wrappers."""
        inner = self.env.unwrapped
        assert isinstance(inner, SpidarEnv)
        return inner


def _player(
    stack: ExitStack, env_id: str, fixed: SuiteTask | None, spec: str | None, trust: bool, given: dict[str, Any],
    shared: dict[str, Any], seconds: float,
) -> _Player:  # fmt: skip
    """Build a policy, or the controller alone, with its environment, which the stack closes.

    Args:
        stack: Closes the environment.
        env_id: Environment.
        fixed: Task of the suite, whose arguments hold where no others are given.
        spec: The policy.
        trust: Whether it may be a zip.
        given: The user's arguments of the task.
        shared: Arguments that all players share.
        seconds: Length of an episode [s].
    """
    if trust and spec is not None and spec.endswith(ZIP):
        print(f"spidar: warning: {spec} is trusted: any code in it is run", file=sys.__stderr__)
    policy = None if spec is None else load_policy(spec, trust=trust)
    if "task" in given:
        load_module(split_name("task", given["task"])[0])  # from the working folder
    own: dict[str, Any] = {}
    if fixed is None and env_id == COURSE:
        own = {"hold": COURSE_HOLD}
        if policy is None:  # zero residuals follow the rule
            given = {"action_mode": "residual", **given}
    chosen = chosen_arguments(policy, spec, env_id, given)
    arguments = {**own, **({} if fixed is None else fixed.options_of(chosen)), **given, **chosen, **shared}
    period = arguments.get("hold", DECIDE if env_id == COURSE else 1) / CONTROL_RATE
    horizon = round(seconds / period)
    env = gymnasium.make(env_id, **{**arguments, "horizon_s": horizon * period, "max_episode_steps": horizon})
    stack.callback(env.close)
    if policy is not None:
        require_robot(policy, env_id, shared.get("robot", ROBOT))
        require_spaces(policy, env_id, env)
    name = f"preset {given['preset']}" if "preset" in given else "controller alone"
    actor = Actor(policy or PresetPolicy(), env.action_space.shape or (), env_id, limit_s=ACT_LIMIT_S)
    return _Player(name if policy is None else policy_name(policy), env, actor)


def _episode(
    player: _Player, seed: int, label: str, filmed: bool, log: Path | None
) -> tuple[list[Step], viz.Take | None]:
    """Run one episode; if it is filmed, collect its take, and if it is logged, write the log."""
    inner = player.inner
    recorder = None if log is None else Recorder(player.env)
    steps = rollout(player.env, player.actor, seed=seed)
    if recorder is not None:
        recorder.add()
    played: list[Step] = []
    seen: list[tuple[np.ndarray, str, np.ndarray | None]] = []
    # A crawl ends at its goal. The bar has the planned length and grows tick by tick when the crawl is slower.
    planned = inner.horizon
    if isinstance(inner, CrawlEnv):
        planned = min(planned, round(inner.progress.nominal_time * CONTROL_RATE / inner.hold))
    with progress(total=planned, unit="tick", desc=label, leave=False) as bar:
        for step in steps:
            played.append(step)
            if recorder is not None:
                recorder.add()
            bar.total = max(planned, bar.n + 1)
            bar.update()
            qpos = inner.plant.data.qpos
            if filmed and np.isfinite(qpos).all():
                contacts = inner.plant.contact_forces() if inner.plant.in_contact else None
                seen.append((qpos.copy(), _phase(inner, step.info), contacts))
    if recorder is not None and log is not None:
        write_mcap(recorder.record(), log)
    return played, _take(player, [step.info for step in played[: len(seen)]], seen) if seen else None


def _phase(inner: SpidarEnv, info: dict[str, Any]) -> str:
    """Return the phase: of the crawl, of the course with its form, or whether the flight's joint targets change."""
    if isinstance(inner, CourseEnv) and inner.target is not None and inner.target.flies:
        return f"{info['phase']}, {inner.target.narrow:.0%} narrow"
    if isinstance(inner, GraspEnv) and info["phase"] == "grasp":
        return f"{info['grasp_phase'].replace('_', ' ')}, {info['payload_kg']:.1f} kg"
    if not isinstance(inner, HoverEnv):
        return str(info["phase"])
    return "hover" if np.array_equal(inner.progress.plan(), inner.progress.goal.joint_target) else "legs move"


def _take(
    player: _Player, infos: list[dict[str, Any]], seen: list[tuple[np.ndarray, str, np.ndarray | None]]
) -> viz.Take:
    """Build the take of an episode for the video."""
    rows, phases, contacts = zip(*seen, strict=True)
    qpos = np.array(rows)
    if isinstance(player.inner, HoverEnv):
        errors = (np.array([info[f"{name}_error"] for info in infos]) for name in ("position", "attitude"))
        traces = viz.flight_traces(qpos, *errors, robot=player.inner.robot)
    elif isinstance(player.inner, CourseEnv):
        values = (np.array([info[name] for info in infos]) for name in ("thrust_fraction", "charge"))
        traces = viz.course_traces(qpos, *values)
    elif isinstance(player.inner, GraspEnv):
        names = ("grip_n", "force_n", "thrust_fraction")
        traces = viz.grasp_traces(qpos, *(np.array([info[name] for info in infos]) for name in names))
    else:
        traces = viz.crawl_traces(qpos)
    robot, time = player.inner.robot, np.arange(1, len(qpos) + 1) * player.inner.hold / CONTROL_RATE
    thrust = np.array([info["thrust"] for info in infos])
    pace = COURSE_PACE if isinstance(player.inner, CourseEnv) else 1.0
    config = player.inner.plant.config
    return viz.Take(
        player.name, time, qpos, thrust, phases, traces, contacts, config.ground, pace, robot, config.object
    )


def _summary(steps: list[Step], period: float) -> str:
    """Return the result of an episode in words; each step takes `period` [s]."""
    last = steps[-1].info
    return (
        f"{len(steps) * period:.1f} s, mean reward {np.mean([step.reward for step in steps]):.3f}, "
        f"{_errors([step.info for step in steps])}, "
        + (f"failure: {last['failure']}" if last["failure"] else f"success: {last['is_success']}")
        + (f" ({last['shortfalls']})" if last.get("shortfalls") else "")
    )


def chosen_arguments(policy: Policy | None, spec: str | None, env_id: str, given: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `gym.make` that a policy selects; they must not be `given` as well."""
    if policy is None:
        return {}
    chosen = policy_arguments(policy, env_id)
    if chosen is None:
        found = ", ".join(defined_on(policy)) or "none"
        raise InvalidValueError("policy", spec, f"one for {env_id}; this one is for {found}")
    for name in chosen:
        if name in given:
            raise InvalidValueError(name, given[name], f"no value with this policy, which selects {chosen[name]}")
    return chosen


def _errors(infos: list[dict[str, Any]]) -> str:
    """Return an episode's errors in words."""
    last = infos[-1]
    if "object_error" in last:
        x, y, z = (1e3 * last["object_error"]).tolist()
        lifted = max(info["lifted_m"] for info in infos)
        return (
            f"object off by {x:.1f}, {y:.1f}, {z:.1f} mm, {1e3 * last['yaw_error_rad']:.1f} mrad, "
            f"lifted by {lifted:.2f} m, largest force of a foot {last['most_force_n']:.0f} N, "
            f"grasps begun: {last['tries']}"
        )
    if "goal_error" in last:
        x, y, yaw = (1e3 * last["goal_error"]).tolist()
        if "charge" in last:
            return (
                f"goal off by {x:.1f}, {y:.1f} mm, {yaw:.1f} mrad, {last['flown_s']:.0f} s in the air, "
                f"{last['crawled_s']:.0f} s crawled, {last['charge']:.0%} of the battery left"
            )
        slip = 1e3 * last["foot_slip_m"]
        return f"goal off by {x:.1f}, {y:.1f} mm, {yaw:.1f} mrad, worst foot slid {slip:.0f} mm"
    errors = np.array([np.concatenate([info["position_error"], info["attitude_error"]]) for info in infos])
    rms = np.sqrt((errors**2).sum(axis=0) / len(errors))
    position, attitude = 1e3 * np.linalg.norm(rms[:3]), 1e3 * np.linalg.norm(rms[3:])
    sunk = 1e3 * max(0.0, float(errors[:, 2].max()))
    return f"RMS position {position:.1f} mm, attitude {attitude:.1f} mrad, sank by {sunk:.1f} mm at most"


def _check_run(
    env_id: str, episodes: int, seed: int, camera: str, seconds: float | None, out: Path | None, show: bool
) -> Entry:
    """Check the arguments of `run`, and return the environment's entry."""
    entry = environment(env_id)
    require_least(1, episodes=episodes)
    require_least(0, seed=seed)
    require_name("camera", camera, VIEWS)
    if seconds is not None and not 1.0 / CONTROL_RATE <= seconds < math.inf:
        raise InvalidValueError("seconds", seconds, f"at least one tick, {1 / CONTROL_RATE:g} s, and finite")
    if out is not None and (out.suffix != ".mp4" or out.is_dir()):
        raise InvalidValueError("out", str(out), "a path of a file that ends in .mp4")
    if show:
        require_display()
    return entry


def _check_log(log: Path | None, *, alone: bool) -> None:
    """Check the argument `log`; `alone` is whether one episode of one policy is run."""
    if log is None:
        return
    if log.suffix != ".mcap" or log.is_dir():
        raise InvalidValueError("log", str(log), "a path of a file that ends in .mcap")
    if not alone:
        raise InvalidValueError("log", str(log), "no log, or one episode without --against")
    mcap_library()  # raises without the library
