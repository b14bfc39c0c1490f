/* Compensations beyond the paper's quasi-static control: leg momentum, observer, leads, reference, joint ramp. */
#include "spidar_core.h"
#include "spidar_math.h"

/* Angular momentum h (3) of the legs about the CoG for a joint velocity. */
void sp_leg_momentum(const sp_snapshot *s, const double *velocity, double *h)
{
    for (int i = 0; i < 3; i++) h[i] = sp_row(s->momentum_map + SP_JOINTS * (3 + i), velocity, SP_JOINTS);
}

/* Advance the critically damped second-order servo model by one tick, exactly, for a constant command. */
static void servo_response(sp_compensation_memory *m, const double *command, double bandwidth, double dt)
{
    double decay = exp(-bandwidth * dt);
    for (int j = 0; j < SP_JOINTS; j++) {
        double e = m->servo_position[j] - command[j], slope = m->servo_velocity[j] + bandwidth * e;
        m->servo_position[j] = command[j] + decay * (e + dt * slope);
        m->servo_velocity[j] = decay * (m->servo_velocity[j] - bandwidth * dt * slope);
    }
}

/* Compute the torque that the legs' change of angular momentum requires, τ = ḣ + ω × h, filtered [Orin2013]. */
static void momentum_torque(const sp_snapshot *s, sp_compensation_memory *m, const double *omega_b,
                            const sp_compensation_config *c, double dt)
{
    double h[3], gyro[3], share = c->momentum_filter > 0.0 ? 1.0 - exp(-dt / c->momentum_filter) : 1.0;
    sp_leg_momentum(s, m->servo_velocity, h);
    sp_cross(omega_b, h, gyro);
    for (int i = 0; i < 3; i++) {
        double wanted = (m->has_momentum ? (h[i] - m->momentum[i]) / dt : 0.0) + gyro[i];
        m->torque[i] += share * (wanted - m->torque[i]);
        m->momentum[i] = h[i];
    }
    m->has_momentum = 1;
}

/* The torque observer's value, or the force observer's if that is 0. */
static double own_or(double own, double other)
{
    return own != 0.0 ? own : other;
}

/* Share of the observed torque that is cancelled. */
double sp_torque_observer_gain(const sp_compensation_config *c)
{
    return own_or(c->torque_observer_gain, c->observer_gain);
}

/* Low-pass coefficients per tick: of an observer, and of its rotor model. */
static void passes(double time, double lag, double dt, double *share, double *of_rotors)
{
    *share = 1.0 - exp(-dt / time);
    *of_rotors = lag > 0.0 ? 1.0 - exp(-dt / lag) : 1.0;
}

/* Momentum observer: ŵ ← ŵ + dt/T (ṗ − w_λ − w_g − ŵ) [DeLuca2006], with one low-pass or two in series.
 * `observer_beyond`: velocities are errors, p is the error's momentum, and feed-forward wrenches are left out. */
static void observe_wrench(const sp_robot *robot, const sp_snapshot *s, sp_compensation_memory *m, const double *R_wb, const double *omega_b,
                           const double *velocity_w, const double *allocated, const sp_compensation_config *c,
                           double dt)
{
    double L[3], h[3], momentum[6], asked[6];
    sp_apply(s->inertia_c, omega_b, L);
    for (int i = 0; i < 3; i++) momentum[i] = s->mass * velocity_w[i];
    if (!c->observer_beyond) {
        sp_leg_momentum(s, m->servo_velocity, h);
        for (int i = 0; i < 3; i++) L[i] += h[i];
    }
    sp_apply(R_wb, L, momentum + 3);
    sp_apply(R_wb, allocated, asked);
    sp_apply(R_wb, allocated + 3, asked + 3);
    if (c->observer_beyond)
        for (int i = 0; i < 6; i++) asked[i] -= m->fed_w[i];
    if (!m->has_observed) {
        sp_copy(m->delivered_w, asked, 6);
    } else {
        double lags[2], shares[2];
        passes(c->observer_time, c->observer_lag, dt, shares, lags);
        if (c->torque_observer_time == 0.0 && c->torque_observer_lag == 0.0)
            shares[1] = shares[0], lags[1] = lags[0];
        else
            passes(own_or(c->torque_observer_time, c->observer_time), own_or(c->torque_observer_lag, c->observer_lag), dt,
                   shares + 1, lags + 1);
        for (int i = 0; i < 6; i++) {
            double share = shares[i / 3];
            m->delivered_w[i] += lags[i / 3] * (asked[i] - m->delivered_w[i]);
            double residual = (momentum[i] - m->observed_momentum[i]) / dt - m->delivered_w[i];
            if (i == 2 && !c->observer_beyond) residual += s->mass * robot->gravity;
            if (c->observer_order == 2) residual = m->residual_w[i] + share * (residual - m->residual_w[i]);
            m->residual_w[i] = residual;
            double bound = i < 3 ? SP_MAX_EXTERNAL_SHARE * robot->weight : SP_MAX_EXTERNAL_TORQUE;
            m->external_w[i] = sp_clip(m->external_w[i] + share * (residual - m->external_w[i]), -bound, bound);
        }
    }
    sp_copy(m->observed_momentum, momentum, 6);
    m->has_observed = 1;
}

