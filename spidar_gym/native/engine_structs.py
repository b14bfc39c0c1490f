"""The engine's own numbers and structs, which become C text and numpy types: robots, their rules and results."""

from collections.abc import Sequence
from functools import cache
from types import ModuleType

import numpy as np

from spidar_gym.control.course import gates
from spidar_gym.control.locomotion import commands as locomotion
from spidar_gym.native.configurations import configuration_structs
from spidar_gym.native.constants import MAX_ENTRIES, MAX_OBSERVATION, Enumeration
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.quantities import (
    CourseQuantities,
    CrawlQuantities,
    GraspQuantities,
    HoverQuantities,
    Quantities,
    quantity_names,
    quantity_struct,
)
from spidar_gym.native.structs import ANY, CODE, COUNT, FLAG, INFINITE, SINCE, USUAL, CStruct, dtypes
from spidar_gym.robot import FORMS, N_JOINTS, N_LEGS, N_LINKS, N_ROTORS, PEG_SITES
from spidar_gym.sim import (
    actuators,
    air,
    course_boxes,
    disturbances,
    energy,
    ground,
    object,
    recirculation,
    scene,
    sensors,
    violations,
)
from spidar_gym.sim.air import N_DUCTS
from spidar_gym.sim.ground import BOXES, STAIR_ROW, STAIR_ROWS, STAIRS, TERRAINS, TILES
from spidar_gym.sim.worlds import MAX_KINDS
from spidar_gym.state import IMU_SAMPLES

