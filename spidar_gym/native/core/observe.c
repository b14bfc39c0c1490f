/* Observations of a policy, in the order of the layouts in Python; clipped to ± bound, single precision. */
#include "spidar_core.h"
#include "spidar_math.h"

/* Append `n` numbers. */
static int put(double *to, int at, const double *from, int n)
{
    sp_copy(to + at, from, n);
    return at + n;
}

/* Append the sines, then the cosines, of 16 angles. */
static int put_turns(double *to, int at, const double *angles)
{
    for (int i = 0; i < 2 * SP_ROTORS; i++) {
        to[at + i] = sin(angles[i]);
        to[at + 2 * SP_ROTORS + i] = cos(angles[i]);
    }
    return at + 4 * SP_ROTORS;
}

static int finish(const double *values, int n, const double *bound, float *observation)
{
    for (int i = 0; i < n; i++) observation[i] = (float)sp_clip(values[i], -bound[i], bound[i]);
    return n;
}

/* Write the flight observation; returns its length. With `has_path` it contains the preview of the path. */
int sp_observe(const sp_flight *f, const sp_robot_state *state, const sp_control_state *control, const double *thrust,
               const double *joint_velocity, const double *leg_momentum, const double *leg_momentum_rate,
               const sp_preview *preview, int has_path, const double *previous_action, int action_size,
               const double *bound, float *observation)
{
    const sp_flight_memory *m = &f->memory;
    double v[SP_MAX_OBSERVATION], own[3];
    int at = 0;
    sp_apply_t(control->R_wb, control->error.position_w, own);
    at = put(v, at, own, 3);
    sp_apply_t(control->R_wb, control->error.velocity_w, own);
    at = put(v, at, own, 3);
    at = put(v, at, control->error.attitude, 3);
    at = put(v, at, control->error.omega_b, 3);
    at = put(v, at, state->joint_position, SP_JOINTS);
    at = put(v, at, state->joint_velocity, SP_JOINTS);
    at = put_turns(v, at, state->vectoring);
    at = put(v, at, state->vectoring_velocity, 2 * SP_ROTORS);
    for (int j = 0; j < SP_JOINTS; j++) v[at++] = preview->joint_target[j] - m->joint_position[j];
    at = put(v, at, joint_velocity, SP_JOINTS);
    at = put(v, at, leg_momentum, 3);
    at = put(v, at, leg_momentum_rate, 3);
    at = put(v, at, m->position_integral_w, 3);
    at = put(v, at, m->attitude_integral, 3);
    at = put(v, at, thrust, SP_ROTORS);
    at = put_turns(v, at, m->vectoring);
    for (int i = 0; i < SP_ROTORS; i++) v[at++] = m->interference.restricted[i];
    at = put(v, at, preview->next_form, SP_JOINTS);
    v[at++] = preview->time_to_next;
    if (has_path) {
        for (int k = 0; k < SP_PATH_AHEAD; k++) {
            sp_apply_t(control->R_wb, preview->ahead_w + 3 * k, own);
            at = put(v, at, own, 3);
        }
        at = put(v, at, preview->turn, SP_PATH_AHEAD);
        sp_apply_t(control->R_wb, preview->velocity_w, own);
        at = put(v, at, own, 3);
        sp_apply_t(control->R_wb, preview->acceleration_w, own);
        at = put(v, at, own, 3);
    }
    at = put(v, at, previous_action, action_size);
    return finish(v, at, bound, observation);
}

