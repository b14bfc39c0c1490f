/* Generated: numbers and structs of the simulated world. */
#ifndef SPIDAR_ENGINE_STRUCTS_H
#define SPIDAR_ENGINE_STRUCTS_H

#include <stdint.h>
#include "spidar_structs.h"

#define SP_DUCTS 16 /* engine_structs */
#define SP_ACTUATORS 40 /* engine_structs */
#define SP_BALLS 12 /* engine_structs */
#define SP_STATIONS 45 /* engine_structs */
#define SP_DOFS 38 /* engine_structs */
#define SP_QPOS 39 /* engine_structs */
#define SP_MAX_BODIES 64 /* engine_structs */
#define SP_MAX_PENDING 32 /* engine_structs */
#define SP_MAX_FRAMES 16 /* engine_structs */
#define SP_TILES 16 /* engine_structs */
#define SP_STAIR_ROW 10 /* engine_structs */
#define SP_STAIR_ROWS 3 /* engine_structs */
#define SP_STAIRS 2 /* engine_structs */
#define SP_BOXES 64 /* engine_structs */
#define SP_AIR_STEPS 10 /* engine_structs */
#define SP_COURSE_QUANTITIES 17 /* engine_structs */
#define SP_SERVO_STEPS 5 /* engine_structs */
#define SP_IMU_STEPS 2 /* engine_structs */
#define SP_FASTEST 0x1.8000000000000p+3 /* 12.0, engine_structs */
#define SP_MAX_WARNING_BYTES 256 /* engine_structs */
#define SP_SEED_POOL 4 /* spidar_gym.native.draws */
#define SP_SEED_START 1135663077 /* spidar_gym.native.draws */
#define SP_SEED_FACTOR 2468251765u /* spidar_gym.native.draws */
#define SP_SEED_LEFT 3389127133u /* spidar_gym.native.draws */
#define SP_SEED_RIGHT 1232336661 /* spidar_gym.native.draws */
#define SP_STATE_START 2337405405u /* spidar_gym.native.draws */
#define SP_STATE_FACTOR 1492356589 /* spidar_gym.native.draws */
#define SP_TIMESTEP 0x1.47ae147ae147bp-9 /* 0.0025, spidar_gym.sim.scene.TIMESTEP */
#define SP_AIR_DENSITY 0x1.399999999999ap+0 /* 1.225, spidar_gym.sim.air.AIR_DENSITY */
#define SP_BLUFF 0x1.199999999999ap+0 /* 1.1, spidar_gym.sim.air.BLUFF */
#define SP_LINK_SEGMENT 0x1.70a3d70a3d70ap-3 /* 0.18, spidar_gym.sim.air.LINK_SEGMENT */
#define SP_REACH 0x1.0a3d70a3d70a4p-3 /* 0.13, spidar_gym.sim.air.REACH */
#define SP_SPREAD 0x1.ae147ae147ae1p-2 /* 0.42, spidar_gym.sim.air.SPREAD */
#define SP_JET_NEAR 0x1.47ae147ae147bp-7 /* 0.01, spidar_gym.sim.air.NEAR */
#define SP_JET_LEAST_THRUST 0x1.47ae147ae147bp-6 /* 0.02, spidar_gym.sim.air.LEAST_THRUST */
#define SP_NOISE_BANDWIDTH 0x1.4000000000000p+3 /* 10.0, spidar_gym.sim.actuators.NOISE_BANDWIDTH */
static const double SP_WIND_LENGTH[3] = {0x1.7000000000000p+4, 0x1.7000000000000p+4, 0x1.8666666666666p+1};
static const double SP_WIND_INTENSITY[3] = {0x1.916872b020c4ap-3, 0x1.916872b020c4ap-3, 0x1.999999999999ap-4};
#define SP_PUSH_SECONDS 0x1.999999999999ap-3 /* 0.2, spidar_gym.sim.disturbances.PUSH_SECONDS */
static const double SP_PUSH_EVERY[2] = {0x1.4000000000000p+2, 0x1.e000000000000p+3};
#define SP_CAPACITY_WH 0x1.0a66666666666p+9 /* 532.8, spidar_gym.sim.energy.CAPACITY_WH */
#define SP_USABLE 0x1.b333333333333p-1 /* 0.85, spidar_gym.sim.energy.USABLE */
#define SP_BASE_POWER 0x1.e000000000000p+5 /* 60.0, spidar_gym.sim.energy.BASE_POWER */
#define SP_THRUST_POWER 0x1.10a3d70a3d70ap+2 /* 4.26, spidar_gym.sim.energy.THRUST_POWER */
#define SP_SERVO_EFFICIENCY 0x1.0000000000000p-1 /* 0.5, spidar_gym.sim.energy.SERVO_EFFICIENCY */
#define SP_HOLDING_POWER 0x1.8000000000000p-1 /* 0.75, spidar_gym.sim.energy.HOLDING_POWER */
#define SP_FULL_VOLTAGE 0x1.9333333333333p+4 /* 25.2, spidar_gym.sim.energy.FULL_VOLTAGE */
#define SP_EMPTY_VOLTAGE 0x1.6333333333333p+4 /* 22.2, spidar_gym.sim.energy.EMPTY_VOLTAGE */
#define SP_RESISTANCE 0x1.47ae147ae147bp-7 /* 0.01, spidar_gym.sim.energy.RESISTANCE */
#define SP_COURSE_THICK 0x1.3333333333333p-2 /* 0.3, spidar_gym.sim.course_boxes.THICK */
#define SP_COURSE_SILL 0x1.999999999999ap-5 /* 0.05, spidar_gym.sim.course_boxes.SILL */
#define SP_COURSE_BEHIND 0x1.0000000000000p-1 /* 0.5, spidar_gym.sim.course_boxes.BEHIND */
#define SP_COURSE_ROW 0x1.0000000000000p-2 /* 0.25, spidar_gym.control.course.gates.ROW */
#define SP_TILE_ROWS 14 /* spidar_gym.control.course.gates.TILE_ROWS */
#define SP_TILE_COLUMNS 2 /* spidar_gym.control.course.gates.TILE_COLUMNS */
#define SP_TILE 0x1.0000000000000p-2 /* 0.25, spidar_gym.sim.ground.TILE */
#define SP_TILE_DEPTH 0x1.999999999999ap-5 /* 0.05, spidar_gym.sim.ground.TILE_DEPTH */
static const double SP_NOWHERE[6] = {0x0.0p+0, 0x0.0p+0, -0x1.9000000000000p+5, 0x1.47ae147ae147bp-7, 0x1.47ae147ae147bp-7, 0x1.47ae147ae147bp-7};
#define SP_AT_LIMIT 0x1.47ae147ae147bp-7 /* 0.01, spidar_gym.sim.violations.AT_LIMIT */
#define SP_BLOWN_FACTOR 0x1.ccccccccccccdp-1 /* 0.9, spidar_gym.sim.violations.BLOWN_FACTOR */
#define SP_POSE_PERIOD 0x1.47ae147ae147bp-7 /* 0.01, spidar_gym.sim.sensors.POSE_PERIOD */
#define SP_IMU_PERIOD 0x1.47ae147ae147bp-8 /* 0.005, spidar_gym.sim.sensors.IMU_PERIOD */
#define SP_ENCODER_PERIOD 0x1.47ae147ae147bp-6 /* 0.02, spidar_gym.sim.sensors.ENCODER_PERIOD */
#define SP_DRIFT_SECONDS 0x1.4000000000000p+3 /* 10.0, spidar_gym.sim.sensors.DRIFT_SECONDS */
#define SP_DROPOUT_SECONDS 0x1.999999999999ap-5 /* 0.05, spidar_gym.sim.sensors.DROPOUT_SECONDS */

