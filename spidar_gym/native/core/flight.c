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

/* Solve I x = b (3) by Cramer's rule, up to the division of x by the determinant, which is returned. */
static double solve(const double *I, const double *b, double *x)
{
    double adjugate[9];
    for (int k = 0; k < 3; k++) sp_cross(I + 3 * ((k + 1) % 3), I + 3 * ((k + 2) % 3), adjugate + 3 * k);
    sp_apply_t(adjugate, b, x);
    return sp_dot(I, adjugate);
}

/* Take the joints' fast deviation from the model of the servos out of a state: δ, its rate, and the model's. */
static void unbend(sp_flight *f, sp_robot_state *state, double *bend, double *bending, double *planned)
{
    sp_motion_memory *m = &f->memory.motion;
    double share = 1.0 - exp(-f->dt / SP_BEND_TIME);
    m->ringing *= exp(-f->dt / SP_RINGING_TIME);
    for (int j = 0; j < SP_JOINTS; j++) {
        double plan = f->memory.compensation.servo_position[j], away = state->joint_position[j] - plan;
        double before = m->has_sag ? m->sag[j] : away, last = m->has_sag ? m->plan[j] : plan;
        m->sag[j] = before + share * (away - before);
        planned[j] = (plan - last) / f->dt; /* the model's velocity at the end of a tick is not its mean */
        double rate = planned[j] + (m->sag[j] - before) / f->dt;
        m->plan[j] = plan;
        bend[j] = away - m->sag[j];
        bending[j] = state->joint_velocity[j] - rate;
        m->ringing = sp_max(m->ringing, fabs(bending[j]));
        state->joint_position[j] = plan + m->sag[j];
        state->joint_velocity[j] = rate;
    }
    m->has_sag = 1;
}

/* A wrench in {CoG} in world axes, less the weight. */
static void to_world(const double *wrench, const double *R_wb, double weight, double *out)
{
    sp_apply(R_wb, wrench, out);
    sp_apply(R_wb, wrench + 3, out + 3);
    out[2] -= weight;
}

/* The wrench of thrusts in the measured directions, in world axes, less the weight. */
static void delivered_wrench(const sp_flight *f, const double *Q, const double *thrust, const double *vectoring, double weight,
                             double *out)
{
    double forces[SP_FORCES], wrench[6];
    sp_vectoring_to_force(thrust, vectoring, forces);
    for (int k = 0; k < 6; k++) wrench[k] = sp_row(Q + SP_FORCES * k, forces, SP_FORCES);
    to_world(wrench, f->control.R_wb, weight, out);
}

/* Observe the momentum p of the whole robot, and predict it to when the next command acts: p̂ ← p̂ + dt (w_λ + w_g + ŵ),
 * then p̂ ← p̂ + (1 − a²) e and ŵ ← ŵ + (1 − a)²/dt e with e = p − p̂. */
