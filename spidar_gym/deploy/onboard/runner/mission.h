/* A mission: what the runner does once it drives, and the limits within which it goes on. A text file, a line each. */
#ifndef SPIDAR_MISSION_H
#define SPIDAR_MISSION_H

#include <stddef.h>

#include "spidar_core.h"

#define SP_MAX_FORMS 64
#define SP_MAX_WINDOWS 8
#define SP_MAX_MOVES 16

/* A form to fly to. */
typedef struct {
    double start; /* since the take-over [s] */
    double joint_target[SP_JOINTS];
} sp_form;

/* When the interference rows are dropped. */
typedef struct {
    double start, end; /* since the take-over [s] */
} sp_window;

/* A move on the ground. */
typedef struct {
    sp_planar way;
    int32_t cycles, unused; /* 0 cycles: as many as it takes */
} sp_move;

/* When it is enough. */
typedef struct {
    double settle;                      /* with good samples before the take-over [s] */
    double pose_age, imu_age, joint_age, state_age; /* oldest sample that still counts [s] */
    double gap;                         /* longest time between two ticks [s] */
    double tilt;                        /* [rad] */
    double fence_low[3], fence_high[3]; /* of the torso, world [m] */
    int32_t hold_ticks;                 /* a fault is held for so long before the landing is forced */
    int32_t landing_ticks;              /* … and the landing commanded for so long before silence */
} sp_limits;

typedef struct {
    int32_t crawls;   /* 0 flies in HOVER, 1 crawls in ARM_ON */
    int32_t odometry; /* 1 takes the lab's estimate `uav/cog/odom`, 0 estimates from mocap and inertial unit */
    int32_t residual; /* 1 lets the exported residual add */
    int32_t form_count, window_count, move_count;
    sp_limits limits;
    sp_controller_config controller;
    sp_crawler_config crawler;
    sp_estimator_config estimator;
    sp_form forms[SP_MAX_FORMS];
    sp_window windows[SP_MAX_WINDOWS];
    sp_move moves[SP_MAX_MOVES];
    double end; /* of the flight, since the take-over; it goes on hovering [s] */
} sp_mission;

/* Read a mission's text; 1, or 0 and a sentence that says what would have been valid. */
int sp_read_mission(const char *text, sp_mission *mission, char *reason, size_t size);

#endif