/* What a drawn number does to the nominal one. */
typedef enum {
    SP_DRAW_SET = 0, SP_DRAW_SCALE = 1, SP_DRAW_ADD = 2
} sp_operation;

/* Sequences of forms. */
typedef enum {
    SP_FORMS_PAPER = 0, SP_FORMS_FORM1 = 1, SP_FORMS_FORM2 = 2, SP_FORMS_FORM3 = 3, SP_FORMS_EQUAL = 4,
    SP_FORMS_INDEPENDENT = 5, SP_FORMS_NARROW = 6, SP_FORMS_MIXED = 7
} sp_sequence;

/* Paths of the CoG. */
typedef enum {
    SP_PATHS_NONE = 0, SP_PATHS_LEGS = 1, SP_PATHS_LEMNISCATE = 2, SP_PATHS_SPLINE = 3, SP_PATHS_MIXED = 4
} sp_path_kind;

/* Where the robot looks on its path. */
typedef enum {
    SP_HEADING_KEPT = 0, SP_HEADING_ALONG = 1, SP_HEADING_MIXED = 2
} sp_heading;

/* What a floor with steps may be. */
typedef enum {
    SP_TERRAIN_TILES = 0, SP_TERRAIN_STAIRS = 1, SP_TERRAIN_MIXED = 2
} sp_terrain;

/* What a robot violates. */
typedef enum {
    SP_VIOLATED_FOOT = 1, SP_VIOLATED_DUCT = 2, SP_VIOLATED_PART = 4, SP_VIOLATED_TORQUE = 8, SP_VIOLATED_BLOWN = 16
} sp_constraint;

/* What happens at the end of an episode. */
typedef enum {
    SP_RESET_NEXT_STEP = 0, SP_RESET_SAME_STEP = 1, SP_RESET_DISABLED = 2
} sp_autoreset;

