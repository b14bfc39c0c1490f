"""The documentation page of an environment, rendered from the code that it documents."""

import dataclasses
import inspect

from spidar_gym.control.controller import CONTROL_RATE
from spidar_gym.control.observation import layout
from spidar_gym.control.presets import PRESETS
from spidar_gym.description import CAMERAS
from spidar_gym.envs.actions import ACTION_MODES
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.registry import ENVIRONMENTS, environment
from spidar_gym.envs.tasks import (
    ARRIVAL_GRACE,
    ARRIVAL_TOLERANCE,
    FAILURES,
    REWARD_TERMS,
    SUCCESS_ATTITUDE,
    SUCCESS_POSITION,
    TASKS,
)
from spidar_gym.robot import field_docs
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.randomize import TABLE

INFO = {
    "position_error": ("(3,)", "m", "desired − actual CoG, world, true state"),
    "attitude_error": ("(3,)", "rad", "log(RᵀR_d), torso axes, true state"),
    "thrust_command, thrust": ("(8,)", "N", "λ commanded and delivered"),
    "vectoring_command, vectoring": ("(8, 2)", "rad", "(φ, θ) commanded and measured, unwrapped"),
    "joint_torque_allocated, joint_torque": ("(16,)", "Nm", "quasi-static torque of the allocation; servo torque"),
    "wrench_desired, wrench_allocated": ("(6,)", "N, Nm", "force and torque in {CoG}"),
    "total_thrust": ("float", "N", "Σλ delivered"),
    "qp_status": ("str", "", "closed_form, solved, softened, held; none where no allocation ran"),
    "qp_iterations": ("int", "", "solver iterations, 0 for the closed form"),
    "qp_slack": ("float", "", "largest violation of a softened row, in units of the weight or the torque limit"),
    "restricted_rotors": ("(8,) bool", "", "rotors restricted by interference"),
    "thrust_factor": ("(8,)", "", "thrust of each module over its thrust in still air"),
    "air_force": ("(3,)", "N", "force of the air besides the thrust in still air, world"),
    "power_w": ("float", "W", "electrical power"),
    "energy_wh": ("float", "Wh", "energy drawn since the reset"),
    "endurance_min": ("float", "min", "how long the batteries last at the episode's mean power"),
    "randomization": ("dict", "", "drawn values by field of `PlantConfig`; empty without randomization"),
    "reward_<term>": ("float", "", "each term of the reward, in [0, 1]"),
    "is_success": ("bool", "", "see Episode End"),
    "failure": ("str", "", "why the episode ended early, empty otherwise"),
}
"""Keys of `info` → shape, unit, meaning. They are the same at every step, reset included."""


