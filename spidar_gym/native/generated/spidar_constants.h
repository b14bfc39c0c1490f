/* Generated: the numbers that Python and C share. */
#ifndef SPIDAR_CONSTANTS_H
#define SPIDAR_CONSTANTS_H

#include <stdint.h>

#define SP_LEGS 4
#define SP_ROTORS 8
#define SP_JOINTS 16
#define SP_FORCES 24
#define SP_UNKNOWNS 36
#define SP_MAX_N 80
#define SP_MAX_M 80
#define SP_MAX_STEPS 256
#define SP_MAX_OBSERVATION 512
#define SP_MAX_ACTION 40
#define SP_HISTORY 32
#define SP_ANGLES 32
#define SP_BODIES 33
#define SP_POSE_FRAMES 4
#define SP_IMU_SAMPLES 8
#define SP_COMMANDS 4
#define SP_MAX_ENTRIES 48
#define SP_NETWORK_BLOCK 32
#define SP_MODE_COSTS 4
#define SP_MODE_ROWS 6
#define SP_PATH_AHEAD 4
#define SP_GRASP_TRIES 3
#define SP_STEER_SIZE 6
#define SP_MAX_WAYPOINTS 64
#define SP_MANAGER_KNOTS 8
#define SP_COURSE_AHEAD 3
#define SP_CLOCK_TICKS 80
#define SP_GRIP_LEVER 0x1.3333333333333p+0 /* 1.2, spidar_gym.control.grasp.grip.LEVER */
#define SP_GRIP_LEAD_TIME 0x1.3333333333333p-2 /* 0.3, spidar_gym.control.grasp.grip.LEAD_TIME */
#define SP_CLAW_HIGHEST -0x1.8f5c28f5c28f6p-1 /* -0.78, spidar_gym.control.grasp.claw.HIGHEST */
#define SP_CLAW_KNEE 0x1.8000000000000p+0 /* 1.5, spidar_gym.control.grasp.claw.KNEE */
#define SP_CLAW_OPEN 0x1.47ae147ae147bp-3 /* 0.16, spidar_gym.control.grasp.claw.OPEN */
#define SP_CLAW_PRESS 0x1.47ae147ae147bp-8 /* 0.005, spidar_gym.control.grasp.claw.PRESS */
#define SP_CLAW_NARROWEST 0x1.1eb851eb851ecp-3 /* 0.14, spidar_gym.control.grasp.claw.NARROWEST */
#define SP_CLAW_WIDEST 0x1.ae147ae147ae1p-2 /* 0.42, spidar_gym.control.grasp.claw.WIDEST */
#define SP_GRASP_SAFE_GRIP 0x1.0800000000000p+5 /* 33.0, spidar_gym.control.grasp.phases.SAFE_GRIP */
#define SP_GRASP_QUINTIC_PEAK 0x1.e000000000000p+0 /* 1.875, spidar_gym.control.grasp.phases.QUINTIC_PEAK */
#define SP_GRASP_RULE_ABOVE_GOAL 0x1.6666666666666p-2 /* 0.35, spidar_gym.control.grasp.rule.ABOVE_GOAL */
#define SP_GRASP_RULE_LIFT 0x1.6666666666666p-1 /* 0.7, spidar_gym.control.grasp.rule.LIFT */
#define SP_GRASP_RULE_CARRY_SPEED 0x1.0000000000000p-1 /* 0.5, spidar_gym.control.grasp.rule.CARRY_SPEED */
#define SP_GRASP_RULE_DELIVERED 0x1.999999999999ap-4 /* 0.1, spidar_gym.control.grasp.rule.DELIVERED */
#define SP_GRASP_RULE_FIRST_MASS 0x1.0000000000000p-1 /* 0.5, spidar_gym.control.grasp.rule.FIRST_MASS */
#define SP_SCENE_STAND_MARGIN 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.grasp.scene.STAND_MARGIN */
#define SP_SCENE_STAND_SHARE 0x1.6666666666666p-1 /* 0.7, spidar_gym.control.grasp.scene.STAND_SHARE */
#define SP_SCENE_CHOCK 0x1.47ae147ae147bp-6 /* 0.02, spidar_gym.control.grasp.scene.CHOCK */
#define SP_SCENE_LEAN 0x1.0000000000000p-1 /* 0.5, spidar_gym.control.grasp.scene.LEAN */
#define SP_SCENE_LESS_PER_KG 0x1.8000000000000p+0 /* 1.5, spidar_gym.control.grasp.scene.LESS_PER_KG */
#define SP_GRAVITY 0x1.39eb851eb851fp+3 /* 9.81, spidar_gym.robot.spec.GRAVITY */
#define SP_STEER_SPEED 0x1.999999999999ap-2 /* 0.4, spidar_gym.control.grasp.phases.STEER_SPEED */
#define SP_STEER_TURN 0x1.999999999999ap-2 /* 0.4, spidar_gym.control.grasp.phases.STEER_TURN */
#define SP_DISC_NEAREST 0x1.47ae147ae147bp-6 /* 0.02, spidar_gym.model.interference.NEAREST */
#define SP_DISC_FARTHEST 0x1.3333333333333p-1 /* 0.6, spidar_gym.model.interference.FARTHEST */
#define SP_CONTROL_RATE 0x1.4000000000000p+5 /* 40.0, spidar_gym.control.flight.controller.CONTROL_RATE */
#define SP_NO_NEXT_FORM 0x1.e000000000000p+5 /* 60.0, spidar_gym.control.flight.observation.NO_NEXT_FORM */
#define SP_LEAST_QUATERNION 0x1.0000000000000p-2 /* 0.25, spidar_gym.state.LEAST_QUATERNION */
#define SP_SMALL_ANGLE 0x1.ad7f29abcaf48p-24 /* 1e-07, spidar_gym.so3.SMALL_ANGLE */
#define SP_SMALL_SINE 0x1.0c6f7a0b5ed8dp-20 /* 1e-06, spidar_gym.so3.SMALL_SINE */
#define SP_MIN_FORCE 0x1.0000000000000p-1 /* 0.5, spidar_gym.model.rotor.MIN_FORCE */
#define SP_AIM_HOLD 0x1.999999999999ap-5 /* 0.05, spidar_gym.model.rotor.AIM_HOLD */
#define SP_TURN_BIAS 0x1.999999999999ap-4 /* 0.1, spidar_gym.model.rotor.TURN_BIAS */
#define SP_BATTERY_VOLTAGE 0x1.6333333333333p+4 /* 22.2, spidar_gym.model.rotor.BATTERY_VOLTAGE */
#define SP_BATTERY_THRUST 0x1.fcccccccccccdp+4 /* 31.8, spidar_gym.model.rotor.BATTERY_THRUST */
#define SP_THRUST_PER_VOLT 0x1.7333333333333p+1 /* 2.9, spidar_gym.model.rotor.THRUST_PER_VOLT */
#define SP_NARROW 0x1.47ae147ae147bp-7 /* 0.01, spidar_gym.control.rotors.NARROW */
#define SP_MISSED_FORCE 0x1.0000000000000p+0 /* 1.0, spidar_gym.control.flight.centroidal.MISSED_FORCE */
#define SP_MISSED_TORQUE 0x1.999999999999ap-4 /* 0.1, spidar_gym.control.flight.centroidal.MISSED_TORQUE */
#define SP_MAX_EXTERNAL_SHARE 0x1.0000000000000p-1 /* 0.5, spidar_gym.control.flight.compensation.MAX_EXTERNAL_SHARE */
#define SP_MAX_EXTERNAL_TORQUE 0x1.4000000000000p+3 /* 10.0, spidar_gym.control.flight.compensation.MAX_EXTERNAL_TORQUE */
#define SP_BEND_TIME 0x1.999999999999ap-4 /* 0.1, spidar_gym.control.flight.motion.BEND_TIME */
#define SP_MOMENTUM_TIME 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.flight.motion.MOMENTUM_TIME */
#define SP_ROTOR_LAG 0x1.47ae147ae147bp-5 /* 0.04, spidar_gym.control.flight.motion.ROTOR_LAG */
#define SP_COMMAND_DELAY 0x1.eb851eb851eb8p-6 /* 0.03, spidar_gym.control.flight.motion.COMMAND_DELAY */
#define SP_RINGING 0x1.3333333333333p-3 /* 0.15, spidar_gym.control.flight.motion.RINGING */
#define SP_RINGING_TIME 0x1.0000000000000p-1 /* 0.5, spidar_gym.control.flight.motion.RINGING_TIME */
#define SP_LEAST_SHARE 0x1.3333333333333p-3 /* 0.15, spidar_gym.control.flight.motion.LEAST_SHARE */
#define SP_INFINITY 0x1.93e5939a08ceap+99 /* 1e+30, spidar_gym.control.allocation.problem.INFINITY */
#define SP_DUAL_TOLERANCE 0x1.ad7f29abcaf48p-24 /* 1e-07, spidar_gym.control.allocation.solver.DUAL_TOLERANCE */
#define SP_RHO 0x1.0000000000000p+0 /* 1.0, spidar_gym.control.allocation.solver.RHO */
#define SP_OTHER_RHO 0x1.4000000000000p+3 /* 10.0, spidar_gym.control.allocation.solver.OTHER_RHO */
#define SP_ROUNDS 3 /* spidar_gym.control.allocation.solver.ROUNDS */
#define SP_MORE_ROUNDS 8 /* spidar_gym.control.allocation.solver.MORE_ROUNDS */
#define SP_ROW_TOLERANCE 0x1.12e0be826d695p-30 /* 1e-09, spidar_gym.control.allocation.solver.ROW_TOLERANCE */
#define SP_SIDE_TOLERANCE 0x1.4f8b588e368f1p-17 /* 1e-05, spidar_gym.control.allocation.allocator.SIDE_TOLERANCE */
#define SP_SPHERE_TOLERANCE 0x1.12e0be826d695p-30 /* 1e-09, spidar_gym.control.allocation.allocator.SPHERE_TOLERANCE */
#define SP_CONE_MAX_STEPS 40 /* spidar_gym.control.allocation.cone.MAX_STEPS */
#define SP_CONE_ROWS 0x1.12e0be826d695p-30 /* 1e-09, spidar_gym.control.allocation.cone.ROWS */
#define SP_CONE_PRODUCT 0x1.5fd7fe1796495p-37 /* 1e-11, spidar_gym.control.allocation.cone.PRODUCT */
#define SP_CONE_GRADIENT 0x1.ad7f29abcaf48p-24 /* 1e-07, spidar_gym.control.allocation.cone.GRADIENT */
#define SP_CONE_LOOSE 0x1.2c00000000000p+8 /* 300.0, spidar_gym.control.allocation.cone.LOOSE */
#define SP_CONE_PROOF 0x1.12e0be826d695p-30 /* 1e-09, spidar_gym.control.allocation.cone.PROOF */
#define SP_CONE_FAR 0x1.f400000000000p+9 /* 1000.0, spidar_gym.control.allocation.cone.FAR */
#define SP_CONE_SHORT 0x1.fd70a3d70a3d7p-1 /* 0.995, spidar_gym.control.allocation.cone.SHORT */
#define SP_CONE_TINY 0x1.19799812dea11p-40 /* 1e-12, spidar_gym.control.allocation.cone.TINY */
#define SP_LEAST_THRUST 0x1.0000000000000p+0 /* 1.0, spidar_gym.control.allocation.contact.LEAST_THRUST */
#define SP_EFFORT_SHARE 0x1.999999999999ap-4 /* 0.1, spidar_gym.control.crawl.controller.EFFORT_SHARE */
#define SP_MOST_STRIDE 0x1.4000000000000p+4 /* 20.0, spidar_gym.control.crawl.footsteps.MOST_STRIDE */
#define SP_BISECTIONS 24 /* spidar_gym.control.crawl.footsteps.BISECTIONS */
#define SP_STRAIGHT 0x1.12e0be826d695p-30 /* 1e-09, spidar_gym.control.crawl.pose2.STRAIGHT */
#define SP_TARGET_SWEEP 0x1.999999999999ap-2 /* 0.4, spidar_gym.control.course.target.SWEEP */
#define SP_TARGET_WAY 0x1.6000000000000p+2 /* 5.5, spidar_gym.control.course.target.WAY */
#define SP_TARGET_MARGIN 0x1.3333333333333p-2 /* 0.3, spidar_gym.control.course.target.MARGIN */
#define SP_PILOT_FLY_LOWEST 0x1.999999999999ap-1 /* 0.8, spidar_gym.control.course.pilot.FLY_LOWEST */
#define SP_PILOT_LEAST_RISE 0x1.3333333333333p-1 /* 0.6, spidar_gym.control.course.pilot.LEAST_RISE */
#define SP_PILOT_SAME_PLACE 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.course.pilot.SAME_PLACE */
#define SP_PILOT_SAME_FORM 0x1.47ae147ae147bp-6 /* 0.02, spidar_gym.control.course.pilot.SAME_FORM */
#define SP_PILOT_SAME_SPEED 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.course.pilot.SAME_SPEED */
#define SP_PILOT_SAME_STEP 0x1.47ae147ae147bp-6 /* 0.02, spidar_gym.control.course.pilot.SAME_STEP */
#define SP_PILOT_SAME_TURN 0x1.47ae147ae147bp-6 /* 0.02, spidar_gym.control.course.pilot.SAME_TURN */
#define SP_PILOT_THERE 0x1.0624dd2f1a9fcp-7 /* 0.008, spidar_gym.control.course.pilot.THERE */
#define SP_PILOT_THERE_TURN 0x1.eb851eb851eb8p-7 /* 0.015, spidar_gym.control.course.pilot.THERE_TURN */
#define SP_COURSE_HALF_WIDTH 0x1.8000000000000p+1 /* 3.0, spidar_gym.control.course.gates.HALF_WIDTH */
#define SP_COURSE_CEILING 0x1.8000000000000p+1 /* 3.0, spidar_gym.control.course.gates.CEILING */
#define SP_COURSE_BEFORE 0x1.4000000000000p+1 /* 2.5, spidar_gym.control.course.gates.BEFORE */
#define SP_COURSE_BEYOND 0x1.4000000000000p+1 /* 2.5, spidar_gym.control.course.gates.BEYOND */
#define SP_COURSE_SEEN 0x1.0000000000000p+1 /* 2.0, spidar_gym.control.course.observation.SEEN */
#define SP_RULE_FLOWN 0x1.8000000000000p+0 /* 1.5, spidar_gym.control.course.rule.FLOWN */
#define SP_RULE_CRAWLED 0x1.599999999999ap+0 /* 1.35, spidar_gym.control.course.rule.CRAWLED */
#define SP_RULE_PASSED 0x1.4000000000000p+0 /* 1.25, spidar_gym.control.course.rule.PASSED */
#define SP_RULE_OVER 0x1.0000000000000p+0 /* 1.0, spidar_gym.control.course.rule.OVER */
#define SP_RULE_ABOVE 0x1.0000000000000p+0 /* 1.0, spidar_gym.control.course.rule.ABOVE */
#define SP_RULE_THROUGH 0x1.6666666666666p+0 /* 1.4, spidar_gym.control.course.rule.THROUGH */
#define SP_RULE_SLOW 0x1.0000000000000p-1 /* 0.5, spidar_gym.control.course.rule.SLOW */
#define SP_RULE_FAST 0x1.999999999999ap-1 /* 0.8, spidar_gym.control.course.rule.FAST */
#define SP_RULE_CRAWLS 0x1.6666666666666p+1 /* 2.8, spidar_gym.control.course.rule.CRAWLS */
#define SP_RULE_NEAR 0x1.47ae147ae147bp-4 /* 0.08, spidar_gym.control.course.rule.NEAR */
#define SP_RULE_BENEATH 0x1.3333333333333p-3 /* 0.15, spidar_gym.control.course.rule.BENEATH */
#define SP_RULE_ALIGNED 0x1.eb851eb851eb8p-6 /* 0.03, spidar_gym.control.course.rule.ALIGNED */
#define SP_RULE_FORMED 0x1.eb851eb851eb8p-5 /* 0.06, spidar_gym.control.course.rule.FORMED */
#define SP_MANAGER_ASIDE 0x1.0000000000000p+1 /* 2.0, spidar_gym.control.locomotion.manager.ASIDE */
#define SP_MANAGER_ENDS_AFTER 0x1.0000000000000p+0 /* 1.0, spidar_gym.control.locomotion.manager.ENDS_AFTER */
#define SP_MANAGER_LEVEL_FROM 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.locomotion.manager.LEVEL_FROM */
#define SP_MANAGER_LEVEL_TO 0x1.6666666666666p-2 /* 0.35, spidar_gym.control.locomotion.manager.LEVEL_TO */
#define SP_MANAGER_NEAR_FLOOR 0x1.999999999999ap-4 /* 0.1, spidar_gym.control.locomotion.manager.NEAR_FLOOR */
#define SP_MANAGER_LEAST_WAY 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.locomotion.manager.LEAST_WAY */
#define SP_MANAGER_ARRIVED 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.locomotion.manager.ARRIVED */
#define SP_MANAGER_PATIENCE 0x1.0000000000000p+1 /* 2.0, spidar_gym.control.locomotion.manager.PATIENCE */
#define SP_PATH_EASE 0x1.8000000000000p-1 /* 0.75, spidar_gym.control.flight.path.EASE */
#define SP_PATH_DETOUR 0x1.999999999999ap-4 /* 0.1, spidar_gym.control.flight.path.DETOUR */
#define SP_PATH_RUN_AHEAD 0x1.6666666666666p-2 /* 0.35, spidar_gym.control.flight.path.RUN_AHEAD */
#define SP_PATH_TOGETHER 0x1.0c6f7a0b5ed8dp-20 /* 1e-06, spidar_gym.control.flight.path.TOGETHER */
#define SP_PATH_LEAST_SECONDS 0x1.0000000000000p-1 /* 0.5, spidar_gym.control.flight.path.LEAST_SECONDS */
#define SP_PATH_FADE 0x1.999999999999ap-2 /* 0.4, spidar_gym.control.flight.path.FADE */
#define SP_PATH_REST 0x1.0000000000000p-1 /* 0.5, spidar_gym.control.flight.path.REST */
#define SP_PATH_TURN_RATE 0x1.3333333333333p-1 /* 0.6, spidar_gym.control.flight.path.TURN_RATE */
#define SP_PATH_KNOT_TIME 0x1.0000000000000p-2 /* 0.25, spidar_gym.control.flight.path.KNOT_TIME */
#define SP_PATH_PEAK 0x1.e000000000000p+0 /* 1.875, spidar_gym.control.flight.path.PEAK */
#define SP_PATH_DRIFT 0x1.999999999999ap-3 /* 0.2, spidar_gym.control.flight.path.DRIFT */
#define SP_PATH_SWING 0x1.1b71758e21965p-6 /* 0.0173, spidar_gym.control.flight.path.SWING */
#define SP_PATH_SUBSTEPS 8 /* spidar_gym.control.flight.path.SUBSTEPS */
#define SP_PATH_AHEAD_STEP 0x1.0000000000000p-2 /* 0.25, spidar_gym.control.flight.path.AHEAD_STEP */
#define SP_GAIT_FILTER_TIME 0x1.999999999999ap-4 /* 0.1, spidar_gym.control.crawl.gait.FILTER_TIME */
#define SP_GAIT_SLOW_TIME 0x1.0000000000000p-2 /* 0.25, spidar_gym.control.crawl.gait.SLOW_TIME */
#define SP_GAIT_AGREE 0x1.47ae147ae147bp-9 /* 0.0025, spidar_gym.control.crawl.gait.AGREE */
#define SP_GAIT_NEAR 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.crawl.gait.NEAR */
#define SP_GAIT_STILL 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.crawl.gait.STILL */
#define SP_GAIT_SWINGING 0x1.3333333333333p-3 /* 0.15, spidar_gym.control.crawl.gait.SWINGING */
#define SP_GAIT_MAX_DEPTH 0x1.999999999999ap-5 /* 0.05, spidar_gym.control.crawl.gait.MAX_DEPTH */
#define SP_GAIT_RESPONSE_TIME 0x1.5c28f5c28f5c3p-3 /* 0.17, spidar_gym.control.crawl.gait.RESPONSE_TIME */
#define SP_GAIT_SHORTEN 0x1.e666666666666p-1 /* 0.95, spidar_gym.control.crawl.gait.SHORTEN */
#define SP_GAIT_LEAST_LIFT 0x1.47ae147ae147bp-7 /* 0.01, spidar_gym.control.crawl.gait.LEAST_LIFT */
#define SP_GAIT_TRIAL 0x1.0624dd2f1a9fcp-9 /* 0.002, spidar_gym.control.crawl.gait.TRIAL */
#define SP_GAIT_MISSED 0x1.89374bc6a7efap-8 /* 0.006, spidar_gym.control.crawl.gait.MISSED */
#define SP_GAIT_MISSED_TURN 0x1.89374bc6a7efap-7 /* 0.012, spidar_gym.control.crawl.gait.MISSED_TURN */
#ifndef __cplusplus
static const double SP_STEER_RADIUS[2] = {0x1.70a3d70a3d70ap-3, 0x1.3d70a3d70a3d7p-1};
static const double SP_TARGET_STRETCHED[4] = {0x0.0p+0, 0x0.0p+0, 0x0.0p+0, 0x0.0p+0};
static const double SP_TARGET_BELOW[4] = {0x0.0p+0, 0x1.921fb54442d18p-1, 0x0.0p+0, 0x1.921fb54442d18p+0};
static const double SP_TARGET_TURNS[4] = {-0x1.0000000000000p+0, 0x1.0000000000000p+0, -0x1.0000000000000p+0, 0x1.0000000000000p+0};
static const double SP_TARGET_SPEEDS[2] = {0x1.999999999999ap-5, 0x1.8000000000000p+0};
#endif

