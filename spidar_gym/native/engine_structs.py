"""The engine's own numbers and structs, which become C text and numpy types: configurations and what a robot is."""

from collections.abc import Sequence
from functools import cache
from types import ModuleType

import numpy as np

from spidar_gym.control.course import gates
from spidar_gym.native.configurations import configuration_structs
from spidar_gym.native.constants import MAX_ENTRIES, MAX_OBSERVATION, Enumeration
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.quantities import (
    CourseQuantities,
    CrawlQuantities,
    HoverQuantities,
    Quantities,
    quantity_names,
    quantity_struct,
)
from spidar_gym.native.structs import ANY, CODE, COUNT, FLAG, INFINITE, SINCE, USUAL, CStruct, dtypes
from spidar_gym.robot import FORMS, N_JOINTS, N_LEGS, N_LINKS, N_ROTORS, PEG_SITES
from spidar_gym.sim import actuators, air, course_boxes, disturbances, energy, ground, scene, sensors, violations
from spidar_gym.sim.air import N_DUCTS
from spidar_gym.sim.ground import BOXES, STAIR_ROW, STAIR_ROWS, STAIRS, TERRAINS, TILES
from spidar_gym.state import IMU_SAMPLES

AIR_STEPS = 10
"""Physics steps between two evaluations of the air: 25 ms; docs/concepts/air.md tells what the hold costs."""
SERVO_STEPS = 5
"""Physics steps between two looks at which way thrusts go and where joints are in their play: 12.5 ms."""
IMU_STEPS = 2
"""Physics steps between two samples of the sensors: 5 ms, 200 Hz."""
FASTEST = 12.0
"""Contacts are looked for only where something that falls as fast as this could touch the floor in time [m/s]."""
N_ANGLES, N_ACTUATORS = N_JOINTS + 2 * N_ROTORS, N_ROTORS + N_JOINTS + 2 * N_ROTORS
N_BALLS = N_LEGS + len(PEG_SITES)
N_STATIONS = N_DUCTS + 3 * N_LINKS + 5
"""Where the air is looked at: the ducts, three places on each link, five on the torso."""
N_DOFS = 6 + N_ANGLES
MUJOCO_STATE = 438
"""Numbers of MuJoCo's state `mjSTATE_INTEGRATION`; held to MuJoCo where a model is handed over."""
MAX_BODIES, MAX_MOVING, MAX_GEOMS = 64, 64, 512
"""Bodies, geoms of the robot and geoms in all that there is room for."""
MAX_WARNING_BYTES = 256
"""Bytes of MuJoCo's counts of its warnings that there is room for."""
MAX_PENDING = 32
"""Commands on their way to the actuators."""
MAX_FRAMES = 16
"""Frames of the motion capture on their way: at 100 Hz more than 0.1 s, the longest latency, and four to hand out."""
DRAWN = ("equal", "independent", "narrow")
"""Sequences of forms that are drawn from ranges of angles."""
COURSE_QUANTITIES = quantity_names(CourseQuantities)
"""Quantities of a course, in the order of its block."""
ENGINE_SIZES = {
    "DUCTS": N_DUCTS, "ACTUATORS": N_ACTUATORS, "BALLS": N_BALLS, "STATIONS": N_STATIONS, "DOFS": N_DOFS,
    "QPOS": N_DOFS + 1, "MAX_BODIES": MAX_BODIES, "MAX_PENDING": MAX_PENDING, "MAX_FRAMES": MAX_FRAMES,
    "TILES": TILES, "STAIR_ROW": STAIR_ROW, "STAIR_ROWS": STAIR_ROWS, "STAIRS": STAIRS, "BOXES": BOXES,
    "AIR_STEPS": AIR_STEPS, "COURSE_QUANTITIES": len(COURSE_QUANTITIES), "SERVO_STEPS": SERVO_STEPS,
    "IMU_STEPS": IMU_STEPS, "FASTEST": FASTEST, "MAX_WARNING_BYTES": MAX_WARNING_BYTES,
}  # fmt: skip
"""Numbers by their names in C without `SP_`."""
ENGINE_NUMBERS: tuple[tuple[str, ModuleType, tuple[str, ...]], ...] = (
    ("", scene, ("TIMESTEP",)),
    ("", air, ("AIR_DENSITY", "BLUFF", "LINK_SEGMENT", "REACH", "SPREAD")),
    ("JET_", air, ("NEAR", "LEAST_THRUST")),
    ("", actuators, ("NOISE_BANDWIDTH",)),
    ("WIND_", disturbances, ("LENGTH", "INTENSITY")),
    ("", disturbances, ("PUSH_SECONDS", "PUSH_EVERY")),
    ("", energy, ("CAPACITY_WH", "USABLE", "BASE_POWER", "THRUST_POWER", "SERVO_EFFICIENCY", "HOLDING_POWER",
                  "FULL_VOLTAGE", "EMPTY_VOLTAGE", "RESISTANCE")),
    ("COURSE_", course_boxes, ("THICK", "SILL", "BEHIND")),
    ("COURSE_", gates, ("ROW",)),
    ("", gates, ("TILE_ROWS", "TILE_COLUMNS")),
    ("", ground, ("TILE", "TILE_DEPTH", "NOWHERE")),
    ("", violations, ("AT_LIMIT", "BLOWN_FACTOR")),
    ("", sensors, ("POSE_PERIOD", "IMU_PERIOD", "ENCODER_PERIOD", "DRIFT_SECONDS", "DROPOUT_SECONDS")),
)  # fmt: skip
"""Prefix in C, where the numbers are, and their names there."""
SEQUENCES = ("paper", *FORMS, *DRAWN, "mixed")
"""Sequences of forms."""
PATHS = ("none", "legs", "lemniscate", "spline", "mixed")
"""Paths of the CoG."""
HEADINGS = ("kept", "along", "mixed")
"""Where the robot looks on its path."""
MAX_OBSTACLES, MAX_WINDOWS, MAX_DRAWS, DRAWN_NUMBERS = 64, 16, 64, 256
"""Blocks on the floor, windows of time, runs of drawn numbers and drawn numbers in all that there is room for."""
AUTORESETS = ("next_step", "same_step", "disabled")
"""What happens at the end of an episode, as Gymnasium has it."""
ENGINE_ENUMERATIONS = (
    Enumeration("operation", "What a drawn number does to the nominal one.", ("set", "scale", "add"), "DRAW_"),
    Enumeration("sequence", "Sequences of forms.", SEQUENCES, "FORMS_"),
    Enumeration("path_kind", "Paths of the CoG.", PATHS, "PATHS_"),
    Enumeration("heading", "Where the robot looks on its path.", HEADINGS, "HEADING_"),
    Enumeration("terrain", "What a floor with steps may be.", TERRAINS, "TERRAIN_"),
    Enumeration("constraint", "What a robot violates.", violations.VIOLATIONS, "VIOLATED_", (1, 2, 4, 8, 16)),
    Enumeration("autoreset", "What happens at the end of an episode.", AUTORESETS, "RESET_"),
)  # fmt: skip
"""Words that are numbers in C."""


