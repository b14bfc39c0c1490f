/* `bench IN`: time the ticks of a log, the hardest demands and the export's policy; count instructions if the kernel
 * allows it. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef __linux__
#include <linux/perf_event.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

#include "runner.h"
#include "spidar_math.h"

#define TICKS 20000
#define HARD 200

/* Measured cost of one kind of tick. */
typedef struct {
    double times[TICKS], counts[TICKS]; /* [us], instructions */
    int n;
} cost;

static int counter = -1; /* file descriptor of the kernel's instruction counter, −1 without */

static void open_counter(void)
{
#ifdef __linux__
    struct perf_event_attr what;
    memset(&what, 0, sizeof what);
    what.type = PERF_TYPE_HARDWARE;
    what.size = sizeof what;
    what.config = PERF_COUNT_HW_INSTRUCTIONS;
    what.exclude_kernel = 1;
    counter = (int)syscall(SYS_perf_event_open, &what, 0, -1, -1, 0);
#endif
}

static double instructions(void)
{
    long long count = 0;
#ifdef __linux__
    if (counter >= 0 && read(counter, &count, sizeof count) != (ssize_t)sizeof count) count = 0;
#endif
    return (double)count;
}

static double began, counted;

static void start_clock(void)
{
    counted = instructions();
    began = sp_microseconds();
}

static void stop_clock(cost *c)
{
    double time = sp_microseconds() - began;
    if (c->n == TICKS) return;
    c->counts[c->n] = instructions() - counted;
    c->times[c->n++] = time;
}

