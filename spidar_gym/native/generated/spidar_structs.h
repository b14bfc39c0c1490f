/* Generated: structs that Python and C exchange, configurations, and the core's state. */
#ifndef SPIDAR_STRUCTS_H
#define SPIDAR_STRUCTS_H

#include <stdint.h>
#include "spidar_constants.h"

/* State of the robot at one instant, true or estimated. */
typedef struct {
    double time; /* Time since the start [s]. */
    double position_w[3]; /* Origin of the torso in the world [m]. */
    double quat_wb[4]; /* Attitude of the torso (w, x, y, z). */
    double velocity_w[3]; /* Velocity of the torso's origin in the world [m/s]. */
    double omega_b[3]; /* Angular velocity of the torso, torso axes [rad/s]. */
    double joint_position[16]; /* q [rad]. */
    double joint_velocity[16]; /* q̇ [rad/s]. */
    double vectoring[16]; /* (8, 2) (φ, θ) of each rotor, unwrapped [rad]. */
    double vectoring_velocity[16]; /* (8, 2) Rates of (φ, θ) [rad/s]. */
    double thrust[8]; /* λ [N]: delivered by the modules in the simulator, last commanded on the robot. */
    double joint_torque[16]; /* Torque of the joint servos [Nm]. */
} sp_robot_state;

/* Sensor data received since the last control tick; the counts give the number of valid rows. */
typedef struct {
    double time; /* Time of the control tick [s]. */
    int32_t pose_count; /* Number of received motion capture frames, which are the first rows of the three arrays below. */
    double pose_time[4]; /* Time at which each frame was taken, shape (4,) [s]. */
    double pose_position_w[12]; /* (4, 3) Origin of the flight controller in the world, shape (4, 3) [m]. */
    double pose_quat_wb[16]; /* (4, 4) Attitude of the torso (w, x, y, z), shape (4, 4). */
    int32_t imu_count; /* Number of samples of the flight controller's inertial unit, oldest first. */
    double imu_time[8]; /* Time of each sample, shape (8,) [s]. */
    double gyro_b[24]; /* (8, 3) Angular velocity, torso axes, shape (8, 3) [rad/s]. */
    double specific_force_b[24]; /* (8, 3) Acceleration minus gravity at the flight controller, torso axes, shape (8, 3) [m/s²]. */
    double encoder_time; /* Time at which the servos were read last [s]. */
    double joint_position[16]; /* Indicated q [rad]. */
    double joint_torque[16]; /* Torque reported by the joint servos [Nm]. */
    double vectoring[16]; /* (8, 2) Indicated (φ, θ) [rad]. */
} sp_measurement;

/* Desired motion of the robot at one instant. */
typedef struct {
    double position_w[3]; /* Desired position of the CoG in the world, r^d [m]. */
    double quat_wb[4]; /* Desired attitude of the torso, R^d (w, x, y, z). */
    double velocity_w[3]; /* Desired velocity of the CoG in the world [m/s]. */
    double omega_b[3]; /* Desired angular velocity, in the desired torso axes [rad/s]. */
    double joint_target[16]; /* Target form [rad]; the controller moves the commanded joints there at the joint speed. */
    int32_t mode; /* Name of the allocation mode, see `spidar_gym.control.allocation.modes`. */
    int32_t lost_thrust[8]; /* Modules reported to have no thrust; the allocation sets their forces to zero. */
    int32_t lost_vectoring[8]; /* Modules whose φ and θ no longer move; the allocation uses their thrust in its present direction. */
    double acceleration_w[3]; /* Desired acceleration of the CoG in the world [m/s²]. */
    double alpha_b[3]; /* Desired angular acceleration, in the desired torso axes [rad/s²]. */
    double support; /* Share of the weight that the floor carries, 0 … 1: the rotor forces are scaled by 1 − support. Above 0 the integrals and the observer are not updated. */
} sp_reference;

/* Additions of a learned policy to the controller. A zero residual changes nothing, bit for bit. */
typedef struct {
    double wrench[6]; /* Added to the desired wrench before the allocation, force [N] and torque [Nm], shape (6,). */
    double joint_offset[16]; /* Added to the joint targets [rad], shape (16,). */
    double joint_speed_scale; /* Factor on the planned joint speed, on the ground the rate of the phases; the servo's own limit stays. */
    int32_t has_forces_l; /* Whether the next field is valid. */
    double forces_l[24]; /* (8, 3) Added to the allocated rotor forces, link axes [N], shape (8, 3); the sum is moved to the nearest valid point. */
    int32_t has_leg_forces_b; /* Whether the next field is valid. */
    double leg_forces_b[12]; /* (4, 3) On the ground: force added to each leg, torso axes [N], shape (4, 3); the two rotors of a leg share it. */
    double raise_scale; /* On the ground: factor on the height to which the next step raises the legs. */
    double stride_scale; /* On the ground: factor on the next stride, within the reach. */
    double lift_scale; /* On the ground: factor on the lift of the next torso motion. */
} sp_residual;

/* Setpoints of the actuators for one control period. */
typedef struct {
    double thrust[8]; /* λ^d [N]. */
    double vectoring[16]; /* (8, 2) (φ^d, θ^d), unwrapped [rad]. */
    double joint_position[16]; /* q^d [rad]. */
    double joint_torque_limit[16]; /* Largest torque each joint servo may use [Nm]. */
} sp_command;

/* An object near the robot, and what the legs do with it. */
typedef struct {
    double position_w[3]; /* Origin of the object, in its middle, world [m]. */
    double radius; /* Radius of the object for the jets [m]; 0 where they do not avoid it. */
    double top; /* Height of its top over the origin [m]. */
    double force; /* Force of each foot towards the object's vertical axis [N]. */
    double payload; /* Mass that the legs carry [kg]. */
} sp_grip;

