/* The runner's tick: check what came in, estimate, control, and know when to stop. A pure function of its inputs. */
#ifndef SPIDAR_LOOP_H
#define SPIDAR_LOOP_H

#include <stddef.h>

#include "spidar_core.h"
#include "spidar_runner.h" /* generated: the runner's words and structs */

#define SP_AHEAD 0.05 /* a stamp may be so far in the future [s] */

/* mission.c: read a mission's text; 1, or 0 and a sentence that says what would have been valid. */
int sp_read_mission(const char *text, sp_mission *mission, char *reason, size_t size);

/* sense.c: check the samples, estimate the state; what is wrong. */
void sp_sense_init(sp_sense *sense, const sp_mission *mission);
sp_fault sp_sense_update(sp_sense *sense, const sp_mission *mission, const sp_loop_input *input, const double *thrust);

/* loop.c */
const char *sp_loop_init(sp_loop *loop, const sp_mission *mission); /* NULL, or why the mission is refused */
void sp_loop_tick(sp_loop *loop, const sp_loop_input *input, sp_loop_output *output);
const char *sp_fault_words(int32_t fault);
const char *sp_stage_words(int32_t stage);

#endif
