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
#define SP_SERVO_STEPS 5 /* engine_structs */
#define SP_FACES 6 /* engine_structs */
#define SP_FACE_PATCHES 144 /* engine_structs */
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
#define SP_RESTING 0x1.0624dd2f1a9fcp-10 /* 0.001, spidar_gym.sim.object.RESTING */
#define SP_STILL_AIR 0x1.0624dd2f1a9fcp-10 /* 0.001, spidar_gym.sim.object.STILL_AIR */
#define SP_REST_SHARE 0x1.0000000000000p-1 /* 0.5, spidar_gym.sim.object.REST_SHARE */
#define SP_REST_LEVER 0x1.999999999999ap-4 /* 0.1, spidar_gym.sim.object.REST_LEVER */
#define SP_AIR_DENSITY 0x1.399999999999ap+0 /* 1.225, spidar_gym.sim.air.AIR_DENSITY */
#define SP_BLUFF 0x1.199999999999ap+0 /* 1.1, spidar_gym.sim.air.BLUFF */
#define SP_LINK_SEGMENT 0x1.70a3d70a3d70ap-3 /* 0.18, spidar_gym.sim.air.LINK_SEGMENT */
#define SP_REACH 0x1.0a3d70a3d70a4p-3 /* 0.13, spidar_gym.sim.air.REACH */
#define SP_SPREAD 0x1.ae147ae147ae1p-2 /* 0.42, spidar_gym.sim.air.SPREAD */
#define SP_STACKING_RADIUS 0x1.c28f5c28f5c29p-3 /* 0.22, spidar_gym.sim.air.STACKING_RADIUS */
#define SP_JET_NEAR 0x1.47ae147ae147bp-7 /* 0.01, spidar_gym.sim.air.NEAR */
#define SP_JET_LEAST_THRUST 0x1.47ae147ae147bp-6 /* 0.02, spidar_gym.sim.air.LEAST_THRUST */
#define SP_NOISE_BANDWIDTH 0x1.4000000000000p+3 /* 10.0, spidar_gym.sim.actuators.NOISE_BANDWIDTH */
#define SP_STICKING 0x1.9000000000000p+5 /* 50.0, spidar_gym.sim.actuators.STICKING */
#define SP_NEAR_LENGTH 0x1.0000000000000p+0 /* 1.0, spidar_gym.sim.recirculation.NEAR_LENGTH */
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

/* How a sampled number changes the nominal one. */
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

/* Headings of the robot on its path. */
typedef enum {
    SP_HEADING_KEPT = 0, SP_HEADING_ALONG = 1, SP_HEADING_MIXED = 2
} sp_heading;

/* Kinds of floors with steps. */
typedef enum {
    SP_TERRAIN_TILES = 0, SP_TERRAIN_STAIRS = 1, SP_TERRAIN_MIXED = 2
} sp_terrain;

/* Shapes of an object. */
typedef enum {
    SP_SHAPE_NONE = 0, SP_SHAPE_BOX = 1, SP_SHAPE_CYLINDER = 2, SP_SHAPE_BALL = 3
} sp_shape;

/* Constraints of a robot. */
typedef enum {
    SP_VIOLATED_FOOT = 1, SP_VIOLATED_DUCT = 2, SP_VIOLATED_PART = 4, SP_VIOLATED_TORQUE = 8, SP_VIOLATED_BLOWN = 16
} sp_constraint;

/* Modes of resetting at the end of an episode. */
typedef enum {
    SP_RESET_NEXT_STEP = 0, SP_RESET_SAME_STEP = 1, SP_RESET_DISABLED = 2
} sp_autoreset;

/* Parameters of the simulated actuators; the defaults are those of the robot description. */
typedef struct {
    double thrust_gain; /* Thrust over commanded thrust, all modules. */
    double module_gain[8]; /* Thrust over commanded thrust of each module, times `thrust_gain`. */
    double duct_imbalance[8]; /* (T_left − T_right) / λ of each module; causes a torque about the module's x axis. */
    double thrust_tilt[16]; /* (8, 2) Tilt of the thrust about the module's x and y axes [rad]. */
    double thrust_offset[16]; /* (8, 2) Offset of the thrust's point of attack from the module's centre, x and y [m]. */
    double max_thrust; /* Largest thrust of a module [N]. */
    int32_t battery; /* Whether the largest thrust falls with the voltage of the battery. */
    double battery_spent; /* Share of the battery's usable energy that is spent at the reset, 0 … 1 [chosen]. */
    int32_t board_scaling; /* Whether the flight board scales all thrusts by one factor when one exceeds the largest thrust [JSK]. */
    double thrust_lag; /* Time constant of a rising thrust [s]. */
    double spin_down; /* Time constant of a falling thrust over that of a rising one. */
    double thrust_noise; /* Standard deviation of each module's thrust noise, with a bandwidth of 10 Hz [N]. */
    double delay; /* Delay between a command and the actuators, rounded to physics steps [s]. */
    double vectoring_delay; /* Additional delay of the vectoring servos, rounded to physics steps [s]. */
    double jitter; /* Largest additional delay of a command, uniform from 0 on, rounded to physics steps [s]; up to 0.01 [chosen]. */
    double loss; /* Probability that a command is lost; the actuators then keep the last one that arrived; up to 0.05 [chosen]. */
    double joint_kp; /* Stiffness of the joint servos [Nm/rad]. */
    double joint_kd; /* Damping of the joint servos [Nm s/rad]. */
    double servo_stiffness[16]; /* Factor on the stiffness of each joint servo. */
    double joint_speed_factor; /* Actual speed limit of the joint servos over the commanded one. */
    double servo_speed[16]; /* Factor on the speed limit of each joint servo, times `joint_speed_factor`; 0.85 … 1.15 [chosen]. */
    double max_joint_torque; /* Largest torque that the joint servos reach [Nm]. */
    double joint_friction; /* Dry friction of a joint [Nm]. */
    double joint_damping; /* Viscous friction of a joint [Nm s/rad]. */
    double backlash; /* Half of a joint's play, within which the servo exerts no torque [rad]. */
    double joint_offset[16]; /* True minus indicated joint angle, the zero offset of the encoder [rad]. */
    double vectoring_kp; /* Stiffness of the vectoring servos [Nm/rad]. */
    double vectoring_friction; /* Dry friction of a vectoring axis [Nm]; up to 0.1, of the servos' 1.5 [chosen]. */
    double vectoring_backlash; /* Half of a vectoring axis' play, within which the servo exerts no torque [rad]; up to 0.01 [chosen]. */
    double vectoring_offset[16]; /* (8, 2) True minus indicated vectoring angle [rad]. */
} sp_actuator_config;