ENGINE_STRUCTS: Sequence[CStruct] = (
    CStruct("generator", "A stream of random numbers: numpy's PCG64, and what spawns others from it.", (
        ("state_high state_low", "u8", (), "of PCG64", ANY),
        ("increment_high increment_low", "u8", (), "odd; which of its streams", ANY),
        ("has_half half", "u4", (), "whether the upper half of a draw is left over; that half", (FLAG, ANY)),
        ("pool", "u4", (4,), "the seed and the spawn key, mixed", ANY),
        ("hash spawned", "u4", (), "constant that goes on mixing; how many were spawned", ANY),
    )),
    CStruct("world", "The robot and the floor as MuJoCo has them: where things are in its arrays, and their numbers.", (
        ("bodies torso floor geoms moving", "i4", (), "of bodies; bodies; geom; of all geoms; of those of the robot"),
        ("module_body link_body", "i4", (N_ROTORS,), "bodies"),
        ("part_body", "i4", (4 * N_LINKS,), "bodies that a link carries: junction, link, and the two of its module"),
        ("body_parent body_dofadr body_dofnum", "i4", (MAX_BODIES,), "of MuJoCo's tree"),
        ("joint_qpos joint_dof", "i4", (N_ANGLES,), "of joints, then vectoring angles"),
        ("ball ball_body", "i4", (N_BALLS,), "geoms of the feet, then of the pegs; bodies that carry them"),
        ("duct", "i4", (N_DUCTS,), "geoms of the ducts"),
        ("geom", "i4", (MAX_MOVING,), "geoms of the robot"),
        ("geom_kind", "i4", (MAX_GEOMS,), "what each geom is: a ball, SP_BALLS for a duct, −1"),
        ("geom_touches geom_is_foot", "i4", (MAX_GEOMS,), "whether it meets the floor; whether it is a foot"),
        ("tile", "i4", (TILES * TILES,), "geoms of the tiles, row by row; −1 where there are none"),
        ("box", "i4", (BOXES,), "geoms of the boxes; −1 where there are none"),
        ("mass", "f8", (MAX_BODIES,), "of the described robot [kg]"),
        ("torso_axes", "f8", (4,), "principal axes of its torso's inertia, a quaternion"),
        ("inertia com", "f8", (MAX_BODIES, 3), "principal inertia [kg m²]; its centre [m]"),
        ("geom_reach", "f8", (MAX_MOVING,), "bounding radius [m]"),
        ("ball_radius", "f8", (N_BALLS,), "[m]"),
        ("duct_radius duct_half", "f8", (N_DUCTS,), "radius and half height [m]"),
        ("weight max_joint_torque torso_radius torso_height", "f8", (), "[N], [Nm], [m]"),
        ("propeller_radius duct_offset_y duct_z", "f8", (), "of a duct; its exit below the module's centre [m]"),
        ("link_station link_width", "f8", (3,), "where a link is looked at, and how wide it is there [m]"),
        ("link_scale", "f8", (N_ROTORS,), "its length over that of the link whose stations these are"),
        ("gravity battery_share", "f8", (), "[m/s²]; largest thrust over that of modules whose battery was measured"),
        ("imu_position_b", "f8", (3,), "where motion capture and inertial unit look [m]"),
        ("encoder_step", "f8", (N_ANGLES,), "a count of each encoder [rad]"),
        ("start", "f8", (MUJOCO_STATE,), "MuJoCo's state after a reset"),
    )),
    CStruct("air", "What the air did at one evaluation.", (
        ("generalized", "f8", (N_DOFS,), "generalised force for qfrc_applied [N, Nm]"),
        ("thrust_factor", "f8", (N_DUCTS,), "thrust of each duct over that in still air"),
        ("forces_w points_w", "f8", (3 * N_STATIONS,), "force at each station, and where it is, world [N], [m]"),
    )),
    CStruct("weather", "Wind and pushes as they unfold.", (
        ("mean_w gust_w push_w", "f8", (3,), "mean wind, turbulence [m/s]; the push that is on now [N]; world"),
        ("next_push push_end", "f8", (), "when the next begins, and the present one ends [s]", (INFINITE, USUAL)),
    )),
    CStruct("pending", "A command on its way.", (
        ("due vectoring_due", "i8", (), "physics steps at which thrusts and joints, and vectoring angles, arrive",
         COUNT),
        ("target", "f8", (N_ACTUATORS,), "thrusts [N], joints, vectoring angles [rad]"),
    )),
    CStruct("sensor_memory", "Everything about the sensors that changes.", (
        ("gyro_bias accelerometer_bias", "f8", (3,), "[rad/s], [m/s²]"),
        ("drift", "f8", (6,), "slow error of position [m] and attitude [rad]"),
        ("velocity_w", "f8", (3,), "of the inertial unit at its last sample [m/s]"),
        ("silent_until next_pose next_encoder", "f8", (), "[s]"),
        ("frames samples", "i4", (), "of the motion capture on their way; of the inertial unit since the last tick",
         ((0, MAX_FRAMES), (0, IMU_SAMPLES))),
        ("frame_time", "f8", (MAX_FRAMES,), "oldest first [s]"),
        ("frame_position_w", "f8", (MAX_FRAMES, 3), "[m]"),
        ("frame_quat_wb", "f8", (MAX_FRAMES, 4), ""),
        ("imu_time", "f8", (IMU_SAMPLES,), "oldest first [s]"),
        ("gyro_b specific_force_b", "f8", (IMU_SAMPLES, 3), "[rad/s], [m/s²]"),
        ("encoder_time", "f8", (), "of the latest reading [s]"),
        ("angles", "f8", (N_ANGLES,), "what the servos indicated [rad]"),
        ("torque", "f8", (N_JOINTS,), "what they reported [Nm]"),
    )),
    CStruct("touch", "What touches the floor at one instant.", (
        ("balls", "i4", (N_BALLS,), "whether each foot, then each peg does", FLAG),
        ("ducts", "i4", (), "whether a duct does", FLAG),
        ("slip", "f8", (2 * N_LEGS,), "speed of the touching points of feet, then of the torso's pegs [m/s]"),
        ("duct_clearance", "f8", (), "height of the lowest duct over the floor [m]", INFINITE),
        ("hit", "f8", (), "largest force on anything but feet and pegs, where there are boxes [N]"),
    )),
    CStruct("plant", "One simulated robot: what it is, and all that changes about it.", (
        ("config", "plant_config", (), ""),
        ("disturbances", "disturbances", (), ""),
        ("floor_R", "f8", (9,), "attitude of the floor"),
        ("highest_tile", "f8", (), "over the floor's plane [m]"),
        ("delay vectoring_delay", "i8", (), "between a command and the actuators, in physics steps", COUNT),
        ("row", "f8", (MUJOCO_STATE,), "MuJoCo's state"),
        ("state", "robot_state", (), "the true state"),
        ("clock", "i8", (), "physics steps since the reset", COUNT),
        ("pending_first pending_count", "i4", (), "a ring", ((0, MAX_PENDING - 1), (0, MAX_PENDING - 1))),
        ("pending", "pending", (MAX_PENDING,), ""),
        ("torque_limit", "f8", (N_JOINTS,), "that the joint servos may use [Nm]"),
        ("in_contact diverged has_air senses", "i4", (), "touching; no longer finite; something blows; measuring",
         FLAG),
        ("violated", "i4", (), "bits of sp_constraint, since somebody made it 0", (0, 31)),
        ("clearance", "f8", (), "least height of everything over the highest tile at the end of the last tick [m]"),
        ("hit", "f8", (), "largest force in the last tick on anything but feet and pegs, where there are boxes [N]"),
        ("spent_wh", "f8", (), "that the battery lacks at the reset [Wh]", SINCE),
        ("noise", "f8", (N_ROTORS,), "of the thrusts [N]"), ("weather", "weather", (), ""),
        ("air_force_w", "f8", (3,), "of the air besides the thrust in still air, world [N]"),
        ("air_factor", "f8", (N_DUCTS,), "thrust of each duct over that in still air"),
        ("falling", "i4", (N_ROTORS,), "modules whose thrust falls", FLAG),
        ("loose", "f8", (N_JOINTS,), "where each joint is within its play [rad]"),
        ("is_stuck", "i4", (), "whether the next counts", FLAG),
        ("stuck", "f8", (2,), "vectoring angles of a module whose servos have failed [rad]"),
        ("power energy_wh", "f8", (), "[W], since the reset [Wh]"),
        ("sensors", "sensor_memory", (), ""),
        ("generator", "generator", (), "source of noise, wind and pushes"),
    )),
    CStruct("goal", "A form to take.", (
        ("start deadline", "f8", (), "when it becomes the target; when the slowest joint arrives [s]"),
        ("joint_target", "f8", (N_JOINTS,), "q [rad]"),
        ("reached", "i4", (), "whether it was, in time", FLAG),
    )),
    CStruct("draw", "A number of a plant's configuration that is drawn, or a run of them.", (
        ("at count operation", "i4", (), "byte of the configuration; how many; sp_operation"),
        ("low high", "f8", (), "even in between at strength 1"),
    )),
    CStruct("action_mode", "What the entries of an action are.", (
        ("size is_direct channels", "i4", (), "entries; whether no controller stands behind; bits of sp_channel"),
        ("authority", "f8", (MAX_ENTRIES,), "what 1 becomes"),
    )),
    CStruct("rules", "What all robots of an environment share.", (
        ("plant", "plant_config", (), "the robot that others are drawn around"),
        ("estimator", "estimator_config", (), ""),
        ("mode", "action_mode", (), ""),
        ("bound", "f8", (MAX_OBSERVATION,), "of the observation"),
        ("size", "i4", (), "of the observation"),
        ("is_described", "i4", (), "whether every robot is the described one, so that a hover needs no trim"),
        ("draws", "i4", (), "how many of the next count"),
        ("draw", "draw", (MAX_DRAWS,), "in the order of the draws"),
        ("strength", "f8", (), "of the randomisation, 0 … 1"),
        ("horizon", "i8", (), "ticks of an episode; success is judged there"),
        ("truncates autoreset", "i4", (), "whether it ends there; sp_autoreset"),
        ("is_commanded is_referred", "i4", (), "whether commands are Python's; whether references are"),
        ("is_advised", "i4", (), "whether the controller says what it would do where an action goes past it"),
    )),
    CStruct("hover_rules", "The task of a flight.", (
        ("rules", "rules", (), ""),
        ("controller", "controller_config", (), ""),
        ("position_w", "f8", (3,), "where the CoG is to be [m]"),
        ("joint_speed perturbation horizon_s", "f8", (), "[rad/s]; of the start, 1; forms are drawn until then [s]"),
        ("avoids windows", "i4", (), "whether rotors are restricted; how many windows of time without"),
        ("window", "f8", (MAX_WINDOWS, 2), "from, until [s]"),
        ("form", "f8", (len(FORMS), N_JOINTS), "the paper's [rad]"),
        ("range", "f8", (len(DRAWN), 2, 4), "least and largest angles of a leg's joints in drawn forms [rad]"),
        ("drawn_legs", "i4", (len(DRAWN),), "how many legs are drawn; the others are alike"),
        ("mixture", "f8", (2,), "of drawn forms: share of the paper's; of these and those with equal legs"),
        ("paper_pause", "f8", (), "from the paper's first form to its second [s]"),
        ("pause", "f8", (2,), "between drawn forms, drawn in between [s]"),
        ("offset", "f8", (2,), "of the start, position and attitude per axis at most [m], [rad]"),
        ("arrival_grace arrival_tolerance", "f8", (), "how late [s] and how far off [rad] a form may be reached"),
        ("path heading", "i4", (), "sp_path_kind; sp_heading"),
        ("path_mixture", "f8", (2,), "share of straight legs; of these and lemniscates"),
        ("speed", "f8", (2,), "of a path, drawn in between [m/s]"),
        ("path_begin half_width", "f8", (), "when it begins [s]; of a lemniscate [m]"),
        ("corner_radius corner_turn", "f8", (2,), "of corners from where it begins [m]; from one to the next [rad]"),
        ("bend_radius bend_turn", "f8", (2,), "of points round a spline's middle [m]; from one to the next [rad]"),
        ("climb", "f8", (), "that its points are higher at most [m]"),
    )),
    CStruct("episode", "What every environment's robot has besides the simulated one.", (
        ("generator", "generator", (), "of the environment: it draws what an episode is"),
        ("disturbances", "disturbances", (), "of this episode and those after it"),
        ("estimator", "estimator", (), ""),
        ("seen", "robot_state", (), "what the controller sees: the state, or its estimate where there are sensors"),
        ("action", "f8", (MAX_ENTRIES,), "the last, within [−1, 1]"),
        ("has_command", "i4", (), "whether there was a tick", FLAG),
        ("command", "command", (), "the last"),
        ("residual", "residual", (), "what the action added"),
        ("ticks", "i8", (), "since the reset", COUNT),
        ("failure", "i4", (), "why the episode is over, or −1", CODE),
        ("truncated over", "i4", (), "whether the horizon is reached; whether the next step is a reset", FLAG),
        ("drawn", "f8", (DRAWN_NUMBERS,), "what was drawn of the robot, in the order of the draws"),
    )),
    CStruct("hover_robot", "A robot in flight: simulated, controlled, and what it is to do.", (
        ("plant", "plant", (), ""),
        ("episode", "episode", (), ""),
        ("flight", "flight", (), ""),
        ("percept truth", "control_state", (), "what the controller makes of what it sees; of the true state"),
        ("reference", "reference", (), ""),
        ("preview", "preview", (), ""),
        ("leg_momentum leg_momentum_rate", "f8", (3,), "[Nms], [Nm]"),
        ("joint_velocity", "f8", (N_JOINTS,), "of the joint commands [rad/s]"),
        ("position_error attitude_error", "f8", (3,), "true ones [m], [rad]"),
        ("forms is_given has_trim", "i4", (), "which sequence; whether the start is given; whether with its trim",
         ("sequence", FLAG, FLAG)),
        ("offset rotation velocity omega", "f8", (3,), "of the start [m], [rad], of the CoG [m/s], [rad/s]"),
        ("trim", "f8", (6,), "what a hover takes beyond the description [N, Nm]"),
        ("goals current flown", "i4", (), "how many; which is the target; ticks", COUNT),
        ("knots", "i4", (), "of the path; 0 where there is none", COUNT),
        ("position_sum attitude_sum", "f8", (), "of squared errors [m²], [rad²]"),
        ("is_led", "i4", (), "whether the controller's advice is done in place of the action", FLAG),
        ("advice", "command", (), "what the controller would have commanded at the last tick"),
    )),
    CStruct("info", "What is told of every robot after a tick.", (
        ("thrust_command thrust", "f8", (N_ROTORS,), "[N]"),
        ("vectoring_command vectoring", "f8", (N_ROTORS, 2), "(φ, θ) [rad]"),
        ("joint_torque_allocated joint_torque", "f8", (N_JOINTS,), "[Nm]"),
        ("wrench_allocated", "f8", (6,), "[N, Nm]"),
        ("total_thrust qp_slack", "f8", (), "[N]"),
        ("thrust_factor", "f8", (N_ROTORS,), "thrust of each module over that in still air"),
        ("air_force", "f8", (3,), "world [N]"),
        ("power_w energy_wh endurance_min", "f8", (), ""),
        ("cost cost_contact cost_torque cost_duct cost_blown", "f8", (), "of violated constraints: the sum, each"),
        ("qp_status_code qp_iterations failure_code", "i4", (), "sp_status or −1; of the task or −1",
         (CODE, COUNT, CODE)),
    )),
    CStruct("hover_info", "What is told of a flight.", (
        ("info", "info", (), ""),
        ("position_error attitude_error", "f8", (3,), "true ones [m], [rad]"),
        ("wrench_desired", "f8", (6,), "[N, Nm]"),
        ("restricted_rotors", "b1", (N_ROTORS,), "", FLAG),
        ("is_success", "b1", (), "", FLAG),
    )),
    quantity_struct("quantities", "What is counted of every robot, for its task.", Quantities),
    quantity_struct("hover_quantities", "What is counted of robots in flight.", HoverQuantities),
    CStruct("flight_start", "What is drawn of a flight besides forms and knots.", (
        ("position rotation", "f8", (3,), "offset of the torso [m], [rad]"),
        ("goals knots", "i4", (), "how many"),
    )),
    CStruct("watch", "What is looked at in a flight besides what is told.", (
        ("config", "interference_config", (), ""),
        ("bounds", "interference", (), "of now, and of the last look before it"),
        ("tolerance thrust", "f8", (), "how far beyond [rad] and with more than which thrust [N] one interferes"),
        ("planned", "f8", (N_JOINTS,), "joint angles of the schedule now [rad]"),
        ("interferes", "i4", (), "whether a rotor does"),
    )),
    CStruct("crawl_rules", "The task of a crawl.", (
        ("rules", "rules", (), ""),
        ("controller", "crawler_config", (), ""),
        ("lies", "f8", (N_JOINTS,), "joint angles of the robot at rest [rad]"),
        ("way", "pose2", (), "the paper's"),
        ("share turn", "f8", (), "how often it is drawn; the other draws turn by at most so much [rad]"),
        ("distance", "f8", (2,), "and go at least and at most so far [m]"),
        ("is_given", "i4", (3,), "whether distance, direction and turn are, and not drawn"),
        ("given", "f8", (3,), "[m], [rad], [rad]"),
        ("steps", "f8", (), "the floor has steps of this height [m]; 0 leaves it as it is"),
        ("terrain", "i4", (), "an `sp_terrain`: what has them"),
        ("obstacles", "i4", (), "how many blocks"),
        ("obstacle", "f8", (MAX_OBSTACLES, 3), "x, y, radius [m]"),
        ("obstacle_height goal_clearance", "f8", (), "[m]"),
        ("settle_ticks", "i4", (), "in which the robot comes to lie on a floor that is no plane"),
        ("turn_length", "f8", (), "of a radian [m]"),
        ("success_position success_yaw", "f8", (), "how near the goal a robot rests at it [m], [rad]"),
        ("saturated rest_time rest_speed rest_turn rest_joint_speed rest_thrust", "f8", (),
         "a servo this close to its largest torque is [Nm]; a rest: [s], [m/s], [rad/s], [rad/s], of the weight"),
    )),
    CStruct("crawl_robot", "A robot on the ground: simulated, controlled, and what it is to do.", (
        ("plant", "plant", (), ""),
        ("episode", "episode", (), ""),
        ("crawl", "crawl", (), ""),
        ("touch", "touch", (), ""),
        ("tilt", "f8", (), "of the torso against the floor [rad]"),
        ("way goal", "pose2", (), "seen from the start; world"),
        ("cycles", "i4", (), "that the way takes; 0 where it is out of reach", COUNT),
        ("nominal_time", "f8", (), "where joints and torso go exactly as planned [s]"),
        ("error", "f8", (3,), "goal − torso, x, y [m], world, and yaw [rad]"),
        ("initial_distance distance", "f8", (), "to the goal, a radian counting as some metres [m]"),
        ("crawled timeouts rested", "i4", (), "ticks; phases timed out; ticks of rest till now", COUNT),
        ("swinging", "i4", (N_LEGS,), "whether the feet are on their way", FLAG),
        ("phase is_done", "i4", (), "sp_phase; whether the gait is done", ("phase", FLAG)),
        ("finished", "f8", (), "when the gait was done, or without one had rested at the goal [s]; 0 before"),
        ("swing_ticks airborne_ticks", "f8", (N_LEGS,), "ticks of the swing; of these in the air"),
        ("foot_slip peg_slip", "f8", (N_LEGS,), "ways on the floor [m]"),
        ("duct_clearance", "f8", (), "least so far [m]", INFINITE),
        ("duct_contact", "i4", (), "whether a duct touched it", FLAG),
        ("saturation thrust thrust_peak", "f8", (), "sums over ticks: saturated joints, thrust over weight; its peak"),
        ("tilt_legs tilt_torso", "f8", (), "largest tilt while legs are lifted, while the torso moves [rad]"),
    )),
    quantity_struct("crawl_quantities", "What is counted of robots on the ground.", CrawlQuantities),
    CStruct("crawl_info", "What is told of a crawl.", (
        ("info", "info", (), ""),
        ("goal_error", "f8", (3,), "[m], [m], [rad]"),
        ("time_s nominal_time_s airborne_share foot_slip_m peg_slip_m duct_clearance_m", "f8", (), ""),
        ("saturation_share thrust_fraction thrust_fraction_mean thrust_fraction_peak", "f8", (), ""),
        ("tilt_rad cost_of_transport", "f8", (), ""),
        ("phase_code timeouts shortfalls_code", "i4", (), "sp_phase; phases; bits of sp_shortfall",
         ("phase", COUNT, (0, 255))),
        ("foot_contact", "b1", (N_LEGS,), "", FLAG),
        ("finished is_success", "b1", (), "", FLAG),
    )),
    quantity_struct("course_quantities", "What is counted of robots on a course.", CourseQuantities),
    CStruct("course_rules", "The task of a course.", (
        ("rules", "rules", (), ""),
        ("manager", "manager_config", (), ""),
        ("kinds floors", "i4", (len(gates.KINDS) + 1,), "sp_gate_kind that is drawn; SP_GATE_KINDS is a plain floor"),
        ("kind_count floor_count", "i4", (), "how many they are"),
        ("count", "i4", (2,), "least and largest number of gates"),
        ("size", "f8", (len(gates.KINDS), 2), "drawn in between, by sp_gate_kind [m], [rad]"),
        ("depth", "f8", (len(gates.KINDS),), "of gates along the course [m]"),
        ("first_gap gap goal_way", "f8", (2,), "to the first gate, between two, from a floor's begin to the goal [m]"),
        ("floor_gap floor_length middle goal_side goal_yaw", "f8", (), "[m], the last [rad]"),
        ("charge", "f8", (2,), "of the battery at the start, drawn in between"),
        ("is_waypoint hold decide", "i4", (), "whether an action is a target; ticks of a step; between decisions"),
        ("stop", "f8", (len(COURSE_QUANTITIES),), "limit of each of the quantities, beyond which a step ends"),
        ("lies at_rest", "f8", (), "[m], [m/s]"),
        ("carried turn_length success_position success_yaw", "f8", (), "of the weight; of a radian [m]; [m], [rad]"),
    )),
    CStruct("course_robot", "A robot on a course: simulated, controlled, and what it is to do.", (
        ("plant", "plant", (), ""),
        ("episode", "episode", (), ""),
        ("manager", "manager", (), ""),
        ("pilot", "pilot", (), ""),
        ("course", "course", (), ""),
        ("is_given", "i4", (), "whether it is given, not drawn", FLAG),
        ("error", "f8", (3,), "goal − torso, x, y [m], world, and yaw [rad]"),
        ("initial_distance distance", "f8", (), "to the goal, a radian counting as some metres [m]"),
        ("controls flown crawled lies", "i4", (), "ticks, in the air, of crawling; whether it lies",
         (COUNT, COUNT, COUNT, FLAG)),
        ("phase", "i4", (), "sp_manager_phase", "manager_phase"),
        ("arrived", "f8", (), "since when it lies at the goal [s]; 0 if it does not"),
        ("hit most_hit tilt charge", "f8", (), "largest force of the last step, of all [N]; [rad]; of the battery"),
    )),
    CStruct("course_info", "What is told of a course.", (
        ("info", "info", (), ""),
        ("goal_error", "f8", (3,), "[m], [m], [rad]"),
        ("distance_m time_s flown_s crawled_s charge hit_n most_hit_n tilt_rad thrust_fraction", "f8", (), ""),
        ("phase_code gate", "i4", (), "sp_manager_phase; how many gates and floors are behind it",
         ("manager_phase", (0, gates.MAX_GATES))),
        ("lies finished is_success", "b1", (), "", FLAG),
    )),
)  # fmt: skip
"""In the order of their definition: those inside others first."""


@cache
def engine_layouts() -> dict[str, np.dtype]:
    """Every struct of the library as a numpy type, by name."""
    return dtypes((*configuration_structs(), *ENGINE_STRUCTS), core_layouts())