/* How far the actuators are from the robot description; the defaults are the description. */
typedef struct {
    double thrust_gain; /* Thrust over commanded thrust, all modules. */
    double module_gain[8]; /* Thrust over commanded thrust of each module, times `thrust_gain`. */
    double duct_imbalance[8]; /* (T_left − T_right) / λ of each module; it turns the module about x. */
    double thrust_tilt[16]; /* (8, 2) Tilt of the thrust about the module's x and y axes [rad]. */
    double thrust_offset[16]; /* (8, 2) Point of attack off the module's centre, x and y [m]. */
    double max_thrust; /* Largest thrust of a module [N]. */
    int32_t battery; /* Whether the largest thrust falls with the voltage of a battery that is full at reset. */
    double thrust_lag; /* Time constant of a rising thrust [s]. */
    double spin_down; /* Time constant of a falling thrust over that of a rising one. */
    double thrust_noise; /* Standard deviation of each module's thrust [N], 10 Hz wide. */
    double delay; /* Between a command and the actuators [s]; rounded to physics steps. */
    double vectoring_delay; /* More delay of the vectoring servos [s]; rounded to physics steps. */
    double joint_kp; /* Stiffness of the joint servos [Nm/rad]. */
    double joint_kd; /* Damping of the joint servos [Nm s/rad]. */
    double servo_stiffness[16]; /* Factor on the stiffness of each joint servo. */
    double joint_speed_factor; /* The servos' speed limit over the one that they are told. */
    double max_joint_torque; /* Torque that the joint servos really reach [Nm]. */
    double joint_friction; /* Dry friction of a joint [Nm]. */
    double joint_damping; /* Viscous friction of a joint [Nm s/rad]. */
    double backlash; /* Half of the play of a joint [rad]: so far a link moves before its servo resists. */
    double joint_offset[16]; /* True minus indicated joint angle [rad]: an encoder whose zero is off. */
    double vectoring_kp; /* Stiffness of the vectoring servos [Nm/rad]. */
    double vectoring_offset[16]; /* (8, 2) True minus indicated vectoring angle [rad]. */
} sp_actuator_config;

/* Parameters of the air; nominal values fitted to the paper's descent in form ③, ranges in `randomize`. */
typedef struct {
    int32_t wake; /* Whether there is air while there is no wind: jets, drag, inflow by the robot's motion, ground effect. */
    double zero_thrust_speed; /* χ: axial inflow at which a duct's thrust vanishes, in units of its own jet speed [Leishman]. */
    double core_length; /* Length of a jet's potential core in duct diameters: 3.25 … 6.2 in the literature [Hamill]. */
    double duct_drag_area; /* C_d A of one duct in a stream [m²]. */
    double ground_effect; /* a in T ← T (1 + a (R / 4h)²): 1 is Cheeseman and Bennett's open rotor; ducts have either sign. */
} sp_aero_config;

/* How far body and ground are from the robot description; the defaults are the description. */
typedef struct {
    double total_mass; /* Mass of the whole robot [kg]; all masses and inertias are scaled to it, after the factors below. */
    double link_mass[8]; /* Factor on mass and inertia of each link with its junction and module. */
    double link_com[24]; /* (8, 3) Shift of each link's centre of mass, link axes [m]. */
    double torso_com[3]; /* Shift of the torso's centre of mass [m]. */
    double inertia[8]; /* Factor on the inertia of each link about its own centre of mass. */
    double payload_mass; /* Mass of what the torso carries beyond all this, a point [kg]. */
    double payload_position[3]; /* Where it is, torso axes [m]. */
    double foot_friction; /* Sliding friction of the feet. */
    double peg_friction; /* Sliding friction of pegs, ducts and torso. */
} sp_body_config;

/* The floor under the robot. */
typedef struct {
    double slope; /* Angle to the horizontal [rad]; the floor turns about the origin. */
    double heading; /* Direction in which it rises [rad]. */
    double tiles[256]; /* (16, 16) Height of each tile over the plane [m]; all zero is a plane without tiles. */
    double boxes[448]; /* (64, 7) Boxes in the world: centre, half of length, width and height [m], how far the front is pitched down [rad]; one of no size is none. */
} sp_ground_config;

/* Noise of the sensors; values of a motion capture of the Vicon class [JSK] and of an ADIS16448 [RotorS]. */
typedef struct {
    double latency; /* Between a frame of the motion capture and its arrival [s]. */
    double position_noise; /* Standard deviation of a position [m]. */
    double rotation_noise; /* Standard deviation of an attitude [rad]. */
    double position_drift; /* Standard deviation of the slow error of positions, 10 s wide [m]. */
    double rotation_drift; /* Standard deviation of the slow error of attitudes, 10 s wide [rad]. */
    double dropout; /* Probability that a frame is the first of 50 ms without any. */
    double gyro_noise; /* Density of the gyroscope's noise [rad/s/√Hz]. */
    double gyro_bias; /* Standard deviation of its bias at switch-on [rad/s]. */
    double accelerometer_noise; /* Density of the accelerometer's noise [m/s²/√Hz]. */
    double accelerometer_bias; /* Standard deviation of its bias at switch-on [m/s²]. */
    double vibration; /* Standard deviation of what the rotors shake into the accelerometer [m/s²] [estimate]. */
    double encoder_noise; /* Standard deviation of an encoder before rounding, in counts. */
    double torque_noise; /* Relative error of a servo's reported torque. */
    double factor; /* On all of the noise, drift and bias above, encoders' steps excepted. */
} sp_sensor_config;

