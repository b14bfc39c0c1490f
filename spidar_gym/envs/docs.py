"""Generator of the environments' documentation pages, from the code that they document."""

import dataclasses
import inspect
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium

from spidar_gym.control.course.observation import course_layout
from spidar_gym.control.crawl.observation import CLOCK_TICKS, crawl_layout
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.flight.observation import Field, layout, path_layout
from spidar_gym.control.grasp.observation import grasp_layout
from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.envs.actions import ACTION_MODES, COURSE_MODES, CRAWL_MODES, GRASP_MODES, TORSO, ActionMode
from spidar_gym.envs.course_env import CourseEnv
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.goals import REWARDS
from spidar_gym.envs.grasp_env import GraspEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.observations import MOST, OBSERVATIONS, privileged_layout
from spidar_gym.envs.path_env import PathEnv
from spidar_gym.envs.registry import COURSE, ENVIRONMENTS, GRASP, environment, import_id
from spidar_gym.envs.suite import CEILING, CLASSICAL, LAZY, SUITE, SUITE_IDS, M, SuiteTask, read_anchors
from spidar_gym.robot import field_docs, source_doc
from spidar_gym.robot.description import CAMERAS
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.rows import OPTIONAL_ROWS, TABLE, Row
from spidar_gym.sim.violations import AT_LIMIT, BLOWN_FACTOR
from spidar_gym.tasks import course as course_task
from spidar_gym.tasks import crawl as crawl_task
from spidar_gym.tasks import grasp as grasp_task
from spidar_gym.tasks import hover as hover_task
from spidar_gym.tasks import path as path_task
from spidar_gym.tasks.sloped import REWARDS as TERMS
from spidar_gym.tasks.sloped import SLOPED
from spidar_gym.tasks.task import Task
from spidar_gym.text import markdown_rows

INFO = {
    "thrust_command, thrust": ("(8,)", "N", "λ commanded and delivered"),
    "vectoring_command, vectoring": ("(8, 2)", "rad", "(φ, θ) commanded and measured, unwrapped"),
    "joint_torque_allocated, joint_torque": ("(16,)", "Nm", "quasi-static torque of the allocation; servo torque"),
    "wrench_allocated": ("(6,)", "N, Nm", "force and torque in {CoG} of the rotors and of the feet on the floor"),
    "total_thrust": ("float", "N", "Σλ delivered"),
    "qp_status": ("str", "", "closed_form, solved, projected, softened, held; none if no allocation ran"),
    "qp_iterations": ("int", "", "solver iterations, 0 for the closed form"),
    "qp_slack": ("float", "", "largest violation of a softened row, in units of the weight or the torque limit"),
    "thrust_factor": ("(8,)", "", "thrust of each module over its thrust in still air"),
    "air_force": ("(3,)", "N", "force of the air besides the thrust in still air, world"),
    "power_w": ("float", "W", "electrical power"),
    "energy_wh": ("float", "Wh", "energy drawn since the reset"),
    "endurance_min": ("float", "min", "endurance of the batteries at the episode's mean power"),
    "cost": ("float", "", "sum of the costs below: constraints that the step has violated, as in safety-gymnasium"),
    "cost_contact": (
        "float",
        "",
        "1 if a part touches something: any part in flight, else any but feet and pegs",
    ),
    "cost_torque": ("float", "", f"1 if a joint servo is within {AT_LIMIT:g} Nm of its largest torque"),
    "cost_duct": ("float", "", "1 if a duct touches the floor or a wall"),
    "cost_blown": ("float", "", f"1 if jets reduce a rotor's thrust below {BLOWN_FACTOR:.0%} of that in still air"),
    "randomization": ("dict", "", "sampled values by field of `PlantConfig`; empty without randomisation"),
    "reward_<term>": ("float", "", "each reward term, in [0, 1]"),
    "is_success": ("bool", "", "see Episode End"),
    "failure": ("str", "", "failure that ended the episode, else empty"),
}
"""Shape, unit and meaning of the keys of `info` that all environments have, at every step and reset."""


