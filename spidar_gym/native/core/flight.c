/* The flight controller: snapshot, wrench, allocation, vectoring, joint targets. */
#include "spidar_core.h"
#include "spidar_math.h"

/* ---- centroidal control [Zhao2025, Eq. 6-8] ---- */

static double pid(const double *gains, double error, double integral, double rate, double max_error, double max_term)
{
    double p = sp_clip(gains[0] * sp_clip(error, -max_error, max_error), -max_term, max_term);
    return p + sp_clip(gains[1] * integral, -max_term, max_term) + sp_clip(gains[2] * rate, -max_term, max_term);
}

static void desired_wrench(const sp_robot *robot, const sp_control_state *control, const double *omega_b, const sp_flight_memory *memory,
                           const sp_centroidal_config *c, double *wrench)
{
    const sp_motion_error *e = &control->error;
    const sp_snapshot *s = &control->snapshot;
    double a[3], alpha[3], h[3], gyro[3], limit = c->max_angular_acceleration;
    for (int k = 0; k < 3; k++) {
        double most = c->max_acceleration[k];
        a[k] = sp_clip(pid(c->position_gains + 3 * k, e->position_w[k], memory->position_integral_w[k],
                           e->velocity_w[k], c->max_position_error[k], c->max_term[k]), -most, most);
        alpha[k] = sp_clip(pid(c->attitude_gains + 3 * k, e->attitude[k], memory->attitude_integral[k], e->omega_b[k],
                               c->max_attitude_error[k], limit), -limit, limit);
    }
    a[2] += robot->gravity;
    sp_apply_t(control->R_wb, a, wrench);
    for (int k = 0; k < 3; k++) wrench[k] *= s->mass;
    sp_apply(s->inertia_c, alpha, wrench + 3);
    sp_apply(s->inertia_c, omega_b, h);
    sp_cross(omega_b, h, gyro);
    for (int k = 0; k < 3; k++) wrench[3 + k] += gyro[k];
}

/* Anti-windup: ∫e + e dt if the unallocated demand is at most `threshold` or opposed to the error, else ∫e. */
static double advance_integral(double integral, double error, double missing, double threshold, double dt)
{
    return fabs(missing) > threshold && missing * error > 0.0 ? integral : integral + dt * error;
}

static void integrate(sp_flight_memory *memory, const sp_motion_error *e, double dt, double max_speed)
{
    for (int k = 0; k < 3; k++) {
        if (!(fabs(e->velocity_w[k]) > max_speed))
            memory->position_integral_w[k] =
                advance_integral(memory->position_integral_w[k], e->position_w[k], memory->unallocated_w[k],
                                 SP_MISSED_FORCE, dt);
        memory->attitude_integral[k] = advance_integral(memory->attitude_integral[k], e->attitude[k],
                                                        memory->unallocated_torque[k], SP_MISSED_TORQUE, dt);
    }
}

/* Errors of the CoG's motion, desired − actual [Zhao2025, Eq. 6, 7]. */
static void motion_error(const sp_robot_state *state, const sp_reference *reference, const sp_snapshot *s,
                         const double *R_wb, sp_motion_error *e)
{
    double relative[3], turned[3], R_d[9], R_e[9], offset[3];
    sp_cross(state->omega_b, s->com_b, turned);
    for (int i = 0; i < 3; i++)
        relative[i] = sp_row(s->momentum_map + SP_JOINTS * i, state->joint_velocity, SP_JOINTS) / s->mass + turned[i];
    sp_apply(R_wb, s->com_b, offset);
    for (int i = 0; i < 3; i++) e->position_w[i] = reference->position_w[i] - state->position_w[i] - offset[i];
    sp_apply(R_wb, relative, offset);
    for (int i = 0; i < 3; i++) e->velocity_w[i] = reference->velocity_w[i] - state->velocity_w[i] - offset[i];
    sp_from_quat(reference->quat_wb, R_d);
    sp_product_t(R_wb, R_d, R_e);
    e->attitude[0] = 0.5 * (R_e[7] - R_e[5]);
    e->attitude[1] = 0.5 * (R_e[2] - R_e[6]);
    e->attitude[2] = 0.5 * (R_e[3] - R_e[1]);
    sp_apply(R_e, reference->omega_b, e->omega_b);
    for (int i = 0; i < 3; i++) e->omega_b[i] -= state->omega_b[i];
}

