/* A loop with its log and its clock: what every link drives. */
#ifndef SPIDAR_RUN_H
#define SPIDAR_RUN_H

#include <stdio.h>

#include "loop.h"

#define SP_BINS 400

typedef struct {
    sp_loop loop;
    FILE *log; /* NULL where nobody wants one */
    const char *path; /* of the log */
    int32_t ticks, late, stage, fault, finished, lost; /* lost: the log ends before the run */
    double worst, worst_wait;      /* of a tick's computing, of a tick's start after its due time [us] */
    int32_t times[SP_BINS], waits[SP_BINS]; /* histograms, 10 us a bin */
} sp_run;

#ifdef __cplusplus
extern "C" {
#endif
double sp_microseconds(void); /* of a clock that only goes on */
/* Say on stderr what is rejected, and why with what would have been valid; the exit status 2. */
int sp_reject(const char *what, const char *why);
/* Read the mission, open the log; 0, or 2 after a line on stderr. `log` may be NULL. */
int sp_run_open(sp_run *run, const char *mission, const char *log, int residual);
/* One tick; logged, timed. `wait` is how late it began [us], negative where there is no clock to be late for. */
void sp_run_tick(sp_run *run, const sp_loop_input *input, sp_loop_output *output, double wait);
/* Statistics on stdout, log closed; the exit status: 0, 1 where a fault ended the drive, 2 where the log is not whole. */
int sp_run_close(sp_run *run);
#ifdef __cplusplus
}
#endif

#endif
