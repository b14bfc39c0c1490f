/* Generated: what crosses the border, configurations, and what the core remembers. */
#ifndef SPIDAR_STRUCTS_H
#define SPIDAR_STRUCTS_H

#include <stdint.h>
#include "spidar_constants.h"

/* What is known of the robot at one instant. */
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
    double thrust[8]; /* λ [N]: what the modules deliver in the simulator, what they were last told on the robot. */
    double joint_torque[16]; /* Torque of the joint servos [Nm]. */
} sp_robot_state;

/* What the sensors of the real robot have said since the last control tick; counts say how much of it is new. */
typedef struct {
    double time; /* Time of the control tick [s]. */
    int32_t pose_count; /* Frames of the motion capture that have arrived: the first rows of the three arrays below. */
    double pose_time[4]; /* When each frame was taken, shape (4,) [s]. */
    double pose_position_w[12]; /* (4, 3) Origin of the flight controller in the world, shape (4, 3) [m]. */
    double pose_quat_wb[16]; /* (4, 4) Attitude of the torso (w, x, y, z), shape (4, 4). */
    int32_t imu_count; /* Samples of the flight controller's inertial unit, oldest first. */
    double imu_time[8]; /* Shape (8,) [s]. */
    double gyro_b[24]; /* (8, 3) Angular velocity, torso axes, shape (8, 3) [rad/s]. */
    double specific_force_b[24]; /* (8, 3) Acceleration minus gravity at the flight controller, torso axes, shape (8, 3) [m/s²]. */
    double encoder_time; /* When the servos were read last [s]. */
    double joint_position[16]; /* Indicated q [rad]. */
    double joint_torque[16]; /* Torque that the joint servos report [Nm]. */
    double vectoring[16]; /* (8, 2) Indicated (φ, θ) [rad]. */
} sp_measurement;

/* What the robot should do at one instant. */
typedef struct {
    double position_w[3]; /* Desired position of the CoG in the world, r^d [m]. */
    double quat_wb[4]; /* Desired attitude of the torso, R^d (w, x, y, z). */
    double velocity_w[3]; /* Desired velocity of the CoG in the world [m/s]. */
    double omega_b[3]; /* Desired angular velocity, in the desired torso axes [rad/s]. */
    double joint_target[16]; /* Form to move to [rad]; the controller moves the commanded joints there at the joint speed. */
    int32_t mode; /* Name of the allocation mode, see `spidar_gym.control.allocation.modes`. */
    int32_t lost_thrust[8]; /* Modules declared lost, whose thrust is gone: the allocation does without them. */
    int32_t lost_vectoring[8]; /* Modules whose φ and θ no longer move: the allocation uses their thrust where it points. */
    double acceleration_w[3]; /* Desired acceleration of the CoG in the world [m/s²]. */
    double alpha_b[3]; /* Desired angular acceleration, in the desired torso axes [rad/s²]. */
    double support; /* Share of the robot that the floor carries, 0 … 1: the rotors give as much less, and neither integrals nor the observer learn from what happens. */
} sp_reference;

/* What a learned policy adds to the controller: the only door it gets. All zero changes nothing, bit for bit. */
typedef struct {
    double wrench[6]; /* Added to the desired wrench before the allocation, force [N] and torque [Nm], shape (6,). */
    double joint_offset[16]; /* Added to the joint targets [rad], shape (16,). */
    double joint_speed_scale; /* Factor on the planned joint speed, on the ground the rate of the phases; the servo's own limit stays. */
    int32_t has_forces_l; /* Whether the next field counts. */
    double forces_l[24]; /* (8, 3) Added to the allocated rotor forces, link axes [N], shape (8, 3); the sum is moved to the nearest valid point. */
    int32_t has_leg_forces_b; /* Whether the next field counts. */
    double leg_forces_b[12]; /* (4, 3) On the ground the same by leg, torso axes [N], shape (4, 3); the two rotors of a leg share it. */
    double raise_scale; /* On the ground: factor on how far the next step raises the legs. */
    double stride_scale; /* On the ground: factor on the next stride, within the reach. */
    double lift_scale; /* On the ground: factor on how high the next torso motion lifts it. */
} sp_residual;