def page(name: str) -> str:
    """Markdown page of an environment: `spidar list ENV_ID` prints it, `spidar assets` writes it."""
    entry = environment(name)
    task = TASKS[entry.task]
    defaults = inspect.signature(SpidarEnv).parameters
    fields = layout(ACTION_MODES[defaults["action_mode"].default].size)
    lines = [
        f"# {name}",
        "",
        "Written by `spidar assets` from the code; a test holds it against the spaces.",
        "",
        "## Description",
        "",
        f"{task.__doc__} One step is one control period of {1000 / CONTROL_RATE:g} ms.",
        "",
        "## Action Space",
        "",
        "`Box(-1, 1, (n,), float32)`; what lies outside is clipped. All zero is exactly the paper's controller in",
        "every mode but `direct`.",
        "",
        "| action_mode | n | entries | what −1 … 1 becomes |",
        "|---|---|---|---|",
    ]
    for mode_name, mode in ACTION_MODES.items():
        start = 0
        for channel in mode.channels:
            end = start + channel.size
            label = (f"`{mode_name}`", f"{mode.size}") if start == 0 else ("", "")
            lines.append(f"| {label[0]} | {label[1]} | {start}–{end - 1} `{channel.name}` | {channel.authority} |")
            start = end
    lines += ["", *(f"- `{n}`: {mode.doc}." for n, mode in ACTION_MODES.items())]
    size = sum(f.size for f in fields)
    lines += [
        "",
        "## Observation Space",
        "",
        f"`Box(-bound, bound, ({size},), float32)` in the default action mode: what the real robot measures or knows.",
        "",
        "| entries | name | bound ± | unit | meaning |",
        "|---|---|---|---|---|",
    ]
    start = 0
    for f in fields:
        where = f"{start}" if f.size == 1 else f"{start}–{start + f.size - 1}"
        lines.append(f"| {where} | `{f.name}` | {f.bound:g} | {f.unit} | {f.doc} |")
        start += f.size
    lines += [
        "",
        "## Rewards",
        "",
        "The weighted sum of terms in [0, 1]; the weights add up to 1. Every term is in `info` as `reward_<term>`.",
        "",
        "| term | weight | formula |",
        "|---|---|---|",
        *(f"| `{term}` | {weight:g} | {formula} |" for term, (weight, formula) in REWARD_TERMS.items()),
        "",
        "## Info",
        "",
        "| key | shape | unit | meaning |",
        "|---|---|---|---|",
        *(f"| {', '.join(f'`{k}`' for k in key.split(', '))} | {a} | {b} | {c} |" for key, (a, b, c) in INFO.items()),
        "",
        "Solve times are not in `info`, because the same seed gives the same `info`: see",
        "`env.unwrapped.controller.tick.allocation.solve_time`.",
        "",
        "## Starting State",
        "",
        "At rest in the first form of the sequence, rotors at hover thrust and upright, torso at the reference plus a",
        "uniform offset of ± 3 cm and ± 0.05 rad per axis (times `perturbation`).",
        "",
        "## Episode End",
        "",
        "Terminated with `info['failure']`:",
        "",
        *(f"- `{word}`: {meaning}." for word, meaning in FAILURES.items()),
        "",
        f"Truncated by `TimeLimit` after {entry.horizon} steps ({entry.horizon / CONTROL_RATE:g} s). For another",
        "length give both: `gym.make(..., horizon_s=40.0, max_episode_steps=1600)`.",
        f"`is_success`: the whole horizon flown, RMS errors below {SUCCESS_POSITION:g} m and {SUCCESS_ATTITUDE:g} rad, "
        f"every form reached within {ARRIVAL_TOLERANCE:g} rad no later than {ARRIVAL_GRACE:g} s after its deadline.",
        "",
        "## Arguments",
        "",
        "| name | default | meaning |",
        "|---|---|---|",
        *(f"| `{a}` | `{b!r}` | {c} |" for a, b, c in _arguments(task)),
        "",
        "`reset(options={'forms': name, 'disturbances': {...}})` changes form sequence and disturbances of this",
        "episode and those after it.",
        "",
        "### Disturbances",
        "",
        "| name | default | meaning |",
        "|---|---|---|",
        *(
            f"| `{f.name}` | `{f.default!r}` | {field_docs(Disturbances)[f.name]} |"
            for f in dataclasses.fields(Disturbances)
        ),
        "",
        "### Randomisation",
        "",
        "At strength 1; at strength s a draw x becomes x₀ + s (x − x₀), x₀ the value that changes nothing. The",
        "controller keeps the nominal numbers; its integrals start with what the drawn robot needs at rest.",
        "",
        "| field of `PlantConfig` | operation | distribution | unit | source |",
        "|---|---|---|---|---|",
        *(f"| `{r.field}` | {r.operation} | {r.distribution} | {r.unit} | {r.source} |" for r in TABLE),
        "",
        "## Version History",
        "",
        "- v0: first version.",
        "",
    ]
    return "\n".join(lines)


def _arguments(task: type) -> list[tuple[str, object, str]]:
    """Arguments of `gym.make`: the task's fields, then the environment's own."""
    docs = field_docs(task)
    rows: list[tuple[str, object, str]] = [(f.name, f.default, docs[f.name]) for f in dataclasses.fields(task)]
    own = {
        "action_mode": "one of " + ", ".join(f"`{n}`" for n in ACTION_MODES),
        "preset": "controller: " + ", ".join(f"`{n}`" for n in PRESETS),
        "controller": "a `ControllerConfig` of one's own in place of a preset",
        "max_iter": "iteration cap of the QP solver; 300 on the robot's computer",
        "idle_thrust": "least thrust of a module [N]; about 1.2 for armed motors",
        "plant": "a `PlantConfig` of one's own: the simulated robot, to which the arguments below are applied",
        "wake": "air: jets between the rotors, drag, ground effect",
        "battery": "the largest thrust falls with the voltage of a battery that is full at reset",
        "sensors": "the controller sees motion capture, inertial unit and encoders through an estimator",
        "randomization": "strength of the domain randomisation, 0 … 1",
        "disturbances": "dictionary with any of " + ", ".join(f"`{n}`" for n in field_docs(Disturbances)),
        "render_mode": "one of " + ", ".join(f"`{n}`" for n in SpidarEnv.metadata["render_modes"]),
        "camera": "one of " + ", ".join(f"`{n}`" for n in CAMERAS),
        "width": "of pictures [px]",
        "height": "of pictures [px]",
    }
    parameters = inspect.signature(SpidarEnv).parameters
    rows += [(n, parameters[n].default, doc) for n, doc in own.items()]
    return rows


def pages() -> dict[str, str]:
    """Every environment's page: path relative to assets/ → text."""
    return {f"environments/{name.split('/')[1]}.md": page(name) for name in ENVIRONMENTS}
