/* Logs: what went in and what came out, tick by tick, as the structs lie in memory (little-endian, 8-byte doubles). */
#ifndef SPIDAR_LOG_H
#define SPIDAR_LOG_H

#include <stdio.h>

#include "spidar_core.h"

#define SP_LOG_MAGIC "SPIDAR01"
enum { SP_LOG_FLIGHT = 0, SP_LOG_CRAWL = 1 };

/* Head of a log; the configuration, the first state and what follows it come after. */
typedef struct {
    char magic[8], interface[32];
    int32_t kind, ticks;
} sp_log_head;

/* Flight: what follows the configuration. */
typedef struct {
    sp_robot_state state;
    double joint_position[SP_JOINTS];
    int32_t has_trim, unused;
    double trim[6];
} sp_log_start;

/* Crawl: a move; the list ends with cycles −1. */
typedef struct {
    sp_planar way;
    int32_t cycles, unused;
} sp_log_move;

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

int sp_replay(FILE *in, FILE *out);

#endif
