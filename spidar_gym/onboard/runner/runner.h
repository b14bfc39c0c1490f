/* The runner: what its files share. Its structs and words are generated, in spidar_runner.h. */
#ifndef SPIDAR_RUNNER_PROGRAM_H
#define SPIDAR_RUNNER_PROGRAM_H

#include <stddef.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

#include "spidar_core.h"
#include "spidar_runner.h"

/* words.c: a line of text as words, and words as numbers. */
#define SP_WORDS 28 /* of a line, and one more is too many */
int sp_split(char *line, char **words); /* its words, comment left out: how many, −1 for too many */
int sp_numbers(char **words, int count, int n, double *values); /* words 1 … n; 0 where one is none or there are others */

/* mission.c: read a mission's text; 1, or 0 and a sentence that says what would have been valid. */
int sp_read_mission(const char *text, sp_mission *mission, char *reason, size_t size);

/* orders.c: what the manager of both gaits is told. Sentences say what would have been valid, NULL that nothing is wrong. */
int sp_is_order(const char *word);
const char *sp_read_order(const sp_mission *mission, char **words, int count, sp_waypoint *order);
const char *sp_cannot_follow(int32_t kind, int *airborne); /* `airborne` before it becomes that behind it */
/* Whether these can follow on what is still to do, or `now` on what the robot is doing. */
const char *sp_refuse_orders(const sp_manager *manager, const sp_robot_state *state, const sp_waypoint *orders, int n, int now);
/* Lines of orders, the first of them `now` where they interrupt; all of them, or none. */
const char *sp_take_orders(sp_manager *manager, const sp_mission *mission, const sp_robot_state *state, const char *text);

/* map.c: gates and goal of a course, as lines of a mission; what would have been valid, or NULL. */
const char *sp_read_gate(sp_mission *mission, char **words, int count);
const char *sp_read_goal(sp_mission *mission, char **words, int count);
const char *sp_refuse_map(const sp_mission *mission);
void sp_go_by_map(sp_loop *loop); /* before the manager's tick: twice a second, what it is told */

/* sense.c: check the samples, estimate the state; what is wrong. */
#define SP_AHEAD 0.05 /* a stamp may be so far in the future [s] */
void sp_sense_init(sp_sense *sense, const sp_mission *mission);
sp_fault sp_sense_update(sp_sense *sense, const sp_mission *mission, const sp_loop_input *input, const double *thrust);

/* hold.c: which commands may leave, and how long old ones stay in force where none does. */
int sp_thrust_within_limits(const double *thrust); /* of every rotor */
/* Old commands may be in force for 100 ms; good ticks give back as much as they last, so that a fault which comes and goes
 * ends in the landing too. */
void sp_hold(sp_loop *loop, double time, sp_fault fault);
/* Take a controller's command, if it may leave; what is wrong with it. */
sp_fault sp_answer(sp_loop *loop, const sp_allocation *allocation, const sp_command *command);

/* loop.c: the runner's tick: check what came in, estimate, control, and know when to stop. A pure function of its
 * inputs. */
const char *sp_loop_init(sp_loop *loop, const sp_mission *mission); /* NULL, or why the mission is refused */
void sp_loop_tick(sp_loop *loop, const sp_loop_input *input, sp_loop_output *output);
const char *sp_fault_words(int32_t fault);
const char *sp_stage_words(int32_t stage);

/* course_drive.c: the tick of a mission of both gaits; NULL, or why it is refused. */
const char *sp_course_init(sp_loop *loop);
const char *sp_course_begin(sp_loop *loop, const sp_robot_state *state);
void sp_course_tick(sp_loop *loop, const sp_loop_input *input, sp_fault fault);
int sp_sees_with(sp_fault fault); /* whether the state is as good as ever: then the manager brings the robot to rest */
void sp_say_why(sp_loop *loop, const char *why); /* refuse the orders that came */
const char *sp_phase_words(int32_t manager_phase);

/* room.c: of the whole program. */
sp_room *sp_own_room(void);

/* contract.c: what the robot has to be, asked before anything is sent to it: the same model, the same joints, topics at
 * their rates; 1, or 0 and a sentence. `odometry` as in the mission. */
typedef struct {
    const char *model;        /* its model's SHA-256; NULL where it does not say */
    int32_t name_count;
    const char *const *names; /* of `joint_states` */
    double rates[SP_TOPICS];  /* measured [Hz]; 0 where nothing came */
} sp_found;
int sp_agree(const sp_found *robot, int32_t odometry, char *reason, size_t size);

/* run.c: a loop with its log and its clock: what every link drives. */
#define SP_BINS 400
typedef struct {
    sp_loop loop;
    FILE *log; /* NULL where nobody wants one */
    const char *path; /* of the log */
    int32_t ticks, late, stage, fault, finished, phase, lost; /* lost: the log ends before the run */
    double worst, worst_wait;      /* of a tick's computing, of a tick's start after its due time [us] */
    int32_t times[SP_BINS], waits[SP_BINS]; /* histograms, 10 us a bin */
} sp_run;
double sp_microseconds(void); /* of a clock that only goes on */
/* Say on stderr what is rejected, and why with what would have been valid; the exit status 2. */
int sp_reject(const char *what, const char *why);
/* Read the mission, open the log; 0, or 2 after a line on stderr. `log` may be NULL. */
int sp_run_open(sp_run *run, const char *mission, const char *log, int residual);
/* One tick; logged, timed. `wait` is how late it began [us], negative where there is no clock to be late for. */
void sp_run_tick(sp_run *run, const sp_loop_input *input, sp_loop_output *output, double wait);
/* Statistics on stdout, log closed; the exit status: 0, 1 where a fault ended the drive, 2 where the log is not whole. */
int sp_run_close(sp_run *run);

/* replay.c: logs are what went in and what came out, tick by tick, as the structs lie in memory (little-endian, 8-byte
 * doubles). After sp_log_head: of a flight the configuration, sp_log_start, sp_log_input; of a crawl the configuration,
 * the first state, moves up to one of −1 cycles, sp_log_input; of a run the mission, and (input, output, sp_log_clock)
 * of every tick. Of the first two `runner replay` writes sp_log_output, tick by tick. */
typedef struct {
    sp_log_head head;
    sp_flight flight; /* one of the controllers, as the log has it */
    sp_crawl crawl;
} sp_recorded;
/* Read up to the first tick, of a run the head alone; NULL, or what is wrong with the log. */
const char *sp_recorded_begin(FILE *in, sp_recorded *recorded);
const sp_allocation *sp_recorded_tick(sp_recorded *recorded, const sp_log_input *input, sp_command *command);

/* The modes, a file each but for `compare`, which is in replay.c; the exit status. */
int sp_replay(const char *from, const char *to);
int sp_compare(const char *one, const char *two);
int sp_bench(const char *log);
int sp_sim(const char *place, const char *mission, const char *log, int residual);
/* Drive the robot of `robot_ns` after a mission's file until it is given back; commands go out under `out_ns`, which is
 * `robot_ns` or, for a dry run, another. `log` may be NULL. */
int sp_ros1(const char *mission, const char *robot_ns, const char *out_ns, const char *log, int residual);

#ifdef __cplusplus
}
#endif

#endif