/* What can be chosen about the simulated robot. */
typedef struct {
    int32_t substeps; /* Physics steps a control period: 10 × 2.5 ms = 25 ms, 40 Hz. */
    double joint_speed; /* The joint servos' setpoints move no faster than this [rad/s]: the one joint speed limit there is. */
    double idle_thrust; /* Least commanded thrust of a module [N]; `ROBOT.idle_thrust` for armed motors. */
    int32_t sense; /* Whether `Plant.measure` gives what the real sensors say. */
    sp_body_config body; /* Masses and friction. */
    sp_actuator_config actuators; /* Rotors and servos. */
    sp_aero_config aero; /* The air. */
    sp_sensor_config sensors; /* Noise of the sensors. */
    sp_ground_config ground; /* The floor. */
} sp_plant_config;

/* Disturbances of an episode; all off by default. */
typedef struct {
    double wind; /* Mean wind [m/s], from a direction drawn at reset, with first-order Dryden turbulence of that strength. */
    double push; /* Force of pushes on the torso [N], 0.2 s long, every 5 … 15 s, from a direction drawn each time. */
    int32_t lost_rotor; /* Module that fails, 1 … 8; 0 for none. The controller is told. */
    int32_t fault; /* `thrust`: the module no longer thrusts; `vectoring`: its φ and θ stay where they are. */
    double fault_time; /* When it fails [s]. */
} sp_disturbances;

/* A stream of random numbers: numpy's PCG64, and what spawns others from it. */
typedef struct {
    uint64_t state_high, state_low; /* of PCG64 */
    uint64_t increment_high, increment_low; /* odd; which of its streams */
    uint32_t has_half, half; /* whether the upper half of a draw is left over; that half */
    uint32_t pool[4]; /* the seed and the spawn key, mixed */
    uint32_t hash, spawned; /* constant that goes on mixing; how many were spawned */
} sp_generator;

/* The robot and the floor as MuJoCo has them: where things are in its arrays, and their numbers. */
typedef struct {
    int32_t bodies, torso, floor, geoms, moving; /* of bodies; bodies; geom; of all geoms; of those of the robot */
    int32_t module_body[8], link_body[8]; /* bodies */
    int32_t part_body[32]; /* bodies that a link carries: junction, link, and the two of its module */
    int32_t body_parent[64], body_dofadr[64], body_dofnum[64]; /* of MuJoCo's tree */
    int32_t joint_qpos[32], joint_dof[32]; /* of joints, then vectoring angles */
    int32_t ball[12], ball_body[12]; /* geoms of the feet, then of the pegs; bodies that carry them */
    int32_t duct[16]; /* geoms of the ducts */
    int32_t geom[64]; /* geoms of the robot */
    int32_t geom_kind[512]; /* what each geom is: a ball, SP_BALLS for a duct, −1 */
    int32_t geom_touches[512], geom_is_foot[512]; /* whether it meets the floor; whether it is a foot */
    int32_t tile[256]; /* geoms of the tiles, row by row; −1 where there are none */
    int32_t box[64]; /* geoms of the boxes; −1 where there are none */
    double mass[64]; /* of the described robot [kg] */
    double torso_axes[4]; /* principal axes of its torso's inertia, a quaternion */
    double inertia[64][3], com[64][3]; /* principal inertia [kg m²]; its centre [m] */
    double geom_reach[64]; /* bounding radius [m] */
    double ball_radius[12]; /* [m] */
    double duct_radius[16], duct_half[16]; /* radius and half height [m] */
    double weight, max_joint_torque, torso_radius, torso_height; /* [N], [Nm], [m] */
    double propeller_radius, duct_offset_y, duct_z; /* of a duct; its exit below the module's centre [m] */
    double link_station[3], link_width[3]; /* where a link is looked at, and how wide it is there [m] */
    double link_scale[8]; /* its length over that of the link whose stations these are */
    double gravity, battery_share; /* [m/s²]; largest thrust over that of modules whose battery was measured */
    double imu_position_b[3]; /* where motion capture and inertial unit look [m] */
    double encoder_step[32]; /* a count of each encoder [rad] */
    double start[438]; /* MuJoCo's state after a reset */
} sp_world;

