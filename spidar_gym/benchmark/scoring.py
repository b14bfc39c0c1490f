"""Complete runs of scenarios and the metrics of a policy in them."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.utils.seeding import np_random

from spidar_gym.benchmark.scenario import Scenario, check_drawn, make_env, reset_options
from spidar_gym.benchmark.tally import FleetWatch, Tally
from spidar_gym.benchmark.track import REST_S, Track, find_track
from spidar_gym.control.course.gates import parse_course
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.grasp.scene import parse_scene
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.progress import PROGRESS, AnyProgress, FlightProgress
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.actor import Actor
from spidar_gym.policies.policy import BatchPolicy, Policy, control_of, policy_arguments
from spidar_gym.policies.rollout import rollout
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.tasks.start import FlightStart

ACT_LIMIT_S = 10.0
"""Largest time of a policy for one action [s]."""
CONTROL = "core"
"""Implementation of the controller for rows, except rows with a custom allocator or control law."""


def play_scenario(
    policy: Policy,
    name: str,
    scenario: Scenario,
    *,
    act_limit_s: float = ACT_LIMIT_S,
    control: str = CONTROL,
    track: Track | None = None,
    run: int = 0,
    on_tick: Callable[[dict[str, Any]], object] = lambda _: None,
) -> dict[str, Any]:
    """Run one complete scenario of a track in a new environment.

    Args:
        policy: Policy.
        name: Track.
        scenario: Scenario.
        act_limit_s: Largest time of the policy for one action [s].
        control: `core`, which rows use, or `python`, which is slower and equal to about 1e-12. A policy with a custom
            allocator or law always uses `python`.
        track: Definition of `name` if it is not a track of the benchmark.
        run: Number of the run, the policy's seed. It is the same in all scenarios, so that the seed reveals nothing
            about the scenario.
        on_tick: Called with the `info` of each tick.

    Returns:
        `metrics`: the `METRICS` by name (None where not defined), and `timing`: median and 99th percentile of the times
        of the policy's actions and of whole steps [s], wall time [s].

    Raises:
        PolicyError: When the policy raises, returns an invalid action, or exceeds the time limit.
        InvalidValueError: When the policy is not defined on this track.
    """
    begin = time.perf_counter()
    track = track or find_track(name)
    env = make_env(track, scenario, _arguments(policy, name, track, control))
    place = f"{name}, scenario {scenario.index}"
    actor = Actor(policy, env.action_space.shape or (), place, limit_s=act_limit_s)
    steps = rollout(
        env,
        actor,
        seed=scenario.seed,
        policy_seed=run,
        options=reset_options(scenario),
        ticks=_steps_of(track.seconds, env),
        until_finished=False,
    )
    check_drawn(env.sampled_parameters, scenario, place)
    watch, tally = FleetWatch(env.fleet, env.failures), Tally(1, track.settle)
    times: list[float] = []
    info: dict[str, Any] = {}
    rest, only = _steps_of(REST_S, env), np.zeros(1, int)
    for step in steps:
        info = step.info
        times.append(step.seconds)
        tally.count(watch.look(only), only)
        on_tick(info)
        rest -= step.finished
        if rest <= 0:
            break
    metrics = tally.metrics(0, info, env.progress)
    env.close()
    return {"metrics": metrics, "timing": _timing(actor.times, times, time.perf_counter() - begin, 1)}


def play_scenarios(
    policy: BatchPolicy,
    name: str,
    scenarios: Sequence[Scenario],
    *,
    act_limit_s: float = ACT_LIMIT_S,
    control: str = CONTROL,
    track: Track | None = None,
    run: int = 0,
) -> list[dict[str, Any]]:
    """Run scenarios of a track side by side in the engine, bit for bit as `play_scenario` does one by one.

    Args:
        policy: Policy that acts for all scenarios at once.
        name: Track.
        scenarios: Scenarios.
        act_limit_s: Largest time of the policy for one action of one scenario [s].
        control: As in `play_scenario`; with `python` the scenarios run one by one.
        track: As in `play_scenario`.
        run: As in `play_scenario`.

    Returns:
        Result of `play_scenario` for each scenario; times are divided by the number of scenarios.

    Raises:
        PolicyError: When the policy raises, returns invalid actions, or exceeds the time limit.
        InvalidValueError: When the policy is not defined on this track.
    """
    begin = time.perf_counter()
    track, count = track or find_track(name), len(scenarios)
    arguments = _arguments(policy, name, track, control)
    # Without options or robots of the scenarios' own, the rules of one environment hold for all scenarios.
    own = bool(track.ranges) or track.robots(0) != track.robots(1)
    envs = [make_env(track, scenario, arguments) for scenario in (scenarios if own else scenarios[:1])]
    env = envs[0]
    if arguments["control"] != CONTROL:
        how: dict[str, Any] = {"act_limit_s": act_limit_s, "control": control, "track": track, "run": run}
        return [play_scenario(policy, name, one, **how) for one in scenarios]
    rules = np.stack([each.rules() for each in envs]) if own else None
    for each in envs:
        each.close()
    fleet = env.make_fleet(count, rules=rules)
    place = f"{name}, scenarios {scenarios[0].index} … {scenarios[-1].index}"
    actor = Actor(policy, (count, *(env.action_space.shape or ())), place, limit_s=act_limit_s * count)
    for k, scenario in enumerate(scenarios):
        options = reset_options(scenario)
        if "scene" in options:
            fleet.set_scene(k, parse_scene(options["scene"]))
        fleet.disturb(k, Disturbances.parse(options["disturbances"]))
        if "start" in options:
            fleet.begin_with(k, FlightStart.parse(options["start"]))
        if "course" in options:
            fleet.go(k, parse_course(options["course"]))
        fleet.seed(k, np_random(scenario.seed)[0])
    fleet.reset()
    for k, scenario in enumerate(scenarios):
        check_drawn(env.sampled(fleet, k), scenario, f"{name}, scenario {scenario.index}")
    actor.reset_batch([run] * count)
    watch, tally = FleetWatch(fleet, env.failures), Tally(count, track.settle)
    times = _fly(fleet, watch, actor, tally, _steps_of(track.seconds, env), _steps_of(REST_S, env))
    metrics = [tally.metrics(k, env.tell(fleet, k), _progress(fleet, k)) for k in range(count)]
    fleet.close()
    wall = time.perf_counter() - begin
    return [{"metrics": own, "timing": _timing(actor.times, times, wall, count)} for own in metrics]


def _fly(
    fleet: Fleet, watch: FleetWatch, actor: Actor, tally: Tally, steps: int, rest_steps: int
) -> list[float]:  # fmt: skip
    """Step the robots until all episodes have ended, counting in the tally; returns the times of the steps [s]."""
    count, times = len(fleet.robots), list[float]()
    rest, ids = np.full(count, rest_steps), np.arange(count)
    for _ in range(steps):
        # A copy, so that the policy cannot change the fleet's observations.
        fleet.actions[:] = actor.act_batch(fleet.observations.copy())
        begin = time.perf_counter()
        fleet.step(ids)
        times.append(time.perf_counter() - begin)
        look = watch.look(ids)
        tally.count(look, ids)
        rest[ids] -= look.finished
        ids = ids[(rest[ids] > 0) & ~fleet.terminated[ids]]
        if not ids.size:
            break
    return times


def _arguments(policy: Policy, name: str, track: Track, control: str) -> dict[str, Any]:
    """Return the policy's arguments of the environment, with the implementation of the controller."""
    arguments = policy_arguments(policy, track.env_id)
    if arguments is None:
        raise InvalidValueError("track", name, "a track on which the policy is defined")
    return {**arguments, "control": control_of(arguments, control)}


def _steps_of(seconds: float, env: SpidarEnv) -> int:
    """Return the number of environment steps in a duration."""
    return round(seconds * CONTROL_RATE / env.hold)


def _progress(fleet: Fleet, robot: int) -> AnyProgress:
    """Return the progress of a robot's episode."""
    record = fleet.robots[robot]
    if fleet.kind == "hover":
        return FlightProgress.read(record, fleet.goals[robot])
    return PROGRESS[fleet.kind].read(record)


def _timing(acts: Sequence[float], steps: Sequence[float], wall: float, share: int) -> dict[str, Any]:
    """Return a scenario's share of the times of `share` scenarios [s]."""
    return {
        "act_s": (np.percentile(acts, [50, 99]) / share).tolist(),
        "step_s": (np.percentile(steps, [50, 99]) / share).tolist(),
        "wall_s": wall / share,
    }
