/* The crawl controller: gait, snapshot, allocation, blending between modes, vectoring, joints. */
#include "spidar_core.h"
#include "spidar_math.h"

void sp_crawl_init(const sp_robot *robot, sp_crawl *crawl, const sp_crawler_config *config)
{
    memset(crawl, 0, sizeof *crawl);
    crawl->config = *config;
    crawl->dt = 1.0 / config->rate_hz;
    crawl->thrust_limit = HUGE_VAL;
    for (int k = SP_PROGRAM_REST; k <= SP_PROGRAM_STANCE; k++) sp_ground_mode(k, config, &crawl->modes[k]);
    sp_home(robot, &config->gait, crawl->home_b);
}

/* Clear the memory: the robot lies on the floor with rotors off, and no commands. */
void sp_crawl_reset(sp_crawl *crawl, const sp_robot_state *state)
{
    sp_crawl_memory *m = &crawl->memory;
    double R[9];
    memset(m, 0, sizeof *m);
    crawl->ticked = 0;
    sp_from_quat(state->quat_wb, R);
    sp_gait_reset(crawl, state->position_w, R, state->joint_position);
    sp_copy(m->vectoring, state->vectoring, 2 * SP_ROTORS);
    sp_copy(m->joint_position, state->joint_position, SP_JOINTS);
    for (int i = 0; i < SP_ROTORS; i++) m->lock.phi[i] = state->vectoring[2 * i], m->effort[i] = 1.0;
    m->mode = SP_PROGRAM_REST;
}

/* Maps of rotor and foot forces to the wrench in {CoG} (6, 36) and to joint torque (16, 36). */
static void add_feet(const sp_robot *robot, const sp_snapshot *s, const double *R_bf, double *Q, double *T)
{
    double down[3] = {robot->foot_radius * R_bf[2], robot->foot_radius * R_bf[5], robot->foot_radius * R_bf[8]};
    for (int leg = 0; leg < SP_LEGS; leg++) {
        double lever[3], back[3];
        for (int i = 0; i < 3; i++) lever[i] = s->feet_b[leg][i] - s->com_b[i] - down[i], back[i] = -down[i];
        for (int k = 0; k < 3; k++) {
            double column[3] = {R_bf[k], R_bf[3 + k], R_bf[6 + k]}, torque[3];
            int c = SP_FORCES + 3 * leg + k;
            sp_cross(lever, column, torque);
            for (int r = 0; r < 3; r++) {
                Q[SP_UNKNOWNS * r + c] = column[r];
                Q[SP_UNKNOWNS * (3 + r) + c] = torque[r];
            }
        }
        for (int j = 4 * leg; j < 4 * leg + 4; j++) {
            /* The ball turns with its link: ∂(touching point)/∂q = J_c − r [axis × n]. */
            double axis[3], turn[3], J[3], moves = 0.0;
            for (int i = 0; i < 3; i++) {
                axis[i] = s->joint_axes[SP_JOINTS * i + j];
                J[i] = s->J_foot[leg][SP_JOINTS * i + j];
                moves += fabs(J[i]);
            }
            sp_cross(axis, back, turn);
            for (int i = 0; i < 3; i++) J[i] += moves > 0.0 ? turn[i] : 0.0;
            for (int k = 0; k < 3; k++)
                T[SP_UNKNOWNS * j + SP_FORCES + 3 * leg + k] = J[0] * R_bf[k] + J[1] * R_bf[3 + k] + J[2] * R_bf[6 + k];
        }
    }
}