/* What the air did at one evaluation. */
typedef struct {
    double generalized[38]; /* generalised force for qfrc_applied [N, Nm] */
    double thrust_factor[16]; /* thrust of each duct over that in still air */
    double forces_w[135], points_w[135]; /* force at each station, and where it is, world [N], [m] */
} sp_air;

/* Wind and pushes as they unfold. */
typedef struct {
    double mean_w[3], gust_w[3], push_w[3]; /* mean wind, turbulence [m/s]; the push that is on now [N]; world */
    double next_push, push_end; /* when the next begins, and the present one ends [s] */
} sp_weather;

/* A command on its way. */
typedef struct {
    int64_t due, vectoring_due; /* physics steps at which thrusts and joints, and vectoring angles, arrive */
    double target[40]; /* thrusts [N], joints, vectoring angles [rad] */
} sp_pending;

/* Everything about the sensors that changes. */
typedef struct {
    double gyro_bias[3], accelerometer_bias[3]; /* [rad/s], [m/s²] */
    double drift[6]; /* slow error of position [m] and attitude [rad] */
    double velocity_w[3]; /* of the inertial unit at its last sample [m/s] */
    double silent_until, next_pose, next_encoder; /* [s] */
    int32_t frames, samples; /* of the motion capture on their way; of the inertial unit since the last tick */
    double frame_time[16]; /* oldest first [s] */
    double frame_position_w[16][3]; /* [m] */
    double frame_quat_wb[16][4];
    double imu_time[8]; /* oldest first [s] */
    double gyro_b[8][3], specific_force_b[8][3]; /* [rad/s], [m/s²] */
    double encoder_time; /* of the latest reading [s] */
    double angles[32]; /* what the servos indicated [rad] */
    double torque[16]; /* what they reported [Nm] */
} sp_sensor_memory;

/* What touches the floor at one instant. */
typedef struct {
    int32_t balls[12]; /* whether each foot, then each peg does */
    int32_t ducts; /* whether a duct does */
    double slip[8]; /* speed of the touching points of feet, then of the torso's pegs [m/s] */
    double duct_clearance; /* height of the lowest duct over the floor [m] */
    double hit; /* largest force on anything but feet and pegs, where there are boxes [N] */
} sp_touch;

/* One simulated robot: what it is, and all that changes about it. */
typedef struct {
    sp_plant_config config;
    sp_disturbances disturbances;
    double floor_R[9]; /* attitude of the floor */
    double highest_tile; /* over the floor's plane [m] */
    int64_t delay, vectoring_delay; /* between a command and the actuators, in physics steps */
    double row[438]; /* MuJoCo's state */
    sp_robot_state state; /* the true state */
    int64_t clock; /* physics steps since the reset */
    int32_t pending_first, pending_count; /* a ring */
    sp_pending pending[32];
    double torque_limit[16]; /* that the joint servos may use [Nm] */
    int32_t in_contact, diverged, has_air, senses; /* touching; no longer finite; something blows; measuring */
    int32_t violated; /* bits of sp_constraint, since somebody made it 0 */
    double clearance; /* least height of everything over the highest tile at the end of the last tick [m] */
    double hit; /* largest force in the last tick on anything but feet and pegs, where there are boxes [N] */
    double spent_wh; /* that the battery lacks at the reset [Wh] */
    double noise[8]; /* of the thrusts [N] */
    sp_weather weather;
    double air_force_w[3]; /* of the air besides the thrust in still air, world [N] */
    double air_factor[16]; /* thrust of each duct over that in still air */
    int32_t falling[8]; /* modules whose thrust falls */
    double loose[16]; /* where each joint is within its play [rad] */
    int32_t is_stuck; /* whether the next counts */
    double stuck[2]; /* vectoring angles of a module whose servos have failed [rad] */
    double power, energy_wh; /* [W], since the reset [Wh] */
    sp_sensor_memory sensors;
    sp_generator generator; /* source of noise, wind and pushes */
} sp_plant;

/* A form to take. */
typedef struct {
    double start, deadline; /* when it becomes the target; when the slowest joint arrives [s] */
    double joint_target[16]; /* q [rad] */
    int32_t reached; /* whether it was, in time */
} sp_goal;

/* A number of a plant's configuration that is drawn, or a run of them. */
typedef struct {
    int32_t at, count, operation; /* byte of the configuration; how many; sp_operation */
    double low, high; /* even in between at strength 1 */
} sp_draw;

/* What the entries of an action are. */
typedef struct {
    int32_t size, is_direct, channels; /* entries; whether no controller stands behind; bits of sp_channel */
    double authority[48]; /* what 1 becomes */
} sp_action_mode;