/* A horizontal disc below the rotors that no jet is to meet: the top of an object. */
typedef struct {
    double centre_c[3]; /* Centre from the CoG, torso axes [m]. */
    double radius; /* Radius [m]. */
} sp_disc;

/* A pose in the plane, or a motion from one to another along an arc. */
typedef struct {
    double x; /* Forward [m]. */
    double y; /* To the left [m]. */
    double yaw; /* Counter-clockwise [rad]. */
} sp_pose2;

/* State of the φ lock of each rotor. */
typedef struct {
    int32_t vertical[8]; /* Whether the link is near vertical (with hysteresis). */
    int32_t active[8]; /* Whether φ is held: near a vertical link, restricted by interference, or on its way back from either. */
    double phi[8]; /* The held angle [rad]; where `active` is False, the angle last commanded. */
} sp_lock;

/* The valid vectoring range of each rotor. */
typedef struct {
    int32_t restricted[8]; /* 𝓘: the rotors whose vectoring is restricted. */
    double lower[8]; /* μ̲ + θ̂: lower bound of θ [rad]; meaningful where restricted. */
    double upper[8]; /* μ̄ + θ̂: upper bound of θ [rad]; meaningful where restricted. */
    int32_t side[8]; /* +1 where the lower bound is the one nearer to the vertical, −1 where the upper one is. */
} sp_interference;

/* Errors of the centroidal motion, desired − actual, in the frames of the equations. */
typedef struct {
    double position_w[3]; /* e_r [m], world. */
    double velocity_w[3]; /* ė_r [m/s], world. */
    double attitude[3]; /* e_R = ½ (RᵀR^d − R^dᵀR)^∨, torso axes; about the rotation vector [rad] while small. */
    double omega_b[3]; /* e_ω [rad/s], torso axes. */
} sp_motion_error;

/* Inputs of the allocation in one tick: everything that the blocks may read. */
typedef struct {
    double wrench[6]; /* Desired wrench w^d in {CoG} [N, Nm]; on the ground the wrench that holds the weight. */
    double thrust_map[216]; /* (6, 36) Q: forces → wrench in {CoG}; 24 columns for the rotors in link axes, and 12 for the feet if they carry. */
    double torque_map[576]; /* (16, 36) T: forces → joint torque that the forces provide; τ_q = g − T f. */
    double gravity_torque[16]; /* g: joint torque that holds the links without thrust [Nm]. */
    int32_t locked[8]; /* Rotors whose φ is held. */
    double phi[8]; /* Held φ of the locked rotors [rad]. */
    int32_t restricted[8]; /* Rotors restricted by interference, 𝓘. */
    double lower[8]; /* Lower bounds of θ [rad], read where restricted. */
    double upper[8]; /* Upper bounds of θ [rad], read where restricted. */
    int32_t lost[8]; /* Rotors without force. */
    int32_t lifted[4]; /* Legs whose joint torque is allocated; that of other legs depends on floor forces that are not modelled. */
    double com_b[3]; /* Position of the CoG from the torso's origin [m], which transforms a wrench from {CoG} to {B}. */
    double R_bf[9]; /* (3, 3) Rotation from floor axes to torso axes. */
    double effort[8]; /* Weight of each rotor's ‖f‖² in the power cost. */
    double thrust_limit; /* λ̄ at the present voltage of the battery where it is below the robot's [N]. */
} sp_demand;

/* Gains as flown [JSK]; every gain yields an acceleration, so none depends on mass or form. */
typedef struct {
    double position_gains[9]; /* (3, 3) k_{f,p} [1/s²], k_{f,i} [1/s³], k_{f,d} [1/s] of x, y and z. */
    double attitude_gains[9]; /* (3, 3) k_{τ,p} [1/s²], k_{τ,i} [1/s³], k_{τ,d} [1/s] about x, y and z. */
    double max_position_error[3]; /* Errors are clipped to ± this before k_{f,p} [m]. */
    double max_attitude_error[3]; /* Attitude errors are clipped to ± this before k_{τ,p}. */
    double max_term[3]; /* Each of the terms P, I, D of the position is clipped to ± this [m/s²]. */
    double max_acceleration[3]; /* The sum of the position's terms is clipped to ± this [m/s²]. */
    double max_integration_speed; /* An axis whose velocity error exceeds this does not integrate its position error [m/s]. */
    double max_angular_acceleration; /* The attitude's terms and their sum are clipped to ± this [rad/s²]. */
} sp_centroidal_config;

/* Gains and time constants of the compensations; all zero is the paper's controller, bit for bit. */
typedef struct {
    double momentum_gain; /* Share of the legs' angular momentum rate that is fed forward as a torque; 0 is off [Orin2013]. */
    double momentum_filter; /* Time constant of the first-order filter of that torque [s]. */
    double servo_bandwidth; /* Natural frequency of the joint servo model that predicts the legs' momentum [rad/s]. */
    double vectoring_lead; /* Forces are expressed in the link axes predicted for this much later [s]; 0 is off. */
    double observer_gain; /* Share of the observed external wrench that is cancelled; 0 is off [DeLuca2006] [Zhao2020]. */
    double observer_time; /* Time constant of the observer [s]. */
    int32_t observer_beyond; /* Whether the observer uses the momentum of the error and excludes the feed-forward wrench, so that errors of its rotor model do not make feed-forward torques appear as a disturbance. */
    int32_t observer_order; /* Order of the observer's low-pass: 1, or 2 for two equal ones in series, with less noise and more lag. */
    double observer_lag; /* Time constant of the observer's model of the rotors [s]. */
    double torque_observer_gain; /* Share of the observed torque that is cancelled; 0: as for the force. */
    double torque_observer_time; /* Time constant of the observer of the torque [s]; 0: as for the force. */
    double torque_observer_lag; /* Time constant of the rotor model for the torque [s]; 0: as for the force. */
    double lead_gain; /* ρ of the lead compensator 1 + ρ (1 − 1/(1 + T s)) on the feedback, which adds phase; 0 is off [Franklin2019]. */
    double lead_time; /* T of the lead compensator [s]. */
    double joint_ramp; /* Time in which the commanded joints reach their speed [s], which limits their acceleration; 0 is off. */
    double reference_gain; /* Share of the reference's acceleration that is fed forward; 0 is off [Lee2010]. */
} sp_compensation_config;