/* Parameters of the air; nominal values fitted to the paper's descent in form ③, ranges in `randomize`. */
typedef struct {
    int32_t wake; /* Whether air is simulated without wind: jets, drag, inflow by the robot's motion, ground effect. */
    double zero_thrust_speed; /* χ: axial inflow at which a duct's thrust vanishes, in units of its own jet speed [Leishman]. */
    double core_length; /* Length of a jet's potential core in duct diameters: 3.25 … 6.2 in the literature [Hamill]. */
    double stacking_loss; /* Share of its thrust that a module loses directly below another one, in addition to the jets' effect; 0 … 0.2 [chosen]. It decreases as exp[−(d / 0.22 m)²] with the distance d from the lower module's axis. */
    double duct_drag_area; /* C_d A of one duct in a stream [m²]. */
    double ground_effect; /* a in T ← T (1 + a (R / 4h)²): 1 is Cheeseman and Bennett's open rotor; ducts have either sign. */
} sp_aero_config;

/* Parameters of the simulated body; the defaults are those of the robot description. */
typedef struct {
    double total_mass; /* Mass of the whole robot [kg]; all masses and inertias are scaled to it, after the factors below. */
    double link_mass[8]; /* Factor on mass and inertia of each link with its junction and module. */
    double link_com[24]; /* (8, 3) Shift of each link's centre of mass, link axes [m]. */
    double torso_com[3]; /* Shift of the torso's centre of mass [m]. */
    double inertia[8]; /* Factor on the inertia of each link about its own centre of mass. */
    double payload_mass; /* Point mass that the torso carries, in addition to `total_mass` [kg]. */
    double payload_position[3]; /* Position of the payload, torso axes [m]. */
    double foot_friction; /* Sliding friction of the feet. */
    double peg_friction; /* Sliding friction of pegs, ducts and torso. */
} sp_body_config;

/* The floor under the robot. */
typedef struct {
    double slope; /* Angle to the horizontal, by rotation about the origin [rad]. */
    double heading; /* Direction in which the floor rises [rad]. */
    double tiles[256]; /* (16, 16) Height of each tile over the plane [m]; all zero is a plane without tiles. */
    double boxes[448]; /* (64, 7) Boxes in the world: centre, half of length, width and height [m], downward pitch of the front [rad]; boxes of zero size are unused. */
} sp_ground_config;

/* A free rigid object; its axes are those of its shape, with the origin in the shape's middle. */
typedef struct {
    int32_t shape; /* `box`, `cylinder` with a vertical axis, `ball`, or `none` for a world without an object. */
    double half_size[3]; /* Half of length, width and height of a box; of a cylinder and a ball the first number is the radius, of a cylinder the last one half the height [m]. */
    double mass; /* Mass [kg]. */
    double com[3]; /* Position of the centre of mass [m]. */
    double inertia; /* Factor on the inertia of a uniform solid about its centre of mass. */
    double friction; /* Sliding friction of its surface against everything. */
    double pressure; /* Pressure of air on a face over the dynamic pressure of the flow towards it: 2 where a jet loses all of its momentum along the normal, 1.1 is the drag of a bluff body. */
} sp_object_config;

/* Parameters of the recirculating wake; off by default. */
typedef struct {
    double flow_xy; /* Standard deviation of U over w along x and along y, world axes [1]. */
    double flow_z; /* Standard deviation of U over w along z [1]. */
    double turn_xy; /* Standard deviation of Ω over w about x and about y, world axes [1/m]. */
    double turn_z; /* Standard deviation of Ω over w about z [1/m]. */
    double mean_flow[3]; /* Mean of U over w, world axes [1]. */
    double mean_turn[3]; /* Mean of Ω over w, world axes [1/m]. */
    double flow_seconds; /* Correlation time of U [s]. */
    double turn_seconds; /* Correlation time of Ω [s]. */
    double near; /* n in the factor 1 + n exp(−d / 1 m) on U and Ω at the distance d from the nearest floor or box. */
} sp_recirculation_config;

