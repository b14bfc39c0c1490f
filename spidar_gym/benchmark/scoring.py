"""Scenarios from their beginning to their end: what a policy did, in numbers with units."""

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
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.info import drawn
from spidar_gym.envs.progress import CourseProgress, CrawlProgress, FlightProgress
from spidar_gym.errors import InvalidValueError
from spidar_gym.policies.actor import Actor
from spidar_gym.policies.policy import BatchPolicy, Policy, control_of, policy_arguments
from spidar_gym.policies.rollout import rollout
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.tasks.start import FlightStart

ACT_LIMIT_S = 10.0
"""How long a policy may think about one action [s]."""
CONTROL = "core"
"""With which rows are made, but for those of an allocator or a law of one's own."""


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
    """Play one scenario of a track, whole, in an environment of its own.

    Args:
        policy: Who acts.
        name: Track.
        scenario: Which episode.
        act_limit_s: How long the policy may think about one action [s].
        control: `core`, with which rows are made, or `python`, which is slower and equal to some 1e-12; with an
            allocator or a law of the policy's own it is always `python`.
        track: What `name` is of, where it is none of the benchmark's tracks.
        run: Number of the run, which the policy gets as its seed: the same in all scenarios, of which it says nothing.
        on_tick: Called with the `info` of each tick.

    Returns:
        The `METRICS` by name (None where one has no meaning), and `timing`: median and 99th percentile of the policy's
        answers and of whole steps [s], wall time [s].

    Raises:
        PolicyError: When the policy raises, answers with what is no action, or takes too long.
        InvalidValueError: When it is not defined on this track.
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
    watch, tally = FleetWatch(env.fleet, env.failures), Tally(1)
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
    """Play scenarios of a track side by side in the engine, with the same bits as one by one.

    Args:
        policy: Who acts, for all of them at once.
        name: Track.
        scenarios: Which episodes.
        act_limit_s: How long the policy may think about one action of each [s].
        control: As in `play_scenario`; what is not of the engine alone is played one by one.
        track: As in `play_scenario`.
        run: As in `play_scenario`.

    Returns:
        For each what `play_scenario` gives, its timing the scenario's share.

    Raises:
        PolicyError: When the policy raises, answers with what are no actions, or takes too long.
        InvalidValueError: When it is not defined on this track.
    """
    begin = time.perf_counter()
    track, count = track or find_track(name), len(scenarios)
    arguments = _arguments(policy, name, track, control)
    # Where no option is a scenario's own, one environment knows what all of them are.
    own = bool(track.ranges)
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
        fleet.disturb(k, Disturbances.parse(options["disturbances"]))
        if "start" in options:
            fleet.begin_with(k, FlightStart.parse(options["start"]))
        if "course" in options:
            fleet.go(k, parse_course(options["course"]))
        fleet.seed(k, np_random(scenario.seed)[0])
    fleet.reset()
    for k, scenario in enumerate(scenarios):
        draws = drawn(fleet.robots[k]["episode"]["drawn"]) if track.options.get("randomization") else {}
        check_drawn(draws, scenario, f"{name}, scenario {scenario.index}")
    actor.reset_batch([run] * count)
    tally, times = _fly(
        fleet, FleetWatch(fleet, env.failures), actor, _steps_of(track.seconds, env), _steps_of(REST_S, env)
    )
    metrics = [tally.metrics(k, env.tell(fleet, k), _progress(fleet, k)) for k in range(count)]
    fleet.close()
    wall = time.perf_counter() - begin
    return [{"metrics": own, "timing": _timing(actor.times, times, wall, count)} for own in metrics]


def _fly(fleet: Fleet, watch: FleetWatch, actor: Actor, steps: int, rest_steps: int) -> tuple[Tally, list[float]]:
    """Step robots until everyone's episode is over; what was counted, and how long the steps took."""
    count = len(fleet.robots)
    tally, times = Tally(count), list[float]()
    rest, ids = np.full(count, rest_steps), np.arange(count)
    for _ in range(steps):
        # A copy: what a policy does to its observations changes nothing.
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
    return tally, times


def _arguments(policy: Policy, name: str, track: Track, control: str) -> dict[str, Any]:
    """Arguments of the environment that are the policy's choice, and who controls."""
    arguments = policy_arguments(policy, track.env_id)
    if arguments is None:
        raise InvalidValueError("track", name, "a track on which the policy is defined")
    return {**arguments, "control": control_of(arguments, control)}


def _steps_of(seconds: float, env: SpidarEnv) -> int:
    """How many steps of an environment take so long."""
    return round(seconds * CONTROL_RATE / env.hold)


def _progress(fleet: Fleet, robot: int) -> FlightProgress | CrawlProgress | CourseProgress:
    """How far a robot's episode has come."""
    record = fleet.robots[robot]
    if fleet.kind == "hover":
        return FlightProgress.read(record, fleet.goals[robot])
    return (CourseProgress if fleet.kind == "course" else CrawlProgress).read(record)


def _timing(acts: Sequence[float], steps: Sequence[float], wall: float, share: int) -> dict[str, Any]:
    """How long it took, of what so many scenarios took together [s]."""
    return {
        "act_s": (np.percentile(acts, [50, 99]) / share).tolist(),
        "step_s": (np.percentile(steps, [50, 99]) / share).tolist(),
        "wall_s": wall / share,
    }