/* What all robots of an environment share. */
typedef struct {
    sp_plant_config plant; /* the robot that others are drawn around */
    sp_estimator_config estimator;
    sp_action_mode mode;
    double bound[512]; /* of the observation */
    int32_t size; /* of the observation */
    int32_t is_described; /* whether every robot is the described one, so that a hover needs no trim */
    int32_t draws; /* how many of the next count */
    sp_draw draw[64]; /* in the order of the draws */
    double strength; /* of the randomisation, 0 … 1 */
    int64_t horizon; /* ticks of an episode; success is judged there */
    int32_t truncates, autoreset; /* whether it ends there; sp_autoreset */
    int32_t is_commanded, is_referred; /* whether commands are Python's; whether references are */
    int32_t is_advised; /* whether the controller says what it would do where an action goes past it */
} sp_rules;

/* The task of a flight. */
typedef struct {
    sp_rules rules;
    sp_controller_config controller;
    double position_w[3]; /* where the CoG is to be [m] */
    double joint_speed, perturbation, horizon_s; /* [rad/s]; of the start, 1; forms are drawn until then [s] */
    int32_t avoids, windows; /* whether rotors are restricted; how many windows of time without */
    double window[16][2]; /* from, until [s] */
    double form[3][16]; /* the paper's [rad] */
    double range[3][2][4]; /* least and largest angles of a leg's joints in drawn forms [rad] */
    int32_t drawn_legs[3]; /* how many legs are drawn; the others are alike */
    double mixture[2]; /* of drawn forms: share of the paper's; of these and those with equal legs */
    double paper_pause; /* from the paper's first form to its second [s] */
    double pause[2]; /* between drawn forms, drawn in between [s] */
    double offset[2]; /* of the start, position and attitude per axis at most [m], [rad] */
    double arrival_grace, arrival_tolerance; /* how late [s] and how far off [rad] a form may be reached */
    int32_t path, heading; /* sp_path_kind; sp_heading */
    double path_mixture[2]; /* share of straight legs; of these and lemniscates */
    double speed[2]; /* of a path, drawn in between [m/s] */
    double path_begin, half_width; /* when it begins [s]; of a lemniscate [m] */
    double corner_radius[2], corner_turn[2]; /* of corners from where it begins [m]; from one to the next [rad] */
    double bend_radius[2], bend_turn[2]; /* of points round a spline's middle [m]; from one to the next [rad] */
    double climb; /* that its points are higher at most [m] */
} sp_hover_rules;

/* What every environment's robot has besides the simulated one. */
typedef struct {
    sp_generator generator; /* of the environment: it draws what an episode is */
    sp_disturbances disturbances; /* of this episode and those after it */
    sp_estimator estimator;
    sp_robot_state seen; /* what the controller sees: the state, or its estimate where there are sensors */
    double action[48]; /* the last, within [−1, 1] */
    int32_t has_command; /* whether there was a tick */
    sp_command command; /* the last */
    sp_residual residual; /* what the action added */
    int64_t ticks; /* since the reset */
    int32_t failure; /* why the episode is over, or −1 */
    int32_t truncated, over; /* whether the horizon is reached; whether the next step is a reset */
    double drawn[256]; /* what was drawn of the robot, in the order of the draws */
} sp_episode;

/* A robot in flight: simulated, controlled, and what it is to do. */
typedef struct {
    sp_plant plant;
    sp_episode episode;
    sp_flight flight;
    sp_control_state percept, truth; /* what the controller makes of what it sees; of the true state */
    sp_reference reference;
    sp_preview preview;
    double leg_momentum[3], leg_momentum_rate[3]; /* [Nms], [Nm] */
    double joint_velocity[16]; /* of the joint commands [rad/s] */
    double position_error[3], attitude_error[3]; /* true ones [m], [rad] */
    int32_t forms, is_given, has_trim; /* which sequence; whether the start is given; whether with its trim */
    double offset[3], rotation[3], velocity[3], omega[3]; /* of the start [m], [rad], of the CoG [m/s], [rad/s] */
    double trim[6]; /* what a hover takes beyond the description [N, Nm] */
    int32_t goals, current, flown; /* how many; which is the target; ticks */
    int32_t knots; /* of the path; 0 where there is none */
    double position_sum, attitude_sum; /* of squared errors [m²], [rad²] */
    int32_t is_led; /* whether the controller's advice is done in place of the action */
    sp_command advice; /* what the controller would have commanded at the last tick */
} sp_hover_robot;

/* What is told of every robot after a tick. */
typedef struct {
    double thrust_command[8], thrust[8]; /* [N] */
    double vectoring_command[8][2], vectoring[8][2]; /* (φ, θ) [rad] */
    double joint_torque_allocated[16], joint_torque[16]; /* [Nm] */
    double wrench_allocated[6]; /* [N, Nm] */
    double total_thrust, qp_slack; /* [N] */
    double thrust_factor[8]; /* thrust of each module over that in still air */
    double air_force[3]; /* world [N] */
    double power_w, energy_wh, endurance_min;
    double cost, cost_contact, cost_torque, cost_duct, cost_blown; /* of violated constraints: the sum, each */
    int32_t qp_status_code, qp_iterations, failure_code; /* sp_status or −1; of the task or −1 */
} sp_info;