/* What the actuators are told for one control period. */
typedef struct {
    double thrust[8]; /* λ^d [N]. */
    double vectoring[16]; /* (8, 2) (φ^d, θ^d), unwrapped [rad]. */
    double joint_position[16]; /* q^d [rad]. */
    double joint_torque_limit[16]; /* Largest torque each joint servo may use [Nm]. */
} sp_command;

/* A pose in the plane, or a motion from one to another along an arc. */
typedef struct {
    double x; /* Forward [m]. */
    double y; /* To the left [m]. */
    double yaw; /* Counter-clockwise [rad]. */
} sp_pose2;

/* Which rotors have their φ held, and where. */
typedef struct {
    int32_t vertical[8]; /* The link is near vertical (with hysteresis). */
    int32_t active[8]; /* φ is held: near a vertical link, restricted by interference, or on its way back from either. */
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

/* What one tick asks of the allocation: everything that the blocks may read. */
typedef struct {
    double wrench[6]; /* Desired wrench w^d in {CoG} [N, Nm]; on the ground what holds the weight. */
    double thrust_map[216]; /* (6, 36) Q: forces → wrench in {CoG}; 24 columns for the rotors in link axes, and 12 for the feet where they carry. */
    double torque_map[576]; /* (16, 36) T: forces → joint torque that they take off the servos; τ_q = g − T f. */
    double gravity_torque[16]; /* g: joint torque that holds the links without thrust [Nm]. */
    int32_t locked[8]; /* Rotors whose φ is held. */
    double phi[8]; /* Where it is held [rad]. */
    int32_t restricted[8]; /* Rotors restricted by interference, 𝓘. */
    double lower[8]; /* Lower bounds of θ [rad], read where restricted. */
    double upper[8]; /* Upper bounds of θ [rad], read where restricted. */
    int32_t lost[8]; /* Rotors that give no force. */
    int32_t lifted[4]; /* Legs whose joint torque counts; what a leg on the ground feels is between it and the floor. */
    double com_b[3]; /* CoG seen from the torso's origin [m]: takes a wrench from {CoG} to {B}. */
    double R_bf[9]; /* (3, 3) Axes of the floor, seen from the torso. */
    double effort[8]; /* Weight of each rotor's ‖f‖² where power is to be saved. */
} sp_demand;

/* Gains as flown [JSK]; every gain gives an acceleration, so none depends on mass or form. */
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

/* Which of them act, and how strongly; all zero is the paper's controller, bit for bit. */
typedef struct {
    double momentum_gain; /* Share of the legs' angular momentum rate that the torque feeds forward; 0 is off [Orin2013]. */
    double momentum_filter; /* Time constant of its first-order filter [s]. */
    double servo_bandwidth; /* Natural frequency of the model of the joint servos that drives it [rad/s]. */
    double vectoring_lead; /* The force is pointed where its link will be this much later [s]; 0 is off. */
    double observer_gain; /* Share of the observed external wrench that is cancelled; 0 is off [DeLuca2006] [Zhao2020]. */
    double observer_time; /* Time constant of the observer [s]. */
    int32_t observer_beyond; /* Whether it looks at the error's momentum and at what is asked beyond what is fed forward: so no belief about the rotors can take the legs' own torque, or a path's, for a disturbance. */
    int32_t observer_order; /* Order of its low-pass: 1, or 2 for two alike in series, which passes less noise and answers later. */
    double observer_lag; /* Time constant of the model of the rotors that the observer believes in [s]. */
    double torque_observer_gain; /* Share of the observed torque that is cancelled; 0: as of the force. */
    double torque_observer_time; /* Time constant of the observer of the torque [s]; 0: as of the force. */
    double torque_observer_lag; /* That of the rotors, as it believes in them [s]; 0: as of the force. */
    double lead_gain; /* ρ: what the feedback asks for passes 1 + ρ (1 − 1/(1 + T s)), which gives back phase; 0 is off [Franklin2019]. */
    double lead_time; /* T of it [s]. */
    double joint_ramp; /* Time in which the commanded joints reach their speed [s]: a limit of the acceleration; 0 is off. */
    double reference_gain; /* Share of the reference's acceleration that is asked for before there is an error; 0 is off [Lee2010]. */
} sp_compensation_config;

/* Settings of the solver. */
typedef struct {
    int32_t max_iter; /* Iteration cap: 2,000 in simulation, 300 on the robot's computer. */
    double tolerance; /* Absolute tolerance of the solver, in scaled units. */
    double check_tolerance; /* Largest violation of a row that our own check lets pass, in scaled units (1.6 mN of lift, 0.07 mNm of torque). */
    double price; /* Price of a violated row in the softened program, in scaled units. */
} sp_allocator_config;

/* Thresholds of the interference test; the values that the lab flew [JSK]. */
typedef struct {
    double alpha; /* α̲: a pair inclined by more than this along φ does not interfere [rad] [Zhao2025, Eq. 22]. */
    double horizon; /* A target seen farther than this from straight below is not met by a hovering rotor [rad]. */
    double rotor_radius; /* Radius of a rotor and of its jet: duct inner radius 0.075 m times 1.2 [m]. */
    double torso_radius; /* Radius of the torso disc [m]. */
    double width; /* A subset of the range narrower than this is not used [rad]. */
    double theta; /* θ̲: a rotor is restricted when a bound comes nearer than this to the vertical [rad] [Zhao2025, Eq. 33]. */
    double hysteresis; /* A restricted rotor is released only when its bound is farther than θ̲ plus this [rad]. */
    double tie; /* Two subsets whose distances from the vertical differ by less than this tie: the previous side is kept [rad]. */
} sp_interference_config;

/* When and how φ is held. */
typedef struct {
    double enter; /* φ is locked when the link comes within this angle of the vertical [rad] [JSK]. */
    double leave; /* φ is released when the link is farther than this from the vertical [rad]. */
    double slew; /* A held φ moves by at most this much a tick [rad] [JSK]. */
    double release; /* A φ that is led back is released when φ̂ is this close: what the servo turns in one tick [rad]. */
    double least; /* Least turn of a φ locked near a vertical link away from φ̂, towards the tangential plane [rad]. */
    double most; /* Largest turn of a φ locked near a vertical link away from φ̂ [rad]. */
} sp_lock_config;

/* Everything that can be chosen about the controller. */
typedef struct {
    int32_t allocation; /* Name of the allocation's blocks, see `spidar_gym.control.allocation.modes.ALLOCATIONS`. */
    double joint_speed; /* Speed of the planned joint motion [rad/s]; the servos are told the same limit. */
    double joint_torque_limit; /* Torque that each joint servo may use [Nm]. */
    double rate_hz; /* Control rate [Hz]. */
    sp_centroidal_config centroidal; /* Gains. */
    sp_compensation_config compensation; /* What goes beyond the paper's quasi-static control. */
    sp_allocator_config allocator; /* Solver settings. */
    sp_interference_config interference; /* Interference thresholds. */
    sp_lock_config lock; /* φ lock. */
} sp_controller_config;

/* What the gait is made of. */
typedef struct {
    double inner; /* Start pose, inner pitch: the feet's home is where this pose has them, on the floor [rad]. */
    double outer; /* Start pose, outer pitch [rad]. */
    int32_t stride; /* Where feet go: one of `STRIDES`. */
    double max_distance; /* Longest way of a cycle [m]; the reach may allow less. */
    double max_turn; /* Largest turn of a cycle [rad]. */
    double raise_angle; /* The inner pitch rises this far above the higher of start and end of the step [rad] [JSK]. */
    double lift_height; /* The torso moves at this height above where it lay [m] [Zhao2025, Sec. Crawling Motion]. */
    double press; /* Feet and torso are sent this far below the floor, so that they arrive [m]. */
    double swing_at; /* The swing begins at this share of the raise. */
    double lower_at; /* Legs are lowered when yaw and outer pitch are this close to their targets [rad]. */
    double forward_at; /* The torso moves on at this share of its lift. */
    double down_at; /* The torso goes down at this share of its way. */
    double start_time; /* Time in which thrust takes over from rest before anything moves [s]. */
    double spool_time; /* Time in which thrust takes over from the mode before it, before anything moves [s]. */
    double settle_time; /* Time in which thrust fades after the torso has come down [s]; 0 goes on to the next cycle without a rest. */
    double leg_touch_time; /* Feet have touched down when the inner pitches are near their targets and still for so long [s]. */
    double torso_touch_time; /* The torso has touched down when it is near its height and still for so long [s]. */
    double arrival; /* The torso is down its way when it is this close, filtered [m]; it waits for its trim until then. */
    double stall_time; /* A phase whose plan is at its end goes on where the legs have come to rest for so long, short of it [s]. */
    double trim_gain; /* Integral gain from the torso's error to where the legs push it [1/s]; 0 is off. */
    double trim_limit; /* Largest trim [m]. */
    int32_t rolling; /* Whether the kinematics know that the feet are balls, which roll as their legs turn. */
    double timeout; /* A phase that has not ended by then ends [s]. */
} sp_gait_config;

/* Everything that can be chosen about the crawl. */
typedef struct {
    sp_gait_config gait; /* Footsteps and phases. */
    double joint_speed; /* Speed of the planned joint motion [rad/s]; the servos are told the same limit. */
    double rate_hz; /* Control rate [Hz]. */
    double torque_limit; /* τ̄_q of the allocation: what it leaves below the servo's limit moves the legs [Nm]. */
    double joint_torque_limit; /* Torque that each joint servo may use [Nm]. */
    double torque_weight; /* w₂ of [Zhao2025, Eq. 9] [1/(Nm)²]. */
    int32_t power; /* Minimise Σ λ^1.5, electrical power, instead of the paper's Σ ‖f‖². */
    double foot_friction; /* Planned friction of the feet. */
    double peg_friction; /* Planned friction of the pegs. */
    double min_normal; /* Least normal force of all pegs together [N]. */
    double blend_time; /* Time in which the forces of one mode give way to those of the next [s]. */
    double feed_forward; /* Share of the allocated joint torque that shifts the servos' setpoints, τ_q / k_{j,p}. */
    double setpoint_filter; /* Time constant of a filter on the servos' setpoints, which takes jolts out of starts and stops [s]; 0 is off. */
    double leg_stiffness; /* Thrust answers a lifted leg's error with this much joint torque [Nm/rad]: the paper's future work; 0 is off. */
    double leg_damping; /* Thrust answers the rate of that error with this much joint torque [Nm s/rad]. */
    sp_allocator_config allocator; /* Solver settings. */
    sp_lock_config lock; /* φ lock near vertical links. */
} sp_crawler_config;

/* Gains of the corrections. */
typedef struct {
    double position; /* Share of a frame's position error that is corrected at once. */
    double velocity; /* Velocity per position error of a frame [1/s]. */
    double accelerometer; /* Accelerometer bias per position error of a frame [1/s²]. */
    double attitude; /* Share of a frame's attitude error that is corrected at once. */
    double gyro; /* Gyroscope bias per attitude error of a frame [1/s]. */
    double joint_bandwidth; /* Bandwidth of the joint velocity [rad/s]; one encoder count a reading is 0.08 rad/s. Slower ones are quieter, but what lags is taken for motion of the CoG: at 15 rad/s the error at a joint speed of 1 rad/s doubles. */
    double vectoring_bandwidth; /* Bandwidth of the vectoring velocity [rad/s]. */
} sp_estimator_config;

/* Everything that can be chosen about how the gaits give way to each other. */
typedef struct {
    sp_controller_config flight; /* Who flies. */
    sp_crawler_config crawl; /* Who crawls. */
    double spool_time; /* Time in which the rotors take over from the floor [s]. */
    double climb_speed; /* Largest speed of the climb after take-off [m/s]. */
    double descent_speed; /* Speed at which it comes down [m/s]. */
    double descent_ease; /* Acceleration with which the descent begins [m/s²]. */
    double unload_time; /* Time in which the floor takes over from the rotors [s]. */
    double touch_error; /* The floor is where the robot is so far above its descent [m]; or as the next says. */
    double touch_force; /* The floor is where an unknown force of such a share of the weight pushes the robot up. */
    double touch_speed; /* For either it has to fall slower than this share of its descent. */
    double touch_time; /* For either it has to last so long [s]. */
    double lost_fall; /* What carried it is no floor where it falls faster than this while the rotors fade [m/s]. */
    double most_slew; /* Σλ changes by no more than this a tick where the floor is near [N]. */
    double most_tilt; /* A landing that tilts by more than this is broken off, and begun once more from above [rad]. */
    double search; /* A descent that finds no floor this far below where it is expected is broken off [m]. */
    double again; /* A landing that is broken off climbs by this much [m]; after the second one it stays there. */
    double cut_tilt; /* Tilted by more than this the rotors are cut [rad]. */
    double clearance; /* The lowest part of a form stays this far above the floor that it took off from [m], and from what it passes. */
} sp_manager_config;

/* A body of the kinematic tree, and the joint that carries it. */
typedef struct {
    int32_t parent, joint; /* its parent, before it in the tree; 0 … 15 are joints, from 16 on vectoring angles */
    double rotation[9]; /* of the joint in its parent */
    double position[3], axis[3]; /* of the joint in its parent [m]; in the body's own axes */
    double mass; /* [kg] */
    double com[3]; /* in the body's own axes [m] */
    double inertia[9]; /* about its CoG, in the body's own axes [kg m²] */
} sp_body;

/* The robot's numbers. */
typedef struct {
    sp_body tree[33]; /* the torso first, every other body after its parent */
    int32_t joint_body[16]; /* bodies that the joints carry */
    int32_t link_body[8], rotor_body[8]; /* the links, and the modules at their rotors */
    double gravity, weight, hover_thrust, max_thrust; /* [m/s²], [N] */
    double max_joint_torque, joint_limit, joint_kp; /* [Nm], [rad], [Nm/rad] */
    double max_vectoring_speed; /* [rad/s] */
    double yaw_axis_xy, yaw_axis_radius, yaw_axis_z, yaw_to_pitch, pitch_to_yaw, pitch_to_foot; /* of a leg [m] */
    double foot_radius, peg_depth; /* [m] */
    double flight_controller[3]; /* where motion capture and inertial unit look [m] */
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
    double gravity_torque[16]; /* holds the links without thrust [Nm] */
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
    sp_program_kind kind; /* which pattern, so which workspace of the solver */
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
} sp_program;

/* The answer of one tick. */
typedef struct {
    double forces_l[24]; /* rotor forces, link axes [N] */
    double foot_forces_f[12]; /* forces of the floor on the feet, floor axes [N] */
    double thrust[8]; /* λ [N] */
    double joint_torques[16]; /* quasi-static joint torque [Nm] */
    double wrench[6], unallocated_wrench[6]; /* produced; desired − produced, {CoG} [N, Nm] */
    int32_t status; /* sp_status */
    int32_t iterations; /* of the solvers, all attempts together */
    double slack; /* largest violation of a softened row, in scaled units */
    int32_t rows; /* how many of the next are meant */
    int32_t active[80]; /* +1 where a row is at its upper bound, −1 at its lower */
} sp_allocation;

/* What the interior-point method works on: equalities, then sides of rows and spheres. */
typedef struct {
    int32_t equal, sides; /* how many of both */
    double largest; /* bound */
    double x[36];
    int32_t row[80]; /* of an equality */
    int32_t side_row[160]; /* of a side */
    double b[80], yield[80], y[80], off[80];
    double sign[160], h[160];
    double give[168], s[168], z[168], ds[168], dz[168];
    double miss[168], D[168], product[168];
} sp_cone;

/* Room for the linear algebra of a tick. */
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

/* What the compensations remember. */
typedef struct {
    double servo_position[16], servo_velocity[16]; /* of the servo model [rad], [rad/s] */
    int32_t has_momentum, has_observed, has_slow; /* whether there was a tick before */
    double momentum[3], torque[3]; /* of the legs [Nms]; feed-forward [Nm] */
    double observed_momentum[6]; /* of the robot, world axes */
    double delivered_w[6], external_w[6], residual_w[6], fed_w[6], slow_w[6]; /* wrenches, world axes */
} sp_compensation_memory;

/* All that the flight controller remembers from one tick to the next. */
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
} sp_flight_memory;

