/* Logs: what went in and what came out, tick by tick, as the structs lie in memory (little-endian, 8-byte doubles). */
#ifndef SPIDAR_LOG_H
#define SPIDAR_LOG_H

#include <stdio.h>

#include "mission.h"

/* After sp_log_head: of a flight the configuration, sp_log_start, sp_log_input; of a crawl the configuration, the first
 * state, moves up to one of −1 cycles, sp_log_input; of a run the mission, and (input, output, sp_log_clock) of every
 * tick. Of the first two `runner replay` writes sp_log_output, tick by tick. */
int sp_replay(FILE *in, FILE *out, int *ticks, int *differ);

#endif