static int order(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void report(const char *name, cost *c)
{
    if (c->n == 0) return;
    qsort(c->times, (size_t)c->n, sizeof c->times[0], order);
    qsort(c->counts, (size_t)c->n, sizeof c->counts[0], order);
    printf("%-34s %6d ticks   median %8.1f   p99 %8.1f   worst %8.1f us", name, c->n, c->times[c->n / 2],
           c->times[c->n * 99 / 100], c->times[c->n - 1]);
    if (counter >= 0) printf("   %9.0f / %9.0f instructions", c->counts[c->n / 2], c->counts[c->n - 1]);
    printf("\n");
}

/* Time infeasible demands: closed form, attempts up to the iteration cap, softened program up to its own. */
static void bench_hardest(const sp_robot *robot, const sp_mode *mode, const sp_demand *demand, const double *previous_l,
                          const sp_allocator_config *config, cost *c)
{
    static sp_allocation answer;
    int most = 0;
    for (int k = 0; k < HARD; k++) {
        sp_demand asked = *demand;
        for (int r = 0; r < 6; r++) asked.wrench[r] *= 1.0 + 0.02 * k * (r % 2 ? -1.0 : 1.0);
        asked.wrench[3] += 0.3 * k;
        for (int j = 0; j < SP_JOINTS; j++) asked.gravity_torque[j] *= 1.0 + 0.05 * k;
        start_clock();
        sp_allocate(mode, &asked, previous_l, NULL, 0, config, sp_own_room(robot), &answer);
        stop_clock(c);
        if (answer.iterations > most) most = answer.iterations;
    }
    report("hardest demands, allocation alone", c);
    printf("%-34s %6d, cap %d an attempt\n", "most iterations of a tick", most, (int)config->max_iter);
}

/* Time the ticks of a flight or crawl, then demands around one tick: a crawl's hardest, a flight's last. */
static int bench_ticks(FILE *in, sp_recorded *recorded, cost *whole, cost *hardest)
{
    static sp_demand demand;
    const sp_mode *mode = NULL;
    const int flies = recorded->head.kind == SP_LOG_FLIGHT;
    sp_flight *f = &recorded->flight;
    sp_crawl *c = &recorded->crawl;
    sp_log_input input;
    sp_command command;
    int32_t most = -1;
    for (int k = 0; k < recorded->head.ticks && fread(&input, sizeof input, 1, in) == 1; k++) {
        start_clock();
        const sp_allocation *a = sp_recorded_tick(recorded, &input, &command);
        stop_clock(whole);
        if (flies || a->iterations > most) {
            most = a->iterations;
            mode = flies ? &f->mode : &c->modes[c->memory.mode];
            demand = flies ? f->demand : c->demand;
        }
    }
    if (mode == NULL) return 0;
    report(flies ? "flight, whole ticks" : "crawl, whole ticks", whole);
    bench_hardest(recorded->robot, mode, &demand, flies ? f->memory.forces_l : c->memory.forces_l,
                  flies ? &f->config.allocator : &c->config.allocator, hardest);
    return 1;
}

/* Time the ticks of a flight or crawl with the export's learned policy: a residual, or a policy without controller. */
static void bench_policy(FILE *in, const sp_parameters *p, sp_recorded *recorded, cost *c)
{
    static sp_policy policy;
    static const double goal[3] = {0.6, 0.0, 0.0};
    const int kind = sp_policy_kind(), crawls = recorded->head.kind == SP_LOG_CRAWL;
    const int direct = kind == (crawls ? SP_POLICY_CRAWL_DIRECT : SP_POLICY_DIRECT);
    sp_flight *f = &recorded->flight;
    sp_crawl *own = &recorded->crawl;
    sp_log_input input;
    sp_command command;
    sp_control_state control;
    sp_preview preview;
    sp_residual residual;
    if (!direct && kind != (crawls ? SP_POLICY_CRAWL : SP_POLICY_FLIGHT)) return;
    rewind(in);
    if (sp_recorded_begin(in, p, recorded) != NULL) return;
    sp_policy_reset(&policy);
    for (int k = 0; k < recorded->head.ticks && fread(&input, sizeof input, 1, in) == 1; k++) {
        const sp_robot_state *x = &input.state;
        sp_copy(preview.joint_target, input.reference.joint_target, SP_JOINTS);
        sp_copy(preview.next_form, input.reference.joint_target, SP_JOINTS);
        preview.time_to_next = SP_NO_NEXT_FORM;
        start_clock();
        if (!crawls) sp_compute_state(recorded->robot, x, &input.reference, &control);
        if (crawls && direct) {
            sp_policy_crawl_direct(recorded->robot, &policy, own, x, goal, &command);
        } else if (crawls) {
            sp_policy_crawl(recorded->robot, &policy, own, x, goal, &residual);
            sp_crawl_step(own, x, &residual, sp_own_room(recorded->robot), &command);
        } else if (direct) {
            sp_policy_direct(recorded->robot, &policy, f, x, &control, &preview, &command);
        } else {
            sp_policy_flight(recorded->robot, &policy, f, x, &control, &preview, &residual);
            sp_flight_step(f, x, &input.reference, &residual, &control, NULL, sp_own_room(recorded->robot), &command);
        }
        stop_clock(c);
    }
    const char *added = crawls ? "crawl with the residual" : "flight with the residual";
    report(direct ? "policy in place of the controller" : added, c);
}

int sp_bench(const sp_parameters *p, const char *path)
{
    static cost whole, worst, learned;
    static sp_recorded recorded;
    FILE *in = fopen(path, "rb");
    open_counter();
    int fits = in != NULL && sp_recorded_begin(in, p, &recorded) == NULL && recorded.head.kind != SP_LOG_RUN &&
               bench_ticks(in, &recorded, &whole, &worst);
    if (fits) bench_policy(in, p, &recorded, &learned);
    if (in != NULL) fclose(in);
    if (!fits)
        return sp_reject("", "bench needs a log of a flight or a crawl; valid: golden/flight.in, golden/crawl.in");
    double slowest = whole.times[whole.n - 1] + worst.times[worst.n - 1];
    printf("%-34s %8.1f us of the paper's 5000 us\n", "worst of both together", slowest);
    if (counter < 0) printf("instructions: not counted here; valgrind --tool=callgrind --toggle-collect=sp_allocate does\n");
    printf("not tested: a Jetson TX2, a flight controller, a servo; on the robot's computer, run this there\n");
    return 0;
}
