"""What the onboard core shares with Python besides structs: sizes, numbers and enumerations, each written in Python."""

import re
from dataclasses import dataclass
from types import ModuleType

from spidar_gym import so3, state
from spidar_gym.control import rotors
from spidar_gym.control.allocation import allocator, blocks, cone, contact, problem, solver
from spidar_gym.control.allocation.allocator import AllocationStatus
from spidar_gym.control.allocation.modes import ALLOCATIONS, PROJECTION
from spidar_gym.control.allocation.problem import N_FORCES, N_UNKNOWNS, Mode
from spidar_gym.control.course import gates, pilot, rule, target
from spidar_gym.control.course import observation as course_observation
from spidar_gym.control.crawl import controller as crawl_controller
from spidar_gym.control.crawl import footsteps, gait, pose2
from spidar_gym.control.crawl import observation as crawl_observation
from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.phases import CYCLE, LIFT, PHASES, STAND
from spidar_gym.control.estimator import HISTORY
from spidar_gym.control.flight import centroidal, compensation, motion, observation, path
from spidar_gym.control.flight import controller as flight_controller
from spidar_gym.control.flight.motion import COMMANDS
from spidar_gym.control.grasp import claw, grip, phases
from spidar_gym.control.grasp import rule as grasp_rule
from spidar_gym.control.grasp import scene as grasp_scene
from spidar_gym.control.locomotion import commands as locomotion
from spidar_gym.control.locomotion import manager, orders
from spidar_gym.model import interference, rotor
from spidar_gym.robot import N_JOINTS, N_LEGS, N_ROTORS, spec
from spidar_gym.state import IMU_SAMPLES, POSE_FRAMES