/* Settings of the solver. */
typedef struct {
    int32_t max_iter; /* Iteration cap: 2,000 in simulation, 300 on the robot's computer. */
    double tolerance; /* Absolute tolerance of the solver, in scaled units. */
    double check_tolerance; /* Largest allowed violation of a row in a solver's result, in scaled units (1.6 mN of lift, 0.07 mNm of torque). */
    double price; /* Price of a violated row in the softened program, in scaled units. */
} sp_allocator_config;

/* Thresholds of the interference test; the defaults are the values that the lab flew [JSK]. */
typedef struct {
    double alpha; /* α̲: a pair inclined by more than this along φ does not interfere [rad] [Zhao2025, Eq. 22]. */
    double horizon; /* A target farther than this from straight below is ignored: the jet of a hovering rotor misses it [rad]. */
    double rotor_radius; /* Radius of a rotor and of its jet: duct inner radius 0.075 m times 1.2 [m]. */
    double torso_radius; /* Radius of the torso disc [m]. */
    double width; /* A subset of the range narrower than this is not used [rad]. */
    double theta; /* θ̲: a rotor is restricted when a bound comes nearer than this to the vertical [rad] [Zhao2025, Eq. 33]. */
    double hysteresis; /* A restricted rotor is released only when its bound is farther than θ̲ plus this [rad]. */
    double tie; /* If the distances of two subsets from the vertical differ by less than this, the previous side is kept [rad]. */
} sp_interference_config;

/* Thresholds and rates of the φ lock. */
typedef struct {
    double enter; /* φ is locked when the link comes within this angle of the vertical [rad] [JSK]. */
    double leave; /* φ is released when the link is farther than this from the vertical [rad]. */
    double slew; /* A held φ moves by at most this much per tick [rad] [JSK]. */
    double release; /* A φ that returns to φ̂ is released within this distance, which the servo turns in one tick [rad]. */
    double least; /* Smallest turn from φ̂ towards the tangential plane of a φ locked near a vertical link [rad]. */
    double most; /* Largest turn from φ̂ towards the tangential plane of a φ locked near a vertical link [rad]. */
} sp_lock_config;

/* Configuration of the flight controller. */
typedef struct {
    int32_t allocation; /* Name of the allocation's blocks, see `spidar_gym.control.allocation.modes.ALLOCATIONS`. */
    int32_t motion; /* Motion that is fed back: `complete`; `quasi_static`, the velocity of {CoG} without the share of the moving joints [JSK]; `observed`, that of the whole robot with legs that bend, see `spidar_gym.control.flight.motion`. */
    double joint_speed; /* Speed of the planned joint motion [rad/s]; the servos have the same limit. */
    double joint_torque_limit; /* Torque that each joint servo may use [Nm]. */
    double rate_hz; /* Control rate [Hz]. */
    sp_centroidal_config centroidal; /* Gains and limits of the centroidal control. */
    sp_compensation_config compensation; /* Compensations beyond the paper's quasi-static control. */
    sp_allocator_config allocator; /* Solver settings. */
    sp_interference_config interference; /* Thresholds of the interference test. */
    sp_lock_config lock; /* Thresholds and rates of the φ lock. */
} sp_controller_config;

/* Configuration of the gait. */
typedef struct {
    double inner; /* Inner pitch of the start pose, which defines the feet's home on the floor [rad]. */
    double outer; /* Outer pitch of the start pose [rad]. */
    int32_t stride; /* Stride scheme, one of `STRIDES`. */
    int32_t corrections; /* Largest number of corrections that are added to a move that has missed its goal: the torso is lifted and moved once more, after a step of all legs where it is farther from its goal than `trim_limit`. With them, a torso that is out of its goal's reach moves as far as it can, and one that is still short of it does not wait for the time-out. */
    double max_distance; /* Longest displacement of a cycle [m]; the reach may allow less. */
    double max_turn; /* Largest turn of a cycle [rad]. */
    double raise_angle; /* The inner pitch rises this far above the higher of start and end of the step [rad] [JSK]. */
    double lift_height; /* The torso moves at this height above its lying position [m] [Zhao2025, Sec. Crawling Motion]. */
    double press; /* Targets of feet and torso are this far below the floor to ensure contact [m]. */
    double swing_at; /* The swing begins at this share of the raise. */
    double lower_at; /* Legs are lowered when yaw and outer pitch are this close to their targets [rad]. */
    double forward_at; /* The torso moves forward from this share of its lift on. */
    double down_at; /* The torso is lowered from this share of its displacement on. */
    double start_time; /* Time in which thrust builds up from rest before the first motion [s]. */
    double spool_time; /* Time in which thrust changes from the previous mode before a motion [s]. */
    double settle_time; /* Time in which thrust fades after the torso has been lowered [s]; with 0 the next cycle follows without a rest. */
    double leg_touch_time; /* Feet have touched down when the inner pitches are near their targets and still for this time [s]. */
    double torso_touch_time; /* The torso has touched down when it is near its height and still for this time [s]. */
    double arrival; /* The torso has arrived when its filtered error is below this [m]; until then it waits for its trim. */
    double stall_time; /* A phase with a completed plan also ends once legs short of their targets have been still for this time [s]. */
    double trim_gain; /* Integral gain from the torso's error to the trim of its target [1/s]; 0 is off. */
    double trim_limit; /* Largest trim [m]. */
    int32_t rolling; /* Whether the kinematics include that the feet are balls, which roll as their legs turn. */
    double timeout; /* Longest duration of a phase without a fixed time [s]. */
} sp_gait_config;

