/* The sensors of the real robot: motion capture at 100 Hz, inertial unit at 200 Hz, encoders at 50 Hz.
 *
 * They are sampled at every instant of the inertial unit. The order of the draws determines what a seed produces:
 * biases and drift at switch-on, then at each sample nine numbers for the inertial unit. A frame adds six for the
 * drift, six for its noise and one for the drop-out. A reading of the servos adds one for every angle and one for
 * every torque.
 */
#include "engine.h"

static void normals(sp_generator *generator, double scale, int n, double *values)
{
    for (int i = 0; i < n; i++) values[i] = scale * sp_normal(generator);
}

/* Velocity of the inertial unit, world. */
static void unit_velocity(const sp_world *world, const sp_robot_state *state, const double *R_wb, double *velocity_w)
{
    double swing[3];
    sp_cross(state->omega_b, world->imu_position_b, swing);
    sp_apply(R_wb, swing, velocity_w);
    for (int i = 0; i < 3; i++) velocity_w[i] += state->velocity_w[i];
}

/* Take a frame of the motion capture. */
static void take_frame(const sp_world *world, const sp_sensor_config *c, const sp_robot_state *state,
                       const double *R_wb, sp_generator *generator, sp_sensor_memory *m)
{
    double decay = exp(-SP_POSE_PERIOD / SP_DRIFT_SECONDS), spread = c->factor * sqrt(1.0 - decay * decay);
    double walk[6], white[6], turn[3], R[9];
    normals(generator, 1.0, 6, walk);
    for (int i = 0; i < 6; i++)
        m->drift[i] = decay * m->drift[i] + spread * (i < 3 ? c->position_drift : c->rotation_drift) * walk[i];
    normals(generator, c->factor, 6, white);
    if (sp_random(generator) < c->dropout) m->silent_until = state->time + SP_DROPOUT_SECONDS;
    if (!(state->time >= m->silent_until - 1e-9)) return;
    if (m->frames == SP_MAX_FRAMES) { /* drop the oldest: a tick delivers only the latest few */
        m->frames--;
        memmove(m->frame_time, m->frame_time + 1, sizeof m->frame_time - sizeof *m->frame_time);
        memmove(m->frame_position_w, m->frame_position_w + 1, sizeof m->frame_position_w - sizeof *m->frame_position_w);
        memmove(m->frame_quat_wb, m->frame_quat_wb + 1, sizeof m->frame_quat_wb - sizeof *m->frame_quat_wb);
    }
    double *position = m->frame_position_w[m->frames];
    sp_apply(R_wb, world->imu_position_b, position);
    for (int i = 0; i < 3; i++) {
        position[i] = state->position_w[i] + position[i] + m->drift[i] + c->position_noise * white[i];
        turn[i] = m->drift[3 + i] + c->rotation_noise * white[3 + i];
    }
    sp_exp(turn, R);
    sp_product(R_wb, R, R);
    sp_to_quat(R, m->frame_quat_wb[m->frames]);
    m->frame_time[m->frames++] = state->time;
}

/* Read the servos; `offset` is true minus indicated angles. */
static void read_servos(const sp_world *world, const sp_sensor_config *c, const double *offset,
                        const sp_robot_state *state, sp_generator *generator, sp_sensor_memory *m)
{
    for (int j = 0; j < SP_ANGLES; j++) {
        double angle = (j < SP_JOINTS ? state->joint_position[j] : state->vectoring[j - SP_JOINTS]) - offset[j];
        double counts = angle / world->encoder_step[j] + c->factor * c->encoder_noise * sp_normal(generator);
        m->angles[j] = nearbyint(counts) * world->encoder_step[j];
    }
    for (int j = 0; j < SP_JOINTS; j++)
        m->torque[j] = state->joint_torque[j] * (1.0 + c->factor * c->torque_noise * sp_normal(generator));
    m->encoder_time = state->time;
}