static void observe_motion(const sp_robot *robot, sp_flight *f, const sp_robot_state *state, const double *bending, const double *planned,
                           const double *velocity_w, const double *Q, int first, double *predicted)
{
    sp_motion_memory *m = &f->memory.motion;
    const sp_snapshot *s = &f->control.snapshot;
    const double *R_wb = f->control.R_wb, dt = f->dt;
    double legs[3], coming_legs[3], whole[3], L[3], h[3], measured[6], delivered[6];
    double weight = s->mass * robot->gravity, late = sp_min(SP_COMMAND_DELAY / dt, SP_COMMANDS - 1.0 - 1e-9);
    int ticks = (int)late;
    double part = late - ticks;
    sp_leg_momentum(s, planned, legs);
    sp_leg_momentum(s, state->joint_velocity, whole);
    sp_leg_momentum(s, bending, h);
    sp_apply(s->inertia_c, state->omega_b, L);
    if (first || !f->ticked) sp_copy(m->legs, legs, 3);
    for (int i = 0; i < 3; i++) {
        measured[i] = s->mass * velocity_w[i];
        L[i] += whole[i] + h[i];
        /* The planned joint motion has its share of the momentum, now and then. */
        coming_legs[i] = whole[i] + SP_COMMAND_DELAY / dt * (legs[i] - m->legs[i]);
        m->legs[i] = legs[i];
    }
    sp_apply(R_wb, L, measured + 3);
    if (first || !f->ticked) {
        delivered_wrench(f, Q, state->thrust, state->vectoring, weight, delivered);
        sp_copy(m->thrust, state->thrust, SP_ROTORS);
        sp_copy(m->momentum_w, measured, 6);
        for (int i = 0; i < 6; i++) { /* the robot is taken to be in balance */
            double bound = i < 3 ? SP_MAX_EXTERNAL_SHARE * robot->weight : SP_MAX_EXTERNAL_TORQUE;
            m->external_w[i] = sp_clip(-delivered[i], -bound, bound);
        }
        for (int k = 0; k < SP_COMMANDS; k++) {
            sp_copy(m->commands[k], state->thrust, SP_ROTORS);
            sp_copy(m->commands[k] + SP_ROTORS, delivered, 6);
        }
    } else {
        double lag = 1.0 - exp(-dt / SP_ROTOR_LAG), decay = exp(-dt / SP_MOMENTUM_TIME);
        memmove(m->commands[1], m->commands[0], sizeof m->commands - sizeof m->commands[0]);
        for (int i = 0; i < SP_ROTORS; i++) m->commands[0][i] = sp_norm(f->memory.forces_l + 3 * i);
        to_world(f->allocation.wrench, R_wb, weight, m->commands[0] + SP_ROTORS);
        for (int i = 0; i < SP_ROTORS; i++) {
            double reached = (1.0 - part) * m->commands[ticks][i] + part * m->commands[ticks + 1][i];
            m->thrust[i] += lag * (reached - m->thrust[i]);
        }
        delivered_wrench(f, Q, m->thrust, state->vectoring, weight, delivered);
        for (int i = 0; i < 6; i++) {
            double bound = i < 3 ? SP_MAX_EXTERNAL_SHARE * robot->weight : SP_MAX_EXTERNAL_TORQUE;
            double momentum = m->momentum_w[i] + dt * (delivered[i] + m->external_w[i]), miss = measured[i] - momentum;
            m->momentum_w[i] = momentum + (1.0 - decay * decay) * miss;
            m->external_w[i] = sp_clip(m->external_w[i] + (1.0 - decay) * (1.0 - decay) / dt * miss, -bound, bound);
        }
    }
    sp_apply(R_wb, coming_legs, h);
    sp_copy(predicted, m->momentum_w, 6);
    for (int i = 0; i < 3; i++) predicted[3 + i] -= h[i];
    for (int k = ticks; k >= 0; k--) {
        double span = k == ticks ? part * dt : dt, share = 1.0 - exp(-span / SP_ROTOR_LAG);
        for (int i = 0; i < 6; i++) {
            double coming = m->commands[k][SP_ROTORS + i];
            predicted[i] += span * (coming + m->external_w[i]) + SP_ROTOR_LAG * share * (delivered[i] - coming);
            delivered[i] += share * (coming - delivered[i]);
        }
    }
}

/* Replace state and errors by those of the whole robot when the next command acts: its momentum is observed, its attitude
 * is the torso's, turned by I⁻¹ H δ. While legs ring, the errors of attitude and angular velocity are reduced. */