AIR_STEPS = 10
"""Physics steps between two evaluations of the air: 25 ms; docs/concepts/air.md states the error of this hold."""
SERVO_STEPS = 5
"""Physics steps between two updates of falling thrusts and of the joints' play: 12.5 ms."""
IMU_STEPS = 2
"""Physics steps between two samples of the sensors: 5 ms, 200 Hz."""
FASTEST = 12.0
"""Contact detection is skipped where a fall at this speed would not reach the floor within a control period [m/s]."""
N_ANGLES, N_ACTUATORS = N_JOINTS + 2 * N_ROTORS, N_ROTORS + N_JOINTS + 2 * N_ROTORS
N_BALLS = N_LEGS + len(PEG_SITES)
N_STATIONS = N_DUCTS + 3 * N_LINKS + 5
"""Points at which the air is evaluated: the ducts, three points on each link, five on the torso."""
N_DOFS = 6 + N_ANGLES
MUJOCO_STATE, OBJECT_STATE = 438, 31
"""Size of MuJoCo's state `mjSTATE_INTEGRATION` of a robot, and what an object adds to it; checked for each model."""
MAX_BODIES, MAX_MOVING, MAX_GEOMS = 64, 64, 512
"""Largest numbers of bodies, of geoms of the robot and of all geoms."""
MAX_WARNING_BYTES = 256
"""Largest size of MuJoCo's counts of its warnings [bytes]."""
MAX_PENDING = 32
"""Largest number of delayed commands."""
MAX_FRAMES = 16
"""Largest number of delayed motion-capture frames: at 100 Hz more than the longest latency, 0.1 s, and four more."""
DRAWN = ("equal", "independent", "narrow")
"""Sequences of forms that are sampled from ranges of angles."""
MAX_QUANTITIES = max(
    len(quantity_names(kind)) for kind in (HoverQuantities, CrawlQuantities, CourseQuantities, GraspQuantities)
)
"""Largest number of quantities of a task."""
ENGINE_SIZES = {
    "DUCTS": N_DUCTS, "ACTUATORS": N_ACTUATORS, "BALLS": N_BALLS, "STATIONS": N_STATIONS, "DOFS": N_DOFS,
    "QPOS": N_DOFS + 1, "MAX_BODIES": MAX_BODIES, "MAX_PENDING": MAX_PENDING, "MAX_FRAMES": MAX_FRAMES,
    "TILES": TILES, "STAIR_ROW": STAIR_ROW, "STAIR_ROWS": STAIR_ROWS, "STAIRS": STAIRS, "BOXES": BOXES,
    "AIR_STEPS": AIR_STEPS, "SERVO_STEPS": SERVO_STEPS,
    "FACES": object.FACES, "FACE_PATCHES": object.FACE_PATCHES,
    "IMU_STEPS": IMU_STEPS, "FASTEST": FASTEST, "MAX_WARNING_BYTES": MAX_WARNING_BYTES,
}  # fmt: skip
"""Numbers by their names in C without `SP_`."""
ENGINE_NUMBERS: tuple[tuple[str, ModuleType, tuple[str, ...]], ...] = (
    ("", scene, ("TIMESTEP",)),
    ("", object, ("RESTING", "STILL_AIR", "REST_SHARE", "REST_LEVER")),
    ("", air, ("AIR_DENSITY", "BLUFF", "LINK_SEGMENT", "REACH", "SPREAD", "STACKING_RADIUS")),
    ("JET_", air, ("NEAR", "LEAST_THRUST")),
    ("", actuators, ("NOISE_BANDWIDTH", "STICKING")),
    ("", recirculation, ("NEAR_LENGTH",)),
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
"""Prefix in C, Python module, and names of the numbers in it."""
SEQUENCES = ("paper", *FORMS, *DRAWN, "mixed")
"""Sequences of forms."""
PATHS = ("none", "legs", "lemniscate", "spline", "mixed")
"""Paths of the CoG."""
HEADINGS = ("kept", "along", "mixed")
"""Headings of the robot on its path."""
MAX_OBSTACLES, MAX_WINDOWS, MAX_DRAWS, DRAWN_NUMBERS = 64, 16, 64, 256
"""Largest numbers of blocks on the floor, time windows, ranges of randomised numbers and randomised numbers in all."""
AUTORESETS = ("next_step", "same_step", "disabled")
"""Gymnasium's modes of resetting at the end of an episode."""
ENGINE_ENUMERATIONS = (
    Enumeration("operation", "How a sampled number changes the nominal one.", ("set", "scale", "add"), "DRAW_"),
    Enumeration("sequence", "Sequences of forms.", SEQUENCES, "FORMS_"),
    Enumeration("path_kind", "Paths of the CoG.", PATHS, "PATHS_"),
    Enumeration("heading", "Headings of the robot on its path.", HEADINGS, "HEADING_"),
    Enumeration("terrain", "Kinds of floors with steps.", TERRAINS, "TERRAIN_"),
    Enumeration("shape", "Shapes of an object.", object.SHAPES, "SHAPE_"),
    Enumeration("constraint", "Constraints of a robot.", violations.VIOLATIONS, "VIOLATED_", (1, 2, 4, 8, 16)),
    Enumeration("autoreset", "Modes of resetting at the end of an episode.", AUTORESETS, "RESET_"),
)  # fmt: skip
"""Enumerations of the engine."""


ENGINE_STRUCTS: Sequence[CStruct] = (
    CStruct("generator", "A stream of random numbers: numpy's PCG64, and the seed state that spawns other streams.", (
        ("state_high state_low", "u8", (), "of PCG64", ANY),
        ("increment_high increment_low", "u8", (), "odd; selects one of PCG64's streams", ANY),
        ("has_half half", "u4", (), "whether the upper half of a draw is unused; that half", (FLAG, ANY)),
        ("pool", "u4", (4,), "the seed and the spawn key, mixed", ANY),
        ("hash spawned", "u4", (), "next constant of the mixing; number of spawned streams", ANY),
    )),
    CStruct("world", "The robot and the floor in MuJoCo: indices into MuJoCo's arrays, and constants.", (
        ("bodies torso floor geoms moving", "i4", (), "number; body; geom; numbers of all geoms and of the robot's"),
        ("module_body link_body", "i4", (N_ROTORS,), "bodies"),
        ("part_body", "i4", (4 * N_LINKS,), "bodies of a link: junction, link, and the two of its module"),
        ("body_parent body_dofadr body_dofnum", "i4", (MAX_BODIES,), "of MuJoCo's tree"),
        ("joint_qpos joint_dof", "i4", (N_ANGLES,), "of joints, then vectoring angles"),
        ("ball ball_body", "i4", (N_BALLS,), "geoms of the feet, then of the pegs; their bodies"),
        ("duct", "i4", (N_DUCTS,), "geoms of the ducts"),
        ("geom", "i4", (MAX_MOVING,), "geoms of the robot"),
        ("geom_kind", "i4", (MAX_GEOMS,), "index of a ball, SP_BALLS for a duct, −1 for other geoms"),
        ("geom_touches geom_is_foot", "i4", (MAX_GEOMS,), "whether it collides with the floor; whether it is a foot"),
        ("tile", "i4", (TILES * TILES,), "geoms of the tiles, row by row; −1 where there are none"),
        ("box", "i4", (BOXES,), "geoms of the boxes; −1 where there are none"),
        ("object object_geom", "i4", (), "body and geom of the object; −1 where there is none"),
        ("mass", "f8", (MAX_BODIES,), "of the described robot [kg]"),
        ("torso_axes", "f8", (4,), "principal axes of the torso's inertia, a quaternion"),
        ("inertia com", "f8", (MAX_BODIES, 3), "principal inertia [kg m²]; CoG [m]"),
        ("geom_reach", "f8", (MAX_MOVING,), "bounding radius [m]"),
        ("ball_radius", "f8", (N_BALLS,), "[m]"),
        ("duct_radius duct_half", "f8", (N_DUCTS,), "radius and half height [m]"),
        ("weight max_joint_torque torso_radius torso_height", "f8", (), "[N], [Nm], [m]"),
        ("propeller_radius duct_offset_y duct_z", "f8", (), "of a duct; its exit below the module's centre [m]"),
        ("link_station link_width", "f8", (3,), "stations along a link, and its width there [m]"),
        ("link_scale", "f8", (N_ROTORS,), "length of each link over that of the link with these stations"),
        ("gravity battery_share", "f8", (), "[m/s²]; largest thrust over that with the measured battery"),
        ("vectoring_kd", "f8", (), "damping of a vectoring servo [Nm s/rad]"),
        ("imu_position_b", "f8", (3,), "position of the inertial unit, which motion capture tracks [m]"),
        ("encoder_step", "f8", (N_ANGLES,), "one count of each encoder [rad]"),
        ("object_type", "i4", (len(object.SHAPES),), "MuJoCo's geom type of each shape"),
        ("patch", "f8", (len(object.SHAPES), object.N_PATCHES, object.PATCH), "of objects with half sizes of 1"),
        ("start", "f8", (MUJOCO_STATE + OBJECT_STATE,), "MuJoCo's state after a reset"),
    )),
    CStruct("air", "Result of one evaluation of the air.", (
        ("generalized", "f8", (N_DOFS,), "generalised force for qfrc_applied [N, Nm]"),
        ("thrust_factor", "f8", (N_DUCTS,), "thrust of each duct over that in still air"),
        ("forces_w points_w", "f8", (3 * N_STATIONS,), "force at each station and its position, world [N], [m]"),
        ("object_force_w object_torque_w", "f8", (3,), "on the object, about its origin, world [N], [Nm]"),
    )),
    CStruct("weather", "State of wind and pushes.", (
        ("mean_w gust_w push_w", "f8", (3,), "mean wind, turbulence [m/s]; present push [N]; world"),
        ("next_push push_end", "f8", (), "start of the next push, end of the present one [s]", (INFINITE, USUAL)),
    )),
    CStruct("pending", "A delayed command.", (
        ("due vectoring_due", "i8", (), "physics step at which thrusts and joints arrive; vectoring angles",
         COUNT),
        ("target", "f8", (N_ACTUATORS,), "thrusts [N], joints, vectoring angles [rad]"),
    )),
    CStruct("sensor_memory", "State of the sensors.", (
        ("gyro_bias accelerometer_bias", "f8", (3,), "[rad/s], [m/s²]"),
        ("drift", "f8", (6,), "slow error of position [m] and attitude [rad]"),
        ("velocity_w", "f8", (3,), "of the inertial unit at its last sample [m/s]"),
        ("silent_until next_pose next_encoder", "f8", (), "[s]"),
        ("frames samples", "i4", (), "delayed motion-capture frames; inertial samples since the last tick",
         ((0, MAX_FRAMES), (0, IMU_SAMPLES))),
        ("frame_time", "f8", (MAX_FRAMES,), "oldest first [s]"),
        ("frame_position_w", "f8", (MAX_FRAMES, 3), "[m]"),
        ("frame_quat_wb", "f8", (MAX_FRAMES, 4), ""),
        ("imu_time", "f8", (IMU_SAMPLES,), "oldest first [s]"),
        ("gyro_b specific_force_b", "f8", (IMU_SAMPLES, 3), "[rad/s], [m/s²]"),
        ("encoder_time", "f8", (), "of the latest reading [s]"),
        ("angles", "f8", (N_ANGLES,), "indicated by the servos [rad]"),
        ("torque", "f8", (N_JOINTS,), "reported by the servos [Nm]"),
    )),
    CStruct("touch", "Floor contacts at one instant.", (
        ("balls", "i4", (N_BALLS,), "whether each foot, then each peg, touches it", FLAG),
        ("ducts", "i4", (), "whether a duct touches it", FLAG),
        ("slip", "f8", (2 * N_LEGS,), "speed of the touching points of feet, then of the torso's pegs [m/s]"),
        ("duct_clearance", "f8", (), "height of the lowest duct over the floor [m]", INFINITE),
        ("hit", "f8", (), "largest force on anything but feet and pegs, with boxes only [N]"),
    )),
    CStruct("object_state", "State of the object, and what acts on it.", (
        ("position_w", "f8", (3,), "origin [m]"),
        ("quat_wo", "f8", (4,), "attitude (w, x, y, z)"),
        ("velocity_w omega_o", "f8", (3,), "of the origin, world [m/s]; angular velocity, object axes [rad/s]"),
        ("foot_force_w", "f8", (3 * N_LEGS,), "force of each foot on it in the last physics step, world [N]"),
        ("floor_force_w", "f8", (3,), "force of floor and boxes on the object in it [N]"),
        ("air_force_w air_torque_w", "f8", (3,), "force of the air and its torque about the origin [N], [Nm]"),
        ("is_hit rests", "i4", (), "touched by more than feet; at rest, the robot away", FLAG),
    )),
    CStruct("plant", "One simulated robot: configuration and state.", (
        ("config", "plant_config", (), ""),
        ("disturbances", "disturbances", (), ""),
        ("floor_R", "f8", (9,), "attitude of the floor"),
        ("highest_tile", "f8", (), "over the floor's plane [m]"),
        ("delay vectoring_delay", "i8", (), "between a command and the actuators, in physics steps", COUNT),
        ("row", "f8", (MUJOCO_STATE + OBJECT_STATE,), "MuJoCo's state; the end is unused without an object"),
        ("state", "robot_state", (), "the true state"),
        ("clock", "i8", (), "physics steps since the reset", COUNT),
        ("pending_first pending_count", "i4", (), "ring buffer", ((0, MAX_PENDING - 1), (0, MAX_PENDING - 1))),
        ("pending", "pending", (MAX_PENDING,), ""),
        ("torque_limit", "f8", (N_JOINTS,), "of the joint servos [Nm]"),
        ("in_contact diverged has_air senses", "i4", (), "touches the floor; not finite; has air; has sensors",
         FLAG),
        ("violated", "i4", (), "bits of sp_constraint since it was last set to 0", (0, 31)),
        ("clearance", "f8", (), "lower bound of the height over the highest tile after the last tick [m]"),
        ("hit", "f8", (), "largest force of the last tick on anything but feet and pegs, with boxes only [N]"),
        ("spent_wh", "f8", (), "energy that the battery lacks at the reset [Wh]", SINCE),
        ("noise", "f8", (N_ROTORS,), "of the thrusts [N]"), ("weather", "weather", (), ""),
        ("eddy", "f8", (6,), "recirculation: U, Ω less their means, over their standard deviations"),
        ("air_force_w", "f8", (3,), "of the air, without the thrust in still air, world [N]"),
        ("air_factor", "f8", (N_DUCTS,), "thrust of each duct over that in still air"),
        ("falling", "i4", (N_ROTORS,), "whether the thrust of each module falls", FLAG),
        ("loose", "f8", (N_JOINTS,), "position of each joint within its play [rad]"),
        ("sticks", "f8", (2 * N_ROTORS,), "angle at which dry friction holds each vectoring axis [rad]"),
        ("is_stuck", "i4", (), "whether `stuck` is valid", FLAG),
        ("stuck", "f8", (2,), "vectoring angles of a module whose servos have failed [rad]"),
        ("power energy_wh", "f8", (), "[W], since the reset [Wh]"),
        ("object", "object_state", (), "zero where there is none"),
        ("sensors", "sensor_memory", (), ""),
        ("generator", "generator", (), "of noise, wind and pushes"),
    )),
    CStruct("goal", "A form of the schedule.", (
        ("start deadline", "f8", (), "time at which it becomes the target; at which the slowest joint arrives [s]"),
        ("joint_target", "f8", (N_JOINTS,), "q [rad]"),
        ("reached", "i4", (), "whether it was reached in time", FLAG),
    )),
    CStruct("draw", "A randomised number of a plant's configuration, or a range of them.", (
        ("at count operation", "i4", (), "byte offset in the configuration; how many; sp_operation"),
        ("is_log", "i4", (), "whether the logarithm is uniform"),
        ("low high", "f8", (MAX_KINDS,), "limits of the distribution at strength 1 for each kind of robots"),
    )),
    CStruct("action_mode", "Meaning of the entries of an action.", (
        ("size is_direct channels", "i4", (), "entries; whether they bypass the controller; bits of sp_channel"),
        ("is_in_torso_axes", "i4", (), "whether those that bypass it are forces in torso axes and offsets of joints"),
        ("has_clock", "i4", (), "whether the observation has a clock"),
        ("trim", "f8", (), "share of the weight that the rotors bear at a zero action in torso axes"),
        ("authority", "f8", (MAX_ENTRIES,), "value of an entry of 1"),
    )),
    CStruct("rules", "Rules that all robots of an environment share.", (
        ("plant", "plant_config", (), "nominal robot of the randomisation"),
        ("estimator", "estimator_config", (), ""),
        ("mode", "action_mode", (), ""),
        ("bound", "f8", (MAX_OBSERVATION,), "of each number of the observation"),
        ("gain", "f8", (MAX_OBSERVATION,), "factor of each of its numbers, after the bound"),
        ("size is_scaled", "i4", (), "of the observation; whether its numbers are multiplied by `gain`"),
        ("is_described", "i4", (), "whether integrals begin at zero, as a described robot needs no trim"),
        ("draws", "i4", (), "number of valid entries of `draw`"),
        ("draw", "draw", (MAX_DRAWS,), "in the order of the draws"),
        ("strength", "f8", (), "of the randomisation, 0 … 1"),
        ("kinds kind", "i4", (), "number of kinds of robots, 0 for one; the given kind, −1 for a sampled one"),
        ("horizon hold", "i8", (), "steps of an episode, after which success is evaluated; ticks of a step"),
        ("stop", "f8", (MAX_QUANTITIES,), "limits of the quantities, above which a step of several ticks ends"),
        ("truncates autoreset", "i4", (), "whether the episode ends at the horizon; sp_autoreset"),
        ("is_commanded is_referred", "i4", (), "whether commands come from Python; whether references do"),
        ("is_advised", "i4", (), "whether the controller computes its advice where actions bypass it"),
    )),
    CStruct("hover_rules", "The task of a flight.", (
        ("rules", "rules", (), ""),
        ("controller", "controller_config", (), ""),
        ("position_w", "f8", (3,), "reference of the CoG [m]"),
        ("joint_speed perturbation horizon_s", "f8", (), "[rad/s]; of the start, 1; end of the schedule [s]"),
        ("avoids windows", "i4", (), "whether rotors are restricted; number of windows without restriction"),
        ("window", "f8", (MAX_WINDOWS, 2), "start and end [s]"),
        ("form", "f8", (len(FORMS), N_JOINTS), "the paper's [rad]"),
        ("range", "f8", (len(DRAWN), 2, 4), "least and largest angles of a leg's joints in sampled forms [rad]"),
        ("drawn_legs", "i4", (len(DRAWN),), "number of sampled legs; the others copy them"),
        ("mixture", "f8", (2,), "share of the paper's forms; of these and forms with equal legs"),
        ("paper_pause", "f8", (), "between the paper's first two forms [s]"),
        ("pause", "f8", (2,), "range of the pause between sampled forms [s]"),
        ("offset", "f8", (2,), "largest initial offset per axis, position [m] and attitude [rad]"),
        ("arrival_grace arrival_tolerance", "f8", (), "tolerances for reaching a form: delay [s], joint error [rad]"),
        ("path heading", "i4", (), "sp_path_kind; sp_heading"),
        ("path_mixture", "f8", (2,), "share of straight legs; of these and lemniscates"),
        ("speed", "f8", (2,), "range of the speed on a path [m/s]"),
        ("path_begin half_width", "f8", (), "start of a path [s]; of a lemniscate [m]"),
        ("corner_radius corner_turn", "f8", (2,), "ranges: corner from the start [m]; turn to the next [rad]"),
        ("bend_radius bend_turn", "f8", (2,), "ranges: point from a spline's middle [m]; turn to the next [rad]"),
        ("climb", "f8", (), "largest height of points above the start [m]"),
    )),
    CStruct("episode", "State of an episode that all tasks share.", (
        ("generator", "generator", (), "of the environment; samples the episodes"),
        ("disturbances", "disturbances", (), "of this episode and those after it"),
        ("estimator", "estimator", (), ""),
        ("seen", "robot_state", (), "observed state: the true one, or its estimate from the sensors"),
        ("action", "f8", (MAX_ENTRIES,), "last action, within [−1, 1]"),
        ("has_command", "i4", (), "whether `command` is valid", FLAG),
        ("command", "command", (), "last command"),
        ("residual", "residual", (), "of the last action"),
        ("ticks", "i8", (), "since the reset", COUNT),
        ("failure", "i4", (), "reason for the end of the episode, or −1", CODE),
        ("truncated over", "i4", (), "whether the horizon is reached; whether the next step is a reset", FLAG),
        ("kind", "i4", (), "of the robot, in a calibrated world", (0, MAX_KINDS - 1)),
        ("drawn", "f8", (DRAWN_NUMBERS,), "randomised numbers of the robot, in the order of the draws"),
    )),
    CStruct("hover_robot", "A robot in flight: plant, controller and task.", (
        ("plant", "plant", (), ""),
        ("episode", "episode", (), ""),
        ("flight", "flight", (), ""),
        ("percept truth", "control_state", (), "of the observed state; of the true state"),
        ("reference", "reference", (), ""),
        ("preview", "preview", (), ""),
        ("leg_momentum leg_momentum_rate", "f8", (3,), "[Nms], [Nm]"),
        ("joint_velocity", "f8", (N_JOINTS,), "of the joint commands [rad/s]"),
        ("position_error attitude_error", "f8", (3,), "true errors [m], [rad]"),
        ("forms is_given has_trim", "i4", (), "sequence of forms; whether the start is given; its trim too",
         ("sequence", FLAG, FLAG)),
        ("offset rotation velocity omega", "f8", (3,), "initial offset [m], [rad], velocity of the CoG [m/s], [rad/s]"),
        ("trim", "f8", (6,), "wrench of a hover beyond that of the description [N, Nm]"),
        ("goals current flown", "i4", (), "number of goals; index of the present one; ticks", COUNT),
        ("knots", "i4", (), "number of knots of the path; 0 without a path", COUNT),
        ("position_sum attitude_sum", "f8", (), "of squared errors [m²], [rad²]"),
        ("is_led", "i4", (), "whether the controller's advice is executed instead of the action", FLAG),
        ("advice", "command", (), "command that the controller would have issued at the last tick"),
    )),
    CStruct("info", "`info` of every task.", (
        ("thrust_command thrust", "f8", (N_ROTORS,), "[N]"),
        ("vectoring_command vectoring", "f8", (N_ROTORS, 2), "(φ, θ) [rad]"),
        ("joint_torque_allocated joint_torque", "f8", (N_JOINTS,), "[Nm]"),
        ("wrench_allocated", "f8", (6,), "[N, Nm]"),
        ("total_thrust qp_slack", "f8", (), "[N]"),
        ("thrust_factor", "f8", (N_ROTORS,), "thrust of each module over that in still air"),
        ("air_force", "f8", (3,), "world [N]"),
        ("power_w energy_wh endurance_min", "f8", (), ""),
        ("cost cost_contact cost_torque cost_duct cost_blown", "f8", (), "of violated constraints: sum, and each"),
        ("qp_status_code qp_iterations failure_code", "i4", (), "sp_status or −1; number; failure of the task or −1",
         (CODE, COUNT, CODE)),
    )),
    CStruct("hover_info", "`info` of a flight.", (
        ("info", "info", (), ""),
        ("position_error attitude_error", "f8", (3,), "true errors [m], [rad]"),
        ("wrench_desired", "f8", (6,), "[N, Nm]"),
        ("restricted_rotors", "b1", (N_ROTORS,), "", FLAG),
        ("is_success", "b1", (), "", FLAG),
    )),
    quantity_struct("quantities", "Quantities of every task.", Quantities),
    quantity_struct("hover_quantities", "Quantities of robots in flight.", HoverQuantities),
    CStruct("flight_start", "Sampled start of a flight, besides forms and knots.", (
        ("position rotation", "f8", (3,), "offset of the torso [m], [rad]"),
        ("goals knots", "i4", (), "numbers of both"),
    )),
    CStruct("watch", "Quantities of a flight that `info` does not contain.", (
        ("config", "interference_config", (), ""),
        ("bounds", "interference", (), "present bounds; those of the last call before"),
        ("tolerance thrust", "f8", (), "a rotor interferes if beyond its bound by this [rad] with this thrust [N]"),
        ("planned", "f8", (N_JOINTS,), "present joint angles of the schedule [rad]"),
        ("interferes", "i4", (), "whether a rotor interferes"),
    )),
    CStruct("crawl_rules", "The task of a crawl.", (
        ("rules", "rules", (), ""),
        ("controller", "crawler_config", (), ""),
        ("lies", "f8", (N_JOINTS,), "joint angles of the robot at rest [rad]"),
        ("way", "pose2", (), "displacement of the paper's crawl"),
        ("share turn", "f8", (), "share of `way` among the samples; largest turn of the others [rad]"),
        ("distance", "f8", (2,), "least and largest distance of the others [m]"),
        ("is_given", "i4", (3,), "whether distance, direction and turn are given, not sampled"),
        ("given", "f8", (3,), "[m], [rad], [rad]"),
        ("steps", "f8", (), "height of the steps of the floor [m]; 0 without steps"),
        ("terrain", "i4", (), "sp_terrain: kind of floor with steps"),
        ("obstacles", "i4", (), "number of blocks"),
        ("obstacle", "f8", (MAX_OBSTACLES, 3), "x, y, radius [m]"),
        ("obstacle_height goal_clearance", "f8", (), "[m]"),
        ("settle_ticks", "i4", (), "ticks in which the robot settles on an uneven floor"),
        ("turn_length", "f8", (), "distance equivalent to a radian [m]"),
        ("success_position success_yaw", "f8", (), "largest errors of a success [m], [rad]"),
        ("saturated rest_time rest_speed rest_turn rest_joint_speed rest_thrust", "f8", (),
         "margin to the torque limit [Nm]; limits of a rest: [s], [m/s], [rad/s], [rad/s], share of the weight"),
    )),
    CStruct("crawl_robot", "A robot on the ground: plant, controller and task.", (
        ("plant", "plant", (), ""),
        ("episode", "episode", (), ""),
        ("crawl", "crawl", (), ""),
        ("touch", "touch", (), ""),
        ("tilt", "f8", (), "of the torso against the floor [rad]"),
        ("way goal", "pose2", (), "displacement from the start; goal pose, world"),
        ("cycles", "i4", (), "number of gait cycles; 0 where the goal is out of reach", COUNT),
        ("nominal_time", "f8", (), "duration if joints and torso follow the plan exactly [s]"),
        ("error", "f8", (3,), "goal − torso, x, y [m], world, and yaw [rad]"),
        ("initial_distance distance", "f8", (), "to the goal; a radian counts as `turn_length` [m]"),
        ("crawled timeouts rested", "i4", (), "ticks; phases that timed out; ticks at rest until now", COUNT),
        ("swinging", "i4", (N_LEGS,), "whether each foot swings", FLAG),
        ("phase is_done", "i4", (), "sp_phase; whether the gait is done", ("phase", FLAG)),
        ("finished", "f8", (), "time of the gait's end, in `direct` of the end of the rest at the goal [s]; 0 before"),
        ("swing_ticks airborne_ticks", "f8", (N_LEGS,), "ticks in swing; ticks of swing in the air"),
        ("foot_slip peg_slip", "f8", (N_LEGS,), "distances slipped on the floor [m]"),
        ("duct_clearance", "f8", (), "least so far [m]", INFINITE),
        ("duct_contact", "i4", (), "whether a duct has touched the floor", FLAG),
        ("saturation thrust thrust_peak", "f8", (), "sums over ticks: saturated joints, thrust over weight; its peak"),
        ("tilt_legs tilt_torso", "f8", (), "largest tilt while legs are lifted, while the torso moves [rad]"),
    )),
    quantity_struct("crawl_quantities", "Quantities of robots on the ground.", CrawlQuantities),
    CStruct("crawl_info", "`info` of a crawl.", (
        ("info", "info", (), ""),
        ("goal_error", "f8", (3,), "[m], [m], [rad]"),
        ("time_s nominal_time_s airborne_share foot_slip_m peg_slip_m duct_clearance_m", "f8", (), ""),
        ("saturation_share thrust_fraction thrust_fraction_mean thrust_fraction_peak", "f8", (), ""),
        ("tilt_rad cost_of_transport", "f8", (), ""),
        ("phase_code timeouts shortfalls_code", "i4", (), "sp_phase; phases that timed out; bits of sp_shortfall",
         ("phase", COUNT, (0, 255))),
        ("foot_contact", "b1", (N_LEGS,), "", FLAG),
        ("finished is_success", "b1", (), "", FLAG),
    )),
    quantity_struct("grasp_quantities", "Quantities of robots that grasp.", GraspQuantities),
    CStruct("grasp_rules", "The task of grasping.", (
        ("rules", "rules", (), ""),
        ("manager", "manager_config", (), ""),
        ("shapes", "f8", (len(locomotion.OBJECTS),), "share of each shape"),
        ("half_width half_height mass friction most_force", "f8", (2,), "ranges [m], [m], [kg], 1, [N]"),
        ("off_centre", "f8", (), "largest offset of the centre of mass along each axis, share of the half size"),
        ("distance turn goal_distance goal_turn goal_yaw stand floor", "f8", (2,),
         "ranges: start → object [m], [rad]; object → goal [m], [rad]; of its heading [rad]; of stands [m]"),
        ("pressure bias noise turn_noise", "f8", (),
         "of jets on faces; largest error and noise of the seen object [m], [m], [rad]"),
        ("begin_height reserve", "f8", (), "of the torso at the start [m]; of the grip's limit over what is needed"),
        ("placed turned upright at_rest clear_of high", "f8", (), "of a success [m], [rad], [rad], [m/s], [m], [m]"),
        ("force_time touch", "f8", (), "of the mean force of a foot [s]; from which a foot touches [N]"),
        ("field ceiling", "f8", (), "largest distance from the start along x and y, and height [m]"),
        ("is_order decide", "i4", (), "whether an action steers; ticks between its decisions"),
        ("grip", "f8", (), "force of each foot that the rule orders [N]; 0 as tested, −1 as told"),
    )),
    CStruct("grasp_robot", "A robot that grasps: plant, controller and task.", (
        ("plant", "plant", (), ""),
        ("episode", "episode", (), ""),
        ("manager", "manager", (), ""),
        ("scene", "grasp_scene", (), ""),
        ("rule", "rule_memory", (), ""),
        ("is_given", "i4", (), "whether the scene is given, not sampled", FLAG),
        ("seen", "seen", (), "the object as motion capture sees it, a tick ago"),
        ("place_w", "f8", (3,), "where the object belongs at the goal [m]"),
        ("stood initial_way", "f8", (), "height of the object at the start [m]; distance to the goal [m]"),
        ("force", "f8", (N_LEGS,), "of the feet on the object, a mean over a tenth of a second [N]"),
        ("most_force most_lifted fall tilt charge", "f8", (), "largest so far [N], [m], [m/s]; [rad]; of the battery"),
        ("arrived", "f8", (), "time since which the object is delivered [s]; 0 if it is not"),
        ("controls hit", "i4", (), "ticks; whether a forbidden part has touched", (COUNT, FLAG)),
        ("phase grasp_phase", "i4", (), "sp_manager_phase; sp_grasp_phase", ("manager_phase", "grasp_phase")),
    )),
    CStruct("grasp_info", "`info` of a grasp.", (
        ("info", "info", (), ""),
        ("object_error", "f8", (3,), "goal − object, world [m]"),
        ("object_force", "f8", (N_LEGS,), "of each foot on the object [N]"),
        ("object_air", "f8", (3,), "force of the air on it, world [N]"),
        ("object_com", "f8", (3,), "its centre of mass from its middle [m]"),
        ("object_mass object_friction", "f8", (), "[kg], 1"),
        ("way_m yaw_error_rad lifted_m time_s charge tilt_rad thrust_fraction grip_n payload_kg", "f8", (), ""),
        ("force_n most_force_n", "f8", (), "largest mean force of a foot; of the episode [N]"),
        ("phase_code grasp_phase_code tries", "i4", (), "sp_manager_phase; sp_grasp_phase; of the rule",
         ("manager_phase", "grasp_phase", COUNT)),
        ("lost refused finished is_success", "b1", (), "", FLAG),
    )),
    quantity_struct("course_quantities", "Quantities of robots on a course.", CourseQuantities),
    CStruct("course_rules", "The task of a course.", (
        ("rules", "rules", (), ""),
        ("manager", "manager_config", (), ""),
        ("kinds floors", "i4", (len(gates.KINDS) + 1,), "sp_gate_kind to sample from; SP_GATE_KINDS is a plain floor"),
        ("kind_count floor_count", "i4", (), "numbers of kinds and floors"),
        ("count", "i4", (2,), "least and largest number of gates"),
        ("size", "f8", (len(gates.KINDS), 2), "ranges by sp_gate_kind [m], [rad]"),
        ("depth", "f8", (len(gates.KINDS),), "of gates along the course [m]"),
        ("first_gap gap goal_way", "f8", (2,), "ranges: to the first gate, between gates, floor to goal [m]"),
        ("floor_gap floor_length middle goal_side goal_yaw", "f8", (), "[m], the last [rad]"),
        ("charge", "f8", (2,), "range of the initial charge"),
        ("is_waypoint decide", "i4", (), "whether an action is a target; ticks between decisions"),
        ("lies at_rest", "f8", (), "[m], [m/s]"),
        ("carried turn_length success_position success_yaw", "f8", (), "of the weight; per radian [m]; [m], [rad]"),
    )),
    CStruct("course_robot", "A robot on a course: plant, controller and task.", (
        ("plant", "plant", (), ""),
        ("episode", "episode", (), ""),
        ("manager", "manager", (), ""),
        ("pilot", "pilot", (), ""),
        ("course", "course", (), ""),
        ("is_given", "i4", (), "whether the course is given, not sampled", FLAG),
        ("error", "f8", (3,), "goal − torso, x, y [m], world, and yaw [rad]"),
        ("initial_distance distance", "f8", (), "to the goal; a radian counts as `turn_length` [m]"),
        ("controls flown crawled lies", "i4", (), "ticks; ticks in the air; ticks of crawling; whether the robot lies",
         (COUNT, COUNT, COUNT, FLAG)),
        ("phase", "i4", (), "sp_manager_phase", "manager_phase"),
        ("arrived", "f8", (), "time since which the robot lies at the goal [s]; 0 if it does not"),
        ("hit most_hit tilt charge", "f8", (), "largest force of the last step, of all [N]; [rad]; of the battery"),
    )),
    CStruct("course_info", "`info` of a course.", (
        ("info", "info", (), ""),
        ("goal_error", "f8", (3,), "[m], [m], [rad]"),
        ("distance_m time_s flown_s crawled_s charge hit_n most_hit_n tilt_rad thrust_fraction", "f8", (), ""),
        ("phase_code gate", "i4", (), "sp_manager_phase; number of passed gates and floors",
         ("manager_phase", (0, gates.MAX_GATES))),
        ("lies finished is_success", "b1", (), "", FLAG),
    )),
)  # fmt: skip
"""In the order of definition: nested structs first."""


@cache
def engine_layouts() -> dict[str, np.dtype]:
    """Return every struct of the library as a numpy type, by name."""
    return dtypes((*configuration_structs(), *ENGINE_STRUCTS), core_layouts())
