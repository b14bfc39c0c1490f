/* Limits of outgoing commands, and how long an old command is held if there is no valid one. */
#include "runner.h"
#include "spidar_math.h"

#define PERIOD (1.0 / SP_CONTROL_RATE) /* of the ticks [s] */
#define CARRIED_TIME 1.0 /* time constant of the thrust that carries the robot [s] */
#define CARRIED_BEYOND 1.05 /* a held command has at most this much of it */

int sp_thrust_within_limits(const sp_robot *robot, const double *thrust)
{
    for (int i = 0; i < SP_ROTORS; i++)
        if (!(thrust[i] >= -1e-9 && thrust[i] <= robot->max_thrust + 1e-6)) return 0;
    return 1;
}

/* Whether a command is within the limits. */
static int command_within_limits(const sp_robot *robot, const sp_command *c)
{
    if (!sp_thrust_within_limits(robot, c->thrust)) return 0;
    for (int j = 0; j < SP_JOINTS; j++)
        if (!(fabs(c->joint_position[j]) <= robot->joint_limit + 1e-6 && fabs(c->vectoring[j]) < 1e3)) return 0;
    return 1;
}

sp_fault sp_answer(sp_loop *l, const sp_allocation *a, const sp_command *command)
{
    l->answer.status = a->status;
    l->answer.iterations = a->iterations;
    sp_copy(l->answer.joint_torques, a->joint_torques, SP_JOINTS);
    sp_copy(l->answer.forces_l, a->forces_l, SP_FORCES);
    if (!command_within_limits(&l->mission.robot, command)) return SP_BAD_COMMAND;
    l->command = *command;
    for (int i = 0; i < SP_ROTORS; i++) l->command.thrust[i] = sp_min(l->command.thrust[i], l->health.thrust_limit);
    return a->status == SP_HELD ? SP_NO_ALLOCATION : SP_FINE;
}

void sp_hold(sp_loop *l, double time, sp_fault fault)
{
    double since = l->has_last ? sp_clip(time - l->last, 0.0, 1.0) : PERIOD;
    if (fault == SP_FINE) l->held = sp_max(0.0, l->held - sp_min(since, PERIOD));
    else l->held += l->stage == SP_HOLDING ? sp_max(since, PERIOD) : PERIOD;
    l->stage = fault == SP_FINE ? SP_DRIVING : SP_HOLDING;
    l->fault = fault;
    if (fault != SP_FINE && l->held > l->mission.limits.hold_ticks * PERIOD + 0.5 * PERIOD) l->stage = SP_LANDING;
}

static double total_thrust(const sp_command *command)
{
    double total = 0.0;
    for (int i = 0; i < SP_ROTORS; i++) total += command->thrust[i];
    return total;
}

void sp_note_carried(sp_loop *l, int airborne)
{
    double total = total_thrust(&l->command);
    l->carried = airborne ? l->carried + (total - l->carried) * (PERIOD / CARRIED_TIME) : total;
}

void sp_hold_level(sp_loop *l)
{
    double total = total_thrust(&l->command);
    if (!(total > CARRIED_BEYOND * l->carried)) return;
    for (int i = 0; i < SP_ROTORS; i++) l->command.thrust[i] *= l->carried / total;
}
