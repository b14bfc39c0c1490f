/* Logs: what went in and what came out, tick by tick, as the structs lie in memory (little-endian, 8-byte doubles).
 *
 * After sp_log_head: of a flight the configuration, sp_log_start, sp_log_input; of a crawl the configuration, the first
 * state, moves up to one of −1 cycles, sp_log_input; of a run the mission, and (input, output, sp_log_clock) of every
 * tick.
 */
#ifndef SPIDAR_LOG_H
#define SPIDAR_LOG_H

#include <stdio.h>

#include "loop.h"

/* The controller that a log of a flight or a crawl is of. */
typedef struct {
    sp_log_head head;
    sp_flight flight;
    sp_crawl crawl;
} sp_recorded;

/* Read up to the first tick; NULL, or what is wrong with the log. A run is read no further than its head. */
const char *sp_recorded_begin(FILE *in, sp_recorded *recorded);
/* The controller's next tick. */
const sp_allocation *sp_recorded_tick(sp_recorded *recorded, const sp_log_input *input, sp_command *command);

#endif