/* What is told of a flight. */
typedef struct {
    sp_info info;
    double position_error[3], attitude_error[3]; /* true ones [m], [rad] */
    double wrench_desired[6]; /* [N, Nm] */
    uint8_t restricted_rotors[8];
    uint8_t is_success;
} sp_hover_info;

/* What is counted of every robot, for its task. */
typedef struct {
    double ticks; /* Steps of the episode. */
    double time; /* Time since its beginning [s]. */
    double in_contact; /* 1 where a part of the robot touches the floor. */
    double diverged; /* 1 where the simulation's state is no longer finite. */
    double power; /* Electrical power [W]. */
    double effort; /* Mean square of the action. */
} sp_quantities;

/* What is counted of robots in flight. */
typedef struct {
    sp_quantities common;
    double distance; /* Length of the position error [m]. */
    double angle; /* Length of the attitude error [rad]. */
    double joint_error; /* Largest difference of a joint from the schedule's plan [rad]. */
    double tilt; /* Angle between the torso's z axis and the vertical [rad]. */
    double position_rms; /* RMS of the position error since the beginning [m]. */
    double attitude_rms; /* RMS of the attitude error since the beginning [rad]. */
    double overdue; /* Forms that were due by now and not reached in time. */
} sp_hover_quantities;

/* What is drawn of a flight besides forms and knots. */
typedef struct {
    double position[3], rotation[3]; /* offset of the torso [m], [rad] */
    int32_t goals, knots; /* how many */
} sp_flight_start;

/* What is looked at in a flight besides what is told. */
typedef struct {
    sp_interference_config config;
    sp_interference bounds; /* of now, and of the last look before it */
    double tolerance, thrust; /* how far beyond [rad] and with more than which thrust [N] one interferes */
    double planned[16]; /* joint angles of the schedule now [rad] */
    int32_t interferes; /* whether a rotor does */
} sp_watch;

/* The task of a crawl. */
typedef struct {
    sp_rules rules;
    sp_crawler_config controller;
    double lies[16]; /* joint angles of the robot at rest [rad] */
    sp_pose2 way; /* the paper's */
    double share, turn; /* how often it is drawn; the other draws turn by at most so much [rad] */
    double distance[2]; /* and go at least and at most so far [m] */
    int32_t is_given[3]; /* whether distance, direction and turn are, and not drawn */
    double given[3]; /* [m], [rad], [rad] */
    double steps; /* the floor has steps of this height [m]; 0 leaves it as it is */
    int32_t terrain; /* an `sp_terrain`: what has them */
    int32_t obstacles; /* how many blocks */
    double obstacle[64][3]; /* x, y, radius [m] */
    double obstacle_height, goal_clearance; /* [m] */
    int32_t settle_ticks; /* in which the robot comes to lie on a floor that is no plane */
    double turn_length; /* of a radian [m] */
    double success_position, success_yaw; /* how near the goal a robot rests at it [m], [rad] */
    double saturated, rest_time, rest_speed, rest_turn, rest_joint_speed, rest_thrust; /* a servo this close to its largest torque is [Nm]; a rest: [s], [m/s], [rad/s], [rad/s], of the weight */
} sp_crawl_rules;

/* A robot on the ground: simulated, controlled, and what it is to do. */
typedef struct {
    sp_plant plant;
    sp_episode episode;
    sp_crawl crawl;
    sp_touch touch;
    double tilt; /* of the torso against the floor [rad] */
    sp_pose2 way, goal; /* seen from the start; world */
    int32_t cycles; /* that the way takes; 0 where it is out of reach */
    double nominal_time; /* where joints and torso go exactly as planned [s] */
    double error[3]; /* goal − torso, x, y [m], world, and yaw [rad] */
    double initial_distance, distance; /* to the goal, a radian counting as some metres [m] */
    int32_t crawled, timeouts, rested; /* ticks; phases timed out; ticks of rest till now */
    int32_t swinging[4]; /* whether the feet are on their way */
    int32_t phase, is_done; /* sp_phase; whether the gait is done */
    double finished; /* when the gait was done, or without one had rested at the goal [s]; 0 before */
    double swing_ticks[4], airborne_ticks[4]; /* ticks of the swing; of these in the air */
    double foot_slip[4], peg_slip[4]; /* ways on the floor [m] */
    double duct_clearance; /* least so far [m] */
    int32_t duct_contact; /* whether a duct touched it */
    double saturation, thrust, thrust_peak; /* sums over ticks: saturated joints, thrust over weight; its peak */
    double tilt_legs, tilt_torso; /* largest tilt while legs are lifted, while the torso moves [rad] */
} sp_crawl_robot;

