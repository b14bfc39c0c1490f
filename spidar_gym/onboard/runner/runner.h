/* Declarations shared by the runner's files. Structs and messages are generated in spidar_runner.h. */
#ifndef SPIDAR_RUNNER_PROGRAM_H
#define SPIDAR_RUNNER_PROGRAM_H

#include <stddef.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

#include "spidar_core.h"
#include "spidar_runner.h"

/* sha256.c */
void sp_sha256(const void *data, size_t size, char *hex); /* 64 digits and a zero */

/* parameters.c: robot, gains and limits. */
void sp_compiled_parameters(sp_parameters *p); /* those of the export */
/* Read a parameter file's text, which is changed; returns 1, or 0 and a sentence. The compiled presets that the file does
 * not have are added. */
int sp_read_parameters(char *text, sp_parameters *p, char *reason, size_t size);
/* Read a file, or take the compiled parameters without a path; returns 0, or 2 after a line on stderr. */
int sp_load_parameters(const char *path, sp_parameters *p);
const sp_controller_config *sp_find_flight(const sp_parameters *p, const char *name); /* NULL: there is none */
const sp_crawler_config *sp_find_crawl(const sp_parameters *p, const char *name);
const char *sp_refuse_robot(const sp_robot *robot); /* what a possible robot would have, or NULL */
int sp_is_own_robot(const sp_robot *robot); /* whether it is the compiled one */

/* words.c: texts. */
/* Print on stderr what is rejected, and what would have been valid; returns the exit status 2. */
int sp_reject(const char *what, const char *why);
/* Read a whole text file of at most `most` characters; returns NULL on failure, else memory to be freed. */
char *sp_read_text(const char *path, size_t most);
#define SP_WORDS 28 /* most words of a line */
int sp_split(char *line, char **words); /* without the comment; returns their number, −1 if too many */
int sp_numbers(char **words, int count, int n, double *values); /* words 1 … n; 0 if not n numbers follow */

/* mission.c: read a mission's text; returns 1, or 0 and a sentence with what would have been valid. */
int sp_read_mission(const char *text, const sp_parameters *p, sp_mission *mission, char *reason, size_t size);

/* excite.c: signals that are added to a hover or on a bench, to identify the robot. */
const char *sp_read_excitation(sp_mission *mission, char **words, int count); /* what would have been valid, or NULL */
void sp_excite(const sp_mission *mission, sp_excited excited, double t, double *values); /* add those at a time [s] */
int sp_is_strained(const sp_loop *loop); /* whether a joint is farther from its command than the mission allows */
int sp_is_over(const sp_loop *loop); /* whether forms and excitations were ended early */
void sp_next_form(sp_loop *loop, double t); /* the mission's target of the joints, with excitations, at a time [s] */

/* orders.c: orders for the manager of both gaits. Functions return what would have been valid, or NULL if all is. */
int sp_is_order(const char *word);
const char *sp_read_order(const sp_mission *mission, char **words, int count, sp_waypoint *order);
/* Check whether orders can follow the pending ones or, with `now`, the robot's present motion. */
const char *sp_refuse_orders(const sp_robot *robot, const sp_manager *manager, const sp_robot_state *state,
                             const sp_waypoint *orders, int n, int now);
/* Pass lines of orders to the manager, all or none. If the first line is `now`, they replace the pending orders. */
const char *sp_take_orders(sp_manager *manager, const sp_mission *mission, const sp_robot_state *state, const char *text);

/* map.c: gates and goal of a course, from lines of a mission. Functions return what would have been valid, or NULL. */
const char *sp_read_gate(sp_mission *mission, char **words, int count);
const char *sp_read_goal(sp_mission *mission, char **words, int count);
const char *sp_refuse_map(const sp_mission *mission);
void sp_go_by_map(sp_loop *loop); /* before the manager's tick: commands it twice a second */

/* sense.c: check the samples and estimate the state; returns the fault. */
#define SP_AHEAD 0.05 /* largest lead of a stamp over the clock [s] */
void sp_sense_init(sp_sense *sense, const sp_mission *mission);
sp_fault sp_sense_update(sp_sense *sense, const sp_mission *mission, const sp_loop_input *input, const double *thrust);

/* health.c: the robot's health. */
const char *sp_read_health(sp_mission *mission, char **words, int count); /* what would have been valid, or NULL */
void sp_health_init(sp_health *health);
/* Take the newest messages, `since` seconds after the last tick; returns the worst fault. */
sp_fault sp_health_update(sp_health *health, const sp_mission *mission, const sp_health_input *input, double now, double since);
int sp_ends_mission(sp_fault fault); /* whether a fault ends the mission while the robot can still be controlled */

/* hold.c: limits of commands, and how long an old command is held. */
int sp_thrust_within_limits(const sp_robot *robot, const double *thrust); /* of every rotor */
/* Update the time for which old commands have been in force, at most 100 ms. A good tick only reduces it by the tick's
 * length, so that an intermittent fault leads to the landing too. */
void sp_hold(sp_loop *loop, double time, sp_fault fault);
/* Update the mean of Σλ that carries the robot, from a new command; on the floor the mean is this Σλ. */
void sp_note_carried(sp_loop *loop, int airborne);
/* Reduce the held command to that mean if its Σλ is larger: the board's landing begins with it, and a command of the
 * last ticks, from measurements that had already stopped, would lift the robot by metres. */