/* Noise of the sensors; values of a motion capture of the Vicon class [JSK] and of an ADIS16448 [RotorS]. */
typedef struct {
    double latency; /* Latency of a frame of the motion capture [s]. */
    double position_noise; /* Standard deviation of a position [m]. */
    double rotation_noise; /* Standard deviation of an attitude [rad]. */
    double position_drift; /* Standard deviation of the slow error of positions, with a correlation time of 10 s [m]. */
    double rotation_drift; /* Standard deviation of the slow error of attitudes, with a correlation time of 10 s [rad]. */
    double dropout; /* Probability that a drop-out of 50 ms begins at a frame. */
    double gyro_noise; /* Density of the gyroscope's noise [rad/s/√Hz]. */
    double gyro_bias; /* Standard deviation of the gyroscope's bias at switch-on [rad/s]. */
    double accelerometer_noise; /* Density of the accelerometer's noise [m/s²/√Hz]. */
    double accelerometer_bias; /* Standard deviation of the accelerometer's bias at switch-on [m/s²]. */
    double vibration; /* Standard deviation of the accelerometer's error from vibration of the rotors [m/s²] [estimate]. */
    double encoder_noise; /* Standard deviation of an encoder before rounding, in counts. */
    double torque_noise; /* Relative error of a servo's reported torque. */
    double factor; /* Factor on all noise, drift and bias above, but not on the encoders' steps. */
} sp_sensor_config;

/* Configuration of the simulated robot. */
typedef struct {
    int32_t substeps; /* Physics steps per control period: 10 × 2.5 ms = 25 ms, 40 Hz. */
    double joint_speed; /* Largest speed of the joint servos' setpoints, the only limit of joint speeds [rad/s]. */
    double idle_thrust; /* Least commanded thrust of a module [N]; `ROBOT.idle_thrust` for armed motors. */
    int32_t sense; /* Whether sensors are simulated, for `Plant.measure`. */
    sp_body_config body; /* Masses, inertias and friction. */
    sp_actuator_config actuators; /* Rotors and servos. */
    sp_aero_config aero; /* The air. */
    sp_recirculation_config recirculation; /* Eddies of the air that returns to the robot. */
    sp_sensor_config sensors; /* Noise of the sensors. */
    sp_ground_config ground; /* The floor. */
    sp_object_config object; /* A free object; by default there is none. */
} sp_plant_config;

/* Disturbances of an episode; all off by default. */
typedef struct {
    double wind; /* Mean wind speed [m/s], with first-order Dryden turbulence in proportion; its direction is sampled at reset. */
    double push; /* Force of pushes on the torso [N], 0.2 s long, every 5 … 15 s, in a direction sampled for each push. */
    int32_t lost_rotor; /* Module that fails, 1 … 8; 0 for none. The fault is reported to the controller. */
    int32_t fault; /* `thrust`: the module loses its thrust; `vectoring`: its φ and θ are stuck. */
    double fault_time; /* Time of the failure [s]. */
} sp_disturbances;

/* A stream of random numbers: numpy's PCG64, and the seed state that spawns other streams. */
typedef struct {
    uint64_t state_high, state_low; /* of PCG64 */
    uint64_t increment_high, increment_low; /* odd; selects one of PCG64's streams */
    uint32_t has_half, half; /* whether the upper half of a draw is unused; that half */
    uint32_t pool[4]; /* the seed and the spawn key, mixed */
    uint32_t hash, spawned; /* next constant of the mixing; number of spawned streams */
} sp_generator;

/* The robot and the floor in MuJoCo: indices into MuJoCo's arrays, and constants. */
typedef struct {
    int32_t bodies, torso, floor, geoms, moving; /* number; body; geom; numbers of all geoms and of the robot's */
    int32_t module_body[8], link_body[8]; /* bodies */
    int32_t part_body[32]; /* bodies of a link: junction, link, and the two of its module */
    int32_t body_parent[64], body_dofadr[64], body_dofnum[64]; /* of MuJoCo's tree */
    int32_t joint_qpos[32], joint_dof[32]; /* of joints, then vectoring angles */
    int32_t ball[12], ball_body[12]; /* geoms of the feet, then of the pegs; their bodies */
    int32_t duct[16]; /* geoms of the ducts */
    int32_t geom[64]; /* geoms of the robot */
    int32_t geom_kind[512]; /* index of a ball, SP_BALLS for a duct, −1 for other geoms */
    int32_t geom_touches[512], geom_is_foot[512]; /* whether it collides with the floor; whether it is a foot */
    int32_t tile[256]; /* geoms of the tiles, row by row; −1 where there are none */
    int32_t box[64]; /* geoms of the boxes; −1 where there are none */
    int32_t object, object_geom; /* body and geom of the object; −1 where there is none */
    double mass[64]; /* of the described robot [kg] */
    double torso_axes[4]; /* principal axes of the torso's inertia, a quaternion */
    double inertia[64][3], com[64][3]; /* principal inertia [kg m²]; CoG [m] */
    double geom_reach[64]; /* bounding radius [m] */
    double ball_radius[12]; /* [m] */
    double duct_radius[16], duct_half[16]; /* radius and half height [m] */
    double weight, max_joint_torque, torso_radius, torso_height; /* [N], [Nm], [m] */
    double propeller_radius, duct_offset_y, duct_z; /* of a duct; its exit below the module's centre [m] */
    double link_station[3], link_width[3]; /* stations along a link, and its width there [m] */
    double link_scale[8]; /* length of each link over that of the link with these stations */
    double gravity, battery_share; /* [m/s²]; largest thrust over that with the measured battery */
    double vectoring_kd; /* damping of a vectoring servo [Nm s/rad] */
    double imu_position_b[3]; /* position of the inertial unit, which motion capture tracks [m] */
    double encoder_step[32]; /* one count of each encoder [rad] */
    int32_t object_type[4]; /* MuJoCo's geom type of each shape */
    double patch[4][864][7]; /* of objects with half sizes of 1 */
    double start[469]; /* MuJoCo's state after a reset */
} sp_world;