/* What the controller makes of a state. */
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
    int32_t ticked; /* whether there is a last tick */
    sp_control_state control;
    sp_demand demand;
    double wrench_desired[6]; /* residual included, {CoG} [N, Nm] */
    double joint_velocity[16]; /* commanded [rad/s] */
    sp_allocation allocation;
} sp_flight;

/* What a path of the CoG and its heading passes. */
typedef struct {
    double time; /* [s] */
    double pose_w[4], rate_w[4], acceleration_w[4]; /* x, y, z and heading; their first and second derivatives */
} sp_knot;

/* A path of straight legs that is being built. */
typedef struct {
    double point[3]; /* where it is so far [m] */
    double speed, heading, seconds; /* [m/s]; [rad], and [s] so far */
    int32_t along, count; /* whether it turns to where it goes; knots */
} sp_legs;

/* One run through some phases. */
typedef struct {
    int32_t phases; /* sp_phases */
    int32_t has_target;
    sp_pose2 target; /* where the torso lies at its end, world */
    int32_t legs[4]; /* 1 where the leg is lifted */
    int32_t has_angle, has_height; /* whether they are given; else the configuration's */
    double angle, height, seconds; /* of the raise [rad], of the lift [m], of the hold [s] */
} sp_step;

/* All that the gait remembers. */
typedef struct {
    sp_step steps[256];
    int32_t first, count; /* a ring: the present step first */
    double plan[16]; /* planned joint setpoints [rad] */
    double position_w[3], slow_w[3]; /* filtered positions of the torso [m] */
    double R_wb[9]; /* attitude of the torso */
    double joints[16]; /* filtered joint angles [rad] */
    int32_t phase, index; /* sp_phase, and which of the step's */
    double time, still; /* in the phase; without motion [s] */
    double target[16], landing[16], highest[16], start[16]; /* joint angles of the legs' way [rad] */
    double floor_R[9]; /* axes of the floor, world */
    double floor_w[3]; /* where the torso lay [m] */
    double feet_f[12]; /* where the feet stand, floor axes [m] */
    sp_pose2 way; /* of the torso, floor axes */
    double share, height, lift; /* of the way; planned and largest height [m] */
    double expected[3]; /* filtered pose where all goes as planned */
    double yaw; /* filtered yaw of the torso [rad] */
    double trim[3]; /* what the legs push the torso beyond its plan */
    int32_t rested, timeouts; /* whether it begins from rest; phases that ended by time-out */
    sp_pose2 planned; /* where the commands end, world */
} sp_gait_memory;