ONBOARD_ITERATIONS = 300
"""Iteration cap on the robot's computer: what fits into 5 ms there."""
MAX_N = MAX_M = 80
"""Unknowns and rows of the largest program, softened ones included."""
MAX_SIDES = 2 * MAX_M + N_ROTORS
"""Sides of rows and thrust spheres of the largest program."""
MAX_STEPS = 256
"""Largest number of steps of the gait."""
MAX_WAYPOINTS, MANAGER_KNOTS = 64, 8
"""Largest number of commands of the manager of both gaits; knots of a straight flight."""
N_ANGLES = N_JOINTS + 2 * N_ROTORS
"""Number of angles that the encoders measure."""
N_BODIES = 1 + N_ANGLES
"""Bodies of the kinematic tree: the torso, and one behind each joint and each vectoring servo."""
MAX_OBSERVATION, MAX_TRACES, MAX_ACTION, MAX_WIDTH = 512, 128, 40, 1024
"""Largest sizes of a policy: observation, low-passed observations, action, widest layer."""
NETWORK_BLOCK = 32
"""Number of a layer's outputs that the core computes side by side."""
MAX_ENTRIES = 48
"""Largest number of entries of an action, modes without a controller included."""
SIZES = {
    "LEGS": N_LEGS, "ROTORS": N_ROTORS, "JOINTS": N_JOINTS, "FORCES": N_FORCES, "UNKNOWNS": N_UNKNOWNS,
    "MAX_N": MAX_N, "MAX_M": MAX_M, "MAX_STEPS": MAX_STEPS, "MAX_OBSERVATION": MAX_OBSERVATION,
    "MAX_ACTION": MAX_ACTION, "HISTORY": HISTORY, "ANGLES": N_ANGLES, "BODIES": N_BODIES, "POSE_FRAMES": POSE_FRAMES,
    "IMU_SAMPLES": IMU_SAMPLES, "COMMANDS": COMMANDS, "MAX_ENTRIES": MAX_ENTRIES,
    "NETWORK_BLOCK": NETWORK_BLOCK, "MODE_COSTS": 4, "MODE_ROWS": 6, "PATH_AHEAD": path.AHEAD,
    "GRASP_TRIES": grasp_rule.TRIES, "STEER_SIZE": phases.STEER_SIZE,
    "MAX_WAYPOINTS": MAX_WAYPOINTS, "MANAGER_KNOTS": MANAGER_KNOTS,
    "COURSE_AHEAD": course_observation.AHEAD, "CLOCK_TICKS": crawl_observation.CLOCK_TICKS,
}  # fmt: skip
"""Integers by their names in C without `SP_`."""
NUMBERS: tuple[tuple[str, ModuleType, tuple[str, ...]], ...] = (
    ("GRIP_", grip, ("LEVER", "LEAD_TIME")),
    ("CLAW_", claw, ("HIGHEST", "KNEE", "OPEN", "PRESS", "NARROWEST", "WIDEST")),
    ("GRASP_", phases, ("SAFE_GRIP", "QUINTIC_PEAK")),
    ("GRASP_RULE_", grasp_rule, ("ABOVE_GOAL", "LIFT", "CARRY_SPEED", "DELIVERED", "FIRST_MASS")),
    ("SCENE_", grasp_scene, ("STAND_MARGIN", "STAND_SHARE", "CHOCK", "LEAN", "LESS_PER_KG")),
    ("", spec, ("GRAVITY",)),
    ("", phases, ("STEER_SPEED", "STEER_TURN", "STEER_RADIUS")),
    ("DISC_", interference, ("NEAREST", "FARTHEST")),
    ("", flight_controller, ("CONTROL_RATE",)),
    ("", observation, ("NO_NEXT_FORM",)),
    ("", state, ("LEAST_QUATERNION",)),
    ("", so3, ("SMALL_ANGLE", "SMALL_SINE")),
    ("", rotor, ("MIN_FORCE", "AIM_HOLD", "TURN_BIAS", "BATTERY_VOLTAGE", "BATTERY_THRUST", "THRUST_PER_VOLT")),
    ("", rotors, ("NARROW",)),
    ("", centroidal, ("MISSED_FORCE", "MISSED_TORQUE")),
    ("", compensation, ("MAX_EXTERNAL_SHARE", "MAX_EXTERNAL_TORQUE")),
    ("", motion, ("BEND_TIME", "MOMENTUM_TIME", "ROTOR_LAG", "COMMAND_DELAY")),
    ("", motion, ("RINGING", "RINGING_TIME", "LEAST_SHARE")),
    ("", problem, ("INFINITY",)),
    ("", solver, ("DUAL_TOLERANCE", "RHO", "OTHER_RHO", "ROUNDS", "MORE_ROUNDS", "ROW_TOLERANCE")),
    ("", allocator, ("SIDE_TOLERANCE", "SPHERE_TOLERANCE")),
    ("CONE_", cone, ("MAX_STEPS", "ROWS", "PRODUCT", "GRADIENT", "LOOSE", "PROOF", "FAR", "SHORT", "TINY")),
    ("", contact, ("LEAST_THRUST",)),
    ("", crawl_controller, ("EFFORT_SHARE",)),
    ("", footsteps, ("MOST_STRIDE", "BISECTIONS")),
    ("", pose2, ("STRAIGHT",)),
    ("TARGET_", target, ("STRETCHED", "BELOW", "SWEEP", "TURNS", "WAY", "MARGIN")),
    ("TARGET_", locomotion, ("SPEEDS",)),
    ("PILOT_", pilot, ("FLY_LOWEST", "LEAST_RISE", "SAME_PLACE", "SAME_FORM", "SAME_SPEED", "SAME_STEP",
                       "SAME_TURN", "THERE", "THERE_TURN")),
    ("COURSE_", gates, ("HALF_WIDTH", "CEILING", "BEFORE", "BEYOND")),
    ("COURSE_", course_observation, ("SEEN",)),
    ("RULE_", rule, ("FLOWN", "CRAWLED", "PASSED", "OVER", "ABOVE", "THROUGH", "SLOW", "FAST", "CRAWLS", "NEAR",
                     "BENEATH", "ALIGNED", "FORMED")),
    ("MANAGER_", manager, ("ASIDE", "ENDS_AFTER", "LEVEL_FROM", "LEVEL_TO", "NEAR_FLOOR", "LEAST_WAY", "ARRIVED",
                           "PATIENCE")),
    ("PATH_", path, ("EASE", "DETOUR", "RUN_AHEAD", "TOGETHER", "LEAST_SECONDS", "FADE", "REST",
               "TURN_RATE", "KNOT_TIME", "PEAK", "DRIFT", "SWING", "SUBSTEPS", "AHEAD_STEP")),
    ("GAIT_", gait, ("FILTER_TIME", "SLOW_TIME", "AGREE", "NEAR", "STILL", "SWINGING", "MAX_DEPTH",
                     "RESPONSE_TIME", "SHORTEN", "LEAST_LIFT", "TRIAL", "MISSED", "MISSED_TURN")),
)  # fmt: skip
"""Prefix in C, Python module, and names of the numbers in it."""