/* Write the allocation's demand, and update the lock of φ. */
static void ground_demand(const sp_robot *robot, sp_crawl *crawl, const sp_robot_state *state, const double *plan, int mode,
                          const int32_t *lifted, const sp_residual *residual, sp_lock *lock)
{
    static const int32_t none[SP_ROTORS] = {0};
    const sp_crawl_memory *m = &crawl->memory;
    const sp_crawler_config *c = &crawl->config;
    const sp_snapshot *s = &crawl->snapshot;
    sp_demand *d = &crawl->demand;
    int n = crawl->modes[mode].n;
    double nominal[2 * SP_ROTORS];
    sp_nominal_vectoring(s, m->vectoring, nominal);
    sp_update_lock(&m->lock, none, nominal, s, m->vectoring, &c->lock, lock);
    sp_copy(d->gravity_torque, s->gravity_torque, SP_JOINTS);
    if ((mode == SP_PROGRAM_LEG || mode == SP_PROGRAM_LEGS) && (c->leg_stiffness != 0.0 || c->leg_damping != 0.0)) {
        double share = mode == m->mode ? 1.0 - m->gap : 0.0; /* blended in with the mode */
        for (int j = 0; j < SP_JOINTS; j++)
            if (lifted[j / 4])
                d->gravity_torque[j] += share * (c->leg_stiffness * (plan[j] - state->joint_position[j]) -
                                                 c->leg_damping * state->joint_velocity[j]);
    }
    sp_product_t(crawl->R_wb, crawl->gait.floor_R, d->R_bf);
    sp_zero(d->thrust_map, 6 * n);
    sp_zero(d->torque_map, SP_JOINTS * n);
    sp_thrust_map(s, d->thrust_map, n);
    sp_torque_map(s, d->torque_map, n);
    if (crawl->modes[mode].feet_carry) add_feet(robot, s, d->R_bf, d->thrust_map, d->torque_map);
    sp_zero(d->wrench, 6);
    for (int i = 0; i < 3; i++) d->wrench[i] = s->mass * robot->gravity * crawl->R_wb[6 + i];
    if (mode != SP_PROGRAM_REST)
        for (int k = 0; k < 6; k++) d->wrench[k] += residual->wrench[k];
    for (int i = 0; i < SP_ROTORS; i++) {
        d->locked[i] = lock->active[i];
        d->phi[i] = lock->phi[i];
        d->restricted[i] = 0;
        d->lower[i] = d->upper[i] = 0.0;
        d->lost[i] = mode == SP_PROGRAM_LEG && !lifted[i / 2];
        d->effort[i] = m->effort[i];
    }
    for (int leg = 0; leg < SP_LEGS; leg++) d->lifted[leg] = lifted[leg];
    sp_copy(d->com_b, s->com_b, 3);
    d->thrust_limit = crawl->thrust_limit;
}

/* Add a policy's forces to the allocation and project the sum to the nearest valid forces; foot forces stay. */
static void add_forces(sp_crawl *crawl, int n, const sp_residual *residual, sp_room *room)
{
    sp_allocation *a = &crawl->allocation;
    sp_demand *d = &crawl->demand, fixed;
    double wish[SP_FORCES], feet[3 * SP_LEGS], any = 0.0, slack = a->slack, wrench[6];
    int32_t status = a->status, rows = a->rows, active[SP_MAX_M];
    sp_zero(wish, SP_FORCES);
    if (residual->has_forces_l) sp_copy(wish, residual->forces_l, SP_FORCES);
    if (residual->has_leg_forces_b)
        for (int i = 0; i < SP_ROTORS; i++) {
            double half[3], own[3];
            for (int k = 0; k < 3; k++) half[k] = 0.5 * residual->leg_forces_b[3 * (i / 2) + k];
            sp_apply_t(crawl->snapshot.R_bl[i], half, own);
            for (int k = 0; k < 3; k++) wish[3 * i + k] += own[k];
        }
    for (int k = 0; k < SP_FORCES; k++) any = sp_max(any, fabs(wish[k]));
    if (any == 0.0) return;
    fixed = *d;
    sp_copy(feet, a->foot_forces_f, 3 * SP_LEGS);
    for (int r = 0; r < 6; r++) {
        wrench[r] = sp_row(d->thrust_map + n * r + SP_FORCES, feet, n - SP_FORCES);
        fixed.wrench[r] = d->wrench[r] - wrench[r];
        sp_copy(fixed.thrust_map + SP_FORCES * r, d->thrust_map + n * r, SP_FORCES);
    }
    for (int j = 0; j < SP_JOINTS; j++) {
        double carried = sp_row(d->torque_map + n * j + SP_FORCES, feet, n - SP_FORCES);
        fixed.gravity_torque[j] = d->gravity_torque[j] - carried;
        sp_copy(fixed.torque_map + SP_FORCES * j, d->torque_map + n * j, SP_FORCES);
    }
    for (int k = 0; k < SP_FORCES; k++) wish[k] += a->forces_l[k];
    memcpy(active, a->active, sizeof active);
    sp_project(&fixed, wish, crawl->memory.forces_l, &crawl->config.allocator, room, a);
    if (status == SP_SOFTENED || status == SP_HELD) a->status = status, a->slack = slack;
    for (int r = 0; r < 6; r++) a->wrench[r] += wrench[r];
    sp_copy(a->foot_forces_f, feet, 3 * SP_LEGS);
    memcpy(a->active, active, sizeof active);
    a->rows = rows;
}