/* Blocks of cost. */
typedef enum {
    SP_NO_COST = 0, SP_THRUST_EFFORT = 1, SP_POWER_EFFORT = 2, SP_JOINT_TORQUE_EFFORT = 3, SP_FOOT_EFFORT = 4
} sp_cost_kind;

/* Blocks of rows. */
typedef enum {
    SP_NO_ROWS = 0, SP_WRENCH_BALANCE = 1, SP_THRUST_BOX = 2, SP_JOINT_TORQUE_LIMIT = 3, SP_VECTORING_LOCK = 4,
    SP_INTERFERENCE_BOUND = 5, SP_CONTACT_WRENCH_RANGE = 6, SP_FRICTION_PYRAMID = 7
} sp_rows_kind;

/* Programs, each with a workspace. */
typedef enum {
    SP_PROGRAM_PAPER = 0, SP_PROGRAM_AS_FLOWN = 1, SP_PROGRAM_PROJECTION = 2, SP_PROGRAM_REST = 3, SP_PROGRAM_LEG = 4,
    SP_PROGRAM_LEGS = 5, SP_PROGRAM_STANCE = 6, SP_PROGRAMS
} sp_program_kind;

/* Outcome of a tick's allocation, best first. */
typedef enum {
    SP_CLOSED_FORM = 0, SP_SOLVED = 1, SP_PROJECTED = 2, SP_SOFTENED = 3, SP_HELD = 4
} sp_status;