/* Add the feed-forward wrench of the reference's acceleration in {CoG}: m r̈ᵈ and I ω̇ᵈ, times a gain. */
static void follow_reference(const sp_control_state *control, const sp_reference *reference, double gain, double *wrench)
{
    double R_d[9], alpha_w[3], alpha[3], force[3], torque[3], any = 0.0;
    for (int i = 0; i < 3; i++) any = sp_max(any, sp_max(fabs(reference->acceleration_w[i]), fabs(reference->alpha_b[i])));
    if (any == 0.0) return; /* a reference without acceleration changes no bit */
    sp_from_quat(reference->quat_wb, R_d);
    sp_apply(R_d, reference->alpha_b, alpha_w);
    sp_apply_t(control->R_wb, alpha_w, alpha);
    sp_apply_t(control->R_wb, reference->acceleration_w, force);
    sp_apply(control->snapshot.inertia_c, alpha, torque);
    for (int i = 0; i < 3; i++) {
        wrench[i] += gain * (control->snapshot.mass * force[i]);
        wrench[3 + i] += gain * torque[i];
    }
}

/* Wrench in {CoG} that balances the weight and the gyroscopic torque ω × I `turning_b`. */
static void weight_wrench(const sp_robot *robot, const sp_control_state *control, const double *omega_b,
                          const double *turning_b, double *wrench)
{
    double L[3];
    sp_apply(control->snapshot.inertia_c, turning_b, L);
    for (int i = 0; i < 3; i++) wrench[i] = control->snapshot.mass * robot->gravity * control->R_wb[6 + i];
    sp_cross(omega_b, L, wrench + 3);
}

/* Apply the lead compensator 1 + ρ (1 − 1/(1 + T s)) to the PIDs' wrench beyond the weight. */
static void lead_feedback(sp_compensation_memory *m, const double *weight, const double *R_wb,
                          const sp_compensation_config *c, double dt, double *wrench)
{
    double feedback[6], asked[6], fast[6], more[6], share = 1.0 - exp(-dt / c->lead_time);
    for (int i = 0; i < 6; i++) feedback[i] = wrench[i] - weight[i];
    sp_apply(R_wb, feedback, asked);
    sp_apply(R_wb, feedback + 3, asked + 3);
    if (!m->has_slow) sp_copy(m->slow_w, asked, 6); /* the first tick adds nothing */
    m->has_slow = 1;
    for (int i = 0; i < 6; i++) {
        m->slow_w[i] += share * (asked[i] - m->slow_w[i]);
        fast[i] = c->lead_gain * (asked[i] - m->slow_w[i]);
    }
    sp_apply_t(R_wb, fast, more);
    sp_apply_t(R_wb, fast + 3, more + 3);
    for (int i = 0; i < 6; i++) wrench[i] += more[i];
}