/* Configuration of the crawler. */
typedef struct {
    sp_gait_config gait; /* Footsteps and phases. */
    double joint_speed; /* Speed of the planned joint motion [rad/s]; the servos have the same limit. */
    double rate_hz; /* Control rate [Hz]. */
    double torque_limit; /* τ̄_q of the allocation [Nm]; the margin to the servo's limit moves the legs. */
    double joint_torque_limit; /* Torque that each joint servo may use [Nm]. */
    double torque_weight; /* w₂ of [Zhao2025, Eq. 9] [1/(Nm)²]. */
    int32_t power; /* Whether to minimise Σ λ^1.5, electrical power, instead of the paper's Σ ‖f‖². */
    double foot_friction; /* Planned friction of the feet. */
    double peg_friction; /* Planned friction of the pegs. */
    double min_normal; /* Smallest normal force of all pegs together [N]. */
    double blend_time; /* Time in which the forces fade from one mode to the next [s]. */
    double feed_forward; /* Share of the allocated joint torque that shifts the servos' setpoints, τ_q / k_{j,p}. */
    double setpoint_filter; /* Time constant of a filter on the servos' setpoints, which smooths starts and stops [s]; 0 is off. */
    double leg_stiffness; /* Joint torque by thrust per position error of a lifted leg [Nm/rad]: the paper's future work; 0 is off. */
    double leg_damping; /* Joint torque by thrust per joint velocity of a lifted leg, opposed to it [Nm s/rad]. */
    sp_allocator_config allocator; /* Solver settings. */
    sp_lock_config lock; /* φ lock near vertical links. */
} sp_crawler_config;

/* Gains of the corrections. */
typedef struct {
    double position; /* Share of a frame's position error that is corrected immediately. */
    double velocity; /* Correction of the velocity per position error of a frame [1/s]. */
    double accelerometer; /* Correction of the accelerometer bias per position error of a frame [1/s²]. */
    double attitude; /* Share of a frame's attitude error that is corrected immediately. */
    double gyro; /* Correction of the gyroscope bias per attitude error of a frame [1/s]. */
    double joint_bandwidth; /* Bandwidth of the joint velocity filter [rad/s]; one encoder count per reading is 0.08 rad/s. A lower bandwidth reduces noise, but its lag appears as motion of the CoG: at 15 rad/s the error at 1 rad/s joint speed doubles. */
    double vectoring_bandwidth; /* Bandwidth of the vectoring velocity filter [rad/s]. */
} sp_estimator_config;

/* Heights, speeds and thresholds of a grasp. */
typedef struct {
    double above; /* Height over the place of the grip at which the robot comes over an object, and to which it leaves [m]. */
    double reach_speed; /* Largest speed of the torso to and over an object [m/s]. */
    double near_speed; /* Largest speed of the torso while its feet surround an object that stands [m/s]. */
    double turn_speed; /* Largest rate of the heading [rad/s]. */
    double first_grip; /* Force of each foot with which the test lift begins [N], or the most that the object bears. */
    double more_grip; /* Increase of that force after a test in which the feet slipped [N]. */
    double reserve; /* Force of the grip after the test over the least that holds the object with `friction`. */
    double friction; /* Friction that is assumed then, if the order has none. */
    double unequal; /* Force that is added where the friction is known [N]: the feet do not press equally. */
    double close_time; /* Time in which the feet come to the object at least [s]: faster ones knock it. */
    double grip_time; /* Time in which the grip grows or ends [s]. */
    double load_time; /* Time in which the payload grows or ends [s]. */
    double test_height; /* Height of the test lift [m]. */
    double test_time; /* Time of the test in the air, of whose second half the mean is taken [s]. */
    double slip; /* The feet slip if the object stays this far behind in the test [m]. */
    int32_t most_tests; /* Number of tests after which the object is left. */
    double feel_speed; /* Speed of the descent near the expected floor [m/s]. */
    double feel_height; /* Height over the expected floor from which that speed is used [m]. */
    double search; /* A descent that finds no floor ends this far below the expected one [m]. */
    double touch_error; /* The floor is found when the torso is this far above its reference [m], beyond its error before. */
    double touch_time; /* Time for which it must be [s]. */
    double slack; /* Height by which the torso rises while it lets go [m]: feet that are pressed down on an object knock it. */
    double bent; /* The object is lost if a joint is this far from its angle at the contact [rad]. */
    double away; /* The object is lost if it is this far from its place below the torso [m]. */
    double squeeze; /* Depth by which joint setpoints lead the feet into the object in place of a grip by the allocation [m]. */
    int32_t avoids; /* Whether the jets avoid the object as they avoid rotors and torso. */
} sp_grasp_config;

/* An object as motion capture sees it. */
typedef struct {
    double position_w[3]; /* Its origin, in its middle, world [m]. */
    double quat_wo[4]; /* Its attitude. */
} sp_seen;