/* Phase sequences of a step of the gait. */
typedef enum {
    SP_CYCLE = 0, SP_LIFT = 1, SP_STAND = 2
} sp_phases;

/* Phases of the gait. */
typedef enum {
    SP_DONE = 0, SP_SPOOL = 1, SP_RAISE = 2, SP_SWING = 3, SP_LOWER = 4, SP_BRACE = 5, SP_UP = 6, SP_FORWARD = 7,
    SP_DOWN = 8, SP_SETTLE = 9, SP_HOLD = 10
} sp_phase;

/* Commands to the manager of both gaits. */
typedef enum {
    SP_LOCOMOTION_CRAWL_TO = 0, SP_LOCOMOTION_TAKE_OFF = 1, SP_LOCOMOTION_FLY_TO = 2, SP_LOCOMOTION_LAND = 3,
    SP_LOCOMOTION_GRASP = 4, SP_LOCOMOTION_CARRY_TO = 5, SP_LOCOMOTION_PLACE = 6, SP_LOCOMOTION_RELEASE = 7
} sp_locomotion_kind;

/* Where a robot is before a command. */
typedef enum {
    SP_ON_FLOOR = 0, SP_ON_AIR = 1, SP_ON_GRIP = 2, SP_ON_PLACED = 3
} sp_situation;