def program_modes() -> dict[str, Mode]:
    """Return the modes that the core solves by name, in the order of `sp_program_kind`; only their patterns matter."""
    flight = {name: allocation["flight"] for name, allocation in ALLOCATIONS.items()}
    return {**flight, PROJECTION.name: PROJECTION, **CrawlerConfig().modes}


PROGRAMS = tuple(program_modes())
"""Programs of the core in its order; those on the ground have the names of the allocation modes."""
COSTS = (blocks.ThrustEffort, contact.PowerEffort, blocks.JointTorqueEffort, contact.FootEffort)
"""Blocks of cost in the core's order."""
ROWS = (
    blocks.WrenchBalance, blocks.ThrustBox, blocks.JointTorqueLimit, blocks.VectoringLock, blocks.InterferenceBound,
    contact.ContactWrenchRange, contact.FrictionPyramid,
)  # fmt: skip
"""Blocks of rows in the core's order."""
STEPS = {"cycle": CYCLE, "lift": LIFT, "stand": STAND}
"""Kinds of a gait's steps in the core's order, with their phases."""
CHANNELS = ("wrench", "joint_offset", "joint_speed_scale", "forces", "gait", "leg_forces")
"""Channels of a policy's action, in the order of its entries; in C each is a bit."""


@dataclass(frozen=True, slots=True)
class Enumeration:
    """An enumeration: words in Python, integers in C."""

    name: str
    """Name of the type without `sp_`."""
    doc: str
    """Description of the enumeration."""
    words: tuple[str, ...]
    """The words in order."""
    prefix: str = ""
    """Text between `SP_` and a word."""
    values: tuple[int, ...] = ()
    """Values of the words; 0, 1, … if not given."""
    count: str = ""
    """Name of the constant for the number of words; empty if not needed."""

    @property
    def numbers(self) -> dict[str, int]:
        """Value of each word."""
        return dict(zip(self.words, self.values or range(len(self.words)), strict=True))


def snake(name: str) -> str:
    """Convert a class name to snake case: RobotState → robot_state."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def _blocks(none: str, kinds: tuple[type, ...]) -> tuple[str, ...]:
    """Return the words for classes of blocks: first that for no block, then thrust_effort …."""
    return (none, *(snake(kind.__name__) for kind in kinds))


ENUMERATIONS = {
    each.name: each
    for each in (
        Enumeration("cost_kind", "Blocks of cost.", _blocks("no_cost", COSTS)),
        Enumeration("rows_kind", "Blocks of rows.", _blocks("no_rows", ROWS)),
        Enumeration("program_kind", "Programs, each with a workspace.", PROGRAMS, "PROGRAM_", count="PROGRAMS"),
        Enumeration("status", "Outcome of a tick's allocation, best first.", tuple(AllocationStatus)),
        Enumeration("phases", "Phase sequences of a step of the gait.", tuple(STEPS)),
        Enumeration("phase", "Phases of the gait.", PHASES),
        Enumeration("locomotion_kind", "Commands to the manager of both gaits.", locomotion.KINDS, "LOCOMOTION_"),
        Enumeration("situation", "Where a robot is before a command.", locomotion.SITUATIONS, "ON_"),
        Enumeration("grasp_phase", "Phases of a grasp.", phases.GRASP_PHASES, "GRASP_"),
        Enumeration("object_shape", "Shapes of objects that can be grasped.", locomotion.OBJECTS, "OBJECT_"),
        Enumeration("manager_phase", "Phases of the manager of both gaits.", orders.PHASES, "MANAGER_"),
        Enumeration("gate_kind", "Parts of a course: gates first, then floors.", gates.KINDS, "GATE_",
                    count="GATE_KINDS"),
        Enumeration("channel", "Channels of a policy's action, in the order of its entries.", CHANNELS, "CHANNEL_",
                    tuple(1 << k for k in range(len(CHANNELS)))),
        Enumeration("policy_target", "Controller that a policy adds to, or `direct` for one without a controller.",
                    ("none", "flight", "crawl", "direct", "crawl_direct"), "POLICY_", (-1, 0, 1, 2, 3)),
    )
}  # fmt: skip
"""Enumerations by the name of their type without `sp_`."""