/* What a phase ends with, and the next begins with. */
typedef struct {
    double pose_w[4]; /* Torso's origin and heading (4,) [m], [rad]. */
    double form[16]; /* Joint angles [rad]. */
    double force; /* Force of each foot [N]. */
    double payload; /* Mass that is carried [kg]. */
} sp_setting;

/* State of a grasp between ticks. */
typedef struct {
    int32_t phase; /* One of `GRASP_PHASES`. */
    double time; /* Time in the phase [s]. */
    double seconds; /* Duration of the phase [s]. */
    sp_setting begin; /* Setting at the begin of the phase. */
    sp_setting end; /* Setting at its end. */
    double place_b[3]; /* Object's origin from the torso's at the last grip, torso axes but level [m]. */
    double turn; /* Heading of the object beyond that of the torso at the last grip [rad]. */
    double force; /* Force of each foot while it holds [N]. */
    double mass; /* Mass of the object as far as it is known [kg]. */
    double hover; /* Mean lift without the object [N]. */
    double height; /* Height of the object over the torso before the test [m]; in `hold` the torso's error of height [m]. */
    double stood; /* Height of the object's origin before the test [m]. */
    int32_t tests; /* Number of tests. */
    double total; /* Sum of a quantity over the ticks of the phase. */
    int32_t count; /* Number of its summands. */
    double found; /* Time for which the signs of a floor have held [s]. */
    int32_t held; /* Whether the test lift has succeeded and the object is held. */
    int32_t placed; /* Whether the held object stands. */
    int32_t lost; /* Whether the object was lost. */
    int32_t refused; /* Whether the test lift found the object too heavy or too slippery for the forces that it bears. */
} sp_grasp_memory;

/* Where and in which forms an object is held. */
typedef struct {
    double open[16]; /* Form around the object [rad]. */
    double closed[16]; /* Form in which the feet touch it [rad]. */
    double pressed[16]; /* Form in which the feet press a little [rad]. */
    double height; /* Height of the torso's origin over the object's [m]. */
    double yaw; /* Heading of the torso [rad]. */
} sp_contact;

/* An object, its stand, and its goal. */
typedef struct {
    int32_t shape; /* `box`, `cylinder` or `ball`. */
    double half_size[3]; /* Half of length, width, height; of cylinder and ball the first is the radius, of a cylinder the last one half the height [m]. */
    double mass; /* Mass [kg], hidden. */
    double com[3]; /* Its centre of mass from its middle [m], hidden. */
    double friction; /* Sliding friction of its surface, hidden. */
    double most_force; /* Largest force that a foot may press it with [N], known. */
    sp_pose2 start; /* Where it stands: its middle, and its heading. */
    double stand; /* Height of the stand below it there [m]; 0 is the floor. */
    sp_pose2 goal; /* Where it is to stand. */
    double floor; /* Height of the stand there [m]; 0 is the floor. */
    double bias[3]; /* Error of the object's position as motion capture sees it [m], hidden. */
} sp_grasp_scene;

/* State of the rule between decisions. */
typedef struct {
    int32_t tries; /* Number of times that it has ordered a grasp. */
    double mass; /* Mass that the last test lift measured, or that is assumed [kg]. */
} sp_rule_memory;

/* Configuration of the manager: controllers of both gaits, take-off and landing, grasps. */
typedef struct {
    sp_controller_config flight; /* Configuration of the flight controller. */
    sp_crawler_config crawl; /* Configuration of the crawler. */
    sp_grasp_config grasp; /* Heights, speeds and thresholds of a grasp. */
    double spool_time; /* Time in which the load shifts from the floor to the rotors [s]. */
    double climb_speed; /* Largest speed of the climb after take-off [m/s]. */
    double descent_speed; /* Speed of the descent [m/s]. */
    double descent_ease; /* Acceleration at the beginning of the descent [m/s²]. */
    double unload_time; /* Time in which the load shifts from the rotors to the floor [s]. */
    double touch_error; /* The floor is detected when the robot is this far above its reference in the descent [m], or by `touch_force`. */
    double touch_force; /* The floor is detected when the observed upward force exceeds this share of the weight, or by `touch_error`. */
    double touch_speed; /* The floor is detected only while the robot falls slower than this share of `descent_speed`. */
    double touch_time; /* The conditions of a detected floor must hold for this time [s]. */
    double lost_fall; /* The descent resumes if the robot falls faster than this while the rotors fade [m/s]. */
    double most_slew; /* Largest change of Σλ per tick near the floor [N]. */
    double most_tilt; /* A landing with a larger tilt is aborted and repeated from above [rad]. */
    double search; /* A descent that finds no floor is aborted this far below the expected height [m]. */
    double again; /* Height of the climb after an aborted landing [m]; after the second one the robot stays in the air. */
    double cut_tilt; /* The rotors are cut at a larger tilt [rad]. */
    double clearance; /* Smallest distance of a form from the take-off floor and from the sides of a passage [m]. */
} sp_manager_config;

/* A body of the kinematic tree, and the joint that carries it. */
typedef struct {
    int32_t parent, joint; /* index of the parent, less than its own; 0 … 15 for joints, then vectoring angles */
    double rotation[9]; /* attitude of the joint in the parent */
    double position[3]; /* of the joint in the parent [m] */
    double axis[3]; /* of the joint in the body's axes */
    double mass; /* [kg] */
    double com[3]; /* CoG in the body's axes [m] */
    double inertia[9]; /* about its CoG, in the body's axes [kg m²] */
} sp_body;

