"""`spidar bench`: measure the time of a control tick and of an environment step, part by part, on this machine."""

import platform
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np

import spidar_gym.envs.registry
from spidar_gym.cli.bench_in_turn import TURNS, WARM, effect_lines, effects, grasp_lines, grasps, took
from spidar_gym.control.allocation.allocator import Allocator
from spidar_gym.control.allocation.modes import find_allocation
from spidar_gym.control.allocation.problem import Demand, assemble
from spidar_gym.control.allocation.solver import closed_form
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import COURSE
from spidar_gym.native.bare import BarePhysics
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot import FORMS, N_ROTORS, ROBOT
from spidar_gym.so3 import exp
from spidar_gym.text import format_table

KINDS: dict[str, dict[str, Any]] = {
    "Hover": {"id": "spidar_gym/Hover-v0"},
    "Hover, drawn, sensors": {"id": "spidar_gym/Hover-v0", "randomization": 1.0, "sensors": True},
    "Crawl": {"id": "spidar_gym/Crawl-v0"},
    "Course, on the floor": {"id": COURSE, "action_mode": "residual", "gates": ("beam",), "count": (1, 1)},
    "Course, in the air": {"id": COURSE, "action_mode": "residual", "gates": ("wall", "slot")},
}
"""Environments whose engine is timed beside the bare physics of the same robots.

On a course, zero actions follow the targets of the rule, `course_rule`.
"""
CROWDS = ((1, 1), (64, 1), (64, 2), (256, 1), (256, 2))
"""Numbers of robots and threads; a single robot is an environment of `gymnasium.make`."""
PARTS = 11 + len(KINDS) * len(CROWDS)
"""Number of progress steps of `run_bench`."""
PAIRS: dict[str, dict[str, Any]] = {
    "independent": {"forms": "independent"},
    "narrow": {"forms": "narrow"},
    "fast, tuned": {"forms": "independent", "preset": "tuned", "joint_speed": 1.0},
    "crawl": {"id": "spidar_gym/Crawl-v0", "distance": 0.6, "direction": 0.0, "turn": 0.0},
}
"""Environments in which the Python and the compiled controller are timed in turn, in the same run."""
ROUNDS = 5
"""Repetitions of each of `PAIRS`."""
HOT = 20
"""Timed control steps of the simulation that stays in the cache."""
CLIMB = 240
"""Control steps before timing of robots that have to take off first."""
HARD_STATES = 400
"""Number of hard states on which the solver is timed."""


def measure(
    function: Callable[[], object], *, seconds: float = 0.5, before: Callable[[], object] = lambda: None
) -> dict[str, float]:
    """Call `function` repeatedly for about `seconds` and summarise its durations, without those of `before`."""
    durations = []
    before()
    function()
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        before()
        start = time.perf_counter()
        function()
        durations.append(time.perf_counter() - start)
    return summary(durations)


def summary(durations: list[float]) -> dict[str, float]:
    """Return median, 99th percentile and minimum [µs] of durations [s]."""
    us = 1e6 * np.array(durations)
    return {"median": float(np.median(us)), "p99": float(np.percentile(us, 99)), "best": float(us.min())}


def hard_demands(rng: np.random.Generator, count: int) -> list[Demand]:
    """Sample demands with large wrenches in random forms: many active constraints, some demands infeasible."""
    controller = FlightController(ControllerConfig(allocation="paper"))
    demands = []
    for _ in range(count):
        q = rng.uniform(np.tile((-0.5, -0.2, -0.5, 0.0), 4), np.tile((0.5, 0.8, 0.5, 1.4), 4))
        if rng.random() < 0.4:
            q = FORMS[f"form{rng.integers(1, 4)}"] + rng.uniform(-0.05, 0.05, 16)
        R_wb = exp(rng.uniform(-0.2, 0.2, 3))
        vectoring = controller.rest_vectoring(q)
        wrench = rng.uniform(-1.0, 1.0, 6) * np.array([60.0, 60.0, 60.0, 15.0, 15.0, 15.0])
        wrench[2] += ROBOT.weight
        demands.append(controller.demand_at(q, R_wb, vectoring, wrench))
    return demands


