/* The kinematic tree: (joint angles, attitude, vectoring angles) → snapshot. The table of bodies is generated. */
#include "spidar_core.h"
#include "spidar_math.h"

/* Frames and composites of the bodies; body 0 is the torso. */
typedef struct {
    double R[SP_BODIES][9], p[SP_BODIES][3], axis[SP_BODIES][3];
    double mass[SP_BODIES], com[SP_BODIES][3], inertia[SP_BODIES][9]; /* of the body and its subtree */
} tree;

/* I += m (|d|² 1 − d dᵀ): parallel axes. */
static void shift(double *I, double m, const double *d)
{
    double s = sp_dot(d, d);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) I[3 * i + j] += m * ((i == j ? s : 0.0) - d[i] * d[j]);
}

/* Attitudes of a body: R1 before its joint turns it, R after. */
static void turn(const sp_body *body, const double *R0, double angle, double *R1, double *R)
{
    double s = sin(angle), c = cos(angle), by[9];
    const double *a = body->axis;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) by[3 * i + j] = (1.0 - c) * a[i] * a[j] + (i == j ? c : 0.0);
    by[1] -= s * a[2], by[2] += s * a[1], by[3] += s * a[2];
    by[5] -= s * a[0], by[6] -= s * a[1], by[7] += s * a[0];
    sp_product(R0, body->rotation, R1);
    sp_product(R1, by, R);
}

static void place(const sp_robot *robot, const double *q, const double *vectoring, tree *t)
{
    sp_identity(t->R[0]);
    sp_zero(t->p[0], 3);
    for (int k = 0; k < SP_BODIES; k++) {
        const sp_body *body = &robot->tree[k];
        if (k > 0) {
            const double *R0 = t->R[body->parent];
            double angle = body->joint < SP_JOINTS ? q[body->joint] : vectoring[body->joint - SP_JOINTS];
            double R1[9], step[3];
            turn(body, R0, angle, R1, t->R[k]);
            sp_apply(R1, body->axis, t->axis[k]);
            sp_apply(R0, body->position, step);
            for (int i = 0; i < 3; i++) t->p[k][i] = t->p[body->parent][i] + step[i];
        }
        double RI[9], lever[3], Rt[9];
        t->mass[k] = body->mass;
        sp_apply(t->R[k], body->com, lever);
        for (int i = 0; i < 3; i++) t->com[k][i] = t->p[k][i] + lever[i];
        sp_product(t->R[k], body->inertia, RI);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) Rt[3 * i + j] = t->R[k][3 * j + i];
        sp_product(RI, Rt, t->inertia[k]);
    }
    for (int k = SP_BODIES - 1; k > 0; k--) { /* children come after their parents */
        int up = robot->tree[k].parent;
        double m = t->mass[up] + t->mass[k], com[3], d[3];
        for (int i = 0; i < 3; i++) com[i] = (t->mass[up] * t->com[up][i] + t->mass[k] * t->com[k][i]) / m;
        for (int i = 0; i < 3; i++) d[i] = t->com[up][i] - com[i];
        shift(t->inertia[up], t->mass[up], d);
        for (int i = 0; i < 3; i++) d[i] = t->com[k][i] - com[i];
        shift(t->inertia[up], t->mass[k], d);
        for (int i = 0; i < 9; i++) t->inertia[up][i] += t->inertia[k][i];
        t->mass[up] = m;
        sp_copy(t->com[up], com, 3);
    }
}

/* Attitudes R_bl of the rotors' links at joint angles q. */
void sp_link_attitudes(const sp_robot *robot, const double *q, double R_bl[SP_ROTORS][9])
{
    double R[SP_BODIES][9], R1[9];
    sp_identity(R[0]);
    for (int k = 1; k < SP_BODIES; k++) {
        const sp_body *body = &robot->tree[k];
        if (body->joint < SP_JOINTS) turn(body, R[body->parent], q[body->joint], R1, R[k]);
    }
    for (int i = 0; i < SP_ROTORS; i++) sp_copy(R_bl[i], R[robot->link_body[i]], 9);
}

/* Column j of J (3, 16): velocity of a point per rate of joint j, which moves body k. */
static void column(const tree *t, int k, const double *point, double *J, int j)
{
    double arm[3], v[3];
    for (int i = 0; i < 3; i++) arm[i] = point[i] - t->p[k][i];
    sp_cross(t->axis[k], arm, v);
    for (int i = 0; i < 3; i++) J[SP_JOINTS * i + j] = v[i];
}

/* Compute the model at one configuration: the coefficients of the centroidal dynamics [Zhao2025, Eq. 3-5]. */
void sp_snapshot_at(const sp_robot *robot, const double *q, const double *R_wb, const double *vectoring, sp_snapshot *s)
{
    tree t;
    place(robot, q, vectoring, &t);
    s->mass = t.mass[0];
    sp_copy(s->com_b, t.com[0], 3);
    sp_copy(s->inertia_c, t.inertia[0], 9);
    sp_zero(s->J_rotor[0], SP_ROTORS * 3 * SP_JOINTS);
    sp_zero(s->J_foot[0], SP_LEGS * 3 * SP_JOINTS);
    for (int j = 0; j < SP_JOINTS; j++) {
        int k = robot->joint_body[j];
        double arm[3], v[3], L[3], turn[3], Ia[3];
        for (int i = 0; i < 3; i++) arm[i] = t.com[k][i] - t.p[k][i];
        sp_cross(t.axis[k], arm, v);
        for (int i = 0; i < 3; i++) v[i] *= t.mass[k];
        for (int i = 0; i < 3; i++) arm[i] = t.com[k][i] - s->com_b[i];
        sp_cross(arm, v, L);
        sp_apply(t.inertia[k], t.axis[k], Ia);
        for (int i = 0; i < 3; i++) {
            turn[i] = Ia[i] + L[i];
            s->joint_axes[SP_JOINTS * i + j] = t.axis[k][i];
            s->momentum_map[SP_JOINTS * i + j] = v[i];
            s->momentum_map[SP_JOINTS * (3 + i) + j] = turn[i];
        }
        /* The rate at which a joint lifts the CoG, times the weight. */
        s->gravity_torque[j] = robot->gravity * sp_dot(R_wb + 6, v);
    }
    for (int i = 0; i < SP_ROTORS; i++) {
        const double *centre = t.p[robot->rotor_body[i]];
        sp_copy(s->R_bl[i], t.R[robot->link_body[i]], 9);
        for (int k = 0; k < 3; k++) s->rotor_c[i][k] = centre[k] - s->com_b[k];
        int first = 4 * (i / 2), last = first + (i % 2 ? 4 : 2);
        for (int j = first; j < last; j++) column(&t, robot->joint_body[j], centre, s->J_rotor[i], j);
    }
    for (int leg = 0; leg < SP_LEGS; leg++) {
        int link = robot->link_body[2 * leg + 1];
        double out[3] = {robot->pitch_to_foot, 0.0, 0.0};
        sp_apply(t.R[link], out, s->feet_b[leg]);
        for (int i = 0; i < 3; i++) s->feet_b[leg][i] += t.p[link][i];
        for (int j = 4 * leg; j < 4 * leg + 4; j++)
            column(&t, robot->joint_body[j], s->feet_b[leg], s->J_foot[leg], j);
    }
}