/* Phases of a grasp. */
typedef enum {
    SP_GRASP_NONE = 0, SP_GRASP_RISE = 1, SP_GRASP_OVER = 2, SP_GRASP_DOWN = 3, SP_GRASP_CLOSE = 4, SP_GRASP_GRIP = 5,
    SP_GRASP_LOAD = 6, SP_GRASP_TEST = 7, SP_GRASP_BACK = 8, SP_GRASP_SETTLE = 9, SP_GRASP_LIFT = 10, SP_GRASP_HOLD =
    11, SP_GRASP_CARRY = 12, SP_GRASP_LOWER = 13, SP_GRASP_FEEL = 14, SP_GRASP_UNLOAD = 15, SP_GRASP_LET_GO = 16,
    SP_GRASP_OPEN = 17, SP_GRASP_LEAVE = 18, SP_GRASP_STEERED = 19
} sp_grasp_phase;

/* Shapes of objects that can be grasped. */
typedef enum {
    SP_OBJECT_BOX = 0, SP_OBJECT_CYLINDER = 1, SP_OBJECT_BALL = 2
} sp_object_shape;

/* Phases of the manager of both gaits. */
typedef enum {
    SP_MANAGER_LIE = 0, SP_MANAGER_CRAWL = 1, SP_MANAGER_SPOOL = 2, SP_MANAGER_CLIMB = 3, SP_MANAGER_HOVER = 4,
    SP_MANAGER_FORM = 5, SP_MANAGER_FLY = 6, SP_MANAGER_DESCEND = 7, SP_MANAGER_UNLOAD = 8, SP_MANAGER_CUT = 9,
    SP_MANAGER_GRASP = 10
} sp_manager_phase;