/* Measure a true state, every 5 ms. */
void sp_sample_sensors(const sp_world *world, const sp_sensor_config *c, const double *offset,
                       const sp_robot_state *state, sp_generator *generator, sp_sensor_memory *m)
{
    double R[9], velocity[3], acceleration[3], force[3], noise[9], density = 1.0 / sqrt(SP_IMU_PERIOD);
    sp_from_quat(state->quat_wb, R);
    unit_velocity(world, state, R, velocity);
    for (int i = 0; i < 3; i++) acceleration[i] = (velocity[i] - m->velocity_w[i]) / SP_IMU_PERIOD;
    sp_copy(m->velocity_w, velocity, 3);
    acceleration[2] += world->gravity;
    normals(generator, c->factor, 9, noise);
    double white = c->accelerometer_noise * density, shake = sqrt(white * white + c->vibration * c->vibration);
    sp_apply_t(R, acceleration, force);
    if (m->samples == SP_IMU_SAMPLES) {
        m->samples--;
        memmove(m->imu_time, m->imu_time + 1, sizeof m->imu_time - sizeof *m->imu_time);
        memmove(m->gyro_b, m->gyro_b + 1, sizeof m->gyro_b - sizeof *m->gyro_b);
        memmove(m->specific_force_b, m->specific_force_b + 1, sizeof m->specific_force_b - sizeof *m->specific_force_b);
    }
    int k = m->samples++;
    m->imu_time[k] = state->time;
    for (int i = 0; i < 3; i++) {
        m->gyro_b[k][i] = state->omega_b[i] + m->gyro_bias[i] + c->gyro_noise * density * noise[i];
        m->specific_force_b[k][i] = force[i] + m->accelerometer_bias[i] + shake * noise[3 + i];
    }
    if (state->time >= m->next_pose - 1e-9) {
        m->next_pose += SP_POSE_PERIOD;
        take_frame(world, c, state, R, generator, m);
    }
    if (state->time >= m->next_encoder - 1e-9) {
        m->next_encoder += SP_ENCODER_PERIOD;
        read_servos(world, c, offset, state, generator, m);
    }
}

/* Switch the sensors on in a state. */
void sp_start_sensors(const sp_world *world, const sp_sensor_config *c, const double *offset,
                      const sp_robot_state *state, sp_generator *generator, sp_sensor_memory *m)
{
    double R[9];
    memset(m, 0, sizeof *m);
    normals(generator, c->factor * c->gyro_bias, 3, m->gyro_bias);
    normals(generator, c->factor * c->accelerometer_bias, 3, m->accelerometer_bias);
    normals(generator, c->factor * c->position_drift, 3, m->drift);
    normals(generator, c->factor * c->rotation_drift, 3, m->drift + 3);
    sp_from_quat(state->quat_wb, R);
    unit_velocity(world, state, R, m->velocity_w);
    sp_sample_sensors(world, c, offset, state, generator, m);
    /* The robot was at rest before the reset: its first frame has arrived. */
    for (int k = 0; k < m->frames; k++) m->frame_time[k] = state->time - c->latency;
}

/* Deliver the readings that have arrived by a control tick at `time`, each of them once. */
void sp_read_sensors(const sp_sensor_config *c, double time, sp_sensor_memory *m, sp_measurement *out)
{
    int due = 0;
    memset(out, 0, sizeof *out);
    /* Frames arrive in the order in which they were taken. */
    while (due < m->frames && m->frame_time[due] + c->latency <= time + 1e-9) due++;
    int first = due > SP_POSE_FRAMES ? due - SP_POSE_FRAMES : 0, kept = m->frames - due;
    out->time = time;
    out->pose_count = due - first;
    for (int k = 0; k < out->pose_count; k++) {
        out->pose_time[k] = m->frame_time[first + k];
        sp_copy(out->pose_position_w + 3 * k, m->frame_position_w[first + k], 3);
        sp_copy(out->pose_quat_wb + 4 * k, m->frame_quat_wb[first + k], 4);
    }
    memmove(m->frame_time, m->frame_time + due, (size_t)kept * sizeof *m->frame_time);
    memmove(m->frame_position_w, m->frame_position_w + due, (size_t)kept * sizeof *m->frame_position_w);
    memmove(m->frame_quat_wb, m->frame_quat_wb + due, (size_t)kept * sizeof *m->frame_quat_wb);
    m->frames = kept;
    out->imu_count = m->samples;
    sp_copy(out->imu_time, m->imu_time, m->samples);
    sp_copy(out->gyro_b, m->gyro_b[0], 3 * m->samples);
    sp_copy(out->specific_force_b, m->specific_force_b[0], 3 * m->samples);
    m->samples = 0;
    out->encoder_time = m->encoder_time;
    sp_copy(out->joint_position, m->angles, SP_JOINTS);
    sp_copy(out->joint_torque, m->torque, SP_JOINTS);
    sp_copy(out->vectoring, m->angles + SP_JOINTS, 2 * SP_ROTORS);
}
