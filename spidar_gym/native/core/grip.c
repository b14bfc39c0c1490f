/* What a gripped object adds to the flight controller; the Python twin is `control/grasp/grip.py`. */
#include "spidar_core.h"
#include "spidar_math.h"

/* The object's origin from the torso's, torso axes. */
static void centre_of(const sp_grip *g, const double *R_wb, const double *position_w, double *centre_b)
{
    double way[3];
    for (int i = 0; i < 3; i++) way[i] = g->position_w[i] - position_w[i];
    sp_apply_t(R_wb, way, centre_b);
}

/* Take the vertical part out of a vector; returns its length then. */
static double flatten(const double *up, double *v)
{
    double along = sp_dot(v, up);
    for (int i = 0; i < 3; i++) v[i] -= along * up[i];
    return sp_norm(v);
}

/* Add the torque of the joints that presses the feet on the object, Σ J_kᵀ F_k. */
void sp_grip_torque(const sp_robot *robot, const sp_grip *g, const sp_snapshot *s, const double *R_wb,
                    const double *position_w, const sp_residual *residual, double *torque)
{
    const double *up = R_wb + 6;
    double centre[3], lift = g->payload * robot->gravity / SP_LEGS;
    centre_of(g, R_wb, position_w, centre);
    for (int leg = 0; leg < SP_LEGS; leg++) {
        double inwards[3], F[3];
        for (int i = 0; i < 3; i++) inwards[i] = centre[i] - s->feet_b[leg][i];
        double length = sp_max(flatten(up, inwards), 1e-6);
        for (int i = 0; i < 3; i++) F[i] = g->force * inwards[i] / length + lift * up[i];
        if (residual->has_leg_forces_b && g->force > 0.0)
            for (int i = 0; i < 3; i++) F[i] += residual->leg_forces_b[3 * leg + i];
        for (int j = 4 * leg; j < 4 * leg + 4; j++)
            for (int i = 0; i < 3; i++) torque[j] += s->J_foot[leg][SP_JOINTS * i + j] * F[i];
    }
}

/* Add the wrench in {CoG} that carries the payload. */
void sp_grip_carried(const sp_robot *robot, const sp_grip *g, const sp_snapshot *s, const double *R_wb,
                     const double *position_w, double *wrench)
{
    const double *up = R_wb + 6;
    double lever[3], across[3], force[3], torque[3];
    centre_of(g, R_wb, position_w, lever);
    for (int i = 0; i < 3; i++) across[i] = lever[i] -= s->com_b[i];
    double share = sp_min(1.0, SP_GRIP_LEVER / sp_max(flatten(up, across), 1e-6));
    for (int i = 0; i < 3; i++) {
        lever[i] *= share;
        force[i] = g->payload * robot->gravity * up[i];
        wrench[i] += force[i];
    }
    sp_cross(lever, force, torque);
    for (int i = 0; i < 3; i++) wrench[3 + i] += torque[i];
}

/* Write the top of the object, a disc that jets avoid. */
void sp_grip_disc(const sp_grip *g, const sp_snapshot *s, const double *R_wb, const double *position_w, sp_disc *disc)
{
    centre_of(g, R_wb, position_w, disc->centre_c);
    for (int i = 0; i < 3; i++) disc->centre_c[i] += g->top * R_wb[6 + i] - s->com_b[i];
    disc->radius = g->radius;
}