void sp_hold_level(sp_loop *loop);
/* Accept a controller's command if it is within limits, at most the thrust at this voltage; returns the fault. */
sp_fault sp_answer(sp_loop *loop, const sp_allocation *allocation, const sp_command *command);

/* loop.c: the runner's tick: check the input, estimate, control, stop. A pure function of its inputs. */
const char *sp_loop_init(sp_loop *loop, const sp_mission *mission); /* NULL, or why the mission is refused */
void sp_loop_tick(sp_loop *loop, const sp_loop_input *input, sp_loop_output *output);
const char *sp_fault_words(int32_t fault);
const char *sp_stage_words(int32_t stage);

/* course_drive.c: tick of a mission of both gaits. `init` and `begin` return NULL, or why the mission is refused. */
const char *sp_course_init(sp_loop *loop);
const char *sp_course_begin(sp_loop *loop, const sp_robot_state *state);
void sp_course_tick(sp_loop *loop, const sp_loop_input *input, sp_fault fault);
int sp_sees_with(sp_fault fault); /* whether the state is still valid: then the manager brings the robot to rest */
void sp_say_why(sp_loop *loop, const char *why); /* refuse the orders that came */
const char *sp_phase_words(int32_t manager_phase);

/* bench_drive.c: tick of a bench test: joints of a robot that is clamped to a stand, without thrust. */
void sp_bench_begin(sp_loop *loop, const sp_robot_state *state);
void sp_bench_tick(sp_loop *loop, const sp_loop_input *input, sp_fault fault);

/* room.c: workspace of the program, for a tick of a robot. */
sp_room *sp_own_room(const sp_robot *robot);

/* contract.c: check the robot before anything is sent to it: model, joint names, topic rates. Returns 1, or 0 and a
 * sentence. `model` as in the parameters, `odometry` as in the mission. */
typedef struct {
    const char *model;        /* SHA-256 of its model; NULL if not set */
    int32_t name_count;
    const char *const *names; /* of `joint_states` */
    double rates[SP_TOPICS];  /* measured [Hz]; 0 without messages */
} sp_found;
int sp_agree(const sp_found *robot, const char *model, int32_t odometry, char *reason, size_t size);
void sp_say_absent(const sp_found *robot); /* print a line for the topics about health that the robot lacks, if any */

/* run.c: a loop with log and statistics, used by every link. */
#define SP_BINS 400
typedef struct {
    sp_loop loop;
    const sp_parameters *parameters;
    FILE *log; /* NULL without a log */
    const char *path; /* of the log */
    int32_t ticks, late, stage, fault, finished, aborted, phase, lost; /* lost: the log is incomplete */
    double worst, worst_wait;      /* of a tick's computing time, of a tick's delay [us] */
    int32_t times[SP_BINS], waits[SP_BINS]; /* histograms, 10 us a bin */
} sp_run;
double sp_microseconds(void); /* of a monotonic clock */
double sp_control_rate(void); /* of the ticks [Hz]; C++ before C++17 cannot read the constant */
/* Read the mission and open the log; returns 0, or 2 after a line on stderr. `log` may be NULL. */
int sp_run_open(sp_run *run, const sp_parameters *p, const char *mission, const char *log, int residual);
/* Run, time and log a tick. `wait` is its delay [us], negative without a clock. */
void sp_run_tick(sp_run *run, const sp_loop_input *input, sp_loop_output *output, double wait);
/* Print statistics, close the log; returns the exit status: 0, 1 after a fault, 2 if the log is incomplete. */
int sp_run_close(sp_run *run);

/* replay.c: a log holds the structs as they lie in memory (little-endian, 8-byte doubles). After sp_log_head follow
 *   flight: configuration, sp_log_start, then sp_log_input per tick;
 *   crawl: configuration, first state, moves up to one of −1 cycles, then sp_log_input per tick;
 *   run: mission, then input, output and sp_log_clock per tick.
 * A run's mission has robot, gains and limits; a flight or crawl is replayed with those of the program, whose robot must
 * be that of the head. For flights and crawls `runner replay` writes an sp_log_output per tick. */
typedef struct {
    sp_log_head head;
    const sp_robot *robot; /* of a flight or a crawl */
    sp_flight flight; /* the log's kind of controller is used */
    sp_crawl crawl;
} sp_recorded;
/* Read up to the first tick (of a run only the head); returns NULL, or the log's error. */
const char *sp_recorded_begin(FILE *in, const sp_parameters *p, sp_recorded *recorded);
const sp_allocation *sp_recorded_tick(sp_recorded *recorded, const sp_log_input *input, sp_command *command);

/* Modes, a file each (`compare` is in replay.c); return the exit status. */
int sp_replay(const sp_parameters *p, int given, const char *from, const char *to); /* given: by a file */
int sp_compare(const char *one, const char *two);
int sp_bench(const sp_parameters *p, const char *log);
int sp_sim(const sp_parameters *p, const char *place, const char *mission, const char *log, int residual);
/* Drive the robot of the namespace `robot_ns` by a mission file until the robot is released. Commands are published
 * under `out_ns`, which differs from `robot_ns` in a dry run. `log` may be NULL. */
int sp_ros1(const sp_parameters *p, const char *mission, const char *robot_ns, const char *out_ns, const char *log,
            int residual);

#ifdef __cplusplus
}
#endif

#endif
