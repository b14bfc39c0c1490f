/* `bench IN`: the log's ticks, timed: median, 99th percentile and worst; and a softened tick at the iteration cap. */
#define _POSIX_C_SOURCE 199309L
#include "bench.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "log.h"

#define TICKS 20000

static double times[TICKS];

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

static int order(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void report(const char *name, int count)
{
    qsort(times, (size_t)count, sizeof times[0], order);
    printf("%-28s %6d ticks   median %8.1f   p99 %8.1f   worst %8.1f us\n", name, count, times[count / 2],
           times[count * 99 / 100], times[count - 1]);
}

/* Demands that no force meets: closed form, two attempts at the cap, then the softened program. */
static int hard(const sp_controller_config *config, const sp_log_input *input)
{
    static sp_flight flight;
    static sp_allocation answer;
    int most = 0;
    sp_command command;
    sp_flight_init(&flight, config);
    sp_flight_reset(&flight, &input->state, NULL, NULL);
    sp_flight_step(&flight, &input->state, &input->reference, NULL, NULL, &command);
    for (int k = 0; k < 200; k++) {
        sp_demand demand = flight.demand;
        for (int r = 0; r < 6; r++) demand.wrench[r] *= 1.0 + 0.02 * k * (r % 2 ? -1.0 : 1.0);
        demand.wrench[3] += 0.3 * k;
        double start = now();
        sp_allocate(&flight.mode, &demand, flight.memory.forces_l, NULL, 0, 0, &config->allocator, &flight.room, &answer);
        times[k] = now() - start;
        if (answer.iterations > most) most = answer.iterations;
    }
    report("hard demands, allocation", 200);
    printf("%-28s %6d of %d an attempt\n", "most iterations", most, config->allocator.max_iter);
    return 0;
}

int sp_bench(const char *path)
{
    static sp_flight flight;
    sp_log_head head;
    sp_controller_config config;
    sp_log_start start;
    sp_log_input input, first = {0};
    sp_command command;
    FILE *in = fopen(path, "rb");
    int count = 0, whole;
    if (in == NULL) return 2;
    whole = fread(&head, sizeof head, 1, in) == 1 && head.kind == SP_LOG_FLIGHT &&
            fread(&config, sizeof config, 1, in) == 1 && fread(&start, sizeof start, 1, in) == 1;
    if (whole) {
        sp_flight_init(&flight, &config);
        sp_flight_reset(&flight, &start.state, start.joint_position, start.has_trim ? start.trim : NULL);
        for (; count < head.ticks && count < TICKS && fread(&input, sizeof input, 1, in) == 1; count++) {
            double begin = now();
            sp_flight_step(&flight, &input.state, &input.reference, NULL, NULL, &command);
            times[count] = now() - begin;
            if (count == 0) first = input;
        }
    }
    fclose(in);
    if (!whole || count == 0) {
        fprintf(stderr, "runner: bench needs a log of a flight\n");
        return 2;
    }
    report("flight, whole tick", count);
    printf("not tested here: a TX2, a flight controller, a servo\n");
    return hard(&config, &first);
}