/* Write the crawl observation; returns its length. It contains a clock unless `ticks`, those since the reset, is negative. */
int sp_observe_crawl(const sp_crawl *crawl, const sp_robot_state *state, const double *goal, const double *thrust,
                     const double *previous_action, int action_size, int ticks, const double *bound, float *observation)
{
    const sp_crawl_memory *m = &crawl->memory;
    const sp_gait_memory *g = &crawl->gait;
    double v[SP_MAX_OBSERVATION], R[9], own[3];
    int at = 0;
    sp_from_quat(state->quat_wb, R);
    double heading = atan2(R[3], R[0]), c = cos(heading), s = sin(heading);
    double dx = goal[0] - state->position_w[0], dy = goal[1] - state->position_w[1];
    v[at++] = c * dx + s * dy;
    v[at++] = c * dy - s * dx;
    v[at++] = sin(goal[2] - heading);
    v[at++] = cos(goal[2] - heading);
    at = put(v, at, R + 6, 3);
    v[at] = 0.0;
    for (int i = 0; i < 3; i++) v[at] += (state->position_w[i] - g->floor_w[i]) * g->floor_R[3 * i + 2];
    at++;
    sp_apply_t(R, state->velocity_w, own);
    at = put(v, at, own, 3);
    at = put(v, at, state->omega_b, 3);
    at = put(v, at, state->joint_position, SP_JOINTS);
    at = put(v, at, state->joint_velocity, SP_JOINTS);
    at = put(v, at, state->joint_torque, SP_JOINTS);
    for (int j = 0; j < SP_JOINTS; j++) v[at++] = g->plan[j] - state->joint_position[j];
    for (int j = 0; j < SP_JOINTS; j++) v[at++] = g->target[j] - g->plan[j];
    at = put_turns(v, at, state->vectoring);
    at = put(v, at, thrust, SP_ROTORS);
    at = put_turns(v, at, m->vectoring);
    for (int k = 0; k <= SP_HOLD; k++) v[at++] = g->phase == k;
    v[at++] = g->time;
    v[at++] = g->share;
    v[at++] = g->count;
    if (ticks >= 0) {
        double turn = 2.0 * SP_PI * (ticks % SP_CLOCK_TICKS) / SP_CLOCK_TICKS;
        v[at++] = sin(turn);
        v[at++] = cos(turn);
    }
    at = put(v, at, previous_action, action_size);
    return finish(v, at, bound, observation);
}

/* Write the observation of a grasp; returns its length. */
int sp_observe_grasp(const sp_robot *robot, const sp_manager *m, const sp_grasp_scene *scene, const sp_seen *seen,
                     const sp_robot_state *state, const sp_command *last, double charge, double time_left, const double *previous_action,
                     int action_size, const double *bound, float *observation)
{
    const sp_grip *grip = &m->grasper.grip;
    int at = 0, holds = m->memory.phase == SP_MANAGER_GRASP;
    double v[SP_MAX_OBSERVATION], R[9], R_wo[9], way[3], middle[3], axis[3], feet[3 * SP_LEGS];
    double top = scene->half_size[scene->shape == SP_OBJECT_BALL ? 0 : 2];
    double goal[3] = {scene->goal.x, scene->goal.y, scene->floor + top};
    const double *q = seen->quat_wo;
    sp_from_quat(state->quat_wb, R);
    sp_from_quat(q, R_wo);
    double own = atan2(R[3], R[0]);
    double its = atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]));
    at = put(v, at, R + 6, 3);
    v[at++] = state->position_w[2];
    sp_apply_t(R, state->velocity_w, way);
    at = put(v, at, way, 3);
    at = put(v, at, state->omega_b, 3);
    at = put(v, at, state->joint_position, SP_JOINTS);
    at = put(v, at, state->joint_velocity, SP_JOINTS);
    at = put(v, at, last->joint_position, SP_JOINTS);
    at = put(v, at, state->joint_torque, SP_JOINTS);
    at = put_turns(v, at, state->vectoring);
    at = put(v, at, last->thrust, SP_ROTORS);
    for (int i = 0; i < 3; i++) way[i] = seen->position_w[i] - state->position_w[i];
    sp_apply_t(R, way, middle);
    at = put(v, at, middle, 3);
    for (int i = 0; i < 3; i++) axis[i] = R_wo[3 * i + 2];
    sp_apply_t(R, axis, way);
    at = put(v, at, way, 3);
    v[at++] = sin(its - own);
    v[at++] = cos(its - own);
    for (int k = 0; k <= SP_OBJECT_BALL; k++) v[at++] = scene->shape == k;
    at = put(v, at, scene->half_size, 3);
    v[at++] = scene->most_force;
    for (int i = 0; i < 3; i++) axis[i] = goal[i] - seen->position_w[i];
    sp_apply_t(R, axis, way);
    at = put(v, at, way, 3);
    v[at++] = sin(scene->goal.yaw - its);
    v[at++] = cos(scene->goal.yaw - its);
    sp_feet_at(robot, state->joint_position, feet);
    for (int i = 0; i < 3 * SP_LEGS; i++) v[at++] = feet[i] - middle[i % 3];
    v[at++] = holds ? grip->force : 0.0;
    v[at++] = holds ? grip->payload : 0.0;
    for (int k = 0; k <= SP_GRASP_STEERED; k++) v[at++] = (holds ? m->grasper.memory.phase : SP_GRASP_NONE) == k;
    v[at++] = charge;
    v[at++] = time_left;
    at = put(v, at, previous_action, action_size);
    return finish(v, at, bound, observation);
}