/* Result of one evaluation of the air. */
typedef struct {
    double generalized[38]; /* generalised force for qfrc_applied [N, Nm] */
    double thrust_factor[16]; /* thrust of each duct over that in still air */
    double forces_w[135], points_w[135]; /* force at each station and its position, world [N], [m] */
    double object_force_w[3], object_torque_w[3]; /* on the object, about its origin, world [N], [Nm] */
} sp_air;

/* State of wind and pushes. */
typedef struct {
    double mean_w[3], gust_w[3], push_w[3]; /* mean wind, turbulence [m/s]; present push [N]; world */
    double next_push, push_end; /* start of the next push, end of the present one [s] */
} sp_weather;

/* A delayed command. */
typedef struct {
    int64_t due, vectoring_due; /* physics step at which thrusts and joints arrive; vectoring angles */
    double target[40]; /* thrusts [N], joints, vectoring angles [rad] */
} sp_pending;

/* State of the sensors. */
typedef struct {
    double gyro_bias[3], accelerometer_bias[3]; /* [rad/s], [m/s²] */
    double drift[6]; /* slow error of position [m] and attitude [rad] */
    double velocity_w[3]; /* of the inertial unit at its last sample [m/s] */
    double silent_until, next_pose, next_encoder; /* [s] */
    int32_t frames, samples; /* delayed motion-capture frames; inertial samples since the last tick */
    double frame_time[16]; /* oldest first [s] */
    double frame_position_w[16][3]; /* [m] */
    double frame_quat_wb[16][4];
    double imu_time[8]; /* oldest first [s] */
    double gyro_b[8][3], specific_force_b[8][3]; /* [rad/s], [m/s²] */
    double encoder_time; /* of the latest reading [s] */
    double angles[32]; /* indicated by the servos [rad] */
    double torque[16]; /* reported by the servos [Nm] */
} sp_sensor_memory;

/* Floor contacts at one instant. */
typedef struct {
    int32_t balls[12]; /* whether each foot, then each peg, touches it */
    int32_t ducts; /* whether a duct touches it */
    double slip[8]; /* speed of the touching points of feet, then of the torso's pegs [m/s] */
    double duct_clearance; /* height of the lowest duct over the floor [m] */
    double hit; /* largest force on anything but feet and pegs, with boxes only [N] */
} sp_touch;

/* State of the object, and what acts on it. */
typedef struct {
    double position_w[3]; /* origin [m] */
    double quat_wo[4]; /* attitude (w, x, y, z) */
    double velocity_w[3], omega_o[3]; /* of the origin, world [m/s]; angular velocity, object axes [rad/s] */
    double foot_force_w[12]; /* force of each foot on it in the last physics step, world [N] */
    double floor_force_w[3]; /* force of floor and boxes on the object in it [N] */
    double air_force_w[3], air_torque_w[3]; /* force of the air and its torque about the origin [N], [Nm] */
    int32_t is_hit, rests; /* touched by more than feet; at rest, the robot away */
} sp_object_state;

/* One simulated robot: configuration and state. */
typedef struct {
    sp_plant_config config;
    sp_disturbances disturbances;
    double floor_R[9]; /* attitude of the floor */
    double highest_tile; /* over the floor's plane [m] */
    int64_t delay, vectoring_delay; /* between a command and the actuators, in physics steps */
    double row[469]; /* MuJoCo's state; the end is unused without an object */
    sp_robot_state state; /* the true state */
    int64_t clock; /* physics steps since the reset */
    int32_t pending_first, pending_count; /* ring buffer */
    sp_pending pending[32];
    double torque_limit[16]; /* of the joint servos [Nm] */
    int32_t in_contact, diverged, has_air, senses; /* touches the floor; not finite; has air; has sensors */
    int32_t violated; /* bits of sp_constraint since it was last set to 0 */
    double clearance; /* lower bound of the height over the highest tile after the last tick [m] */
    double hit; /* largest force of the last tick on anything but feet and pegs, with boxes only [N] */
    double spent_wh; /* energy that the battery lacks at the reset [Wh] */
    double noise[8]; /* of the thrusts [N] */
    sp_weather weather;
    double eddy[6]; /* recirculation: U, Ω less their means, over their standard deviations */
    double air_force_w[3]; /* of the air, without the thrust in still air, world [N] */
    double air_factor[16]; /* thrust of each duct over that in still air */
    int32_t falling[8]; /* whether the thrust of each module falls */
    double loose[16]; /* position of each joint within its play [rad] */
    double sticks[16]; /* angle at which dry friction holds each vectoring axis [rad] */
    int32_t is_stuck; /* whether `stuck` is valid */
    double stuck[2]; /* vectoring angles of a module whose servos have failed [rad] */
    double power, energy_wh; /* [W], since the reset [Wh] */
    sp_object_state object; /* zero where there is none */
    sp_sensor_memory sensors;
    sp_generator generator; /* of noise, wind and pushes */
} sp_plant;