/* Add the compensations to the desired wrench; `joints` is the new q^d. */
void sp_compensate(const sp_robot *robot, sp_flight *f, const sp_robot_state *state, const sp_reference *reference,
                   const double *joints, double *wrench)
{
    const sp_compensation_config *c = &f->config.compensation;
    sp_compensation_memory *m = &f->memory.compensation;
    const sp_control_state *control = &f->control;
    const sp_motion_error *e = &control->error;
    const double *R_wb = control->R_wb, *omega = state->omega_b;
    double weight[6], fed[6], way[3];
    if (c->lead_gain != 0.0) {
        weight_wrench(robot, control, omega, omega, weight);
        lead_feedback(m, weight, R_wb, c, f->dt, wrench);
    }
    sp_zero(fed, 6);
    if (c->reference_gain != 0.0) {
        follow_reference(control, reference, c->reference_gain, fed);
        for (int i = 0; i < 6; i++) wrench[i] += fed[i];
    }
    int observed = f->config.motion == SP_CONTROLLER_CONFIG_MOTION_OBSERVED; /* it reads the model of the servos */
    if (!(c->momentum_gain != 0.0 || c->vectoring_lead != 0.0 || c->observer_gain != 0.0 || observed)) return;
    if (reference->support > 0.0) m->has_observed = 0; /* the floor's force is not a disturbance */
    else if (c->observer_gain != 0.0 && f->ticked) {
        double velocity_w[3], turning[3];
        for (int i = 0; i < 3; i++) {
            velocity_w[i] = c->observer_beyond ? -e->velocity_w[i] : reference->velocity_w[i] - e->velocity_w[i];
            turning[i] = c->observer_beyond ? -e->omega_b[i] : omega[i];
        }
        observe_wrench(robot, &control->snapshot, m, R_wb, turning, velocity_w, f->allocation.wrench, c, f->dt);
    }
    if (c->observer_gain != 0.0) {
        double force[3], torque[3];
        sp_apply_t(R_wb, m->external_w, force);
        sp_apply_t(R_wb, m->external_w + 3, torque);
        for (int i = 0; i < 3; i++) {
            wrench[i] -= c->observer_gain * force[i];
            wrench[3 + i] -= sp_torque_observer_gain(c) * torque[i];
        }
    }
    servo_response(m, joints, c->servo_bandwidth, f->dt);
    if (c->momentum_gain != 0.0) {
        momentum_torque(&control->snapshot, m, omega, c, f->dt);
        for (int i = 0; i < 3; i++) {
            wrench[3 + i] += c->momentum_gain * m->torque[i];
            fed[3 + i] += c->momentum_gain * m->torque[i];
        }
    }
    if (!c->observer_beyond) return;
    for (int i = 0; i < 3; i++) way[i] = omega[i] + e->omega_b[i]; /* the reference's angular velocity */
    weight_wrench(robot, control, omega, way, weight);
    for (int i = 0; i < 6; i++) fed[i] += weight[i];
    sp_apply(R_wb, fed, m->fed_w);
    sp_apply(R_wb, fed + 3, m->fed_w + 3);
}

/* Express the forces in the link axes of `lead` [s] later, to compensate for slow vectoring servos. */
void sp_lead_forces(const double *forces_l, const sp_snapshot *s, const double *omega_b, const double *velocity,
                    double lead, double *led)
{
    for (int i = 0; i < SP_ROTORS; i++) {
        double omega[3], turn[3], R[9];
        int first = 4 * (i / 2), last = first + (i % 2 ? 4 : 2);
        for (int k = 0; k < 3; k++) {
            omega[k] = 0.0;
            for (int j = first; j < last; j++) omega[k] += s->joint_axes[SP_JOINTS * k + j] * velocity[j];
            omega[k] += omega_b[k];
        }
        sp_apply_t(s->R_bl[i], omega, turn);
        for (int k = 0; k < 3; k++) turn[k] *= -lead;
        sp_exp(turn, R);
        sp_apply(R, forces_l + 3 * i, led + 3 * i);
    }
}

/* Compute the next joint command and its rate: joints are synchronised, acceleration is at most speed / ramp. */
void sp_ramp_joints(const double *command, const double *velocity, const double *target, double speed, double ramp,
                    double dt, double *following, double *rate)
{
    double way[SP_JOINTS], change[SP_JOINTS], longest, most, step = speed / ramp * dt, off = 0.0;
    int moving = 0;
    for (int j = 0; j < SP_JOINTS; j++) way[j] = target[j] - command[j], moving |= velocity[j] != 0.0;
    longest = sp_largest(way, SP_JOINTS);
    if (longest == 0.0 && !moving) {
        sp_copy(following, command, SP_JOINTS);
        sp_copy(rate, velocity, SP_JOINTS);
        return;
    }
    /* Largest speed from which the command, losing one step per tick, stops on the target. */
    double far = longest / (step * dt), n = floor(sqrt(0.25 + 2.0 * far) - 0.5 + 1e-9);
    double reach = step * (n + (far - 0.5 * n * (n + 1.0)) / (n + 1.0));
    double scale = longest > 0.0 ? sp_min(speed, reach) / longest : 0.0;
    for (int j = 0; j < SP_JOINTS; j++) change[j] = way[j] * scale - velocity[j];
    most = sp_largest(change, SP_JOINTS);
    if (most > step * (1.0 + 1e-9))
        for (int j = 0; j < SP_JOINTS; j++) change[j] *= step / most;
    for (int j = 0; j < SP_JOINTS; j++) {
        rate[j] = velocity[j] + change[j];
        following[j] = command[j] + dt * rate[j];
        off = sp_max(off, fabs(target[j] - following[j]));
    }
    if (off < 1e-9) sp_copy(following, target, SP_JOINTS);
}