/* The robot's numbers. */
typedef struct {
    sp_body tree[33]; /* the torso first, every other body after its parent */
    int32_t joint_body[16]; /* bodies behind the joints */
    int32_t link_body[8], rotor_body[8]; /* bodies of the links; of the modules with their rotors */
    double gravity; /* [m/s²] */
    double weight, hover_thrust, max_thrust; /* of the robot; of a module in a hover, and at most [N] */
    double max_joint_torque; /* [Nm] */
    double joint_limit; /* [rad] */
    double joint_kp; /* [Nm/rad] */
    double max_vectoring_speed; /* [rad/s] */
    double yaw_axis_xy, yaw_axis_radius, yaw_axis_z, yaw_to_pitch, pitch_to_yaw, pitch_to_foot; /* of a leg [m] */
    double foot_radius, peg_depth; /* [m] */
    double duct_reach; /* distance of the ducts' outer edge from the rotor centre [m] */
    double flight_controller[3]; /* position of the inertial unit, which motion capture tracks [m] */
} sp_robot;

/* Model quantities at one configuration, torso axes. */
typedef struct {
    double mass; /* [kg] */
    double com_b[3]; /* CoG from the torso's origin [m] */
    double inertia_c[9]; /* centroidal inertia [kg m²] */
    double R_bl[8][9]; /* attitude of each rotor's link */
    double rotor_c[8][3]; /* rotor centres from the CoG [m] */
    double J_rotor[8][48]; /* ∂(rotor centre)/∂q, torso held fixed */
    double joint_axes[48]; /* direction of each joint's axis, (3, 16) */
    double gravity_torque[16]; /* joint torque that holds the links without thrust [Nm] */
    double momentum_map[96]; /* momentum about the CoG per joint velocity, (6, 16) */
    double feet_b[4][3]; /* centres of the foot spheres from the torso's origin [m] */
    double J_foot[4][48]; /* ∂(centre of the sphere)/∂q */
} sp_snapshot;

/* A block of cost. */
typedef struct {
    sp_cost_kind kind; /* which block */
    double weight; /* its weight */
} sp_cost;

/* A block of rows. */
typedef struct {
    sp_rows_kind kind; /* which block */
    double a, b; /* limit, or friction and least normal force */
} sp_rows;

/* An allocation mode: its blocks, and its unknowns and rows. */
typedef struct {
    sp_program_kind kind; /* its pattern, which selects the solver's workspace */
    int32_t feet_carry, n, m; /* whether foot forces are unknowns; unknowns; rows */
    sp_cost costs[4];
    sp_rows rows[6];
} sp_mode;

/* min ½ xᵀ P x + qᵀ x subject to l ≤ A x ≤ u; P (n, n) and A (m, n) row-major with stride n. */
typedef struct {
    int32_t n, m; /* unknowns and rows */
    double P[6400];
    double q[80];
    double A[6400];
    double l[80], u[80];
    double radius; /* of the thrust spheres ‖f_i‖ ≤ r, in units of λ̄ */
} sp_program;

/* The allocation of one tick. */
typedef struct {
    double forces_l[24]; /* rotor forces, link axes [N] */
    double foot_forces_f[12]; /* forces of the floor on the feet, floor axes [N] */
    double thrust[8]; /* λ [N] */
    double joint_torques[16]; /* quasi-static joint torque [Nm] */
    double wrench[6], unallocated_wrench[6]; /* produced; desired − produced, {CoG} [N, Nm] */
    int32_t status; /* sp_status */
    int32_t iterations; /* of the solvers, summed over all attempts */
    double slack; /* largest violation of a softened row, in scaled units */
    int32_t rows; /* number of valid entries of `active` */
    int32_t active[80]; /* +1 where a row is at its upper bound, −1 at its lower */
} sp_allocation;

/* Variables of the interior-point method: equalities, then sides of rows and spheres. */
typedef struct {
    int32_t equal, sides; /* numbers of equalities and of sides */
    double largest; /* bound */
    double x[36];
    int32_t row[80]; /* of an equality */
    int32_t side_row[160]; /* of a side */
    double b[80], yield[80], y[80], off[80];
    double sign[160], h[160];
    double give[168], s[168], z[168], ds[168], dz[168];
    double miss[168], D[168], product[168];
} sp_cone;

/* Scratch memory for the linear algebra of a tick. */
typedef struct {
    sp_program program, soft;
    double K[25600];
    double right[160];
    double r[80];
    int32_t rows[160];
    double target[160], signs[160];
    double Px[6400];
    double Ax[6400];
    sp_cone cone;
} sp_workspace;

/* State of the compensations between ticks. */
typedef struct {
    double servo_position[16], servo_velocity[16]; /* of the servo model [rad], [rad/s] */
    int32_t has_momentum, has_observed, has_slow; /* whether a previous tick exists */
    double momentum[3], torque[3]; /* of the legs [Nms]; feed-forward [Nm] */
    double observed_momentum[6]; /* of the robot, world axes */
    double delivered_w[6], external_w[6], residual_w[6], fed_w[6], slow_w[6]; /* wrenches, world axes */
} sp_compensation_memory;

/* State of the observer of the whole robot's motion between ticks. */
typedef struct {
    int32_t has_sag; /* whether a previous tick exists */
    double sag[16], plan[16]; /* slow part of the joints' deviation from their plan; that plan [rad] */
    double thrust[8]; /* according to the model of the rotors [N] */
    double commands[4][14]; /* thrusts [N], wrench less the weight, world axes, latest first */
    double momentum_w[6]; /* linear and angular momentum of the robot, world axes [Ns, Nms] */
    double external_w[6]; /* wrench, world axes */
    double legs[3]; /* angular momentum of the planned joint motion, torso axes [Nms] */
    double ringing; /* largest rate at which a joint bent, fading [rad/s] */
} sp_motion_memory;

