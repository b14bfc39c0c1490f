/* Logs: what went in and what came out, tick by tick, as the structs lie in memory (little-endian, 8-byte doubles). */
#ifndef SPIDAR_LOG_H
#define SPIDAR_LOG_H

#include <stdio.h>

#include "mission.h"

#define SP_LOG_MAGIC "SPIDAR01"
enum { SP_LOG_FLIGHT = 0, SP_LOG_CRAWL = 1, SP_LOG_RUN = 2 };

/* Head of a log. After it: of a flight the configuration, sp_log_start, sp_log_input; of a crawl the configuration, the
 * first state, moves up to one of −1 cycles, sp_log_input; of a run the mission, and (input, output, sp_log_clock) of every tick. */
typedef struct {
    char magic[8], interface[32];
    int32_t kind, ticks; /* of a run 0: to the end of the file */
} sp_log_head;

/* Flight: what follows the configuration. */
typedef struct {
    sp_robot_state state;
    double joint_position[SP_JOINTS];
    int32_t has_trim, unused;
    double trim[6];
} sp_log_start;

/* One tick of input. */
typedef struct {
    sp_robot_state state;
    sp_reference reference; /* not read on the ground */
    int32_t has_residual, unused;
    sp_residual residual;
} sp_log_input;

/* One tick of output. */
typedef struct {
    sp_command command;
    double forces_l[SP_FORCES];
    int32_t status, iterations;
} sp_log_output;

/* When a tick of a run began after its due time, negative without a clock, and how long it took. */
typedef struct {
    double wait_us, compute_us;
} sp_log_clock;

int sp_replay(FILE *in, FILE *out, int *ticks, int *differ);

#endif