/* Write the course observation; returns its length. */
int sp_observe_course(const sp_robot *robot, const sp_manager *m, const sp_pilot *pilot, const sp_course *course,
                      const sp_robot_state *state, const sp_command *last, double charge, double time_left,
                      const double *previous_action, int action_size, const double *bound, float *observation)
{
    double v[SP_MAX_OBSERVATION], R[9], x = state->position_w[0], y = state->position_w[1], z = state->position_w[2];
    int at = 0, told = 0;
    sp_from_quat(state->quat_wb, R);
    double yaw = atan2(R[3], R[0]);
    v[at++] = course->goal.x - x;
    v[at++] = course->goal.y - y;
    v[at++] = sp_course_floor(course, course->goal.x) + robot->peg_depth - z;
    v[at++] = sin(course->goal.yaw - yaw);
    v[at++] = cos(course->goal.yaw - yaw);
    v[at++] = y;
    v[at++] = z;
    v[at++] = sin(yaw);
    v[at++] = cos(yaw);
    at = put(v, at, R + 6, 3);
    at = put(v, at, state->velocity_w, 3);
    at = put(v, at, state->omega_b, 3);
    at = put(v, at, state->joint_position, SP_JOINTS);
    at = put(v, at, state->joint_velocity, SP_JOINTS);
    at = put(v, at, last->joint_position, SP_JOINTS);
    at = put_turns(v, at, state->vectoring);
    at = put(v, at, last->thrust, SP_ROTORS);
    at = put_turns(v, at, last->vectoring);
    for (int k = 0; k <= SP_MANAGER_CUT; k++) v[at++] = m->memory.phase == k;
    v[at++] = pilot->has_target;
    v[at++] = pilot->has_target && pilot->last.flies;
    v[at++] = pilot->has_target ? pilot->last.x - x : 0.0;
    v[at++] = pilot->has_target ? pilot->last.y - y : 0.0;
    v[at++] = pilot->has_target ? pilot->last.z - z : 0.0;
    v[at++] = charge;
    v[at++] = time_left;
    for (int k = 0; k < course->count && told < SP_COURSE_AHEAD; k++) {
        const sp_gate *gate = &course->gates[k];
        if (!(x < gate->end + SP_COURSE_SEEN)) continue;
        for (int kind = 0; kind < SP_GATE_KINDS; kind++) v[at++] = gate->kind == kind;
        v[at++] = gate->begin - x;
        v[at++] = gate->end - x;
        v[at++] = gate->size;
        v[at++] = gate->middle - y;
        told++;
    }
    sp_zero(v + at, (SP_COURSE_AHEAD - told) * (SP_GATE_KINDS + 4));
    at += (SP_COURSE_AHEAD - told) * (SP_GATE_KINDS + 4);
    at = put(v, at, previous_action, action_size);
    return finish(v, at, bound, observation);
}
