/* Samples → state: the estimator receives only samples that are finite, in range and in order. */
#include "runner.h"
#include "spidar_math.h"

#define MAX_ANGLE 3.3      /* of a joint, measured [rad] */
#define MAX_TURN 40.0      /* of a vectoring angle, ± 6π with margin [rad] */
#define MAX_POSITION 100.0 /* [m] */
#define MAX_SPEED 30.0     /* [m/s] */
#define MAX_RATE 35.0      /* of the gyroscope, 2000°/s [rad/s] */
#define MAX_FORCE 200.0    /* of the accelerometer [m/s²] */
#define JUMP 0.1           /* largest difference between two poses, plus … [m] */
#define JUMP_SPEED 1.0     /* … this speed times the time between them [m/s] */

static int outside(const double *x, int n, double limit)
{
    for (int i = 0; i < n; i++)
        if (!(fabs(x[i]) <= limit)) return 1;
    return 0;
}

static void first_of(sp_fault *fault, sp_fault found)
{
    if (*fault == SP_FINE) *fault = found;
}

/* Check a sample of a time and n numbers; returns the fault. */
static sp_fault check_sample(double time, double now, double newest, const double *x, int n, double limit)
{
    if (!sp_finite(&time, 1) || !sp_finite(x, n)) return SP_NOT_FINITE;
    if (outside(x, n, limit)) return SP_OUT_OF_RANGE;
    return time < newest || time > now + SP_AHEAD ? SP_OUT_OF_ORDER : SP_FINE;
}

/* Check a pose in range for jumps, e.g. from confused markers of the tracking system; returns the fault. */
static sp_fault check_pose(const sp_sense *s, double time, const double *position, const double *quat, const double *last)
{
    double norm = sp_row(quat, quat, 4), way = 0.0;
    if (!sp_finite(quat, 4)) return SP_NOT_FINITE;
    if (!(norm > 0.9 && norm < 1.1)) return SP_OUT_OF_RANGE;
    for (int i = 0; i < 3; i++) way += (position[i] - last[i]) * (position[i] - last[i]);
    return s->has_pose && sqrt(way) > JUMP + JUMP_SPEED * (time - s->pose_time) ? SP_JUMPED : SP_FINE;
}

static void receive_poses(sp_sense *s, const sp_measurement *m, double now, sp_measurement *clean, sp_fault *fault)
{
    for (int k = 0; k < m->pose_count && k < SP_POSE_FRAMES; k++) {
        const double *p = m->pose_position_w + 3 * k, *q = m->pose_quat_wb + 4 * k;
        sp_fault found = check_sample(m->pose_time[k], now, s->pose_time, p, 3, MAX_POSITION);
        if (found == SP_FINE) found = check_pose(s, m->pose_time[k], p, q, s->pose_position_w);
        first_of(fault, found);
        if (found != SP_FINE) continue;
        int to = clean->pose_count++;
        clean->pose_time[to] = s->pose_time = m->pose_time[k];
        sp_copy(clean->pose_position_w + 3 * to, p, 3);
        sp_copy(clean->pose_quat_wb + 4 * to, q, 4);
        sp_copy(s->pose_position_w, p, 3);
        sp_copy(s->pose_quat_wb, q, 4);
        s->has_pose = 1;
    }
}

static void receive_imu(sp_sense *s, const sp_measurement *m, double now, sp_measurement *clean, sp_fault *fault)
{
    for (int k = 0; k < m->imu_count && k < SP_IMU_SAMPLES; k++) {
        const double *gyro = m->gyro_b + 3 * k, *force = m->specific_force_b + 3 * k;
        sp_fault found = check_sample(m->imu_time[k], now, s->imu_time, gyro, 3, MAX_RATE);
        if (found == SP_FINE) found = check_sample(m->imu_time[k], now, s->imu_time, force, 3, MAX_FORCE);
        first_of(fault, found);
        if (found != SP_FINE) continue;
        int to = clean->imu_count++;
        clean->imu_time[to] = s->imu_time = m->imu_time[k];
        sp_copy(clean->gyro_b + 3 * to, gyro, 3);
        sp_copy(clean->specific_force_b + 3 * to, force, 3);
    }
}

static void receive_joints(sp_sense *s, const sp_measurement *m, double now, sp_measurement *clean, sp_fault *fault)
{
    sp_fault found = check_sample(m->encoder_time, now, s->joint_time, m->joint_position, SP_JOINTS, MAX_ANGLE);
    if (found == SP_FINE)
        found = check_sample(m->encoder_time, now, s->joint_time, m->vectoring, 2 * SP_ROTORS, MAX_TURN);
    first_of(fault, found);
    if (found != SP_FINE) return;
    clean->encoder_time = s->joint_time = m->encoder_time;
    sp_copy(clean->joint_position, m->joint_position, SP_JOINTS);
    sp_copy(clean->vectoring, m->vectoring, 2 * SP_ROTORS);
    for (int j = 0; j < SP_JOINTS; j++) /* torque is only logged: 0 if not finite */
        clean->joint_torque[j] = sp_finite(m->joint_torque + j, 1) ? m->joint_torque[j] : 0.0;
}