static void feed_whole_motion(const sp_robot *robot, sp_flight *f, const sp_reference *reference, sp_robot_state *state)
{
    const sp_snapshot *s = &f->control.snapshot;
    sp_motion_error *e = &f->control.error;
    double bend[SP_JOINTS], bending[SP_JOINTS], planned[SP_JOINTS], velocity_w[3], predicted[6], L[3], h[3], turning[3], turned[3];
    double Q[6 * SP_FORCES];
    int first = !f->memory.motion.has_sag;
    sp_zero(Q, 6 * SP_FORCES);
    sp_thrust_map(s, Q, SP_FORCES); /* of the links as they are */
    unbend(f, state, bend, bending, planned);
    sp_compute_state(robot, state, reference, &f->control);
    for (int i = 0; i < 3; i++) velocity_w[i] = reference->velocity_w[i] - e->velocity_w[i];
    observe_motion(robot, f, state, bending, planned, velocity_w, Q, first, predicted);
    sp_apply_t(f->control.R_wb, predicted + 3, L);
    sp_leg_momentum(s, bend, h);
    double det = solve(s->inertia_c, L, turning);
    double calm = SP_RINGING / sp_max(f->memory.motion.ringing, SP_RINGING), share = sp_max(SP_LEAST_SHARE, calm * calm);
    solve(s->inertia_c, h, turned);
    for (int i = 0; i < 3; i++) {
        turning[i] /= det;
        e->velocity_w[i] += velocity_w[i] - predicted[i] / s->mass;
        e->omega_b[i] += state->omega_b[i] - turning[i];
        e->position_w[i] += SP_COMMAND_DELAY * e->velocity_w[i];
        e->attitude[i] = share * (e->attitude[i] - turned[i] / det + SP_COMMAND_DELAY * e->omega_b[i]);
        e->omega_b[i] *= share;
        state->omega_b[i] = turning[i];
    }
}

/* ---- joint motion ---- */

/* Compute the next joint command on the straight line to the target, and its rate. */
void sp_plan_joints(const sp_robot *robot, const sp_flight *f, const double *wanted, double scale, double *following,
                    double *rate)
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
    f->thrust_limit = HUGE_VAL;
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
    double R[9], force[3], torque[3], angular[3];
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
    double det = solve(s->inertia_c, trim + 3, angular);
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
    sp_find_interference(&s, nominal, &none, &config->interference, NULL, &bounds);
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
static void command_of(const sp_flight *f, const double *thrust, sp_command *command)
{
    double joints[SP_JOINTS];
    sp_copy(joints, f->memory.joint_position, SP_JOINTS);
    for (int j = 0; j < SP_JOINTS; j++) /* not + 0.0, which would change −0.0 */
        if (f->memory.joint_lead[j] != 0.0) joints[j] += f->memory.joint_lead[j];
    sp_make_command(thrust, f->memory.vectoring, joints, f->config.joint_torque_limit, command);
}

/* Let the joint setpoints lead q^d, so that the springs of the servos exert their share of a grip. */
static void lead_joints(const sp_robot *robot, sp_flight *f, const sp_grip *grip)
{
    double most = f->config.joint_speed * f->dt, share = 1.0 - exp(-f->dt / SP_GRIP_LEAD_TIME), *lead = f->memory.joint_lead;
    int presses = grip != NULL && grip->force > 0.0;
    for (int j = 0; j < SP_JOINTS; j++) {
        double wanted = presses ? f->allocation.joint_torques[j] / robot->joint_kp : 0.0;
        lead[j] += sp_clip(share * (wanted - lead[j]), -most, most);
    }
}

static void hold_command(sp_flight *f, sp_command *command)
{
    double thrust[SP_ROTORS];
    f->allocation.status = SP_HELD;
    sp_zero(f->joint_velocity, SP_JOINTS);
    for (int i = 0; i < SP_ROTORS; i++) thrust[i] = sp_norm(f->memory.forces_l + 3 * i);
    command_of(f, thrust, command);
}

