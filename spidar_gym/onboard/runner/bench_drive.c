/* A bench test: the joints of a robot that is clamped to a stand follow forms and excitations; the rotors stay still.
 *
 * Any fault that lasts, and a joint too far from its command, end the test: the joints are held, and the runner keeps
 * commanding this until the robot is disarmed. */
#include <string.h>

#include "runner.h"
#include "spidar_math.h"

void sp_bench_begin(sp_loop *l, const sp_robot_state *state)
{
    sp_copy(l->form, state->joint_position, SP_JOINTS);
    sp_zero(l->command.thrust, SP_ROTORS);
}

static void begin_to_rest(sp_loop *l, sp_fault fault)
{
    l->stage = SP_RESTING;
    l->ending = l->fault = fault;
    l->finished = 1;
}

/* Move the joints' command towards the mission's target at the planned speed. */
static void move(sp_loop *l, double t)
{
    double way = l->mission.controller.joint_speed / SP_CONTROL_RATE, limit = l->mission.robot.joint_limit;
    double *commanded = l->command.joint_position;
    sp_next_form(l, t);
    for (int j = 0; j < SP_JOINTS; j++) {
        double target = sp_clip(l->reference.joint_target[j], -limit, limit);
        commanded[j] += sp_clip(target - commanded[j], -way, way);
        l->command.joint_torque_limit[j] = sp_min(l->mission.limits.torque, l->mission.robot.max_joint_torque);
    }
}

void sp_bench_tick(sp_loop *l, const sp_loop_input *input, sp_fault fault)
{
    if (l->stage == SP_RESTING) return;
    if (fault == SP_FINE && sp_is_strained(l)) {
        l->aborted = 1;
        begin_to_rest(l, SP_STRAINED);
        return;
    }
    if (fault == SP_FINE) move(l, input->time - l->taken_over);
    sp_hold(l, input->time, fault);
    if (l->stage == SP_LANDING && fault != SP_CONTENDED) begin_to_rest(l, fault);
}