/* Remove the share of the moving joints from the velocity error: the CoG then moves as if fixed to the torso. */
static void remove_joints(const sp_robot_state *state, sp_control_state *control)
{
    const sp_snapshot *s = &control->snapshot;
    double share[3], turned[3];
    for (int i = 0; i < 3; i++)
        share[i] = sp_row(s->momentum_map + SP_JOINTS * i, state->joint_velocity, SP_JOINTS) / s->mass;
    sp_apply(control->R_wb, share, turned);
    for (int i = 0; i < 3; i++) control->error.velocity_w[i] += turned[i];
}

/* ---- joint motion ---- */

/* Compute the next joint command on the straight line to the target, and its rate. */
static void plan_joints(const sp_robot *robot, const sp_flight *f, const double *wanted, double scale, double *following, double *rate)
{
    const double *command = f->memory.joint_position;
    double target[SP_JOINTS], way[SP_JOINTS], reach = f->config.joint_speed * f->dt;
    for (int j = 0; j < SP_JOINTS; j++) {
        target[j] = sp_clip(wanted[j], -robot->joint_limit, robot->joint_limit);
        way[j] = target[j] - command[j];
    }
    if (f->config.compensation.joint_ramp > 0.0) {
        double speed = f->config.joint_speed * sp_min(1.0, sp_max(0.0, scale));
        sp_ramp_joints(command, f->memory.joint_velocity, target, sp_max(speed, 1e-6),
                       f->config.compensation.joint_ramp, f->dt, following, rate);
        return;
    }
    double longest = sp_largest(way, SP_JOINTS);
    sp_copy(following, command, SP_JOINTS);
    sp_zero(rate, SP_JOINTS);
    if (longest == 0.0) return;
    double share = sp_min(1.0, scale * reach / longest);
    for (int j = 0; j < SP_JOINTS; j++) {
        following[j] = command[j] + sp_clip(way[j] * share, -reach, reach);
        rate[j] = (following[j] - command[j]) / f->dt;
    }
}

/* ---- the controller ---- */

void sp_flight_init(sp_flight *f, const sp_controller_config *config)
{
    memset(f, 0, sizeof *f);
    f->config = *config;
    f->dt = 1.0 / config->rate_hz;
    /* Any other value, as in a damaged log, selects the allocation with fewer rows. */
    int paper = config->allocation == SP_CONTROLLER_CONFIG_ALLOCATION_PAPER;
    f->mode = *sp_find_mode(paper ? SP_PROGRAM_PAPER : SP_PROGRAM_AS_FLOWN);
    sp_no_interference(&f->memory.interference);
}

void sp_flight_reset(const sp_robot *robot, sp_flight *f, const sp_robot_state *state, const double *joint_position, const double *trim)
{
    const double *joints = joint_position == NULL ? state->joint_position : joint_position;
    sp_flight_memory *m = &f->memory;
    memset(m, 0, sizeof *m);
    f->ticked = 0;
    sp_zero(f->joint_velocity, SP_JOINTS);
    sp_no_interference(&m->interference);
    sp_copy(m->vectoring, state->vectoring, 2 * SP_ROTORS);
    for (int i = 0; i < SP_ROTORS; i++) m->lock.phi[i] = state->vectoring[2 * i];
    sp_vectoring_to_force(state->thrust, state->vectoring, m->forces_l);
    sp_copy(m->joint_position, joints, SP_JOINTS);
    sp_copy(m->compensation.servo_position, joints, SP_JOINTS);
    if (trim == NULL) return;
    /* Initialise integrals to the known trim wrench, less the share that the observer cancels. */
    sp_snapshot *s = &f->control.snapshot;
    double R[9], force[3], torque[3], adjugate[9], angular[3];
    double of_force = 1.0 - f->config.compensation.observer_gain;
    double of_torque = 1.0 - sp_torque_observer_gain(&f->config.compensation);
    sp_from_quat(state->quat_wb, R);
    sp_snapshot_at(robot, joints, R, state->vectoring, s);
    sp_apply(R, trim, force);
    sp_apply(R, trim + 3, torque);
    for (int i = 0; i < 3; i++) {
        m->compensation.external_w[i] = m->compensation.residual_w[i] = -force[i];
        m->compensation.external_w[3 + i] = m->compensation.residual_w[3 + i] = -torque[i];
    }
    /* Solve I α = τ by Cramer's rule. */
    const double *I = s->inertia_c;
    for (int k = 0; k < 3; k++) sp_cross(I + 3 * ((k + 1) % 3), I + 3 * ((k + 2) % 3), adjugate + 3 * k);
    double det = sp_dot(I, adjugate);
    sp_apply_t(adjugate, trim + 3, angular);
    for (int i = 0; i < 3; i++) {
        double kf = f->config.centroidal.position_gains[3 * i + 1], kt = f->config.centroidal.attitude_gains[3 * i + 1];
        m->position_integral_w[i] = kf > 0.0 ? of_force * force[i] / s->mass / kf : 0.0;
        m->attitude_integral[i] = kt > 0.0 ? of_torque * angular[i] / det / kt : 0.0;
    }
}

