/* Estimator: integrates the inertial unit, corrects with pose measurements, filters encoder angles. */
#include "spidar_core.h"
#include "spidar_math.h"

void sp_estimator_init(sp_estimator *e, const sp_estimator_config *config)
{
    memset(e, 0, sizeof *e);
    e->config = *config;
}

/* Start from a known state at rest. */
void sp_estimator_reset(const sp_robot *robot, sp_estimator *e, const sp_robot_state *state)
{
    sp_estimator_config config = e->config;
    double lever[3];
    sp_estimator_init(e, &config);
    e->time = e->encoder_time = state->time;
    sp_from_quat(state->quat_wb, e->R_wb);
    sp_apply(e->R_wb, robot->flight_controller, lever);
    for (int i = 0; i < 3; i++) e->position_w[i] = state->position_w[i] + lever[i];
    sp_copy(e->velocity_w, state->velocity_w, 3);
    sp_copy(e->omega_b, state->omega_b, 3);
    for (int k = 0; k < SP_HISTORY; k++) {
        e->past_time[k] = -HUGE_VAL;
        sp_identity(e->past_R_wb[k]);
    }
    e->past_time[SP_HISTORY - 1] = state->time;
    sp_copy(e->past_position_w[SP_HISTORY - 1], e->position_w, 3);
    sp_copy(e->past_R_wb[SP_HISTORY - 1], e->R_wb, 9);
    sp_copy(e->angles, state->joint_position, SP_JOINTS);
    sp_copy(e->angles + SP_JOINTS, state->vectoring, 2 * SP_ROTORS);
}

/* Integrate one sample; the accelerometer's value is the mean since the previous sample. */
static void predict(const sp_robot *robot, sp_estimator *e, double time, const double *gyro, const double *force)
{
    double dt = time - e->time, omega[3], mean[3], turn[9], own[3], a[3];
    if (!(dt > 0.0)) return;
    for (int i = 0; i < 3; i++) {
        omega[i] = gyro[i] - e->gyro_bias[i];
        mean[i] = 0.5 * dt * (omega[i] + e->omega_b[i]);
        own[i] = force[i] - e->accelerometer_bias[i];
    }
    sp_exp(mean, turn);
    sp_product(e->R_wb, turn, e->R_wb);
    sp_apply(e->R_wb, own, a);
    a[2] -= robot->gravity;
    for (int i = 0; i < 3; i++) {
        e->position_w[i] += dt * e->velocity_w[i] + 0.5 * dt * dt * a[i];
        e->velocity_w[i] += dt * a[i];
    }
    sp_copy(e->omega_b, omega, 3);
    e->time = time;
    memmove(e->past_time, e->past_time + 1, (SP_HISTORY - 1) * sizeof e->past_time[0]);
    memmove(e->past_position_w, e->past_position_w + 1, (SP_HISTORY - 1) * sizeof e->past_position_w[0]);
    memmove(e->past_R_wb, e->past_R_wb + 1, (SP_HISTORY - 1) * sizeof e->past_R_wb[0]);
    e->past_time[SP_HISTORY - 1] = time;
    sp_copy(e->past_position_w[SP_HISTORY - 1], e->position_w, 3);
    sp_copy(e->past_R_wb[SP_HISTORY - 1], e->R_wb, 9);
}

/* Correct the estimate and its history since `time` with a pose measured at `time`. */
static void correct(sp_estimator *e, double time, const double *position_w, const double *R_wb)
{
    const sp_estimator_config *c = &e->config;
    int k = 0;
    for (int i = 1; i < SP_HISTORY; i++)
        if (fabs(e->past_time[i] - time) < fabs(e->past_time[k] - time)) k = i;
    double error[3], back[9], off[9], turn[3], own[3], share[3], nudge[9];
    for (int i = 0; i < 3; i++) error[i] = position_w[i] - e->past_position_w[k][i];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) back[3 * i + j] = e->past_R_wb[k][3 * j + i];
    sp_product(R_wb, back, off);
    sp_log(off, turn);
    sp_apply_t(e->R_wb, error, own);
    for (int i = 0; i < 3; i++) {
        e->velocity_w[i] += c->velocity * error[i];
        e->accelerometer_bias[i] -= c->accelerometer * own[i];
    }
    sp_apply_t(e->R_wb, turn, own);
    for (int i = 0; i < 3; i++) e->gyro_bias[i] -= c->gyro * own[i], share[i] = c->attitude * turn[i];
    sp_exp(share, nudge);
    double then = e->past_time[k];
    for (int i = k; i < SP_HISTORY; i++) {
        double gain = c->position + c->velocity * (e->past_time[i] - then);
        for (int j = 0; j < 3; j++) e->past_position_w[i][j] += gain * error[j];
        sp_product(nudge, e->past_R_wb[i], e->past_R_wb[i]);
    }
    sp_copy(e->position_w, e->past_position_w[SP_HISTORY - 1], 3);
    sp_copy(e->R_wb, e->past_R_wb[SP_HISTORY - 1], 9);
}

/* Estimate the state at a control tick; `thrust` is the last command, because thrust is not measured. */
void sp_estimator_update(const sp_robot *robot, sp_estimator *e, const sp_measurement *m, const double *thrust, sp_robot_state *state)
{
    for (int k = 0; k < m->imu_count; k++)
        predict(robot, e, m->imu_time[k], m->gyro_b + 3 * k, m->specific_force_b + 3 * k);
    for (int k = 0; k < m->pose_count; k++) {
        double R[9];
        sp_from_quat(m->pose_quat_wb + 4 * k, R);
        correct(e, m->pose_time[k], m->pose_position_w + 3 * k, R);
    }
    double dt = m->encoder_time - e->encoder_time;
    if (dt > 1e-9) { /* critically damped observer, constant-rate model */
        for (int j = 0; j < SP_ANGLES; j++) {
            double read = j < SP_JOINTS ? m->joint_position[j] : m->vectoring[j - SP_JOINTS];
            double decay = exp(-(j < SP_JOINTS ? e->config.joint_bandwidth : e->config.vectoring_bandwidth) * dt);
            double guess = e->angles[j] + dt * e->rates[j], error = read - guess;
            e->angles[j] = guess + (1.0 - decay * decay) * error;
            e->rates[j] += (1.0 - decay) * (1.0 - decay) / dt * error;
        }
        e->encoder_time = m->encoder_time;
    }
    double ahead = m->time - e->encoder_time, lever[3], swing[3];
    state->time = m->time;
    sp_apply(e->R_wb, robot->flight_controller, lever);
    sp_cross(e->omega_b, robot->flight_controller, swing);
    sp_apply(e->R_wb, swing, swing);
    for (int i = 0; i < 3; i++) {
        state->position_w[i] = e->position_w[i] - lever[i];
        state->velocity_w[i] = e->velocity_w[i] - swing[i];
        state->omega_b[i] = e->omega_b[i];
    }
    sp_to_quat(e->R_wb, state->quat_wb);
    for (int j = 0; j < SP_JOINTS; j++) {
        state->joint_position[j] = e->angles[j] + ahead * e->rates[j];
        state->joint_velocity[j] = e->rates[j];
        state->vectoring[j] = e->angles[SP_JOINTS + j] + ahead * e->rates[SP_JOINTS + j];
        state->vectoring_velocity[j] = e->rates[SP_JOINTS + j];
        state->joint_torque[j] = m->joint_torque[j];
    }
    sp_copy(state->thrust, thrust, SP_ROTORS);
}
