/* `replay IN OUT` computes the outputs of recorded inputs again; `compare OUT GOLDEN` compares outputs. */
#define _POSIX_C_SOURCE 200112L
#include <string.h>
#include <sys/stat.h>

#include "runner.h"

#define READ(x) (fread(&(x), sizeof(x), 1, in) == 1)
#define WRITE(x) (fwrite(&(x), sizeof(x), 1, out) == 1)

static const char NO_LOG[] = "no log; valid: one that `spidar export` or this runner wrote";
static const char ENDS_EARLY[] = "the log ends early; valid: a whole one";
static const char IMPOSSIBLE[] = "the log needs what this export lacks; valid: a log of this export";
static const char UNWRITABLE[] = "cannot write the output; valid: a path in a writable folder";

const char *sp_recorded_begin(FILE *in, const sp_parameters *p, sp_recorded *r)
{
    if (!READ(r->head) || memcmp(r->head.magic, SP_LOG_MAGIC, sizeof r->head.magic) != 0) return NO_LOG;
    if (memcmp(r->head.interface, SP_RUNNER_INTERFACE, sizeof r->head.interface) != 0)
        return "the log is of another interface; valid: one of this export";
    r->robot = &p->robot;
    if (r->head.kind != SP_LOG_RUN && memcmp(r->head.model, p->model, sizeof p->model) != 0)
        return "the log is of another robot; valid: --parameters with a file of that robot";
    if (r->head.kind == SP_LOG_FLIGHT) {
        sp_controller_config config;
        sp_log_start start;
        if (!READ(config) || !READ(start)) return ENDS_EARLY;
        sp_flight_init(&r->flight, &config);
        sp_flight_reset(r->robot, &r->flight, &start.state, start.joint_position, start.has_trim ? start.trim : NULL);
    } else if (r->head.kind != SP_LOG_RUN) {
        sp_crawler_config config;
        sp_robot_state state;
        sp_move move;
        if (!READ(config) || !READ(state)) return ENDS_EARLY;
        sp_crawl_init(r->robot, &r->crawl, &config);
        sp_crawl_reset(&r->crawl, &state);
        for (;;) {
            if (!READ(move)) return ENDS_EARLY;
            if (move.cycles < 0) break;
            if (!sp_gait_move(r->robot, &r->crawl, move.way, move.cycles)) return IMPOSSIBLE;
        }
    }
    return NULL;
}

const sp_allocation *sp_recorded_tick(sp_recorded *r, const sp_log_input *input, sp_command *command)
{
    const sp_residual *residual = input->has_residual ? &input->residual : NULL;
    if (r->head.kind == SP_LOG_FLIGHT) {
        sp_flight_step(&r->flight, &input->state, &input->reference, residual, NULL, NULL, sp_own_room(r->robot), command);
        return &r->flight.allocation;
    }
    sp_crawl_step(&r->crawl, &input->state, residual, sp_own_room(r->robot), command);
    return &r->crawl.allocation;
}

/* Replay a flight's or a crawl's inputs. */
static const char *replay_controller(FILE *in, FILE *out, sp_recorded *recorded)
{
    sp_log_input input;
    sp_log_output line;
    for (int k = 0; k < recorded->head.ticks; k++) {
        if (!READ(input)) return ENDS_EARLY;
        memset(&line, 0, sizeof line);
        const sp_allocation *a = sp_recorded_tick(recorded, &input, &line.command);
        memcpy(line.forces_l, a->forces_l, sizeof line.forces_l);
        line.status = a->status;
        line.iterations = a->iterations;
        if (!WRITE(line)) return UNWRITABLE;
    }
    return NULL;
}

static int within(int32_t count, int32_t most) { return count >= 0 && count <= most; }

/* Whether the excitations of a log name joints and modules that exist. */
static int known_excitations(const sp_mission *m)
{
    for (int k = 0; k < m->excitation_count; k++)
        if (!within(m->excitations[k].index, m->excitations[k].excited == SP_EXCITED_JOINT ? SP_JOINTS - 1 : SP_ROTORS - 1))
            return 0;
    return 1;
}