/* Resume after another controller's `command`: resets, but keeps the integrals and the observed external wrench. */
void sp_flight_resume(const sp_robot *robot, sp_flight *f, const sp_robot_state *state, const sp_command *command)
{
    sp_flight_memory *m = &f->memory, before = *m;
    sp_flight_reset(robot, f, state, command->joint_position, NULL);
    sp_copy(m->vectoring, command->vectoring, 2 * SP_ROTORS);
    sp_vectoring_to_force(command->thrust, command->vectoring, m->forces_l);
    for (int i = 0; i < SP_ROTORS; i++) m->lock.phi[i] = command->vectoring[2 * i];
    sp_copy(m->position_integral_w, before.position_integral_w, 3);
    sp_copy(m->attitude_integral, before.attitude_integral, 3);
    sp_copy(m->compensation.external_w, before.compensation.external_w, 6);
    sp_copy(m->compensation.residual_w, before.compensation.external_w, 6);
}

/* Estimate (φ, θ) of a steady hover in the form q: forces are vertical, φ is locked as in the controller. */
void sp_rest_vectoring(const sp_robot *robot, const sp_controller_config *config, const double *q, double *vectoring)
{
    double guess[2 * SP_ROTORS], nominal[2 * SP_ROTORS], level[9];
    sp_snapshot s;
    sp_interference none, bounds;
    sp_lock lock, free;
    sp_lock_config at_once = config->lock;
    at_once.slew = HUGE_VAL;
    sp_identity(level);
    for (int i = 0; i < SP_ROTORS; i++) {
        guess[2 * i] = 0.0;
        guess[2 * i + 1] = -q[4 * (i / 2) + 1];
        if (i % 2) guess[2 * i + 1] = -(q[4 * (i / 2) + 1] + q[4 * (i / 2) + 3]);
    }
    sp_snapshot_at(robot, q, level, guess, &s);
    sp_nominal_vectoring(&s, guess, nominal);
    sp_no_interference(&none);
    sp_find_interference(&s, nominal, &none, &config->interference, &bounds);
    memset(&free, 0, sizeof free);
    for (int i = 0; i < SP_ROTORS; i++) free.phi[i] = nominal[2 * i];
    sp_update_lock(&free, bounds.restricted, nominal, &s, nominal, &at_once, &lock);
    for (int i = 0; i < SP_ROTORS; i++)
        sp_point(s.R_bl[i] + 6, nominal[2 * i], nominal[2 * i + 1], lock.active[i] ? &lock.phi[i] : NULL, 0.0,
                 vectoring + 2 * i);
}

void sp_compute_state(const sp_robot *robot, const sp_robot_state *state, const sp_reference *reference, sp_control_state *control)
{
    sp_from_quat(state->quat_wb, control->R_wb);
    sp_snapshot_at(robot, state->joint_position, control->R_wb, state->vectoring, &control->snapshot);
    motion_error(state, reference, &control->snapshot, control->R_wb, &control->error);
}