/* All that the allocation on the ground remembers. */
typedef struct {
    sp_lock lock;
    double vectoring[16]; /* (φ, θ) last commanded [rad] */
    double forces_l[24]; /* last commanded [N] */
    double joint_torque[16], joint_position[16]; /* last commanded [Nm], [rad] */
    int32_t mode; /* sp_program_kind */
    double force_gap[24]; /* what the last mode gave beyond the present one [N] */
    double torque_gap[16]; /* the same of the joint torque [Nm] */
    double gap; /* how much of both is left, 1 … 0 */
    double effort[8]; /* weights of the power cost */
    int32_t rows; /* how many of the next are meant */
    int32_t active[80]; /* rows of the last tick that were active */
} sp_crawl_memory;

/* The crawl's controller. */
typedef struct {
    sp_crawler_config config;
    sp_gait_memory gait;
    sp_crawl_memory memory;
    sp_mode modes[7]; /* by sp_program_kind */
    double dt; /* length of a tick [s] */
    double home_b[12]; /* where the feet stand at rest [m] */
    int32_t ticked; /* whether there is a last tick */
    double R_wb[9]; /* attitude of the torso */
    sp_snapshot snapshot;
    sp_demand demand;
    sp_allocation allocation;
} sp_crawl;

/* What the manager of both gaits is told to do. */
typedef struct {
    int32_t kind; /* sp_locomotion_kind; the others are not all read */
    sp_pose2 pose; /* to crawl to, world */
    double position_w[3]; /* of the centre of mass, to fly to [m] */
    int32_t has_form, along; /* whether the next counts; whether it turns to where it flies first */
    int32_t at_once; /* whether it turns to there from however it moves, and takes the form on the way */
    double form[16]; /* on the way [rad] */
    double speed, height, floor; /* of the flight [m/s]; of the take-off [m]; where the floor is expected [m] */
} sp_waypoint;