/* Replay a run; counts its ticks, and those that differ. The same runner reproduces the log byte for byte. */
static const char *replay_run(FILE *in, FILE *out, const sp_log_head *head, int *ticks, int *differ)
{
    static sp_loop loop;
    static sp_mission mission;
    sp_loop_input input;
    sp_loop_output was, is;
    sp_log_clock clock;
    if (!READ(mission) || !within(mission.form_count, SP_MAX_FORMS) || !within(mission.window_count, SP_MAX_WINDOWS) ||
        !within(mission.move_count, SP_MAX_MOVES) || !within(mission.order_count, SP_MAX_WAYPOINTS) ||
        !within(mission.heading_count, SP_MAX_HEADINGS) || !within(mission.excitation_count, SP_MAX_EXCITATIONS) ||
        !within(mission.map.count, SP_MAX_GATES) || !known_excitations(&mission))
        return ENDS_EARLY;
    if (sp_refuse_robot(&mission.robot) != NULL || sp_loop_init(&loop, &mission) != NULL) return IMPOSSIBLE;
    if (!WRITE(*head) || !WRITE(mission)) return UNWRITABLE;
    for (;;) {
        size_t got = fread(&input, 1, sizeof input, in);
        if (got == 0) return NULL;
        if (got < sizeof input || !READ(was) || !READ(clock) || !within(input.measurement.pose_count, SP_POSE_FRAMES) ||
            !within(input.measurement.imu_count, SP_IMU_SAMPLES))
            return ENDS_EARLY;
        sp_loop_tick(&loop, &input, &is);
        *differ += memcmp(&was, &is, sizeof is) != 0;
        ++*ticks;
        if (!WRITE(input) || !WRITE(is) || !WRITE(clock)) return UNWRITABLE;
    }
}

/* Whether two paths name the same file. */
static int same(const char *a, const char *b)
{
    struct stat x, y;
    return stat(a, &x) == 0 && stat(b, &y) == 0 && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

int sp_replay(const sp_parameters *p, int given, const char *from, const char *to)
{
    static sp_recorded recorded;
    int ticks = 0, differ = 0;
    FILE *in = fopen(from, "rb"), *out = NULL;
    const char *why = in == NULL ? NO_LOG : same(from, to) ? "the output is the log itself; valid: another file" : NULL;
    if (why == NULL && (out = fopen(to, "wb")) == NULL) why = UNWRITABLE;
    if (why == NULL) why = sp_recorded_begin(in, p, &recorded);
    if (why == NULL && given && recorded.head.kind == SP_LOG_RUN &&
        memcmp(recorded.head.parameters, p->sha256, sizeof p->sha256) != 0)
        why = "the run had other parameters; valid: no --parameters, as the log of a run has its own";
    if (why == NULL)
        why = recorded.head.kind == SP_LOG_RUN ? replay_run(in, out, &recorded.head, &ticks, &differ)
                                               : replay_controller(in, out, &recorded);
    if (in != NULL) fclose(in);
    if (out != NULL && fclose(out) != 0 && why == NULL) why = UNWRITABLE;
    if (out != NULL && why != NULL) remove(to);
    if (why != NULL) return sp_reject("", why);
    if (ticks > 0) printf("%d ticks of a run, %d with other answers\n", ticks, differ);
    return differ > 0 ? sp_reject("", "the replay differs; valid: the runner that wrote the log") : 0;
}

int sp_compare(const char *a, const char *b)
{
    FILE *one = fopen(a, "rb"), *two = fopen(b, "rb");
    double worst = 0.0;
    int ticks = 0, whole = one != NULL && two != NULL;
    sp_log_output x, y;
    while (whole) {
        size_t left = fread(&x, sizeof x, 1, one), right = fread(&y, sizeof y, 1, two);
        if (left != right) whole = 0;
        if (left != 1 || right != 1) break;
        const double *p = (const double *)&x.command, *q = (const double *)&y.command;
        for (size_t k = 0; k < (sizeof x.command + sizeof x.forces_l) / sizeof(double); k++) {
            double d = p[k] - q[k];
            if (!(d <= worst && -d <= worst)) worst = d < 0 ? -d : d;
        }
        ticks++;
    }
    if (one != NULL) fclose(one);
    if (two != NULL) fclose(two);
    if (!whole) return sp_reject("", ENDS_EARLY);
    printf("%d ticks, largest difference %.3g\n", ticks, worst);
    return worst <= 1e-6 ? 0 : sp_reject("", "an output differs from the golden one by more than 1e-6");
}
