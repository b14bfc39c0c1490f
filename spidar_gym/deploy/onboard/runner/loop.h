/* The runner's tick: check what came in, estimate, control, and know when to stop. A pure function of its inputs. */
#ifndef SPIDAR_LOOP_H
#define SPIDAR_LOOP_H

#include "mission.h"

/* Flight states of the robot's own stack [JSK]. */
enum {
    SP_ARM_OFF, SP_START, SP_ARM_ON, SP_TAKEOFF, SP_LAND, SP_HOVER, SP_STOP, SP_LOW_BATTERY = 16, SP_FORCED_LANDING = 17
};

/* What is wrong. */
typedef enum {
    SP_FINE, SP_LATE, SP_NO_STATE, SP_NO_POSE, SP_NO_IMU, SP_NO_JOINTS, SP_NOT_FINITE, SP_OUT_OF_RANGE, SP_OUT_OF_ORDER,
    SP_JUMPED, SP_TILTED, SP_OUTSIDE, SP_CONTENDED, SP_NO_ALLOCATION, SP_BAD_COMMAND, SP_FAULTS
} sp_fault;

/* Where the runner is: it drives once in its life, and gives back for good. */
typedef enum { SP_WAITING, SP_DRIVING, SP_HOLDING, SP_LANDING, SP_RELEASED } sp_stage;

/* What the links do with an answer. */
typedef enum { SP_SILENT, SP_PUBLISH, SP_FORCE_LANDING } sp_action;

/* The lab's own estimate, `uav/cog/odom`. */
typedef struct {
    double time;
    double position_w[3], quat_wb[4]; /* CoG; attitude of the torso (w, x, y, z) */
    double velocity_w[3], omega_b[3]; /* of the CoG in the world; torso axes */
} sp_odometry;

/* What a link has heard since the last tick. Samples as they came: nothing is checked yet. */
typedef struct {
    double time;              /* now, of the clock that stamps the samples [s] */
    double flight_state_time; /* when the flight state was heard last [s] */
    int32_t flight_state;     /* −1 before the first */
    int32_t has_odometry;     /* whether a new one came */
    int32_t has_thrust;       /* whether somebody else told the rotors something */
    int32_t unused;
    double thrust[SP_ROTORS]; /* … what, last [N] */
    sp_odometry odometry;
    sp_measurement measurement;
} sp_loop_input;

/* What the runner answers. */
typedef struct {
    int32_t action;   /* sp_action */
    int32_t stage;    /* sp_stage */
    int32_t fault;    /* sp_fault */
    int32_t status;   /* sp_status of the allocation */
    int32_t iterations, finished; /* of the solver; whether the mission is over */
    int32_t phase, timeouts;      /* of the gait: sp_phase, and how many ended by time-out */
    double mission_time; /* since the take-over [s] */
    sp_command command;
    sp_robot_state state;
    sp_reference reference;
    double joint_torques[SP_JOINTS], forces_l[SP_FORCES]; /* allocated */
    double policy_action[SP_MAX_ACTION];                  /* of the learned residual, 0 where it is off */
} sp_loop_output;

/* What the runner makes of the samples. */
typedef struct {
    int32_t started, has_pose;
    double pose_time, imu_time, joint_time; /* of the newest good samples [s] */
    double pose_position_w[3], pose_quat_wb[4];
    sp_odometry odometry;
    sp_estimator estimator;
    sp_robot_state state;
} sp_sense;

/* All that the runner remembers. */
typedef struct {
    sp_mission mission;
    sp_sense sense;
    sp_flight flight;
    sp_crawl crawl;
    sp_policy policy;
    double goal[3]; /* of a crawl: x, y [m], yaw [rad], world */
    sp_reference reference;
    sp_command command;
    sp_loop_output answer; /* the last one */
    double last, good_since, taken_over; /* [s] */
    double held;                         /* how long old commands have been in force [s] */
    double trim[6];                      /* what the robot's own stack adds to the weight to hover [N, Nm] */
    int32_t has_last, stage, fault, landing, has_trim, finished;
} sp_loop;

/* sense.c: check the samples, estimate the state; what is wrong. */
void sp_sense_init(sp_sense *sense, const sp_mission *mission);
sp_fault sp_sense_update(sp_sense *sense, const sp_mission *mission, const sp_loop_input *input, const double *thrust);

/* loop.c */
const char *sp_loop_init(sp_loop *loop, const sp_mission *mission); /* NULL, or why the mission is refused */
void sp_loop_tick(sp_loop *loop, const sp_loop_input *input, sp_loop_output *output);
const char *sp_fault_words(int32_t fault);
const char *sp_stage_words(int32_t stage);

#endif