/* Parts of a course: gates first, then floors. */
typedef enum {
    SP_GATE_WALL = 0, SP_GATE_BEAM = 1, SP_GATE_SLOT = 2, SP_GATE_PLATFORM = 3, SP_GATE_TILES = 4, SP_GATE_SLOPE = 5,
    SP_GATE_KINDS
} sp_gate_kind;

/* Channels of a policy's action, in the order of its entries. */
typedef enum {
    SP_CHANNEL_WRENCH = 1, SP_CHANNEL_JOINT_OFFSET = 2, SP_CHANNEL_JOINT_SPEED_SCALE = 4, SP_CHANNEL_FORCES = 8,
    SP_CHANNEL_GAIT = 16, SP_CHANNEL_LEG_FORCES = 32
} sp_channel;

/* Controller that a policy adds to, or `direct` for one without a controller. */
typedef enum {
    SP_POLICY_NONE = -1, SP_POLICY_FLIGHT = 0, SP_POLICY_CRAWL = 1, SP_POLICY_DIRECT = 2, SP_POLICY_CRAWL_DIRECT = 3
} sp_policy_target;

enum { SP_REFERENCE_MODE_FLIGHT = 0, SP_REFERENCE_MODE_FLIGHT_UNRESTRICTED = 1 };

enum { SP_CONTROLLER_CONFIG_ALLOCATION_PAPER = 0, SP_CONTROLLER_CONFIG_ALLOCATION_AS_FLOWN = 1 };

