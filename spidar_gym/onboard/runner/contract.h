/* What the robot has to be, asked before anything is sent to it: the same model, the same joints, topics at their rates. */
#ifndef SPIDAR_CONTRACT_H
#define SPIDAR_CONTRACT_H

#include <stddef.h>
#include <stdint.h>

#include "spidar_runner.h"

/* What a link has found out about the robot. */
typedef struct {
    const char *model;        /* its model's SHA-256; NULL where it does not say */
    int32_t name_count;
    const char *const *names; /* of `joint_states` */
    double rates[SP_TOPICS];  /* measured [Hz]; 0 where nothing came */
} sp_robot;

/* 1, or 0 and a sentence. `odometry` as in the mission. */
int sp_agree(const sp_robot *robot, int32_t odometry, char *reason, size_t size);

#endif