/* What is counted of robots on the ground. */
typedef struct {
    sp_quantities common;
    double distance; /* Distance to the goal, a radian counting 0.5 m [m]. */
    double initial_distance; /* The same at the start [m]. */
    double position_error; /* Way to the goal [m]. */
    double yaw_error; /* Turn to the goal, its size [rad]. */
    double tilt; /* Angle of the torso against the floor [rad]. */
    double slip; /* Speed of the fastest touching point [m/s]. */
    double duct_touches; /* 1 where a duct touches the floor. */
    double duct_touched; /* 1 where a duct has touched it in this episode. */
    double finished; /* When the gait was done, or in `direct` the robot had rested at the goal [s]; 0 before. */
    double nominal_time; /* How long the preset's gait takes, servos perfect [s]. */
    double timeouts; /* Phases that ended by time-out. */
    double airborne; /* Share of its swing in which the worst foot was in the air; 1 before the first swing. */
    double foot_slip; /* Way of the worst foot's touching point along the floor [m]. */
} sp_crawl_quantities;

/* What is told of a crawl. */
typedef struct {
    sp_info info;
    double goal_error[3]; /* [m], [m], [rad] */
    double time_s, nominal_time_s, airborne_share, foot_slip_m, peg_slip_m, duct_clearance_m;
    double saturation_share, thrust_fraction, thrust_fraction_mean, thrust_fraction_peak;
    double tilt_rad, cost_of_transport;
    int32_t phase_code, timeouts, shortfalls_code; /* sp_phase; phases; bits of sp_shortfall */
    uint8_t foot_contact[4];
    uint8_t finished, is_success;
} sp_crawl_info;

/* What is counted of robots on a course. */
typedef struct {
    sp_quantities common;
    double distance; /* Distance to the goal, a radian counting 0.5 m [m]. */
    double initial_distance; /* The same at the start [m]. */
    double position_error; /* Way to the goal [m]. */
    double yaw_error; /* Turn to the goal, its size [rad]. */
    double hit; /* Largest force of the step on anything but feet and pegs [N]. */
    double tilt; /* Angle between the torso's z axis and the vertical [rad]. */
    double charge; /* What is left of the battery's usable energy, 0 … 1. */
    double lies; /* 1 where the robot lies on the floor at rest. */
    double is_cut; /* 1 where the rotors are cut in the air. */
    double is_outside; /* 1 where the robot has left the field. */
    double is_empty; /* 1 where the battery's usable charge is used up. */
} sp_course_quantities;

/* The task of a course. */
typedef struct {
    sp_rules rules;
    sp_manager_config manager;
    int32_t kinds[7], floors[7]; /* sp_gate_kind that is drawn; SP_GATE_KINDS is a plain floor */
    int32_t kind_count, floor_count; /* how many they are */
    int32_t count[2]; /* least and largest number of gates */
    double size[6][2]; /* drawn in between, by sp_gate_kind [m], [rad] */
    double depth[6]; /* of gates along the course [m] */
    double first_gap[2], gap[2], goal_way[2]; /* to the first gate, between two, from a floor's begin to the goal [m] */
    double floor_gap, floor_length, middle, goal_side, goal_yaw; /* [m], the last [rad] */
    double charge[2]; /* of the battery at the start, drawn in between */
    int32_t is_waypoint, hold, decide; /* whether an action is a target; ticks of a step; between decisions */
    double stop[17]; /* limit of each of the quantities, beyond which a step ends */
    double lies, at_rest; /* [m], [m/s] */
    double carried, turn_length, success_position, success_yaw; /* of the weight; of a radian [m]; [m], [rad] */
} sp_course_rules;

/* A robot on a course: simulated, controlled, and what it is to do. */
typedef struct {
    sp_plant plant;
    sp_episode episode;
    sp_manager manager;
    sp_pilot pilot;
    sp_course course;
    int32_t is_given; /* whether it is given, not drawn */
    double error[3]; /* goal − torso, x, y [m], world, and yaw [rad] */
    double initial_distance, distance; /* to the goal, a radian counting as some metres [m] */
    int32_t controls, flown, crawled, lies; /* ticks, in the air, of crawling; whether it lies */
    int32_t phase; /* sp_manager_phase */
    double arrived; /* since when it lies at the goal [s]; 0 if it does not */
    double hit, most_hit, tilt, charge; /* largest force of the last step, of all [N]; [rad]; of the battery */
} sp_course_robot;

/* What is told of a course. */
typedef struct {
    sp_info info;
    double goal_error[3]; /* [m], [m], [rad] */
    double distance_m, time_s, flown_s, crawled_s, charge, hit_n, most_hit_n, tilt_rad, thrust_fraction;
    int32_t phase_code, gate; /* sp_manager_phase; how many gates and floors are behind it */
    uint8_t lies, finished, is_success;
} sp_course_info;

#endif