@dataclass(frozen=True)
class Chapter:
    """Content of a page that is specific to an environment."""

    env: type[SpidarEnv]
    """Class of the environment."""
    task: Any
    """Class of the task."""
    modes: dict[str, ActionMode]
    """Action modes."""
    ranges: dict[str, tuple[float, float, str]]
    """Least and largest value of the task's arguments, and their units."""
    layout: Any
    """Mapping from the size of the action to the layout of the observation."""
    info: dict[str, tuple[str, str, str]]
    """Additional keys of `info`."""
    start: str
    """Starting state."""
    success: str
    """Definition of `is_success`."""
    presets: list[str]
    """Names of the controllers."""
    controller: str
    """Class of the argument `controller`."""
    options: str
    """Options of `reset`, as a call."""
    trim: str
    """Sentence about the controller's knowledge of a randomised robot."""
    zero: str = "A zero action is exactly the preset's\ncommand in every mode but `direct` and `torso_forces`."
    """Sentence about a zero action."""
    clock: str = ""
    """Sentence about the clock in the observation."""
    arrival: str = ""
    """Sentence about the end of an episode with the reward `sloped`."""
    law: str = "FlightController"
    """Base class of the argument `law`."""
    step: str = f"One step is one control period of {1000 / CONTROL_RATE:g} ms."
    """Sentence about the length of a step."""


_ENDS = "\nAn episode then ends, terminated without a failure, with its success"
HOVER_CHAPTER = Chapter(
    HoverEnv,
    hover_task.HoverTask,
    ACTION_MODES,
    hover_task.RANGES,
    layout,
    {
        "position_error": ("(3,)", "m", "desired − actual CoG, world, true state"),
        "attitude_error": ("(3,)", "rad", "log(RᵀR_d), torso axes, true state"),
        "wrench_desired": ("(6,)", "N, Nm", "force and torque in {CoG}"),
        "restricted_rotors": ("(8,) bool", "", "rotors restricted by interference"),
    },
    "At rest in the first form of the sequence, rotors at hover thrust and upright, torso at the reference plus a\n"
    "uniform offset of ± 3 cm and ± 0.05 rad per axis (times `perturbation`). The option `start` of `reset` sets\n"
    "offset, forms with their deadlines and the integrals' initial values, as the benchmark's scenarios do.",
    f"`is_success`: the whole horizon flown, RMS errors below {hover_task.SUCCESS_POSITION:g} m and "
    f"{hover_task.SUCCESS_ATTITUDE:g} rad, every form reached within {hover_task.ARRIVAL_TOLERANCE:g} rad no later "
    f"than {hover_task.ARRIVAL_GRACE:g} s after its deadline.",
    list(PRESETS),
    "ControllerConfig",
    "{'forms': name, 'start': {...}, 'disturbances': {...}}",
    "controller keeps the nominal parameters; its integrals start with the wrench that the randomised robot needs at\n"
    "rest.",
)
"""Chapter of Hover-v0; that of Path-v0 is derived from it."""