/* Write the allocation's demand: wrench, maps, and the rotors that are locked, restricted or lost. */
static void flight_demand(const sp_robot *robot, sp_flight *f, const sp_robot_state *state, const sp_reference *reference,
                          const sp_grip *grip, const sp_residual *residual, sp_lock *lock, sp_interference *bounds)
{
    const sp_snapshot *s = &f->control.snapshot;
    const sp_flight_memory *m = &f->memory;
    sp_demand *d = &f->demand;
    double nominal[2 * SP_ROTORS];
    sp_nominal_vectoring(s, m->vectoring, nominal);
    sp_disc disc;
    int avoids = grip != NULL && grip->radius > 0.0;
    if (avoids) sp_grip_disc(grip, s, f->control.R_wb, state->position_w, &disc);
    sp_find_interference(s, nominal, &m->interference, &f->config.interference, avoids ? &disc : NULL, bounds);
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
    d->thrust_limit = f->thrust_limit;
    sp_copy(d->wrench, f->wrench_desired, 6);
    sp_thrust_map(s, d->thrust_map, SP_FORCES);
    sp_torque_map(s, d->torque_map, SP_FORCES);
    sp_copy(d->gravity_torque, s->gravity_torque, SP_JOINTS);
    if (grip != NULL) sp_grip_torque(robot, grip, s, f->control.R_wb, state->position_w, residual, d->gravity_torque);
    for (int leg = 0; leg < SP_LEGS; leg++) d->lifted[leg] = 1;
    sp_zero(d->com_b, 3);
    sp_identity(d->R_bf);
}

/* One control tick; `control` is NULL unless the caller has computed it already, `grip` without an object. */
void sp_flight_step(sp_flight *f, const sp_robot_state *state, const sp_reference *reference,
                    const sp_residual *residual, const sp_control_state *control, const sp_grip *grip, sp_room *room,
                    sp_command *command)
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
    sp_robot_state seen = *state; /* as it is fed back */
    if (f->config.motion == SP_CONTROLLER_CONFIG_MOTION_QUASI_STATIC) remove_joints(state, &f->control);
    else if (f->config.motion == SP_CONTROLLER_CONFIG_MOTION_OBSERVED) {
        if (reference->support > 0.0) memset(&m->motion, 0, sizeof m->motion); /* the floor's force is no disturbance */
        else feed_whole_motion(robot, f, reference, &seen);
    }
    double target[SP_JOINTS], joints[SP_JOINTS], speed[SP_JOINTS], led[SP_FORCES];
    const double *forces, lead = f->config.compensation.vectoring_lead;
    sp_lock lock;
    sp_interference bounds;
    for (int j = 0; j < SP_JOINTS; j++) target[j] = reference->joint_target[j] + residual->joint_offset[j];
    sp_plan_joints(robot, f, target, residual->joint_speed_scale, joints, speed);
    if (!(reference->support > 0.0)) integrate(m, &f->control.error, f->dt, f->config.centroidal.max_integration_speed);
    desired_wrench(robot, &f->control, seen.omega_b, m, &f->config.centroidal, f->wrench_desired);
    sp_compensate(robot, f, &seen, reference, joints, f->wrench_desired);
    for (int k = 0; k < 6; k++) f->wrench_desired[k] += residual->wrench[k];
    if (grip != NULL) sp_grip_carried(robot, grip, &f->control.snapshot, f->control.R_wb, state->position_w, f->wrench_desired);
    flight_demand(robot, f, state, reference, grip, residual, &lock, &bounds);
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
    lead_joints(robot, f, grip);
    command_of(f, f->allocation.thrust, command);
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
    flight_demand(room->robot, f, state, reference, NULL, &SP_NO_RESIDUAL, &lock, &bounds);
    sp_allocate(&f->mode, &f->demand, m->forces_l, NULL, 0, &f->config.allocator, room, &f->allocation);
    sp_follow(f->allocation.forces_l, &lock, m->vectoring, room->robot->max_vectoring_speed * f->dt, m->vectoring);
    m->lock = lock;
    m->interference = bounds;
    sp_copy(m->forces_l, f->allocation.forces_l, SP_FORCES);
    f->ticked = 1;
    sp_copy(thrust, f->allocation.thrust, SP_ROTORS);
    sp_copy(vectoring, m->vectoring, 2 * SP_ROTORS);
}
