/* Reads parameter files and missions from stdin, drives the missions that they allow, and prints a line for each file.
 *
 * stdin: number of ticks, then that many of sp_loop_input; then for each file the size of its text, of its mission's,
 * and both texts. Output: the refusal, or the hash of the parameters and what became of the mission. */
#include <stdlib.h>
#include <string.h>

#include "runner.h"

static int take(void *to, size_t size) { return size == 0 || fread(to, size, 1, stdin) == 1; }

/* Whether what would be published is finite and within the limits of the robot. */
static int is_valid(const sp_robot *robot, const sp_loop_output *output)
{
    const sp_command *c = &output->command;
    if (output->action != SP_PUBLISH) return 1;
    for (int j = 0; j < SP_JOINTS; j++) {
        double angle = c->joint_position[j], torque = c->joint_torque_limit[j], vectoring = c->vectoring[j];
        if (!(angle >= -robot->joint_limit - 1e-6 && angle <= robot->joint_limit + 1e-6)) return 0;
        if (!(torque >= 0.0 && torque <= 1e6) || !(vectoring > -1e3 && vectoring < 1e3)) return 0;
    }
    return sp_thrust_within_limits(robot, c->thrust);
}

static const char *drive(const sp_parameters *p, const char *text, const sp_loop_input *inputs, int32_t ticks)
{
    static sp_loop loop;
    static sp_mission mission;
    static sp_loop_output output;
    static char reason[256];
    int driven = 0;
    if (!sp_read_mission(text, p, &mission, reason, sizeof reason)) return "no mission";
    if (sp_loop_init(&loop, &mission) != NULL) return "out of reach";
    for (int32_t k = 0; k < ticks; k++) {
        sp_loop_tick(&loop, &inputs[k], &output);
        driven += output.stage == SP_DRIVING;
        if (!is_valid(&p->robot, &output)) return "OUT OF BOUNDS";
    }
    return driven > 0 ? "driven" : "not driven";
}

int main(void)
{
    static sp_parameters p;
    static char reason[384], hex[65];
    int32_t ticks, sizes[2];
    if (!take(&ticks, sizeof ticks)) return 2;
    sp_loop_input *inputs = calloc((size_t)ticks, sizeof *inputs);
    if (inputs == NULL || !take(inputs, (size_t)ticks * sizeof *inputs)) return 2;
    while (take(sizes, sizeof sizes)) {
        char *text = calloc(1, (size_t)sizes[0] + 1), *mission = calloc(1, (size_t)sizes[1] + 1);
        if (text == NULL || mission == NULL || !take(text, (size_t)sizes[0]) || !take(mission, (size_t)sizes[1])) return 2;
        if (sp_read_parameters(text, &p, reason, sizeof reason)) {
            sp_sha256(&p, sizeof p, hex);
            printf("%s %s\n", hex, drive(&p, mission, inputs, ticks));
        } else {
            printf("refused: %s\n", reason);
        }
        free(text);
        free(mission);
    }
    free(inputs);
    return 0;
}