CHAPTERS: dict[str, Chapter] = {
    "spidar_gym/Hover-v0": HOVER_CHAPTER,
    "spidar_gym/Path-v0": replace(
        HOVER_CHAPTER, env=PathEnv, task=path_task.PathTask, ranges=path_task.RANGES, layout=path_layout,
        start="At rest in the first form of the sequence, rotors at hover thrust and upright, torso at the beginning\n"
        "of the path with its heading, plus a uniform offset of ± 3 cm and ± 0.05 rad per axis (times\n"
        "`perturbation`). The path begins after a second. The option `start` of `reset` sets offset, forms with\n"
        "their deadlines, the integrals' initial values and the path's knots, as the benchmark's scenarios do.",
    ),
    "spidar_gym/Crawl-v0": Chapter(
        CrawlEnv, crawl_task.CrawlTask, CRAWL_MODES, crawl_task.RANGES, crawl_layout,
        {
            "goal_error": ("(3,)", "m, m, rad", "goal − torso: x, y in the world, yaw; true state"),
            "phase": ("str", "", "phase of the gait"),
            "finished": ("bool", "", "the gait is complete and thrust is off; in `direct`, see Episode End"),
            "time_s, nominal_time_s": ("float", "s", "time so far, or until finished; the preset's planned time"),
            "airborne_share": ("float", "", "share of its swing that the worst foot was in the air"),
            "foot_contact": ("(4,) bool", "", "feet that touch the floor"),
            "foot_slip_m, peg_slip_m": ("float", "m", "slip of the worst foot, or peg, on the floor"),
            "duct_clearance_m": ("float", "m", "least height of a duct over the floor so far"),
            "saturation_share": ("float", "", "share of joint-time within 0.01 Nm of the servo's limit"),
            "thrust_fraction": ("float", "", "commanded Σλ over the weight"),
            "thrust_fraction_mean, thrust_fraction_peak": ("float", "", "mean and largest `thrust_fraction` so far"),
            "tilt_rad": ("float", "rad", "tilt of the torso against the floor"),
            "timeouts": ("int", "", "phases that ended by time-out"),
            "cost_of_transport": ("float", "", "energy over weight times distance covered towards the goal"),
            "shortfalls": ("str", "", "criteria of `is_success` that are not met"),
        },
        "Torso on its pegs, feet at home on the floor, rotors off; with `steps` the robot has settled on the tiles.",
        f"`is_success`: the gait finishes within {crawl_task.SUCCESS_TIME:g} times its nominal time, the torso within\n"
        f"{1000 * crawl_task.SUCCESS_POSITION:g} mm and {crawl_task.SUCCESS_YAW:g} rad of the goal, every foot in the "
        f"air for {crawl_task.SUCCESS_AIRBORNE:.0%} of its swing, no phase\nended by time-out, no foot slid "
        f"{1000 * crawl_task.SUCCESS_SLIP:g} mm, no duct touched the floor.\n"
        f"In `direct` there is no gait: a crawl is finished when the robot has lain on its pegs for "
        f"{crawl_task.REST_TIME:g} s, that close to\nthe goal, below {crawl_task.REST_SPEED:g} m/s, "
        f"{crawl_task.REST_TURN:g} rad/s and {crawl_task.REST_JOINT_SPEED:g} rad/s of every joint, with less than "
        f"{crawl_task.REST_THRUST:.0%} of its\nweight commanded as thrust.",
        list(CRAWL_PRESETS), "CrawlerConfig", "{'disturbances': {...}}",
        "controller keeps the nominal parameters.",
        law="Crawler",
        clock="In `torso_forces`, which has no gait, `clock` precedes `previous_action`: sine and cosine of the time\n"
        f"since the reset, of period {CLOCK_TICKS / CONTROL_RATE:g} s.",
        arrival=f"{_ENDS}: the torso within `arrival_position` (0.05 m) and `arrival_yaw` (0.1 rad) of the goal.",
    ),
    "spidar_gym/Course-v0": Chapter(
        CourseEnv, course_task.CourseTask, COURSE_MODES, course_task.RANGES, course_layout,
        {
            "goal_error": ("(3,)", "m, m, rad", "goal − torso: x, y in the world, yaw; true state"),
            "distance_m": ("float", "m", "distance to the goal, a radian counting 0.5 m"),
            "time_s": ("float", "s", "time so far, or until the robot lay at the goal"),
            "flown_s, crawled_s": ("float", "s", "time in the air, with take-off and landing; time of crawling"),
            "charge": ("float", "", "share of the battery's usable energy that is left"),
            "hit_n, most_hit_n": ("float", "N", "largest force on ducts and links in the step, and so far"),
            "tilt_rad": ("float", "rad", "tilt of the torso"),
            "thrust_fraction": ("float", "", "commanded Σλ over the weight"),
            "phase": ("str", "", f"phase of the manager: {', '.join(PHASES)}"),
            "gate": ("int", "", "number of gates and floors behind the robot"),
            "lies": ("bool", "", "whether the robot lies on the floor at rest"),
            "finished": ("bool", "", "whether the robot lies at the goal"),
        },
        "Torso on its pegs, feet at home on the floor, rotors off, at the origin, heading along the course. The\n"
        "course is sampled, or set by the option `course` of `reset`, as in the benchmark's scenarios.",
        f"`is_success`: the robot lies within {1000 * course_task.SUCCESS_POSITION:g} mm and "
        f"{course_task.SUCCESS_YAW:g} rad of the goal.",
        list(PRESETS), "ManagerConfig", "{'course': {...}, 'disturbances': {...}}",
        "controller keeps the nominal parameters.",
        "A zero action is in\n`waypoint` a target on the floor at the current position, in `residual` exactly the "
        "rule's command.",
        arrival=f"{_ENDS}.",
        step=f"With `waypoint` one step is {1000 * course_task.DECIDE / CONTROL_RATE:g} ms, else one control period of "
        f"{1000 / CONTROL_RATE:g} ms.",
    ),
    "spidar_gym/Grasp-v0": Chapter(
        GraspEnv, grasp_task.GraspTask, GRASP_MODES, grasp_task.RANGES, grasp_layout,
        {
            "object_error": ("(3,)", "m", "place at the goal − object's middle, world, true state"),
            "way_m": ("float", "m", "length of that error, a radian of heading counting 0.5 m"),
            "yaw_error_rad": ("float", "rad", "of the object's heading, up to turns after which it looks the same"),
            "lifted_m": ("float", "m", "height of the object over its stand at the start"),
            "object_force": ("(4,)", "N", "force of each foot on the object, at the end of the step"),
            "object_air": ("(3,)", "N", "force of the air on the object, world"),
            "object_mass, object_friction": ("float", "kg, 1", "of the object, hidden"),
            "object_com": ("(3,)", "m", "its centre of mass from its middle, hidden"),
            "force_n, most_force_n": ("float", "N", "largest force of a foot, a mean over 0.1 s: now, and so far"),
            "grip_n, payload_kg": ("float", "N, kg", "planned force of each foot; mass that the controller carries"),
            "time_s": ("float", "s", "time so far, or until the object was delivered"),
            "charge": ("float", "", "share of the battery's usable energy that is left"),
            "tilt_rad": ("float", "rad", "tilt of the torso"),
            "thrust_fraction": ("float", "", "commanded Σλ over the weight"),
            "phase, grasp_phase": ("str", "", "phase of the manager; of the grasp, as in the observation"),
            "tries": ("int", "", "number of times that the rule has begun to grasp"),
            "lost, refused": ("bool", "", "whether the object was lost; whether it was too heavy or too slippery"),
            "finished": ("bool", "", "whether the object is delivered"),
        },
        "The robot hovers at the origin with the open claw, "
        f"{grasp_task.BEGIN_HEIGHT:g} m above the floor; the object stands {grasp_task.DISTANCE[0]:g} to "
        f"{grasp_task.DISTANCE[1]:g} m ahead,\nits goal {grasp_task.GOAL_DISTANCE[0]:g} to "
        f"{grasp_task.GOAL_DISTANCE[1]:g} m behind it. The scene is sampled so that it can be held, or set by the "
        "option\n`scene` of `reset`, as in the benchmark's scenarios.",
        f"`is_success`: the object stands within {grasp_task.PLACED:g} m and "
        f"{math.degrees(grasp_task.TURNED):g}° of its goal, upright within {math.degrees(grasp_task.UPRIGHT):g}°, at "
        f"rest, every foot\n{grasp_task.CLEAR_OF:g} m away from it, and was lifted by {grasp_task.HIGH:g} m.",
        list(PRESETS), "ManagerConfig", "{'scene': {...}, 'disturbances': {...}}",
        "controller keeps the nominal parameters.",
        "A zero action is in\n`residual` exactly the rule's command, in `order` a hover with half the opening and half "
        "the grip.",
        arrival=f"{_ENDS}.",
        step=f"With `order` one step is {1000 * grasp_task.DECIDE / CONTROL_RATE:g} ms, else one control period of "
        f"{1000 / CONTROL_RATE:g} ms.",
    ),
}  # fmt: skip
"""Chapters of all environments by id."""


