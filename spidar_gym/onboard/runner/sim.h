/* The simulated robot over a socket: it says who it is, then sp_loop_input, and hears sp_loop_output, tick by tick. */
#ifndef SPIDAR_SIM_H
#define SPIDAR_SIM_H

int sp_sim(const char *place, const char *mission, const char *log, int residual);

#endif