/* A form of the schedule. */
typedef struct {
    double start, deadline; /* time at which it becomes the target; at which the slowest joint arrives [s] */
    double joint_target[16]; /* q [rad] */
    int32_t reached; /* whether it was reached in time */
} sp_goal;

/* A randomised number of a plant's configuration, or a range of them. */
typedef struct {
    int32_t at, count, operation; /* byte offset in the configuration; how many; sp_operation */
    int32_t is_log; /* whether the logarithm is uniform */
    double low[8], high[8]; /* limits of the distribution at strength 1 for each kind of robots */
} sp_draw;

/* Meaning of the entries of an action. */
typedef struct {
    int32_t size, is_direct, channels; /* entries; whether they bypass the controller; bits of sp_channel */
    int32_t is_in_torso_axes; /* whether those that bypass it are forces in torso axes and offsets of joints */
    int32_t has_clock; /* whether the observation has a clock */
    double trim; /* share of the weight that the rotors bear at a zero action in torso axes */
    double authority[48]; /* value of an entry of 1 */
} sp_action_mode;

/* Rules that all robots of an environment share. */
typedef struct {
    sp_plant_config plant; /* nominal robot of the randomisation */
    sp_estimator_config estimator;
    sp_action_mode mode;
    double bound[512]; /* of each number of the observation */
    double gain[512]; /* factor of each of its numbers, after the bound */
    int32_t size, is_scaled; /* of the observation; whether its numbers are multiplied by `gain` */
    int32_t is_described; /* whether integrals begin at zero, as a described robot needs no trim */
    int32_t draws; /* number of valid entries of `draw` */
    sp_draw draw[64]; /* in the order of the draws */
    double strength; /* of the randomisation, 0 … 1 */
    int32_t kinds, kind; /* number of kinds of robots, 0 for one; the given kind, −1 for a sampled one */
    int64_t horizon, hold; /* steps of an episode, after which success is evaluated; ticks of a step */
    double stop[27]; /* limits of the quantities, above which a step of several ticks ends */
    int32_t truncates, autoreset; /* whether the episode ends at the horizon; sp_autoreset */
    int32_t is_commanded, is_referred; /* whether commands come from Python; whether references do */
    int32_t is_advised; /* whether the controller computes its advice where actions bypass it */
} sp_rules;

/* The task of a flight. */
typedef struct {
    sp_rules rules;
    sp_controller_config controller;
    double position_w[3]; /* reference of the CoG [m] */
    double joint_speed, perturbation, horizon_s; /* [rad/s]; of the start, 1; end of the schedule [s] */
    int32_t avoids, windows; /* whether rotors are restricted; number of windows without restriction */
    double window[16][2]; /* start and end [s] */
    double form[3][16]; /* the paper's [rad] */
    double range[3][2][4]; /* least and largest angles of a leg's joints in sampled forms [rad] */
    int32_t drawn_legs[3]; /* number of sampled legs; the others copy them */
    double mixture[2]; /* share of the paper's forms; of these and forms with equal legs */
    double paper_pause; /* between the paper's first two forms [s] */
    double pause[2]; /* range of the pause between sampled forms [s] */
    double offset[2]; /* largest initial offset per axis, position [m] and attitude [rad] */
    double arrival_grace, arrival_tolerance; /* tolerances for reaching a form: delay [s], joint error [rad] */
    int32_t path, heading; /* sp_path_kind; sp_heading */
    double path_mixture[2]; /* share of straight legs; of these and lemniscates */
    double speed[2]; /* range of the speed on a path [m/s] */
    double path_begin, half_width; /* start of a path [s]; of a lemniscate [m] */
    double corner_radius[2], corner_turn[2]; /* ranges: corner from the start [m]; turn to the next [rad] */
    double bend_radius[2], bend_turn[2]; /* ranges: point from a spline's middle [m]; turn to the next [rad] */
    double climb; /* largest height of points above the start [m] */
} sp_hover_rules;

/* State of an episode that all tasks share. */
typedef struct {
    sp_generator generator; /* of the environment; samples the episodes */
    sp_disturbances disturbances; /* of this episode and those after it */
    sp_estimator estimator;
    sp_robot_state seen; /* observed state: the true one, or its estimate from the sensors */
    double action[48]; /* last action, within [−1, 1] */
    int32_t has_command; /* whether `command` is valid */
    sp_command command; /* last command */
    sp_residual residual; /* of the last action */
    int64_t ticks; /* since the reset */
    int32_t failure; /* reason for the end of the episode, or −1 */
    int32_t truncated, over; /* whether the horizon is reached; whether the next step is a reset */
    int32_t kind; /* of the robot, in a calibrated world */
    double drawn[256]; /* randomised numbers of the robot, in the order of the draws */
} sp_episode;