_HOLDS: dict[type, str] = {
    CourseEnv: "; by default 20 with `waypoint`, 1 with the others",
    GraspEnv: "; by default 20 with `order`, 1 with the others",
}
"""Default of `hold` of the environments with orders."""


def _action_rows(modes: dict[str, ActionMode]) -> Iterator[Sequence[str]]:
    for name, mode in modes.items():
        label, start = (f"`{name}`", str(mode.size)), 0
        for channel in mode.channels:
            end = start + channel.size
            yield *label, f"{start}–{end - 1} `{channel.name}`", channel.authority
            label, start = ("", ""), end


def _observation_rows(fields: tuple[Field, ...], *, scaled: bool = False) -> Iterator[Sequence[str]]:
    start = 0
    for f in fields:
        where = f"{start}" if f.size == 1 else f"{start}–{start + f.size - 1}"
        yield where, f"`{f.name}`", f"{f.bound:g}", *([f"{f.scale:g}"] if scaled else []), f.unit, f.doc
        start += f.size


def _other_observations(own: Chapter) -> Iterator[str]:
    """Yield the sections on the observations other than the flat vector."""
    goal = own.env.goal_type
    yield (
        "The argument `observation` selects `vector`, the above and the default, `scaled`, the same with every number\n"
        "over its scale, for networks without a normaliser, or one of these dictionaries."
    )
    yield "### Goal"
    if goal is None:
        yield f"`goal` is refused: {own.env.no_goal}."
    else:
        left_out = ", ".join(f"`{name}`" for name in goal.left_out)
        yield (
            "`goal` has `observation`, `achieved_goal` and `desired_goal`, as in `gymnasium_robotics`, for hindsight\n"
            "experience replay (HER). `observation` is the vector above without\n"
            f"{left_out}. Both goals are computed from the true state, also with sensors:"
        )
        yield markdown_rows("entries | name | bound ± | unit | meaning", _observation_rows(goal.fields))
        rewards = {"sparse": f"0 if {goal.reach}, else −1", "dense": f"− {goal.far}"}
        yield (
            "The reward is then `compute_reward(achieved_goal, desired_goal, info)`, for one robot or for rows of\n"
            "many; the terms below stay in `info`. The argument `goal_reward` selects one of:"
        )
        yield "\n".join(f"- `{name}`: {text}." for name, text in rewards.items())
        yield (
            "`compute_terminated` returns whether `info` reports a failure, `compute_truncated` returns False. In\n"
            "every action mode but `direct` the controller moves to the desired goal, not to the goals that hindsight\n"
            "experience replay substitutes."
        )
    yield "### Asymmetric"
    yield (
        "`asymmetric` has `observation`, the above, and `privileged` for a critic or a teacher: true values and\n"
        f"sampled parameters. Each is divided by its scale and clipped to ± {MOST:g}:"
    )
    rows = _observation_rows(privileged_layout(own.env.true_fields))
    yield markdown_rows("entries | name | scale | unit | meaning", rows)