static void receive_odometry(sp_sense *s, const sp_odometry *o, double now, sp_fault *fault)
{
    sp_fault found = check_sample(o->time, now, s->odometry.time, o->position_w, 3, MAX_POSITION);
    if (found == SP_FINE) found = check_sample(o->time, now, s->odometry.time, o->velocity_w, 3, MAX_SPEED);
    if (found == SP_FINE) found = check_sample(o->time, now, s->odometry.time, o->omega_b, 3, MAX_RATE);
    if (found == SP_FINE) found = check_pose(s, o->time, o->position_w, o->quat_wb, s->odometry.position_w);
    first_of(fault, found);
    if (found != SP_FINE) return;
    s->odometry = *o;
    sp_copy(s->pose_position_w, o->position_w, 3);
    sp_copy(s->pose_quat_wb, o->quat_wb, 4);
    s->pose_time = o->time;
    s->has_pose = 1;
}

/* Compute the torso's pose and velocity from the CoG's; the legs' motion moves the CoG within the torso. */
static void from_odometry(const sp_robot *robot, sp_sense *s)
{
    const sp_odometry *o = &s->odometry;
    sp_robot_state *x = &s->state;
    sp_snapshot here, soon;
    double R[9], q[SP_JOINTS], v[2 * SP_ROTORS], rate[3], swing[3], lever[3], step = 1e-3;
    sp_copy(x->quat_wb, o->quat_wb, 4);
    sp_copy(x->omega_b, o->omega_b, 3);
    sp_from_quat(x->quat_wb, R);
    for (int j = 0; j < SP_JOINTS; j++) {
        q[j] = x->joint_position[j] + step * x->joint_velocity[j];
        v[j] = x->vectoring[j] + step * x->vectoring_velocity[j];
    }
    sp_snapshot_at(robot, x->joint_position, R, x->vectoring, &here);
    sp_snapshot_at(robot, q, R, v, &soon);
    sp_cross(o->omega_b, here.com_b, swing);
    for (int i = 0; i < 3; i++) rate[i] = swing[i] + (soon.com_b[i] - here.com_b[i]) / step;
    sp_apply(R, here.com_b, lever);
    sp_apply(R, rate, swing);
    for (int i = 0; i < 3; i++) {
        x->velocity_w[i] = o->velocity_w[i] - swing[i];
        x->position_w[i] = o->position_w[i] + (x->time - o->time) * o->velocity_w[i] - lever[i];
    }
}

/* Initialise the estimator at rest, at the first samples. */
static void start(const sp_robot *robot, sp_sense *s, double now)
{
    double R[9], lever[3];
    sp_robot_state first;
    memset(&first, 0, sizeof first);
    first.time = now;
    sp_copy(first.quat_wb, s->pose_quat_wb, 4);
    sp_from_quat(s->pose_quat_wb, R);
    sp_apply(R, robot->flight_controller, lever);
    for (int i = 0; i < 3; i++) first.position_w[i] = s->pose_position_w[i] - lever[i];
    sp_copy(first.joint_position, s->state.joint_position, SP_JOINTS);
    sp_copy(first.vectoring, s->state.vectoring, 2 * SP_ROTORS);
    sp_estimator_reset(robot, &s->estimator, &first);
}

void sp_sense_init(sp_sense *s, const sp_mission *mission)
{
    memset(s, 0, sizeof *s);
    s->pose_time = s->imu_time = s->joint_time = s->odometry.time = -HUGE_VAL;
    sp_estimator_init(&s->estimator, &mission->estimator);
}

sp_fault sp_sense_update(sp_sense *s, const sp_mission *mission, const sp_loop_input *input, const double *thrust)
{
    const sp_limits *limits = &mission->limits;
    const sp_measurement *m = &input->measurement;
    sp_measurement clean;
    sp_fault fault = SP_FINE;
    double now = input->time;
    memset(&clean, 0, sizeof clean);
    clean.time = now;
    clean.encoder_time = s->joint_time;
    if (s->joint_time > -HUGE_VAL) { /* a rejected message leaves the last values */
        sp_copy(clean.joint_position, s->state.joint_position, SP_JOINTS);
        sp_copy(clean.vectoring, s->state.vectoring, 2 * SP_ROTORS);
        sp_copy(clean.joint_torque, s->state.joint_torque, SP_JOINTS);
    }
    if (m->encoder_time > 0.0 || !sp_finite(&m->encoder_time, 1)) receive_joints(s, m, now, &clean, &fault);
    if (mission->odometry) {
        if (input->has_odometry) receive_odometry(s, &input->odometry, now, &fault);
    } else {
        receive_poses(s, m, now, &clean, &fault);
        receive_imu(s, m, now, &clean, &fault);
    }
    if (!s->started) {
        sp_copy(s->state.joint_position, clean.joint_position, SP_JOINTS);
        sp_copy(s->state.vectoring, clean.vectoring, 2 * SP_ROTORS);
        int heard = s->has_pose && s->joint_time > -HUGE_VAL && (mission->odometry || s->imu_time > -HUGE_VAL);
        if (!heard)
            return fault != SP_FINE ? fault : !s->has_pose ? SP_NO_POSE : s->joint_time > -HUGE_VAL ? SP_NO_IMU : SP_NO_JOINTS;
        start(&mission->robot, s, now);
        s->started = 1;
    }
    sp_estimator_update(&mission->robot, &s->estimator, &clean, thrust, &s->state);
    if (mission->odometry) from_odometry(&mission->robot, s);
    if (now - s->joint_time > limits->joint_age) first_of(&fault, SP_NO_JOINTS);
    if (now - s->pose_time > limits->pose_age) first_of(&fault, SP_NO_POSE);
    if (!mission->odometry && now - s->imu_time > limits->imu_age) first_of(&fault, SP_NO_IMU);
    if (!sp_valid_state(&s->state)) {
        sp_sense_init(s, mission); /* discard all memory of the invalid state */
        first_of(&fault, SP_NOT_FINITE);
    }
    return fault;
}