/* All that the manager of both gaits remembers. */
typedef struct {
    int32_t phase; /* sp_manager_phase */
    double time; /* in it [s] */
    double begin_w[3]; /* where the centre of mass was when it began, or is to be [m] */
    double quat_wb[4]; /* attitude that is asked for when it begins */
    double yaw; /* heading in flight [rad] */
    double form[16]; /* that is asked for [rad] */
    double floor, velocity; /* height of the centre of mass on the floor [m]; rate of the descent [m/s] */
    double believed, thrust; /* how long there is a floor, or a form asked for [s]; Σλ of the last tick [N] */
    int32_t failures, rises; /* landings in a row that failed; whether it takes off at the next tick */
} sp_manager_memory;

/* The manager of both gaits. */
typedef struct {
    sp_manager_config config;
    sp_manager_memory memory;
    sp_flight flight;
    sp_crawl crawl;
    sp_reference reference; /* of the last tick in flight */
    sp_waypoint commands[64]; /* the present one first */
    int32_t count, knot_count; /* of commands, of knots */
    sp_knot knots[8]; /* of the present flight; its time begins with the phase */
    double lying[16]; /* joint angles on the floor [rad] */
    double lying_height; /* of the centre of mass over a floor on which it lies [m] */
    sp_snapshot snapshot;
} sp_manager;