def page(name: str) -> str:
    """Return the Markdown page of an environment or of a task of the suite; `spidar list ENV_ID` prints it."""
    if name in SUITE_IDS:
        return suite_page(SUITE_IDS[name])
    entry = environment(name)
    own = CHAPTERS[name]
    task = own.task
    defaults = inspect.signature(own.env).parameters
    fields: tuple[Field, ...] = own.layout(own.modes[defaults["action_mode"].default].size)
    info = own.info | INFO
    size = sum(f.size for f in fields)
    blocks = [
        f"# {name}",
        "Generated from the code when the guide is built; tests compare it with the spaces.",
        "## Description",
        f"{source_doc(task)} {own.step}",
        f'`import spidar_gym`, then `gymnasium.make("{name}")`. In a process that has not imported it, such as a\n'
        f'spawned or remote one, use the id `gymnasium.make("{import_id(name)}")`.',
        "## Action Space",
        f"`Box(-1, 1, (n,), float32)`; values outside are clipped. {own.zero}",
        markdown_rows("action_mode | n | entries | −1 … 1 is scaled to", _action_rows(own.modes)),
        "\n".join(f"- `{n}`: {mode.doc}." for n, mode in own.modes.items()),
        "## Observation Space",
        f"`Box(-bound, bound, ({size},), float32)` in the default action mode: values available on the real robot.",
        markdown_rows("entries | name | bound ± | scale | unit | meaning", _observation_rows(fields, scaled=True)),
        *filter(None, (own.clock,)),
        *_other_observations(own),
        "## Rewards",
        "The weighted sum of terms in [0, 1]; the weights add up to 1. Every term is in `info` as `reward_<term>`.",
        _reward_table(own.task),
        "### Sloped",
        '`reward="sloped"` selects terms with a slope everywhere, for learning from nothing, not all of them in [0, 1].'
        + own.arrival,
        _reward_table(SLOPED[own.task]),
        "## Info",
        markdown_rows("key | shape | unit | meaning", ((f"`{k.replace(', ', '`, `')}`", *v) for k, v in info.items())),
        "Solve times are not in `info`, which depends only on seed and actions. The engine measures none;\n"
        'with `control="python"` they are in `env.unwrapped.controller.last_step.allocation.solve_time`.',
        "## Starting State",
        own.start,
        "## Episode End",
        "Terminated with `info['failure']`:",
        "\n".join(f"- `{word}`: {meaning}." for word, meaning in own.task.failures.items()),
        f"Truncated after {entry.horizon} steps ({task.horizon_s:g} s). For another length pass "
        "`gym.make` either\n"
        f"`horizon_s={2.0 * task.horizon_s:g}` or `max_episode_steps={2 * entry.horizon}`; the shorter of both "
        "ends the episode,\nand success is evaluated there. `max_episode_steps=-1` never truncates,\nand vectors take "
        "the same arguments.\n" + own.success,
        "## Arguments",
        markdown_rows(
            "name | default | meaning", ((f"`{n}`", f"`{value!r}`", doc) for n, value, doc in _arguments(own))
        ),
        f"`reset(options={own.options})` changes this episode and those after it.",
        f"Each of {_names(own)} is an option of `reset` too. Such an option rebuilds\nthe environment, which takes "
        "about 10 ms. In a vector, a list has a value for each robot.",
        "### Disturbances",
        markdown_rows(
            "name | default | meaning",
            ((f"`{n}`", f"`{getattr(Disturbances, n)!r}`", doc) for n, doc in field_docs(Disturbances).items()),
        ),
        "### Randomisation",
        "At strength 1. At strength s, a sample x becomes x₀ + s (x − x₀) with the value x₀ that changes nothing. The\n"
        + own.trim,
        _randomised("distribution", TABLE),
        "### Optional randomisation",
        "Sampled only with a range in `randomization`, after the parameters above; a strength does not randomise them.",
        _randomised("suggestion", (r for r in OPTIONAL_ROWS if own.env not in _HOLDS or not r.is_of_floor)),
        "## Version History",
        "- v0: first version.",
    ]
    return "\n\n".join(blocks) + "\n"


