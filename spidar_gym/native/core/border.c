/* Interface digest, validation of incoming states, references and residuals, and the outgoing command. */
#include "spidar_core.h"
#include "spidar_interface.h" /* generated: digest of the sources */
#include "spidar_math.h"

const sp_residual SP_NO_RESIDUAL = {
    .joint_speed_scale = 1.0, .raise_scale = 1.0, .stride_scale = 1.0, .lift_scale = 1.0,
};

const char *sp_interface(void) { return SP_INTERFACE; }

static int is_attitude(const double *quat)
{
    /* A tracking system may send a quaternion of zeros when it has lost the robot. */
    return quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3] > SP_LEAST_QUATERNION;
}

/* Add the squares of n numbers to `sum`; whether it is still finite. The Python controller has the same test. */
static int squares(const double *x, int n, double *sum)
{
    for (int i = 0; i < n; i++) *sum += x[i] * x[i];
    return sp_finite(sum, 1);
}

int sp_valid_state(const sp_robot_state *s)
{
    double sum = 0.0;
    return squares(s->position_w, 3, &sum) && squares(s->quat_wb, 4, &sum) && squares(s->velocity_w, 3, &sum) &&
           squares(s->omega_b, 3, &sum) && squares(s->joint_position, SP_JOINTS, &sum) &&
           squares(s->joint_velocity, SP_JOINTS, &sum) && squares(s->vectoring, 2 * SP_ROTORS, &sum) &&
           is_attitude(s->quat_wb);
}

int sp_valid_reference(const sp_reference *r)
{
    double sum = 0.0;
    return squares(r->position_w, 3, &sum) && squares(r->quat_wb, 4, &sum) && squares(r->velocity_w, 3, &sum) &&
           squares(r->omega_b, 3, &sum) && squares(r->joint_target, SP_JOINTS, &sum) &&
           squares(r->acceleration_w, 3, &sum) && squares(r->alpha_b, 3, &sum) && squares(&r->support, 1, &sum) &&
           is_attitude(r->quat_wb);
}

/* The residual, or the neutral one if it is NULL or not finite. */
const sp_residual *sp_usable_residual(const sp_residual *r)
{
    if (r == NULL) return &SP_NO_RESIDUAL;
    double sum = r->joint_speed_scale + r->raise_scale + r->stride_scale + r->lift_scale;
    int valid = squares(r->wrench, 6, &sum) && squares(r->joint_offset, SP_JOINTS, &sum) &&
                (!r->has_forces_l || squares(r->forces_l, SP_FORCES, &sum)) &&
                (!r->has_leg_forces_b || squares(r->leg_forces_b, 3 * SP_LEGS, &sum));
    return valid ? r : &SP_NO_RESIDUAL;
}

void sp_make_command(const double *thrust, const double *vectoring, const double *joints, double limit,
                     sp_command *command)
{
    sp_copy(command->thrust, thrust, SP_ROTORS);
    sp_copy(command->vectoring, vectoring, 2 * SP_ROTORS);
    sp_copy(command->joint_position, joints, SP_JOINTS);
    for (int j = 0; j < SP_JOINTS; j++) command->joint_torque_limit[j] = limit;
}