def run_bench(*, seconds: float = 0.5, on_step: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Run all measurements and return them as one dictionary.

    The names of times end in their unit; median, 99th percentile and minimum below a name share this unit.
    """
    spidar_gym.envs.registry.register()
    result: dict[str, Any] = {"machine": machine()}
    on_step("reference")
    x = np.arange(8.0)
    result["numpy_add_us"] = measure(lambda: x + x, seconds=seconds / 5)
    for preset_name in ("as_flown", "paper"):
        block: dict[str, Any] = {}
        for form in FORMS:
            on_step(f"{preset_name} {form}")
            block[form] = _form(preset_name, form, seconds)
        result[preset_name] = block
    on_step("hard states")
    result["hard_states"] = _hard()
    on_step("compiled core")
    result["core"] = _core(seconds)
    result["engine"] = [
        _crowd(name, arguments, robots, threads, seconds, on_step)
        for name, arguments in KINDS.items()
        for robots, threads in CROWDS
    ]
    on_step("effects")
    result["effects"] = effects(seconds)
    on_step("grasps")
    result["grasps"] = grasps(seconds)
    return result


def _crowd(
    name: str, arguments: dict[str, Any], robots: int, threads: int, seconds: float, on_step: Callable[[str], None]
) -> dict[str, Any]:  # fmt: skip
    """Time the engine, the bare physics of its robots, and one simulation that stays in the cache, in turn.

    Actions are zero and resets are not timed. Times are per control step of a robot [µs], medians over `TURNS`.
    """
    on_step(f"{name}, robots: {robots}, threads: {threads}")
    alone: Any = gymnasium.make(**arguments).unwrapped
    alone.reset(seed=0)
    env: Any = alone if robots == 1 else gymnasium.make_vec(num_envs=robots, num_threads=threads, **arguments)
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape)
    bare, hot = BarePhysics(env.fleet.engine, threads), BarePhysics(alone.fleet.engine, 1)
    ticks, warm = max(1, round(512 * seconds / max(robots, 12))), CLIMB if "air" in name else WARM
    times = []
    for _ in range(TURNS):
        for _ in range(warm):
            env.step(action)
        bare.take(env.fleet.engine)
        hot.take(alone.fleet.engine)
        times.append([
            took(lambda: [env.step(action) for _ in range(ticks)], ticks * robots),
            took(lambda: bare.step(ticks), ticks * robots),
            took(lambda: hot.step(HOT), HOT),
        ])  # fmt: skip
        warm = 1
    bare.close()
    for each in {id(env): env, id(alone): alone}.values():
        each.close()
    wall, cpu = np.moveaxis(np.array(times), 2, 0)
    medians = {
        f"{of}_{kind}_us": float(np.median(found[:, k]))
        for kind, found in (("wall", wall), ("cpu", cpu))
        for k, of in enumerate(("engine", "bare", "hot"))
    }
    shares = {f"of_{of}": float(np.median(cpu[:, k] / cpu[:, 0])) for k, of in ((1, "bare"), (2, "hot"))}
    return {"environment": name, "robots": robots, "threads": threads, **medians, **shares}


def engine_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the table of the engine's times beside those of the bare physics of the same robots."""
    lines = [
        ["", "robots", "threads", "steps/s", "engine [µs]", "bare physics [µs]", "of bare", "of hot", "2nd thread"]
    ]
    single = {(row["environment"], row["robots"]): row for row in rows if row["threads"] == 1}
    for row in rows:
        one, gain = single.get((row["environment"], row["robots"])), "–"
        if row["threads"] > 1 and one is not None:
            own, bare = (one[f"{of}_wall_us"] / row[f"{of}_wall_us"] for of in ("engine", "bare"))
            gain = f"{own:.2f} of {bare:.2f}"
        times = (f"{row[f'{of}_wall_us']:.0f} ({row[f'{of}_cpu_us']:.0f})" for of in ("engine", "bare"))
        shares = (f"{row['of_bare']:.2f}", f"{row['of_hot']:.2f}")
        rate = f"{1e6 / row['engine_wall_us']:.0f}"
        lines.append([row["environment"], str(row["robots"]), str(row["threads"]), rate, *times, *shares, gain])
    return lines


def _form(preset_name: str, form: str, seconds: float) -> dict[str, Any]:
    wrapped = gymnasium.make(
        "spidar_gym/Hover-v0", forms=form, preset=preset_name, control="python", max_episode_steps=10**6
    )
    env = wrapped.unwrapped
    assert isinstance(env, HoverEnv)
    for _ in rollout(wrapped, seed=0, ticks=80):
        pass
    controller, state, plant = env.controller, env.state, env.plant
    last = controller.last_step
    assert isinstance(controller, FlightController)
    assert last is not None
    control_state, demand = last.control_state, last.demand
    assert demand is not None
    reference = env.reference()
    mode = controller.allocator.modes["flight"]
    program = assemble(mode, demand)
    allocator = Allocator(controller.allocator.modes)
    forces = controller.memory.forces_l
    saved = plant.save()
    figures = {
        "snapshot_us": lambda: controller.model.snapshot(state.joint_position, control_state.R_wb, state.vectoring),
        "qp_assembly_us": lambda: assemble(mode, demand),
        "closed_form_us": lambda: closed_form(program),
        "osqp_us": lambda: allocator.solver(mode).solve(program),
        "allocation_us": lambda: allocator.allocate(demand, "flight", forces),
        "control_tick_us": lambda: controller.step(state, reference),
    }
    timings = {name: measure(function, seconds=seconds) for name, function in figures.items()}
    tick = measure(
        lambda: mujoco.mj_step(plant.model, plant.data, 10),  # pyright: ignore[reportAttributeAccessIssue] - compiled, without stubs
        seconds=seconds,
        before=lambda: plant.restore(saved),
    )
    timings["mj_step_us"] = {name: value / 10 for name, value in tick.items()}
    wrapped.close()
    return timings


def _hard() -> dict[str, Any]:
    """Time the allocation once for every hard state, after one round that warms the caches."""
    demands = hard_demands(np.random.default_rng(0), HARD_STATES)
    allocator = Allocator(find_allocation("paper"))
    mode = allocator.modes["flight"]
    forces = np.zeros((N_ROTORS, 3))
    programs = [assemble(mode, demand) for demand in demands]
    statuses = [str(allocator.allocate(demand, "flight", forces).status) for demand in demands]
    feasible = [
        program for program, status in zip(programs, statuses, strict=True) if status in ("closed_form", "solved")
    ]
    solver = allocator.solver(mode)
    osqp, iterations, total = [], [], []
    for program in feasible:
        start = time.perf_counter()
        _, _, count, *_ = solver.solve(program)
        osqp.append(time.perf_counter() - start)
        iterations.append(count)
    for demand in demands:
        total.append(allocator.allocate(demand, "flight", forces).solve_time)
    return {
        "osqp_us": summary(osqp),
        "osqp_iterations": {"median": float(np.median(iterations)), "max": int(max(iterations))},
        "allocation_us": summary(total),
        "statuses": {status: statuses.count(status) for status in sorted(set(statuses))},
    }


def _rate(env: gymnasium.Env, ticks: int) -> float:
    """Return the environment steps per second of an episode, without reset and first tick."""
    times = [step.seconds for step in rollout(env, seed=1, ticks=1 + ticks)]
    return ticks / sum(times[1:])


def _core(seconds: float) -> dict[str, Any]:
    """Time a tick of the compiled core called from Python, and environments with either controller in turn."""
    env: Any = gymnasium.make("spidar_gym/Hover-v0", control="core", **PAIRS["narrow"]).unwrapped
    env.reset(seed=0)
    seen, reference, controller = env.seen, env.reference(), env.controller
    tick = measure(
        lambda: controller.step(seen, reference, control_state=controller.compute_state(seen, reference)),
        seconds=seconds,
    )
    env.close()
    result: dict[str, Any] = {"tick_us": tick}
    for name, arguments in PAIRS.items():
        pair = [
            gymnasium.make(**{"id": "spidar_gym/Hover-v0", "control": control, **arguments})
            for control in ("python", "core")
        ]
        rates = [[_rate(env, max(4, round(400 * seconds))) for env in pair] for _ in range(ROUNDS)]
        python, core = np.median(np.array(rates), axis=0).tolist()
        result[name] = {"python_steps_per_s": python, "core_steps_per_s": core, "ratio": core / python}
        for env in pair:
            env.close()
    return result


def machine(*more: str) -> dict[str, str]:
    """Return the processor, and the versions of Python, of packages that affect the times, and of `more` packages."""
    packages = ("gymnasium", "mujoco", "numpy", "osqp", "pin", *more)
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        names = [line.split(":")[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0] if names else cpu
    return {"cpu": cpu, "python": platform.python_version(), **{name: metadata.version(name) for name in packages}}


def part_lines(result: dict[str, Any]) -> list[list[str]]:
    """Return the table of the times of a control tick's parts in the Python controller."""
    forms = [(p, form) for p in ("as_flown", "paper") for form in FORMS]
    cells = [["median (p99) [µs]", *(f"{p} {form}" for p, form in forms)]]
    for name in next(iter(result["paper"].values())):
        timings = (result[p][form][name] for p, form in forms)
        cells.append([name.removesuffix("_us"), *(f"{t['median']:.0f} ({t['p99']:.0f})" for t in timings)])
    return cells


def bench_table(result: dict[str, Any]) -> str:
    """Return the results of `run_bench` as text."""
    machine = result["machine"]
    hard = result["hard_states"]
    lines = [
        ", ".join(f"{name} {value}" for name, value in machine.items()),
        "",
        "a control step of a robot in the engine, wall (CPU) time, zero action; bare: 10 × mj_step of the same robots, "
        "each with its own model and data; hot: 10 × mj_step of a single robot, which stays in the cache",
        format_table(engine_lines(result["engine"]), left=1),
        "",
        "a control step of a randomised robot with sensors and one effect of the calibrated world, CPU time",
        format_table(effect_lines(result["effects"]), left=1),
        "",
        "a control step of a robot of the calibrated world in flight, in a crawl and in a grasp, CPU time",
        format_table(grasp_lines(result["grasps"]), left=1),
        "",
        "the Python controller, form by form",
        format_table(part_lines(result), left=1),
        "",
        f"hard states, OSQP part: median {hard['osqp_us']['median']:.0f}, p99 {hard['osqp_us']['p99']:.0f} µs, "
        f"iterations median {hard['osqp_iterations']['median']:.0f}, max {hard['osqp_iterations']['max']}; "
        f"statuses {hard['statuses']}",
        f"one numpy addition of 8 numbers: {result['numpy_add_us']['median']:.2f} µs (a reference for the machine)",
    ]
    core = result["core"]
    pairs = (f"{name} {c['core_steps_per_s']:.0f} ({c['ratio']:.2f})" for name, c in core.items() if name in PAIRS)
    lines.append(
        f"compiled core: tick through Python {core['tick_us']['median']:.0f} ({core['tick_us']['p99']:.0f}) µs; "
        f"steps/s, and the factor over the Python controller in the same run: {', '.join(pairs)}"
    )
    return "\n".join(lines)
