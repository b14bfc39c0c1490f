/* The modes of the runner: each returns the exit status. */
#ifndef SPIDAR_RUNNER_MODES_H
#define SPIDAR_RUNNER_MODES_H

#ifdef __cplusplus
extern "C" {
#endif
/* The core on recorded inputs: the same log gives the same bytes on every machine. Of a flight or a crawl it writes
 * sp_log_output, tick by tick; of a run the run again. */
int sp_replay(const char *from, const char *to);
/* The largest difference of two outputs. */
int sp_compare(const char *one, const char *two);
/* How long a tick takes. */
int sp_bench(const char *log);
/* A simulated robot over a socket: it says who it is, then sp_loop_input, and hears sp_loop_output, tick by tick. */
int sp_sim(const char *place, const char *mission, const char *log, int residual);
/* Drive the robot of `robot_ns` after a mission's file until it is given back; commands go out under `out_ns`, which is
 * `robot_ns` or, for a dry run, another. `log` may be NULL. */
int sp_ros1(const char *mission, const char *robot_ns, const char *out_ns, const char *log, int residual);
#ifdef __cplusplus
}
#endif

#endif
