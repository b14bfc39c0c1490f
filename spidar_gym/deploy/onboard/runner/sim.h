/* The simulated robot over a socket: it says who it is, then sp_loop_input, and hears sp_loop_output, tick by tick. */
#ifndef SPIDAR_SIM_H
#define SPIDAR_SIM_H

#include "contract.h"

/* The first thing that the simulator says. */
typedef struct {
    char interface[32], model[72];
    char names[SP_NAMES][24];
    int32_t name_count, unused;
    double rates[SP_TOPICS]; /* [Hz] */
} sp_sim_hello;

int sp_sim(const char *place, const char *mission, const char *log, int residual);

#endif