/* A part of a course, from side to side of the field. */
typedef struct {
    int32_t kind; /* sp_gate_kind */
    double begin, end; /* along the course [m] */
    double size, middle; /* height, clearance, width [m] or angle [rad]; the middle of a slot to the left [m] */
} sp_gate;

/* What a map tells of a course. */
typedef struct {
    int32_t count, dares; /* of gates and floors; whether they may be smaller than what passes them */
    sp_gate gates[8]; /* in the order in which they are passed */
    sp_pose2 goal; /* where the torso is to lie, world */
    double tiles[28]; /* their heights, row by row from right to left [m] */
} sp_course;

/* Where to, and how. */
typedef struct {
    int32_t flies; /* whether in the air; else on the floor, after a landing if need be */
    double x, y, z, yaw; /* world; of the CoG in the air, of the torso on the floor [m]; heading there [rad] */
    double speed, narrow, sweep; /* of the flight [m/s]; from form 1 to form 3; of the legs' first joints [rad] */
} sp_target;

/* Which target is followed. */
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

/* What a policy in flight is told of the plan. */
typedef struct {
    double joint_target[16], next_form[16]; /* to reach now, and after it (the same if none) [rad] */
    double time_to_next; /* until then; SP_NO_NEXT_FORM if there is none [s] */
    double ahead_w[12]; /* of the path: where it will be, seen from where it is, world axes [m] */
    double turn[4]; /* how far its heading will turn until then [rad] */
    double velocity_w[3], acceleration_w[3]; /* of the path now [m/s], [m/s²] */
} sp_preview;

/* What a learned policy remembers: its last action and what leads to the next. */
typedef struct {
    int32_t has_momentum, has_joints; /* whether there was a tick before */
    double action[40]; /* last, as it was applied, in [−1, 1] */
    double leg_momentum[3]; /* [Nms] */
    double slow[40]; /* low-passed answers that the washout takes away */
    double traces[128]; /* low-passes of what it saw */
    double joints[16]; /* as commanded [rad] */
    int32_t has_velocity, has_first; /* whether they are remembered */
    double velocity[3], force[3]; /* of the last tick, of the model of the rotors; torso axes [m/s], [N] */
    double external[9]; /* external force; the same, and the first integral of the position, without signs */
    float observation[512]; /* what it saw last */
} sp_policy;

#endif