/* A robot in flight: plant, controller and task. */
typedef struct {
    sp_plant plant;
    sp_episode episode;
    sp_flight flight;
    sp_control_state percept, truth; /* of the observed state; of the true state */
    sp_reference reference;
    sp_preview preview;
    double leg_momentum[3], leg_momentum_rate[3]; /* [Nms], [Nm] */
    double joint_velocity[16]; /* of the joint commands [rad/s] */
    double position_error[3], attitude_error[3]; /* true errors [m], [rad] */
    int32_t forms, is_given, has_trim; /* sequence of forms; whether the start is given; its trim too */
    double offset[3], rotation[3], velocity[3], omega[3]; /* initial offset [m], [rad], velocity of the CoG [m/s], [rad/s] */
    double trim[6]; /* wrench of a hover beyond that of the description [N, Nm] */
    int32_t goals, current, flown; /* number of goals; index of the present one; ticks */
    int32_t knots; /* number of knots of the path; 0 without a path */
    double position_sum, attitude_sum; /* of squared errors [m²], [rad²] */
    int32_t is_led; /* whether the controller's advice is executed instead of the action */
    sp_command advice; /* command that the controller would have issued at the last tick */
} sp_hover_robot;

/* `info` of every task. */
typedef struct {
    double thrust_command[8], thrust[8]; /* [N] */
    double vectoring_command[8][2], vectoring[8][2]; /* (φ, θ) [rad] */
    double joint_torque_allocated[16], joint_torque[16]; /* [Nm] */
    double wrench_allocated[6]; /* [N, Nm] */
    double total_thrust, qp_slack; /* [N] */
    double thrust_factor[8]; /* thrust of each module over that in still air */
    double air_force[3]; /* world [N] */
    double power_w, energy_wh, endurance_min;
    double cost, cost_contact, cost_torque, cost_duct, cost_blown; /* of violated constraints: sum, and each */
    int32_t qp_status_code, qp_iterations, failure_code; /* sp_status or −1; number; failure of the task or −1 */
} sp_info;

/* `info` of a flight. */
typedef struct {
    sp_info info;
    double position_error[3], attitude_error[3]; /* true errors [m], [rad] */
    double wrench_desired[6]; /* [N, Nm] */
    uint8_t restricted_rotors[8];
    uint8_t is_success;
} sp_hover_info;

/* Quantities of every task. */
typedef struct {
    double ticks; /* Steps of the episode. */
    double time; /* Time since the reset [s]. */
    double in_contact; /* 1 where a part of the robot touches the floor. */
    double diverged; /* 1 where the simulation's state is no longer finite. */
    double power; /* Electrical power [W]. */
    double effort; /* Mean square of the action. */
} sp_quantities;

/* Quantities of robots in flight. */
typedef struct {
    sp_quantities common;
    double distance; /* Length of the position error [m]. */
    double angle; /* Length of the attitude error [rad]. */
    double joint_error; /* Largest deviation of a joint angle from the schedule [rad]. */
    double tilt; /* Angle between the torso's z axis and the vertical [rad]. */
    double position_rms; /* RMS of the position error since the reset [m]. */
    double attitude_rms; /* RMS of the attitude error since the reset [rad]. */
    double overdue; /* Number of forms that were due by now and not reached in time. */
} sp_hover_quantities;

/* Sampled start of a flight, besides forms and knots. */
typedef struct {
    double position[3], rotation[3]; /* offset of the torso [m], [rad] */
    int32_t goals, knots; /* numbers of both */
} sp_flight_start;

/* Quantities of a flight that `info` does not contain. */
typedef struct {
    sp_interference_config config;
    sp_interference bounds; /* present bounds; those of the last call before */
    double tolerance, thrust; /* a rotor interferes if beyond its bound by this [rad] with this thrust [N] */
    double planned[16]; /* present joint angles of the schedule [rad] */
    int32_t interferes; /* whether a rotor interferes */
} sp_watch;

/* The task of a crawl. */
typedef struct {
    sp_rules rules;
    sp_crawler_config controller;
    double lies[16]; /* joint angles of the robot at rest [rad] */
    sp_pose2 way; /* displacement of the paper's crawl */
    double share, turn; /* share of `way` among the samples; largest turn of the others [rad] */
    double distance[2]; /* least and largest distance of the others [m] */
    int32_t is_given[3]; /* whether distance, direction and turn are given, not sampled */
    double given[3]; /* [m], [rad], [rad] */
    double steps; /* height of the steps of the floor [m]; 0 without steps */
    int32_t terrain; /* sp_terrain: kind of floor with steps */
    int32_t obstacles; /* number of blocks */
    double obstacle[64][3]; /* x, y, radius [m] */
    double obstacle_height, goal_clearance; /* [m] */
    int32_t settle_ticks; /* ticks in which the robot settles on an uneven floor */
    double turn_length; /* distance equivalent to a radian [m] */
    double success_position, success_yaw; /* largest errors of a success [m], [rad] */
    double saturated, rest_time, rest_speed, rest_turn, rest_joint_speed, rest_thrust; /* margin to the torque limit [Nm]; limits of a rest: [s], [m/s], [rad/s], [rad/s], share of the weight */
} sp_crawl_rules;