def _reward_table(task: type[Task[Any]]) -> str:
    return markdown_rows(
        "term | weight | formula", ((f"`{n}`", f"{w:g}", text) for n, (w, text) in task.reward_terms.items())
    )


def _randomised(title: str, rows: Iterable[Row]) -> str:
    """Return a table of parameters that are randomised."""
    return markdown_rows(
        f"field of `PlantConfig` | operation | {title} | unit | source",
        ((f"`{r.field}`", r.operation, r.distribution, r.unit, r.source) for r in rows),
    )


def _arguments(own: Chapter) -> list[tuple[str, object, str]]:
    """Return the arguments of `gym.make`: the task's, then the environment's, then those of all environments."""
    docs = field_docs(own.task)
    for name, (low, high, _) in own.ranges.items():
        docs[name] += f" Within {low:.6g} … {high:.6g}."
    rows: list[tuple[str, object, str]] = [(f.name, f.default, docs[f.name]) for f in dataclasses.fields(own.task)]
    meanings = {
        "action_mode": "one of " + ", ".join(f"`{n}`" for n in own.modes),
        "preset": "controller: " + ", ".join(f"`{n}`" for n in own.presets),
        "gait": "crawler: " + ", ".join(f"`{n}`" for n in CRAWL_PRESETS),
        "manager": "custom `ManagerConfig` in place of both presets",
        "grip": "how the rule grips: `tested`, as the test lift finds; a force of each foot [N]; or `told`, by the "
        "true mass and friction, a ceiling",
        "grasp": "custom `GraspConfig`: heights, speeds and thresholds of the grasp",
        "controller": f"custom `{own.controller}` in place of a preset",
        "allocator": "custom subclass of `Allocator` in place of the QP",
        "law": f"custom subclass of `{own.law}` in place of the paper's",
        "control": "`core`, the controller that is compiled for the robot, or `python`, the Python controller",
        "action_scale": 'share of a residual\'s authority, `{"share": 0.2}`; or zero and scale of `torso_forces`: '
        '`{"force": N, "joint": rad, "trim": share of the weight}`, '
        f"by default 3, 0.1 and {_trim(own):g}; with `joint` 0 the action has no entries for joints",
        "hold": "control periods of 25 ms per step, through which an action is held" + (_HOLDS.get(own.env, "")),
        "max_iter": "iteration cap of the QP solver; 300 on the robot's computer",
        "task": f"custom task: an object of a class derived from `{own.task.__name__}`, the class, or its name, "
        "`module:Class`",
        "reward": "one of " + ", ".join(f"`{n}`" for n in TERMS) + ", the first by default",
        "idle_thrust": "least thrust of a module [N]; about 1.2 for armed motors",
        "robot": "custom robot of controller and simulator: a `RobotSpec`, its numbers by name, or a TOML file",
        "plant": "custom `PlantConfig`, the simulated robot, to which the arguments below are applied",
        "wake": "air: jets between the rotors, drag, ground effect",
        "battery": "the largest thrust falls with the voltage of the battery, which is full at reset by default",
        "sensors": "the controller receives an estimate from motion capture, inertial unit and encoders",
        "randomization": "strength of the domain randomisation, 0 … 1; or ranges by field of the tables below, "
        '`{"body.total_mass": (15.5, 17.0)}`, with `strength` for all others (0 by default); or a TOML file of these',
        "observation": "one of " + ", ".join(f"`{n}`" for n in OBSERVATIONS),
        "goal_reward": "one of " + ", ".join(f"`{n}`" for n in REWARDS) + ", with the observation `goal`",
        "disturbances": "dictionary with any of " + ", ".join(f"`{n}`" for n in field_docs(Disturbances)),
        "max_episode_steps": "steps after which an episode is truncated, at most those of `horizon_s` if that is "
        "given too; −1 for no end",
        "render_mode": "one of " + ", ".join(f"`{n}`" for n in SpidarEnv.metadata["render_modes"]),
        "camera": "one of " + ", ".join(f"`{n}`" for n in CAMERAS),
        "width": "width of pictures [px]",
        "height": "height of pictures [px]",
    }
    parameters = {**inspect.signature(SpidarEnv.__init__).parameters, **inspect.signature(own.env).parameters}
    return rows + [(n, parameters[n].default, doc) for n, doc in meanings.items() if n in parameters]