/* Repeat the last command with status `held`. */
static void hold_command(sp_flight *f, sp_command *command)
{
    double thrust[SP_ROTORS];
    f->allocation.status = SP_HELD;
    sp_zero(f->joint_velocity, SP_JOINTS);
    for (int i = 0; i < SP_ROTORS; i++) thrust[i] = sp_norm(f->memory.forces_l + 3 * i);
    sp_make_command(thrust, f->memory.vectoring, f->memory.joint_position, f->config.joint_torque_limit, command);
}

/* Write the allocation's demand: wrench, maps, and the rotors that are locked, restricted or lost. */
static void flight_demand(sp_flight *f, const sp_robot_state *state, const sp_reference *reference, sp_lock *lock,
                          sp_interference *bounds)
{
    const sp_snapshot *s = &f->control.snapshot;
    const sp_flight_memory *m = &f->memory;
    sp_demand *d = &f->demand;
    double nominal[2 * SP_ROTORS];
    sp_nominal_vectoring(s, m->vectoring, nominal);
    sp_find_interference(s, nominal, &m->interference, &f->config.interference, bounds);
    if (reference->mode != SP_REFERENCE_MODE_FLIGHT) memset(bounds->restricted, 0, sizeof bounds->restricted);
    sp_update_lock(&m->lock, bounds->restricted, nominal, s, m->vectoring, &f->config.lock, lock);
    for (int i = 0; i < SP_ROTORS; i++) {
        int gone = reference->lost_thrust[i] != 0, stuck = reference->lost_vectoring[i] != 0;
        if (gone || stuck) {
            lock->active[i] = (lock->active[i] || stuck) && !gone;
            bounds->restricted[i] = (bounds->restricted[i] || stuck) && !gone;
        }
        if (stuck) {
            lock->phi[i] = state->vectoring[2 * i];
            bounds->lower[i] = state->vectoring[2 * i + 1] - SP_NARROW;
            bounds->upper[i] = state->vectoring[2 * i + 1] + SP_NARROW;
        }
        d->locked[i] = lock->active[i];
        d->phi[i] = lock->phi[i];
        d->restricted[i] = bounds->restricted[i];
        d->lower[i] = bounds->lower[i];
        d->upper[i] = bounds->upper[i];
        d->lost[i] = gone;
        d->effort[i] = 1.0;
    }
    sp_copy(d->wrench, f->wrench_desired, 6);
    sp_thrust_map(s, d->thrust_map, SP_FORCES);
    sp_torque_map(s, d->torque_map, SP_FORCES);
    sp_copy(d->gravity_torque, s->gravity_torque, SP_JOINTS);
    for (int leg = 0; leg < SP_LEGS; leg++) d->lifted[leg] = 1;
    sp_zero(d->com_b, 3);
    sp_identity(d->R_bf);
}