/* A robot on the ground: plant, controller and task. */
typedef struct {
    sp_plant plant;
    sp_episode episode;
    sp_crawl crawl;
    sp_touch touch;
    double tilt; /* of the torso against the floor [rad] */
    sp_pose2 way, goal; /* displacement from the start; goal pose, world */
    int32_t cycles; /* number of gait cycles; 0 where the goal is out of reach */
    double nominal_time; /* duration if joints and torso follow the plan exactly [s] */
    double error[3]; /* goal − torso, x, y [m], world, and yaw [rad] */
    double initial_distance, distance; /* to the goal; a radian counts as `turn_length` [m] */
    int32_t crawled, timeouts, rested; /* ticks; phases that timed out; ticks at rest until now */
    int32_t swinging[4]; /* whether each foot swings */
    int32_t phase, is_done; /* sp_phase; whether the gait is done */
    double finished; /* time of the gait's end, in `direct` of the end of the rest at the goal [s]; 0 before */
    double swing_ticks[4], airborne_ticks[4]; /* ticks in swing; ticks of swing in the air */
    double foot_slip[4], peg_slip[4]; /* distances slipped on the floor [m] */
    double duct_clearance; /* least so far [m] */
    int32_t duct_contact; /* whether a duct has touched the floor */
    double saturation, thrust, thrust_peak; /* sums over ticks: saturated joints, thrust over weight; its peak */
    double tilt_legs, tilt_torso; /* largest tilt while legs are lifted, while the torso moves [rad] */
} sp_crawl_robot;

/* Quantities of robots on the ground. */
typedef struct {
    sp_quantities common;
    double distance; /* Distance to the goal; a radian of yaw error counts as 0.5 m [m]. */
    double initial_distance; /* Distance to the goal at the start [m]. */
    double position_error; /* Horizontal distance to the goal [m]. */
    double yaw_error; /* Absolute yaw error to the goal [rad]. */
    double tilt; /* Angle of the torso against the floor [rad]. */
    double slip; /* Speed of the fastest touching point [m/s]. */
    double duct_touches; /* 1 where a duct touches the floor. */
    double duct_touched; /* 1 where a duct has touched the floor in this episode. */
    double finished; /* Time at which the gait was done, or in `direct` the robot had rested at the goal [s]; 0 before. */
    double nominal_time; /* Duration of the preset's gait with perfect servos [s]. */
    double timeouts; /* Number of phases that ended by time-out. */
    double airborne; /* Share of the swing time in which the worst foot was in the air; 1 before the first swing. */
    double foot_slip; /* Distance that the worst foot has slipped along the floor [m]. */
} sp_crawl_quantities;

/* `info` of a crawl. */
typedef struct {
    sp_info info;
    double goal_error[3]; /* [m], [m], [rad] */
    double time_s, nominal_time_s, airborne_share, foot_slip_m, peg_slip_m, duct_clearance_m;
    double saturation_share, thrust_fraction, thrust_fraction_mean, thrust_fraction_peak;
    double tilt_rad, cost_of_transport;
    int32_t phase_code, timeouts, shortfalls_code; /* sp_phase; phases that timed out; bits of sp_shortfall */
    uint8_t foot_contact[4];
    uint8_t finished, is_success;
} sp_crawl_info;

/* Quantities of robots that grasp. */
typedef struct {
    sp_quantities common;
    double reach; /* Distance of the torso from its place for the grip [m]. */
    double gap; /* Mean horizontal distance of the feet from the object's sides [m]. */
    double clear; /* Least distance of a foot from the object's sides or top [m]. */
    double touching; /* Number of feet that touch the object. */
    double lifted; /* Height of the object over its stand at the start [m]. */
    double most_lifted; /* Largest such height of the episode [m]. */
    double way; /* Distance of the object from its place at the goal; a radian of heading counts as 0.5 m [m]. */
    double initial_way; /* That distance at the start [m]. */
    double position_error; /* Distance of the object from its place at the goal [m]. */
    double yaw_error; /* Absolute error of its heading, up to turns after which it looks the same [rad]. */
    double object_tilt; /* Angle between its axis and the vertical [rad]. */
    double object_speed; /* Speed of its middle [m/s]. */
    double fall; /* Largest speed at which the object has fallen in this episode [m/s]. */
    double force; /* Largest force of a foot on the object, a mean over a tenth of a second [N]. */
    double pressed; /* Largest such force of the episode over the one that the object bears. */
    double is_hit; /* 1 where a part other than a foot has touched the object, or one other than feet and pegs anything. */
    double tilt; /* Angle between the torso's z axis and the vertical [rad]. */
    double charge; /* Remaining share of the battery's usable energy, 0 … 1. */
    double is_cut; /* 1 where the rotors have been cut in the air. */
    double is_outside; /* 1 where the robot has left the field. */
    double is_empty; /* 1 where the battery's usable energy is used up. */
} sp_grasp_quantities;

/* The task of grasping. */
typedef struct {
    sp_rules rules;
    sp_manager_config manager;
    double shapes[3]; /* share of each shape */
    double half_width[2], half_height[2], mass[2], friction[2], most_force[2]; /* ranges [m], [m], [kg], 1, [N] */
    double off_centre; /* largest offset of the centre of mass along each axis, share of the half size */
    double distance[2], turn[2], goal_distance[2], goal_turn[2], goal_yaw[2], stand[2], floor[2]; /* ranges: start → object [m], [rad]; object → goal [m], [rad]; of its heading [rad]; of stands [m] */
    double pressure, bias, noise, turn_noise; /* of jets on faces; largest error and noise of the seen object [m], [m], [rad] */
    double begin_height, reserve; /* of the torso at the start [m]; of the grip's limit over what is needed */
    double placed, turned, upright, at_rest, clear_of, high; /* of a success [m], [rad], [rad], [m/s], [m], [m] */
    double force_time, touch; /* of the mean force of a foot [s]; from which a foot touches [N] */
    double field, ceiling; /* largest distance from the start along x and y, and height [m] */
    int32_t is_order, decide; /* whether an action steers; ticks between its decisions */
    double grip; /* force of each foot that the rule orders [N]; 0 as tested, −1 as told */
} sp_grasp_rules;