/* State of the flight controller between ticks. */
typedef struct {
    double position_integral_w[3], attitude_integral[3]; /* [m s], [rad s] */
    sp_lock lock;
    sp_interference interference;
    double vectoring[16]; /* (φ, θ) last commanded [rad] */
    double forces_l[24]; /* last allocated [N] */
    double joint_position[16]; /* q^d last commanded [rad] */
    double unallocated_w[3], unallocated_torque[3]; /* of the last tick, world [N]; torso axes [Nm] */
    double joint_velocity[16]; /* rate of q^d [rad/s] */
    sp_compensation_memory compensation;
    sp_motion_memory motion;
    double joint_lead[16]; /* of the last setpoints before q^d, for servos that press [rad] */
} sp_flight_memory;

/* Quantities that the controller computes from a state. */
typedef struct {
    double R_wb[9]; /* attitude of the torso */
    sp_snapshot snapshot;
    sp_motion_error error;
} sp_control_state;

/* The flight controller. */
typedef struct {
    sp_controller_config config;
    sp_flight_memory memory;
    sp_mode mode;
    double dt; /* length of a tick [s] */
    double thrust_limit; /* input: λ̄ at the present voltage where it is below the robot's [N] */
    int32_t ticked; /* whether a previous tick exists */
    sp_control_state control;
    sp_demand demand;
    double wrench_desired[6]; /* residual included, {CoG} [N, Nm] */
    double joint_velocity[16]; /* commanded [rad/s] */
    sp_allocation allocation;
} sp_flight;

/* A knot of a path of CoG and heading. */
typedef struct {
    double time; /* [s] */
    double pose_w[4], rate_w[4], acceleration_w[4]; /* x, y, z and heading; their first and second derivatives */
} sp_knot;

/* A path of straight legs under construction. */
typedef struct {
    double point[3]; /* its end so far [m] */
    double speed, heading, seconds; /* [m/s]; heading [rad] and duration [s] so far */
    int32_t along, count; /* whether the heading follows the path; number of knots */
} sp_legs;

/* A step of the gait: a sequence of phases. */
typedef struct {
    int32_t phases; /* sp_phases */
    int32_t has_target;
    sp_pose2 target; /* pose of the lying torso at its end, world */
    int32_t legs[4]; /* 1 for a leg that is lifted */
    int32_t has_angle, has_height; /* whether angle and height are given; else the configuration's apply */
    double angle, height, seconds; /* of the raise [rad], of the lift [m], of the hold [s] */
} sp_step;

/* State of the gait between ticks. */
typedef struct {
    sp_step steps[256];
    int32_t first, count; /* ring: present step, number of steps */
    double plan[16]; /* planned joint setpoints [rad] */
    double position_w[3], slow_w[3]; /* filtered positions of the torso [m] */
    double R_wb[9]; /* attitude of the torso */
    double joints[16]; /* filtered joint angles [rad] */
    int32_t phase, index; /* sp_phase; its index in the step */
    double time, still; /* time in the phase; time without motion [s] */
    double target[16], landing[16], highest[16], start[16]; /* joint angles of the legs' motion [rad] */
    double floor_R[9]; /* axes of the floor, world */
    double floor_w[3]; /* position at which the torso lay [m] */
    double feet_f[12]; /* positions of the standing feet, floor axes [m] */
    sp_pose2 way; /* displacement of the torso, floor axes */
    double share, height, lift; /* covered share of `way`; planned and largest height [m] */
    double expected[3]; /* filtered pose according to the plan */
    double yaw; /* filtered yaw of the torso [rad] */
    double trim[3]; /* offset of the torso that the legs add to its plan */
    int32_t rested, timeouts, corrected; /* whether it starts from rest; phases ended by time-out; cycles added */
    sp_pose2 planned; /* pose at the end of all commands, world */
} sp_gait_memory;

/* State of the allocation on the ground between ticks. */
typedef struct {
    sp_lock lock;
    double vectoring[16]; /* (φ, θ) last commanded [rad] */
    double forces_l[24]; /* last commanded [N] */
    double joint_torque[16], joint_position[16]; /* last commanded [Nm], [rad] */
    int32_t mode; /* sp_program_kind */
    double force_gap[24]; /* forces of the last mode minus those of the present one [N] */
    double torque_gap[16]; /* likewise for the joint torques [Nm] */
    double gap; /* remaining share of both gaps, 1 … 0 */
    double effort[8]; /* weights of the power cost */
    int32_t rows; /* number of valid entries of `active` */
    int32_t active[80]; /* rows of the last tick that were active */
} sp_crawl_memory;

/* The crawl's controller. */
typedef struct {
    sp_crawler_config config;
    sp_gait_memory gait;
    sp_crawl_memory memory;
    sp_mode modes[7]; /* by sp_program_kind */
    double dt; /* length of a tick [s] */
    double thrust_limit; /* input: λ̄ at the present voltage where it is below the robot's [N] */
    double home_b[12]; /* positions of the feet at rest [m] */
    int32_t ticked; /* whether a previous tick exists */
    double R_wb[9]; /* attitude of the torso */
    sp_snapshot snapshot;
    sp_demand demand;
    sp_allocation allocation;
} sp_crawl;