/* One control tick. */
void sp_crawl_step(sp_crawl *crawl, const sp_robot_state *state, const sp_residual *residual, sp_room *room,
                   sp_command *command)
{
    const sp_robot *robot = room->robot;
    sp_crawl_memory *m = &crawl->memory;
    const sp_crawler_config *c = &crawl->config;
    sp_allocation *a = &crawl->allocation;
    double plan[SP_JOINTS], torque[SP_JOINTS], forces[SP_FORCES], thrust[SP_ROTORS], joints[SP_JOINTS];
    int32_t lifted[SP_LEGS];
    sp_lock lock;
    if (!sp_valid_state(state)) { /* repeat the last command */
        a->status = SP_HELD;
        for (int i = 0; i < SP_ROTORS; i++) thrust[i] = sp_norm(m->forces_l + 3 * i);
        sp_make_command(thrust, m->vectoring, m->joint_position, c->joint_torque_limit, command);
        return;
    }
    residual = sp_usable_residual(residual);
    sp_from_quat(state->quat_wb, crawl->R_wb);
    sp_gait_step(robot, crawl, state->position_w, crawl->R_wb, state->joint_position, residual, plan);
    int mode = sp_gait_mode(crawl);
    sp_gait_lifted(crawl, lifted);
    sp_snapshot_at(robot, state->joint_position, crawl->R_wb, state->vectoring, &crawl->snapshot);
    ground_demand(robot, crawl, state, plan, mode, lifted, residual, &lock);
    sp_allocate(&crawl->modes[mode], &crawl->demand, m->forces_l, m->active, m->rows, &c->allocator,
                room, a);
    if (residual->has_forces_l || residual->has_leg_forces_b)
        add_forces(crawl, crawl->modes[mode].n, residual, room);
    for (int j = 0; j < SP_JOINTS; j++) torque[j] = lifted[j / 4] ? a->joint_torques[j] : 0.0;
    if (mode != m->mode) {
        for (int k = 0; k < SP_FORCES; k++) m->force_gap[k] = m->forces_l[k] - a->forces_l[k];
        for (int j = 0; j < SP_JOINTS; j++) m->torque_gap[j] = m->joint_torque[j] - torque[j];
        m->gap = 1.0;
    }
    m->gap = c->blend_time > 0.0 ? sp_max(0.0, m->gap - crawl->dt / c->blend_time) : 0.0;
    for (int j = 0; j < SP_JOINTS; j++) torque[j] += m->gap * m->torque_gap[j];
    for (int k = 0; k < SP_FORCES; k++) forces[k] = a->forces_l[k] + (m->gap > 0.0 ? m->gap * m->force_gap[k] : 0.0);
    double most = sp_min(robot->max_thrust, crawl->thrust_limit);
    for (int i = 0; i < SP_ROTORS; i++) thrust[i] = sp_limit_thrust(most, forces + 3 * i);
    sp_follow(forces, &lock, m->vectoring, robot->max_vectoring_speed * crawl->dt, m->vectoring);
    double filter = c->setpoint_filter > 0.0 ? 1.0 - exp(-crawl->dt / c->setpoint_filter) : 1.0;
    for (int j = 0; j < SP_JOINTS; j++) {
        joints[j] = plan[j] + c->feed_forward / robot->joint_kp * torque[j] + residual->joint_offset[j];
        if (c->setpoint_filter > 0.0) joints[j] = m->joint_position[j] + filter * (joints[j] - m->joint_position[j]);
        joints[j] = sp_clip(joints[j], -robot->joint_limit, robot->joint_limit);
    }
    if (c->power)
        for (int i = 0; i < SP_ROTORS; i++)
            m->effort[i] +=
                SP_EFFORT_SHARE * (sqrt(robot->hover_thrust / sp_max(a->thrust[i], SP_LEAST_THRUST)) - m->effort[i]);
    m->lock = lock;
    sp_copy(m->forces_l, forces, SP_FORCES);
    sp_copy(m->joint_torque, torque, SP_JOINTS);
    sp_copy(m->joint_position, joints, SP_JOINTS);
    m->mode = mode;
    m->rows = a->rows;
    memcpy(m->active, a->active, sizeof m->active);
    crawl->ticked = 1;
    sp_make_command(thrust, m->vectoring, joints, c->joint_torque_limit, command);
}