enum { SP_CONTROLLER_CONFIG_MOTION_COMPLETE = 0, SP_CONTROLLER_CONFIG_MOTION_QUASI_STATIC = 1, SP_CONTROLLER_CONFIG_MOTION_OBSERVED = 2 };

enum { SP_GAIT_CONFIG_STRIDE_CENTRED = 0, SP_GAIT_CONFIG_STRIDE_HOME = 1 };

enum { SP_DISTURBANCES_FAULT_THRUST = 0, SP_DISTURBANCES_FAULT_VECTORING = 1 };

enum { SP_OBJECT_CONFIG_SHAPE_NONE = 0, SP_OBJECT_CONFIG_SHAPE_BOX = 1, SP_OBJECT_CONFIG_SHAPE_CYLINDER = 2, SP_OBJECT_CONFIG_SHAPE_BALL = 3 };

enum { SP_GRASP_MEMORY_PHASE_NONE = 0, SP_GRASP_MEMORY_PHASE_RISE = 1, SP_GRASP_MEMORY_PHASE_OVER = 2, SP_GRASP_MEMORY_PHASE_DOWN = 3, SP_GRASP_MEMORY_PHASE_CLOSE = 4, SP_GRASP_MEMORY_PHASE_GRIP = 5, SP_GRASP_MEMORY_PHASE_LOAD = 6, SP_GRASP_MEMORY_PHASE_TEST = 7, SP_GRASP_MEMORY_PHASE_BACK = 8, SP_GRASP_MEMORY_PHASE_SETTLE = 9, SP_GRASP_MEMORY_PHASE_LIFT = 10, SP_GRASP_MEMORY_PHASE_HOLD = 11, SP_GRASP_MEMORY_PHASE_CARRY = 12, SP_GRASP_MEMORY_PHASE_LOWER = 13, SP_GRASP_MEMORY_PHASE_FEEL = 14, SP_GRASP_MEMORY_PHASE_UNLOAD = 15, SP_GRASP_MEMORY_PHASE_LET_GO = 16, SP_GRASP_MEMORY_PHASE_OPEN = 17, SP_GRASP_MEMORY_PHASE_LEAVE = 18, SP_GRASP_MEMORY_PHASE_STEERED = 19 };

enum { SP_GRASP_SCENE_SHAPE_BOX = 0, SP_GRASP_SCENE_SHAPE_CYLINDER = 1, SP_GRASP_SCENE_SHAPE_BALL = 2 };

/* Phases of each of sp_phases, −1 after the last. */
static const int32_t SP_STEP_PHASES[3][10] = {
    {SP_SPOOL, SP_RAISE, SP_SWING, SP_LOWER, SP_BRACE, SP_UP, SP_FORWARD, SP_DOWN, SP_SETTLE, -1},
    {SP_SPOOL, SP_RAISE, SP_HOLD, SP_LOWER, SP_SETTLE, -1},
    {SP_BRACE, SP_UP, SP_HOLD, SP_DOWN, SP_SETTLE, -1},
};

#endif
