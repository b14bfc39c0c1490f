"""`spidar bench`: where the time of a control tick and of an environment step goes, on this machine."""

import platform
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.utils.performance import benchmark_step
from gymnasium.wrappers import TransformAction

import spidar_gym.envs.registry
from spidar_gym.control.allocation.allocator import Allocator
from spidar_gym.control.allocation.modes import find_allocation
from spidar_gym.control.allocation.problem import Demand, assemble
from spidar_gym.control.allocation.solver import closed_form
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.envs.hover.env import HoverEnv
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot import FORMS, N_ROTORS, ROBOT
from spidar_gym.sim.air import Aero
from spidar_gym.so3 import exp
from spidar_gym.text import format_table

ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "mixed": {"forms": "mixed"},
    "paper": {"forms": "paper"},
    "mixed_without_wake": {"forms": "mixed", "wake": False},
    "mixed_tuned": {"forms": "mixed", "preset": "tuned"},
    "mixed_randomised": {"forms": "mixed", "randomization": 1.0, "sensors": True},
    "crawl": {"id": "spidar_gym/Crawl-v0", "distance": 0.6, "direction": 0.0, "turn": 0.0},
    "crawl_randomised": {"id": "spidar_gym/Crawl-v0", "preset": "robust", "randomization": 1.0, "sensors": True},
}
"""Environments that are timed, by name."""
PARTS = 9 + len(ENVIRONMENTS)
"""Parts of `run_bench`."""
PAIRS: dict[str, dict[str, Any]] = {
    "independent": {"forms": "independent"},
    "narrow": {"forms": "narrow"},
    "fast, tuned": {"forms": "independent", "preset": "tuned", "joint_speed": 1.0},
    "crawl": {"id": "spidar_gym/Crawl-v0", "distance": 0.6, "direction": 0.0, "turn": 0.0},
}
"""Environments that both controllers are timed in, one after the other in the same run."""
ROUNDS = 5
"""How often either controller has its turn."""
HARD_STATES = 400
"""How many hard states the solver is timed on."""


def measure(
    function: Callable[[], object], *, seconds: float = 0.5, before: Callable[[], object] = lambda: None
) -> dict[str, float]:
    """Call `function` again and again for about `seconds` and report the durations, those of `before` left out."""
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
    """Median, 99th percentile and minimum of durations [s], in µs."""
    us = 1e6 * np.array(durations)
    return {"median": float(np.median(us)), "p99": float(np.percentile(us, 99)), "best": float(us.min())}


def hard_demands(rng: np.random.Generator, count: int) -> list[Demand]:
    """Demands with wide wrenches in random forms: many active rows, some of them infeasible."""
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
    """All figures as one dictionary; keys end in their unit, µs unless they say otherwise."""
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
    for name, arguments in ENVIRONMENTS.items():
        on_step(f"environment, {name}")
        env = gymnasium.make(**{"id": "spidar_gym/Hover-v0", **arguments})
        # Gymnasium's benchmark samples actions; the controller alone is what is timed here.
        zero = np.zeros(env.action_space.shape or (), np.float32)
        alone = TransformAction(env, lambda _, zero=zero: zero, None)
        result[f"env_steps_per_s_{name}"] = benchmark_step(alone, target_duration=max(2, round(6 * seconds)))
        env.close()
    return result


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
    aero, still = Aero(plant.model, plant.data), np.zeros(3)
    figures = {
        "air_us": lambda: aero.evaluate(state.thrust, wind_w=still, noise=np.zeros(N_ROTORS), push_w=still),
        "snapshot_us": lambda: controller.model.snapshot(state.joint_position, control_state.R_wb, state.vectoring),
        "qp_assembly_us": lambda: assemble(mode, demand),
        "closed_form_us": lambda: closed_form(program),
        "osqp_us": lambda: allocator.solver(mode).solve(program),
        "allocation_us": lambda: allocator.allocate(demand, "flight", forces),
        "control_tick_us": lambda: controller.step(state, reference),
    }
    timings = {name: measure(function, seconds=seconds) for name, function in figures.items()}
    tick = measure(
        lambda: mujoco.mj_step(plant.model, plant.data, 10),  # pyright: ignore[reportAttributeAccessIssue]
        seconds=seconds,
        before=lambda: plant.restore(saved),
    )
    timings["mj_step_us"] = {name: value / 10 for name, value in tick.items()}
    wrapped.close()
    return timings


def _hard() -> dict[str, Any]:
    """Every hard state once, after one round that warms the caches."""
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
    """Steps of an episode a second, reset and the first tick left out."""
    times = [step.seconds for step in rollout(env, seed=1, ticks=1 + ticks)]
    return ticks / sum(times[1:])


def _core(seconds: float) -> dict[str, Any]:
    """The compiled core: a whole tick through Python, and environments with either controller, in turn."""
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
    """Processor, Python and the packages that the figures depend on, and `more` of them."""
    packages = ("gymnasium", "mujoco", "numpy", "osqp", "pin", *more)
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        names = [line.split(":")[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0] if names else cpu
    return {"cpu": cpu, "python": platform.python_version(), **{name: metadata.version(name) for name in packages}}


def bench_table(result: dict[str, Any]) -> str:
    """The figures as text."""
    machine = result["machine"]
    names = list(next(iter(result["paper"].values())))
    forms = [(p, form) for p in ("as_flown", "paper") for form in FORMS]
    cells = [["median (p99) [µs]", *(f"{p} {form}" for p, form in forms)]]
    for name in names:
        timings = (result[p][form][name] for p, form in forms)
        cells.append([name.removesuffix("_us"), *(f"{t['median']:.0f} ({t['p99']:.0f})" for t in timings)])
    hard = result["hard_states"]
    step = result["paper"]["form1"]["mj_step_us"]["median"]
    lines = [
        ", ".join(f"{name} {value}" for name, value in machine.items()),
        "",
        format_table(cells, left=1),
        "",
        f"hard states, OSQP part: median {hard['osqp_us']['median']:.0f}, p99 {hard['osqp_us']['p99']:.0f} µs, "
        f"iterations median {hard['osqp_iterations']['median']:.0f}, max {hard['osqp_iterations']['max']}; "
        f"answers {hard['statuses']}",
        f"one numpy addition of 8 numbers: {result['numpy_add_us']['median']:.2f} µs (the machine's unit)",
        "environment, zero action, steps/s: "
        + ", ".join(f"{result[f'env_steps_per_s_{name}']:.0f} {name.replace('_', ' ')}" for name in ENVIRONMENTS),
        f"the bare 10 × mj_step would allow {1e5 / step:.0f}; the air's share of a step (mixed forms): "
        f"{1.0 - result['env_steps_per_s_mixed'] / result['env_steps_per_s_mixed_without_wake']:.0%}",
    ]
    core = result["core"]
    pairs = (f"{name} {c['core_steps_per_s']:.0f} ({c['ratio']:.2f})" for name, c in core.items() if name in PAIRS)
    lines.append(
        f"compiled core: tick through Python {core['tick_us']['median']:.0f} ({core['tick_us']['p99']:.0f}) µs; "
        f"steps/s, and times those of the readable controller in the same run: {', '.join(pairs)}"
    )
    return "\n".join(lines)
