/* `replay IN OUT`: the core on recorded inputs; the same log gives the same bytes on every machine. */
#include <string.h>

#include "log.h"
#include "loop.h"

#define READ(x) (fread(&(x), sizeof(x), 1, in) == 1)

static void record_allocation(const sp_allocation *a, sp_log_output *line)
{
    memcpy(line->forces_l, a->forces_l, sizeof line->forces_l);
    line->status = a->status;
    line->iterations = a->iterations;
}

/* A run again: its very bytes, where this is the runner that drove. */
static int replay_run(FILE *in, FILE *out, const sp_log_head *head, int *ticks, int *differ)
{
    static sp_loop loop;
    static sp_mission mission;
    sp_loop_input input;
    sp_loop_output was, is;
    sp_log_clock clock;
    if (!READ(mission)) return 3;
    if (mission.form_count < 0 || mission.form_count > SP_MAX_FORMS || mission.window_count < 0 ||
        mission.window_count > SP_MAX_WINDOWS || mission.move_count < 0 || mission.move_count > SP_MAX_MOVES)
        return 3;
    if (sp_loop_init(&loop, &mission) != NULL) return 4;
    if (fwrite(head, sizeof *head, 1, out) != 1 || fwrite(&mission, sizeof mission, 1, out) != 1) return 5;
    for (;;) {
        size_t got = fread(&input, 1, sizeof input, in);
        if (got == 0) break;
        if (got < sizeof input || !READ(was) || !READ(clock)) return 3;
        const sp_measurement *m = &input.measurement;
        if (m->pose_count < 0 || m->pose_count > SP_POSE_FRAMES || m->imu_count < 0 || m->imu_count > SP_IMU_SAMPLES)
            return 3;
        sp_loop_tick(&loop, &input, &is);
        *differ += memcmp(&was, &is, sizeof is) != 0;
        ++*ticks;
        if (fwrite(&input, sizeof input, 1, out) != 1 || fwrite(&is, sizeof is, 1, out) != 1 ||
            fwrite(&clock, sizeof clock, 1, out) != 1)
            return 5;
    }
    return 0;
}

/* 0 where all went well, else a message's number (see main.c); of a run, how many ticks, and how many now differ. */
int sp_replay(FILE *in, FILE *out, int *ticks, int *differ)
{
    static sp_flight flight;
    static sp_crawl crawl;
    sp_log_head head;
    sp_log_input input;
    sp_log_output line;
    if (!READ(head) || memcmp(head.magic, SP_LOG_MAGIC, 8) != 0) return 1;
    if (memcmp(head.interface, SP_RUNNER_INTERFACE, 32) != 0) return 2;
    if (head.kind == SP_LOG_RUN) return replay_run(in, out, &head, ticks, differ);
    if (head.kind == SP_LOG_FLIGHT) {
        sp_controller_config config;
        sp_log_start start;
        if (!READ(config) || !READ(start)) return 3;
        sp_flight_init(&flight, &config);
        sp_flight_reset(&flight, &start.state, start.joint_position, start.has_trim ? start.trim : NULL);
    } else {
        sp_crawler_config config;
        sp_robot_state state;
        sp_move move;
        if (!READ(config) || !READ(state)) return 3;
        sp_crawl_init(&crawl, &config);
        sp_crawl_reset(&crawl, &state);
        for (;;) {
            if (!READ(move)) return 3;
            if (move.cycles < 0) break;
            if (!sp_gait_move(&crawl, move.way, move.cycles)) return 4;
        }
    }
    for (int k = 0; k < head.ticks; k++) {
        if (!READ(input)) return 3;
        const sp_residual *residual = input.has_residual ? &input.residual : NULL;
        memset(&line, 0, sizeof line);
        if (head.kind == SP_LOG_FLIGHT) {
            sp_flight_step(&flight, &input.state, &input.reference, residual, NULL, &line.command);
            record_allocation(&flight.allocation, &line);
        } else {
            sp_crawl_step(&crawl, &input.state, residual, &line.command);
            record_allocation(&crawl.allocation, &line);
        }
        if (fwrite(&line, sizeof line, 1, out) != 1) return 5;
    }
    return 0;
}