/* A command to the manager of both gaits. */
typedef struct {
    int32_t kind; /* sp_locomotion_kind, which selects the members that are read */
    sp_pose2 pose; /* goal of a crawl, world */
    double position_w[3]; /* of the CoG, goal of a flight [m] */
    int32_t has_form, along; /* whether `form` is valid; whether to turn towards the goal first */
    int32_t at_once; /* whether to turn during the present motion and to change the form in flight */
    double form[16]; /* joint angles during the flight [rad] */
    double speed, height, floor; /* of the flight [m/s]; of take-off or lift [m]; of the expected floor [m] */
    int32_t shape, has_yaw; /* of the object, as in `OBJECTS`; whether `yaw` is valid */
    double yaw; /* heading of the object at the goal [rad] */
    double half_size[3]; /* of the object [m] */
    double most_force, mass, force; /* of a foot at most [N]; until it is measured [kg]; of a foot or 0 [N] */
    double friction; /* of feet on the object; 0 where it is not known */
} sp_waypoint;

/* The phases of a grasp. */
typedef struct {
    sp_grasp_config config;
    sp_grasp_memory memory;
    sp_contact plan;
    sp_waypoint target; /* order to grasp */
    double joint_speed; /* largest speed of the joints [rad/s] */
    sp_grip grip; /* of the last tick */
} sp_grasper;

/* State of the manager of both gaits between ticks. */
typedef struct {
    int32_t phase; /* sp_manager_phase */
    double time; /* since its start [s] */
    double begin_w[3]; /* CoG at its start, or commanded CoG [m] */
    double quat_wb[4]; /* commanded attitude at its start */
    double yaw; /* heading in flight [rad] */
    double form[16]; /* commanded joint angles [rad] */
    double floor, velocity; /* height of the CoG of the lying robot [m]; rate of the descent [m/s] */
    double believed, thrust; /* time since floor detection or form command [s]; Σλ of the last tick [N] */
    int32_t failures, rises; /* failed landings in a row; whether it takes off at the next tick */
    int32_t begun, ends; /* whether a command of a grasp has begun; whether the mission was ended */
} sp_manager_memory;

/* The manager of both gaits. */
typedef struct {
    sp_manager_config config;
    sp_manager_memory memory;
    sp_flight flight;
    sp_crawl crawl;
    sp_grasper grasper;
    sp_reference reference; /* of the last tick in flight */
    sp_waypoint commands[64]; /* the present one first */
    int32_t count, knot_count; /* numbers of commands and of knots */
    sp_knot knots[8]; /* of the present flight; their time counts from the start of the phase */
    double lying[16]; /* joint angles on the floor [rad] */
    double lying_height; /* height of the CoG over the floor when the robot lies [m] */
    sp_snapshot snapshot;
} sp_manager;

/* A part of a course, which spans the width of the field. */
typedef struct {
    int32_t kind; /* sp_gate_kind */
    double begin, end; /* along the course [m] */
    double size, middle; /* height, clearance, width [m] or angle [rad]; middle of a slot, left positive [m] */
} sp_gate;

/* The map of a course. */
typedef struct {
    int32_t count, dares; /* number of gates and floors; whether gates may be smaller than the robot */
    sp_gate gates[8]; /* in the order in which they are passed */
    sp_pose2 goal; /* goal of the lying torso, world */
    double tiles[28]; /* heights of the tiles, row by row from right to left [m] */
} sp_course;

/* Goal of the next motion, and gait and form for it. */
typedef struct {
    int32_t flies; /* whether to fly; else to crawl, after a landing if necessary */
    double x, y, z, yaw; /* of the CoG in flight or the torso on the floor, world [m]; heading there [rad] */
    double speed, narrow, sweep; /* of the flight [m/s]; form 1 to 3, 0 … 1; of the legs' first joints [rad] */
} sp_target;

/* The target that is followed. */
typedef struct {
    int32_t has_target; /* whether there is one */
    sp_target last;
} sp_pilot;

/* The state estimator. */
typedef struct {
    sp_estimator_config config;
    double time; /* of the estimate [s] */
    double R_wb[9]; /* attitude of the torso */
    double position_w[3], velocity_w[3], omega_b[3], gyro_bias[3], accelerometer_bias[3]; /* of the inertial unit */
    double past_time[32]; /* oldest first [s] */
    double past_position_w[32][3]; /* [m] */
    double past_R_wb[32][9];
    double encoder_time; /* of the latest reading [s] */
    double angles[32], rates[32]; /* joints, then (φ, θ) [rad], [rad/s] */
} sp_estimator;

/* The plan ahead as policies in flight observe it. */
typedef struct {
    double joint_target[16], next_form[16]; /* present and next form (equal if none follows) [rad] */
    double time_to_next; /* until the next form; SP_NO_NEXT_FORM if none follows [s] */
    double ahead_w[12]; /* points of the path ahead relative to its present point, world axes [m] */
    double turn[4]; /* turn of the path's heading until these points [rad] */
    double velocity_w[3], acceleration_w[3]; /* of the path's present point [m/s], [m/s²] */
} sp_preview;

/* State of a learned policy between ticks. */
typedef struct {
    int32_t has_momentum, has_joints; /* whether a previous tick exists */
    int32_t ticks; /* since the first, modulo decisions times periods of the clock */
    double action[40]; /* last applied action, in [−1, 1] */
    double leg_momentum[3]; /* [Nms] */
    double slow[40]; /* low-passed outputs, which the washout subtracts */
    double traces[128]; /* low-passed observations */
    double joints[16]; /* commanded joint angles [rad] */
    int32_t has_velocity, has_first; /* whether velocity and force are stored; whether the first integral is */
    double velocity[3], force[3]; /* at the last tick; of the rotor model; torso axes [m/s], [N] */
    double external[9]; /* external force; its absolute values; absolute first position integral */
    float observation[512]; /* last observation */
} sp_policy;

#endif