/* A robot that grasps: plant, controller and task. */
typedef struct {
    sp_plant plant;
    sp_episode episode;
    sp_manager manager;
    sp_grasp_scene scene;
    sp_rule_memory rule;
    int32_t is_given; /* whether the scene is given, not sampled */
    sp_seen seen; /* the object as motion capture sees it, a tick ago */
    double place_w[3]; /* where the object belongs at the goal [m] */
    double stood, initial_way; /* height of the object at the start [m]; distance to the goal [m] */
    double force[4]; /* of the feet on the object, a mean over a tenth of a second [N] */
    double most_force, most_lifted, fall, tilt, charge; /* largest so far [N], [m], [m/s]; [rad]; of the battery */
    double arrived; /* time since which the object is delivered [s]; 0 if it is not */
    int32_t controls, hit; /* ticks; whether a forbidden part has touched */
    int32_t phase, grasp_phase; /* sp_manager_phase; sp_grasp_phase */
} sp_grasp_robot;

/* `info` of a grasp. */
typedef struct {
    sp_info info;
    double object_error[3]; /* goal − object, world [m] */
    double object_force[4]; /* of each foot on the object [N] */
    double object_air[3]; /* force of the air on it, world [N] */
    double object_com[3]; /* its centre of mass from its middle [m] */
    double object_mass, object_friction; /* [kg], 1 */
    double way_m, yaw_error_rad, lifted_m, time_s, charge, tilt_rad, thrust_fraction, grip_n, payload_kg;
    double force_n, most_force_n; /* largest mean force of a foot; of the episode [N] */
    int32_t phase_code, grasp_phase_code, tries; /* sp_manager_phase; sp_grasp_phase; of the rule */
    uint8_t lost, refused, finished, is_success;
} sp_grasp_info;

/* Quantities of robots on a course. */
typedef struct {
    sp_quantities common;
    double distance; /* Distance to the goal; a radian of yaw error counts as 0.5 m [m]. */
    double initial_distance; /* Distance to the goal at the start [m]. */
    double position_error; /* Horizontal distance to the goal [m]. */
    double yaw_error; /* Absolute yaw error to the goal [rad]. */
    double hit; /* Largest force of the step on anything but feet and pegs [N]. */
    double tilt; /* Angle between the torso's z axis and the vertical [rad]. */
    double charge; /* Remaining share of the battery's usable energy, 0 … 1. */
    double lies; /* 1 where the robot lies on the floor at rest. */
    double is_cut; /* 1 where the rotors have been cut in the air. */
    double is_outside; /* 1 where the robot has left the field. */
    double is_empty; /* 1 where the battery's usable energy is used up. */
} sp_course_quantities;

/* The task of a course. */
typedef struct {
    sp_rules rules;
    sp_manager_config manager;
    int32_t kinds[7], floors[7]; /* sp_gate_kind to sample from; SP_GATE_KINDS is a plain floor */
    int32_t kind_count, floor_count; /* numbers of kinds and floors */
    int32_t count[2]; /* least and largest number of gates */
    double size[6][2]; /* ranges by sp_gate_kind [m], [rad] */
    double depth[6]; /* of gates along the course [m] */
    double first_gap[2], gap[2], goal_way[2]; /* ranges: to the first gate, between gates, floor to goal [m] */
    double floor_gap, floor_length, middle, goal_side, goal_yaw; /* [m], the last [rad] */
    double charge[2]; /* range of the initial charge */
    int32_t is_waypoint, decide; /* whether an action is a target; ticks between decisions */
    double lies, at_rest; /* [m], [m/s] */
    double carried, turn_length, success_position, success_yaw; /* of the weight; per radian [m]; [m], [rad] */
} sp_course_rules;

/* A robot on a course: plant, controller and task. */
typedef struct {
    sp_plant plant;
    sp_episode episode;
    sp_manager manager;
    sp_pilot pilot;
    sp_course course;
    int32_t is_given; /* whether the course is given, not sampled */
    double error[3]; /* goal − torso, x, y [m], world, and yaw [rad] */
    double initial_distance, distance; /* to the goal; a radian counts as `turn_length` [m] */
    int32_t controls, flown, crawled, lies; /* ticks; ticks in the air; ticks of crawling; whether the robot lies */
    int32_t phase; /* sp_manager_phase */
    double arrived; /* time since which the robot lies at the goal [s]; 0 if it does not */
    double hit, most_hit, tilt, charge; /* largest force of the last step, of all [N]; [rad]; of the battery */
} sp_course_robot;

/* `info` of a course. */
typedef struct {
    sp_info info;
    double goal_error[3]; /* [m], [m], [rad] */
    double distance_m, time_s, flown_s, crawled_s, charge, hit_n, most_hit_n, tilt_rad, thrust_fraction;
    int32_t phase_code, gate; /* sp_manager_phase; number of passed gates and floors */
    uint8_t lies, finished, is_success;
} sp_course_info;

#endif
