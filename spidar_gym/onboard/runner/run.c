/* Ticks of the loop with log, timing and messages. */
#define _POSIX_C_SOURCE 199309L
#include "runner.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#define MOST 65535 /* characters of a mission */

double sp_microseconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

double sp_control_rate(void) { return SP_CONTROL_RATE; }

/* Write the log's head and the mission. */
static int begin_log(sp_run *run)
{
    sp_log_head head;
    memset(&head, 0, sizeof head);
    memcpy(head.magic, SP_LOG_MAGIC, sizeof head.magic);
    memcpy(head.interface, SP_RUNNER_INTERFACE, sizeof head.interface);
    memcpy(head.model, run->parameters->model, sizeof head.model);
    memcpy(head.parameters, run->parameters->sha256, sizeof head.parameters);
    head.kind = SP_LOG_RUN;
    fclose(run->log);
    run->log = fopen(run->path, "wb");
    return run->log != NULL && fwrite(&head, sizeof head, 1, run->log) == 1 &&
           fwrite(&run->loop.mission, sizeof run->loop.mission, 1, run->log) == 1 && fflush(run->log) == 0;
}

int sp_run_open(sp_run *run, const sp_parameters *p, const char *mission, const char *log, int residual)
{
    static sp_mission read;
    char reason[256];
    char *text = sp_read_text(mission, MOST);
    memset(run, 0, sizeof *run);
    run->parameters = p;
    if (text == NULL)
        return sp_reject(mission, ": no mission; valid: a text file of at most 65535 characters, see README.md");
    int whole = sp_read_mission(text, p, &read, reason, sizeof reason);
    free(text);
    if (!whole) return sp_reject("", reason);
    if (residual) read.residual = 1;
    const char *why = sp_loop_init(&run->loop, &read);
    if (why != NULL) return sp_reject("", why);
    if (log == NULL) return 0;
    run->log = fopen(log, "ab"); /* a run refused later must not change an older log */
    run->path = log;
    int empty = run->log != NULL && fseek(run->log, 0, SEEK_END) == 0 && ftell(run->log) <= 0;
    if (run->log == NULL || (empty && !begin_log(run)))
        return sp_reject(log, ": cannot be written; valid: a path in a writable folder");
    return 0;
}

static void count(int32_t *bins, double microseconds, double *worst)
{
    int bin = microseconds < 0.0 ? 0 : (int)(microseconds / 10.0);
    bins[bin < SP_BINS ? bin : SP_BINS - 1]++;
    if (microseconds > *worst) *worst = microseconds;
}

void sp_run_tick(sp_run *run, const sp_loop_input *input, sp_loop_output *output, double wait)
{
    sp_log_clock clock;
    double start = sp_microseconds();
    sp_loop_tick(&run->loop, input, output);
    clock.wait_us = wait;
    clock.compute_us = sp_microseconds() - start;
    count(run->times, clock.compute_us, &run->worst);
    if (wait >= 0.0) count(run->waits, wait, &run->worst_wait);
    run->late += wait > 1e6 / SP_CONTROL_RATE;
    run->ticks++;
    if (output->stage != run->stage)
        fprintf(stderr, "runner: %.3f s: %s%s%s\n", input->time, sp_stage_words(output->stage),
                output->fault ? ", " : "", output->fault ? sp_fault_words(output->fault) : "");
    if (output->manager_phase != run->phase)
        fprintf(stderr, "runner: %.3f s: %s\n", input->time, sp_phase_words(output->manager_phase));
    if (output->heard == SP_HEARD_TAKEN) fprintf(stderr, "runner: %.3f s: orders taken\n", input->time);
    if (output->heard == SP_HEARD_REFUSED)
        fprintf(stderr, "runner: %.3f s: orders refused; valid: %s\n", input->time, run->loop.reason);
    if (output->aborted && !run->aborted)
        fprintf(stderr, "runner: %.3f s: the excitations are ended: a joint is too far from its command\n", input->time);
    if (output->finished && !run->finished) fprintf(stderr, "runner: %.3f s: the mission is over\n", input->time);
    run->stage = output->stage;
    run->phase = output->manager_phase;
    run->finished = output->finished;
    run->aborted = output->aborted;
    if (output->fault != SP_FINE) run->fault = output->fault;
    int whole = run->log == NULL || run->ticks > 1 || begin_log(run);
    run->lost |= !whole;
    if (run->log != NULL) { /* flushed every tick: a killed runner leaves whole ticks */
        if (!whole || fwrite(input, sizeof *input, 1, run->log) != 1 || fwrite(output, sizeof *output, 1, run->log) != 1 ||
            fwrite(&clock, sizeof clock, 1, run->log) != 1 || fflush(run->log) != 0) {
            fprintf(stderr, "runner: the log cannot be written any more; the drive continues\n");
            fclose(run->log);
            run->log = NULL;
            run->lost = 1;
        }
    }
}

/* Quantile of a histogram, to 10 us. */
static double quantile(const int32_t *bins, int32_t total, double share)
{
    double sum = 0.0;
    for (int k = 0; k < SP_BINS; k++) {
        sum += bins[k];
        if (sum >= share * total) return 10.0 * (k + 1);
    }
    return 10.0 * SP_BINS;
}

static void line(const char *name, const int32_t *bins, double worst)
{
    int32_t total = 0;
    for (int k = 0; k < SP_BINS; k++) total += bins[k];
    if (total > 0)
        printf("%-26s %6d   median < %5.0f   p99 < %5.0f   worst %8.1f us\n", name, (int)total,
               quantile(bins, total, 0.5), quantile(bins, total, 0.99), worst);
}

int sp_run_close(sp_run *run)
{
    line("computing a tick", run->times, run->worst);
    line("tick after its due time", run->waits, run->worst_wait);
    printf("%d ticks, %d later than a period; %s; %s%s\n", (int)run->ticks, (int)run->late, sp_stage_words(run->stage),
           run->loop.landing > 0 ? "landing forced: " : "last fault: ",
           sp_fault_words(run->loop.landing > 0 ? run->loop.fault : run->fault));
    fflush(stdout);
    if (run->log != NULL && fclose(run->log) != 0) run->lost = 1;
    run->log = NULL;
    return run->lost ? 2 : run->loop.landing > 0 || run->loop.ending != SP_FINE ? 1 : 0;
}