def _trim(own: Chapter) -> float:
    scale = own.modes[TORSO].scale
    assert scale is not None
    return scale.trim


def _names(own: Chapter) -> str:
    """Return the names of the arguments that are also options of `reset`."""
    return ", ".join(f"`{name}`" for name in (*inspect.signature(own.task).parameters, "randomization", "task"))


def _scale_lines(own: SuiteTask) -> list[tuple[str, ...]]:
    """Return a line for each policy that anchors the scale: its results, and the terms of its return."""
    lines = []
    for policy, found in read_anchors()[own.name].items():
        words = {LAZY[0]: "zero action", LAZY[1]: LAZY[1], CLASSICAL: f"`{own.classical}`",
                 CEILING: f"ceiling: `{own.classical}` with the true state"}[policy]  # fmt: skip
        numbers = found["return"], float(own.normalised(found["return"])), *found["terms"].values()
        lines.append((words, *(f"{number:.3g}" for number in numbers), f"{found['success']:.0%}",
                      f"{found['duration_s']:.1f} s"))  # fmt: skip
    return lines


def suite_page(name: str) -> str:
    """Return the Markdown page of a task of the suite; `spidar list SUITE_ID` prints it."""
    own, env = SUITE[name], gymnasium.make(SUITE[name].id).unwrapped
    assert isinstance(env, SpidarEnv)
    base = f"[{own.base}-v0](../environments/{own.base}-v0.md)"
    mode = own.options.get("action_mode", "waypoint")
    options = ",\n".join(f"    {key}={value!r}" for key, value in own.options.items())
    budgets = ", ".join(f"{algorithm} {ticks / M:g} M" for algorithm, ticks in own.budgets.items())
    terms = env.task.reward_terms
    blocks = [
        f"# {own.id}",
        f"{own.doc[0].upper()}{own.doc[1:]}.",
        f'`import spidar_gym`, then `gymnasium.make("{own.id}")`, which is',
        f'```python\ngymnasium.make(\n    "{own.env_id}",\n{options},\n)\n```',
        f"One step is {own.hold * 1000 / CONTROL_RATE:g} ms, an episode {own.seconds:g} s. All else is on the page of "
        f"{base}.",
        f"- **Success**: {own.success}.",
        f"- **Budget** of training [control ticks, summed over all robots]: {budgets}; other algorithms as ppo. "
        f"`python -m train.standard {name} ppo --seed 0` trains, "
        f"`spidar suite {name} --policy POLICY` evaluates on 100 episodes with fixed seeds.",
        f"- **Scale** of the returns: {own.anchors[0]:.4g} is 0, the better of zero action and random policy; "
        f"{own.anchors[1]:.4g} is 1, the best classical controller. `spidar suite {name} --check` plays them again.",
        "## Action Space",
        f"`Box(-1, 1, ({env.action_mode.size},), float32)`, `{mode}`:",
        markdown_rows("action_mode | n | entries | −1 … 1 is scaled to", _action_rows({mode: env.action_mode})),
        "## Observation Space",
        f"`Box(-bound / scale, bound / scale, ({sum(f.size for f in env.layout)},), float32)`:",
        markdown_rows("entries | name | bound ± | scale | unit | meaning", _observation_rows(env.layout, scaled=True)),
        "## Rewards",
        _reward_table(type(env.task)),
        "Mean return of 100 episodes, on the scale, and what each term brings:",
        markdown_rows(" | ".join(["policy", "return", "scaled", *terms, "success", "length"]), _scale_lines(own)),
        "## Episode End",
        "Terminated with `info['failure']`:",
        "\n".join(f"- `{word}`: {meaning}." for word, meaning in env.task.failures.items()),
    ]
    env.close()
    return "\n\n".join(blocks) + "\n"


def pages() -> dict[str, str]:
    """Return the guide's page of each environment, with its picture, by path relative to docs/."""
    found = {f"suite/{name}.md": suite_page(name) for name in SUITE}
    for name in ENVIRONMENTS:
        short = name.split("/")[1]
        shown = "at four moments" if name in (COURSE, GRASP) else "from each camera"
        picture = f"![{name} {shown}](../pictures/environment-{short}.png)\n\n## Description\n"
        found[f"environments/{short}.md"] = page(name).replace("## Description\n", picture, 1)
    return found