/* One control tick; `control` is NULL unless the caller has computed it already. */
void sp_flight_step(sp_flight *f, const sp_robot_state *state, const sp_reference *reference,
                    const sp_residual *residual, const sp_control_state *control, sp_room *room, sp_command *command)
{
    const sp_robot *robot = room->robot;
    sp_flight_memory *m = &f->memory;
    if (!sp_valid_state(state) || !sp_valid_reference(reference)) {
        hold_command(f, command);
        return;
    }
    residual = sp_usable_residual(residual);
    if (control == NULL) sp_compute_state(robot, state, reference, &f->control);
    else f->control = *control;
    if (f->config.quasi_static) remove_joints(state, &f->control);
    double target[SP_JOINTS], joints[SP_JOINTS], speed[SP_JOINTS], led[SP_FORCES];
    const double *forces, lead = f->config.compensation.vectoring_lead;
    sp_lock lock;
    sp_interference bounds;
    for (int j = 0; j < SP_JOINTS; j++) target[j] = reference->joint_target[j] + residual->joint_offset[j];
    plan_joints(robot, f, target, residual->joint_speed_scale, joints, speed);
    if (!(reference->support > 0.0)) integrate(m, &f->control.error, f->dt, f->config.centroidal.max_integration_speed);
    desired_wrench(robot, &f->control, state->omega_b, m, &f->config.centroidal, f->wrench_desired);
    sp_compensate(robot, f, state, reference, joints, f->wrench_desired);
    for (int k = 0; k < 6; k++) f->wrench_desired[k] += residual->wrench[k];
    flight_demand(f, state, reference, &lock, &bounds);
    sp_allocate(&f->mode, &f->demand, m->forces_l, NULL, 0, &f->config.allocator, room, &f->allocation);
    if (residual->has_forces_l) {
        double wish[SP_FORCES], any = 0.0;
        for (int k = 0; k < SP_FORCES; k++) {
            wish[k] = f->allocation.forces_l[k] + residual->forces_l[k];
            any = sp_max(any, fabs(residual->forces_l[k]));
        }
        if (any > 0.0)
            sp_project(&f->demand, wish, m->forces_l, &f->config.allocator, room, &f->allocation);
    }
    if (reference->support > 0.0) {
        double share = sp_max(0.0, 1.0 - reference->support);
        for (int k = 0; k < SP_FORCES; k++) f->allocation.forces_l[k] *= share;
        for (int i = 0; i < SP_ROTORS; i++) f->allocation.thrust[i] *= share;
    }
    forces = f->allocation.forces_l;
    if (lead > 0.0) {
        sp_lead_forces(forces, &f->control.snapshot, state->omega_b, m->compensation.servo_velocity, lead, led);
        forces = led;
    }
    sp_follow(forces, &lock, m->vectoring, robot->max_vectoring_speed * f->dt, m->vectoring);
    m->lock = lock;
    m->interference = bounds;
    sp_copy(m->forces_l, f->allocation.forces_l, SP_FORCES);
    sp_copy(m->joint_position, joints, SP_JOINTS);
    sp_copy(m->joint_velocity, speed, SP_JOINTS);
    sp_copy(f->joint_velocity, speed, SP_JOINTS);
    sp_apply(f->control.R_wb, f->allocation.unallocated_wrench, m->unallocated_w);
    sp_copy(m->unallocated_torque, f->allocation.unallocated_wrench + 3, 3);
    f->ticked = 1;
    sp_make_command(f->allocation.thrust, m->vectoring, joints, f->config.joint_torque_limit, command);
}

/* Allocate a wrench in {CoG} to the rotors, for a custom controller. Call it once per control period, after
 * sp_flight_reset. Of the reference only the mode and the lost modules are used. If the state or the wrench is not
 * finite, the last command is returned. `flight->allocation` holds the status. */
void sp_flight_allocate(sp_flight *f, const sp_robot_state *state, const sp_reference *reference, const double *wrench,
                        sp_room *room, double *thrust, double *vectoring)
{
    sp_flight_memory *m = &f->memory;
    sp_lock lock;
    sp_interference bounds;
    double square = 0.0;
    for (int k = 0; k < 6; k++) square += wrench[k] * wrench[k];
    if (!sp_valid_state(state) || !isfinite(square)) {
        f->allocation.status = SP_HELD;
        for (int i = 0; i < SP_ROTORS; i++) thrust[i] = sp_norm(m->forces_l + 3 * i);
        sp_copy(vectoring, m->vectoring, 2 * SP_ROTORS);
        return;
    }
    sp_from_quat(state->quat_wb, f->control.R_wb);
    sp_snapshot_at(room->robot, state->joint_position, f->control.R_wb, state->vectoring, &f->control.snapshot);
    sp_copy(f->wrench_desired, wrench, 6);
    flight_demand(f, state, reference, &lock, &bounds);
    sp_allocate(&f->mode, &f->demand, m->forces_l, NULL, 0, &f->config.allocator, room, &f->allocation);
    sp_follow(f->allocation.forces_l, &lock, m->vectoring, room->robot->max_vectoring_speed * f->dt, m->vectoring);
    m->lock = lock;
    m->interference = bounds;
    sp_copy(m->forces_l, f->allocation.forces_l, SP_FORCES);
    f->ticked = 1;
    sp_copy(thrust, f->allocation.thrust, SP_ROTORS);
    sp_copy(vectoring, m->vectoring, 2 * SP_ROTORS);
}
