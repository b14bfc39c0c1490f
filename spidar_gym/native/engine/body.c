/* Writes a configuration into MuJoCo's model: masses, friction, gears, lags, limits, the joint servos' stiffness and
 * damping [Zhao2025, Eq. 17]. */
#include "engine.h"

#define GAINS 10 /* numbers of an actuator's dynamics, gain and bias each */

/* Add a point mass to the torso: one rigid body with the common CoG and principal axes. */
static void write_payload(const sp_world *world, double mass, const double *position, const sp_sim *sim)
{
    double *own = sim->body_mass + world->torso, *com = sim->body_ipos + 3 * world->torso;
    double *moments = sim->body_inertia + 3 * world->torso, *axes = sim->body_iquat + 4 * world->torso;
    double R[9], inertia[9], vectors[9], lever[3], total = *own + mass, both = *own * mass / total, square = 0.0;
    sp_from_quat(axes, R);
    for (int x = 0; x < 3; x++) {
        lever[x] = position[x] - com[x];
        square += lever[x] * lever[x];
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            inertia[3 * r + c] = both * ((r == c) * square - lever[r] * lever[c]);
            for (int k = 0; k < 3; k++) inertia[3 * r + c] += R[3 * r + k] * moments[k] * R[3 * c + k];
        }
    sim->mujoco->eig3(moments, vectors, axes, inertia);
    for (int x = 0; x < 3; x++) com[x] += mass / total * lever[x];
    *own = total;
}

/* Write masses and friction, starting from the described robot, so that no earlier configuration has an effect. */
void sp_write_body(const sp_world *world, const sp_body_config *c, const sp_sim *sim)
{
    double mass[SP_MAX_BODIES], sum = 0.0;
    int n = world->bodies;
    sp_copy(mass, world->mass, n);
    sp_copy(sim->body_inertia, world->inertia[0], 3 * n);
    sp_copy(sim->body_ipos, world->com[0], 3 * n);
    for (int i = 0; i < SP_ROTORS; i++) {
        for (int k = 4 * i; k < 4 * i + 4; k++) {
            int32_t body = world->part_body[k];
            mass[body] *= c->link_mass[i];
            for (int x = 0; x < 3; x++) sim->body_inertia[3 * body + x] *= c->link_mass[i];
        }
        for (int x = 0; x < 3; x++) {
            sim->body_inertia[3 * world->link_body[i] + x] *= c->inertia[i];
            sim->body_ipos[3 * world->link_body[i] + x] += c->link_com[3 * i + x];
        }
    }
    for (int x = 0; x < 3; x++) sim->body_ipos[3 * world->torso + x] += c->torso_com[x];
    for (int k = 0; k < n; k++) sum += mass[k];
    sp_copy(sim->body_iquat + 4 * world->torso, world->torso_axes, 4);
    double factor = c->total_mass / sum;
    for (int k = 0; k < n; k++) {
        sim->body_mass[k] = factor * mass[k];
        for (int x = 0; x < 3; x++) sim->body_inertia[3 * k + x] *= factor;
    }
    if (c->payload_mass > 0.0) write_payload(world, c->payload_mass, c->payload_position, sim);
    for (int k = 0; k < world->geoms; k++)
        if (world->geom_touches[k])
            sim->geom_friction[3 * k] = world->geom_is_foot[k] ? c->foot_friction : c->peg_friction;
}

/* Write the parameters of rotors and servos that MuJoCo simulates itself. */
void sp_write_actuators(const sp_world *world, const sp_actuator_config *c, double joint_speed, const sp_sim *sim)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        double gain = c->thrust_gain * c->module_gain[i], *gear = sim->actuator_gear + 6 * i;
        double tilt_x = c->thrust_tilt[2 * i], tilt_y = c->thrust_tilt[2 * i + 1], torque[3];
        double at[3] = {c->thrust_offset[2 * i], c->thrust_offset[2 * i + 1], 0.0};
        double axis[3] = {sin(tilt_y), -sin(tilt_x) * cos(tilt_y), cos(tilt_x) * cos(tilt_y)};
        /* Torque of the force at (x, y, 0), and of unequal thrusts of the two ducts at ± d on the y axis. */
        sp_cross(at, axis, torque);
        torque[0] += world->duct_offset_y * c->duct_imbalance[i];
        for (int x = 0; x < 3; x++) gear[x] = gain * axis[x], gear[3 + x] = gain * torque[x];
        sim->actuator_ctrlrange[2 * i + 1] = sim->actuator_actrange[2 * i + 1] = c->max_thrust / gain;
        sim->actuator_dynprm[GAINS * i] = c->thrust_lag;
    }
    for (int j = 0; j < SP_ANGLES; j++) {
        double *bias = sim->actuator_biasprm + GAINS * (SP_ROTORS + j);
        bias[0] = 0.0;
        if (j >= SP_JOINTS) {
            bias[1] = -c->vectoring_kp;
            bias[2] = -world->vectoring_kd;
            continue;
        }
        sim->actuator_dynprm[GAINS * (SP_ROTORS + j) + 1] = joint_speed * c->joint_speed_factor * c->servo_speed[j];
        bias[1] = -c->joint_kp * c->servo_stiffness[j];
        bias[2] = -c->joint_kd;
        sim->dof_frictionloss[world->joint_dof[j]] = c->joint_friction;
        sim->dof_damping[world->joint_dof[j]] = c->joint_damping;
    }
}
