/* The manager of both gaits: commands → phases, each flown or crawled by its controller, with smooth transitions.
 * The Python twin `control/locomotion/manager.py` documents the phases. */
#include "ground.h"

/* Argument at which `sp_ease` reaches a share, by bisection. */
static double inverse_ease(double share)
{
    double low = 0.0, high = 1.0;
    for (int k = 0; k < SP_BISECTIONS; k++) {
        double middle = 0.5 * (low + high);
        if (sp_ease(middle) < share) low = middle;
        else high = middle;
    }
    return low;
}

static void level(double yaw, double *quat)
{
    sp_zero(quat, 4);
    quat[0] = cos(0.5 * yaw);
    quat[3] = sin(0.5 * yaw);
}

static double tilt_of(const double *R) { return acos(sp_clip(R[8], -1.0, 1.0)); }

static int on_ground(const sp_manager *m) { return m->memory.phase == SP_MANAGER_LIE || m->memory.phase == SP_MANAGER_CRAWL; }

/* Compute the position of the CoG. */
static void com_of(const sp_robot *robot, sp_manager *m, const sp_robot_state *state, double *com_w)
{
    double R[9], offset[3];
    sp_from_quat(state->quat_wb, R);
    sp_snapshot_at(robot, state->joint_position, R, state->vectoring, &m->snapshot);
    sp_apply(R, m->snapshot.com_b, offset);
    for (int i = 0; i < 3; i++) com_w[i] = state->position_w[i] + offset[i];
}

/* Last command of the active controller. */
static void last_command(const sp_manager *m, sp_command *command)
{
    int ground = on_ground(m);
    const double *forces = ground ? m->crawl.memory.forces_l : m->flight.memory.forces_l;
    double thrust[SP_ROTORS];
    for (int i = 0; i < SP_ROTORS; i++) thrust[i] = sp_norm(forces + 3 * i);
    sp_make_command(thrust, ground ? m->crawl.memory.vectoring : m->flight.memory.vectoring,
                    ground ? m->crawl.memory.joint_position : m->flight.memory.joint_position,
                    m->config.flight.joint_torque_limit, command);
}

static void enter(sp_manager *m, int32_t phase)
{
    m->memory.phase = phase;
    m->memory.time = m->memory.believed = 0.0;
}

static void drop_command(sp_manager *m)
{
    if (m->count > 0) m->count--;
    memmove(m->commands, m->commands + 1, (size_t)m->count * sizeof m->commands[0]);
}

static void straight(sp_manager *m, const double *from, const double *to, double speed, int along)
{
    sp_legs legs;
    sp_begin_legs(from, speed, along, m->memory.yaw, 0.0, m->knots, SP_MANAGER_KNOTS, &legs);
    sp_leg_to(to, m->knots, SP_MANAGER_KNOTS, &legs);
    m->knot_count = legs.count;
}

/* Reset the crawler and pass it the last command. */
static void give_to_crawler(sp_manager *m, const sp_robot_state *state, const sp_command *last)
{
    sp_crawl_reset(&m->crawl, state);
    sp_copy(m->crawl.memory.vectoring, last->vectoring, 2 * SP_ROTORS);
    sp_vectoring_to_force(last->thrust, last->vectoring, m->crawl.memory.forces_l);
    sp_copy(m->crawl.memory.joint_position, last->joint_position, SP_JOINTS);
}

/* Pose, rate and acceleration of the present flight reference. */
static void moving(const sp_manager *m, double *pose, double *rate, double *acceleration)
{
    const sp_manager_memory *memory = &m->memory;
    if (memory->phase != SP_MANAGER_DESCEND) {
        sp_path_at(m->knots, m->knot_count, memory->time, pose, rate, acceleration);
        return;
    }
    sp_copy(pose, memory->begin_w, 3);
    pose[3] = memory->yaw;
    sp_zero(rate, 4);
    rate[2] = -memory->velocity;
    sp_zero(acceleration, 4);
}

static double wrap(double angle) { return angle - SP_TWO_PI * floor((angle + SP_PI) / SP_TWO_PI); }

/* Plan a flight to a position from the present motion of the path. */
static void steer(sp_manager *m, const sp_waypoint *command)
{
    sp_manager_memory *memory = &m->memory;
    sp_knot begin;
    double end[4];
    memset(&begin, 0, sizeof begin);
    moving(m, begin.pose_w, begin.rate_w, begin.acceleration_w);
    double ahead = command->position_w[0] - begin.pose_w[0], aside = command->position_w[1] - begin.pose_w[1];
    sp_copy(end, command->position_w, 3);
    end[3] = begin.pose_w[3];
    if (command->along && length(ahead, aside) > SP_MANAGER_LEAST_WAY)
        end[3] += wrap(atan2(aside, ahead) - begin.pose_w[3]);
    m->knot_count = sp_path_from_motion(&begin, end, command->speed, m->knots);
    memory->yaw = end[3];
    if (command->has_form) sp_copy(memory->form, command->form, SP_JOINTS);
    enter(m, SP_MANAGER_FLY);
}

/* Plan a stop from the present motion of the path. */
static void hover(sp_manager *m)
{
    sp_manager_memory *memory = &m->memory;
    double pose[4], rate[4], acceleration[4];
    moving(m, pose, rate, acceleration);
    double brake = sp_max(sp_norm(rate) / SP_PATH_EASE, fabs(rate[3]) / SP_PATH_TURN_RATE);
    sp_knot *end = m->knots;
    memset(m->knots, 0, 2 * sizeof m->knots[0]);
    if (brake > 1e-6) {
        sp_copy(end->pose_w, pose, 4);
        sp_copy(end->rate_w, rate, 4);
        sp_copy(end->acceleration_w, acceleration, 4);
        end++;
        end->time = brake;
    }
    for (int i = 0; i < 4; i++) end->pose_w[i] = pose[i] + 0.5 * brake * rate[i];
    memory->yaw = end->pose_w[3];
    m->knot_count = (int)(end - m->knots) + 1;
    enter(m, SP_MANAGER_HOVER);
}

/* Replace the path by its end, because time restarts with the next phase. */
static void stay(sp_manager *m)
{
    sp_knot *here = m->knots;
    double pose[4];
    sp_copy(pose, m->knots[m->knot_count - 1].pose_w, 4);
    memset(here, 0, sizeof *here);
    sp_copy(here->pose_w, pose, 4);
    m->knot_count = 1;
}

/* End of the present path [s]. */
static double path_end(const sp_manager *m) { return m->knots[m->knot_count - 1].time; }

/* Begin to transfer the weight from the floor to the rotors, starting from the share that they carry already. */
static void begin_spool(const sp_robot *robot, sp_manager *m, const sp_robot_state *state)
{
    sp_manager_memory *memory = &m->memory;
    sp_command last;
    double R[9], share = sp_min(1.0, memory->thrust / robot->weight);
    last_command(m, &last);
    sp_from_quat(state->quat_wb, R);
    com_of(robot, m, state, memory->begin_w);
    sp_copy(memory->quat_wb, state->quat_wb, 4);
    memory->floor = memory->begin_w[2];
    memory->yaw = atan2(R[3], R[0]);
    sp_copy(memory->form, last.joint_position, SP_JOINTS); /* the feet must not push */
    sp_flight_resume(robot, &m->flight, state, &last);
    enter(m, SP_MANAGER_SPOOL);
    memory->time = m->config.spool_time * inverse_ease(share);
}

/* Abort a landing and climb; a second failure in a row drops the commands. */
static void break_off(sp_manager *m)
{
    sp_manager_memory *memory = &m->memory;
    double above[3];
    memory->failures++;
    sp_copy(above, memory->begin_w, 3);
    above[2] += m->config.again;
    straight(m, memory->begin_w, above, m->config.climb_speed, 0);
    level(memory->yaw, memory->quat_wb);
    if (memory->failures > 1) m->count = 0;
    enter(m, m->count > 0 ? SP_MANAGER_FLY : SP_MANAGER_HOVER);
}

/* ---- grasps ---- */

/* The CoG from the torso's origin of the snapshot at a state, turned to a heading. */
static void com_at(const sp_robot *robot, sp_manager *m, const sp_robot_state *state, double yaw, double *offset)
{
    double R[9], quat[4];
    sp_from_quat(state->quat_wb, R);
    sp_snapshot_at(robot, state->joint_position, R, state->vectoring, &m->snapshot);
    level(yaw, quat);
    sp_from_quat(quat, R);
    sp_apply(R, m->snapshot.com_b, offset);
}

/* Begin to grasp as soon as the object is seen. */
static void begin_grasp(const sp_robot *robot, sp_manager *m, const sp_robot_state *state, const sp_seen *seen)
{
    double pose[4], offset[3];
    if (seen == NULL) return;
    sp_copy(pose, m->knots[m->knot_count - 1].pose_w, 4);
    com_at(robot, m, state, pose[3], offset);
    for (int i = 0; i < 3; i++) pose[i] -= offset[i];
    sp_grasp_begin(robot, &m->grasper, &m->commands[0], seen, pose, m->flight.memory.joint_position);
    enter(m, SP_MANAGER_GRASP);
    m->memory.begun = 1;
}

/* Hover where the grasp ended. */
static void leave_grasp(const sp_robot *robot, sp_manager *m, const sp_robot_state *state)
{
    const sp_setting *end = &m->grasper.memory.end;
    double offset[3];
    com_at(robot, m, state, end->pose_w[3], offset);
    memset(m->knots, 0, sizeof m->knots[0]);
    sp_copy(m->knots[0].pose_w, end->pose_w, 4);
    for (int i = 0; i < 3; i++) m->knots[0].pose_w[i] += offset[i];
    m->knot_count = 1;
    m->memory.yaw = end->pose_w[3];
    sp_copy(m->memory.form, end->form, SP_JOINTS);
    enter(m, SP_MANAGER_HOVER);
}

/* Begin the next command of a grasp when the one before it is executed. */
static void grasp(const sp_robot *robot, sp_manager *m, const sp_robot_state *state)
{
    sp_grasper *g = &m->grasper;
    sp_manager_memory *memory = &m->memory;
    if (memory->begun && sp_grasp_waits(g)) {
        int32_t kind = m->count > 0 ? m->commands[0].kind : SP_LOCOMOTION_RELEASE;
        int failed = kind == SP_LOCOMOTION_PLACE && !g->memory.placed && !memory->ends; /* there was no floor */
        memory->begun = 0;
        drop_command(m);
        /* without a release: the object was lost, or is too heavy */
        if (failed || (g->memory.phase == SP_GRASP_NONE && kind != SP_LOCOMOTION_RELEASE)) m->count = 0;
    }
    if (g->memory.phase == SP_GRASP_NONE) {
        leave_grasp(robot, m, state);
    } else if (m->count > 0 && sp_grasp_waits(g) && !memory->begun && !(memory->ends && g->memory.time < SP_MANAGER_ENDS_AFTER)) {
        memory->begun = 1;
        if (m->commands[0].kind == SP_LOCOMOTION_CARRY_TO) sp_grasp_carry(g, &m->commands[0]);
        else if (m->commands[0].kind == SP_LOCOMOTION_PLACE) sp_grasp_place(g, m->commands[0].floor);
        else sp_grasp_release(g);
    }
}

void sp_manager_begin_in_air(const sp_robot *robot, sp_manager *m, const sp_robot_state *state)
{
    sp_knot *here = m->knots;
    double R[9];
    memset(here, 0, sizeof *here);
    com_of(robot, m, state, here->pose_w);
    sp_from_quat(state->quat_wb, R);
    here->pose_w[3] = m->memory.yaw = atan2(R[3], R[0]);
    m->knot_count = 1;
    sp_copy(m->memory.form, state->joint_position, SP_JOINTS);
    m->memory.floor = m->lying_height;
    enter(m, SP_MANAGER_HOVER);
}

/* Let a policy lead the torso, the legs and the grip. */
void sp_manager_steer(const sp_robot *robot, sp_manager *m, const sp_robot_state *state, const sp_waypoint *target,
                      const double *action, double seconds)
{
    double pose[4] = {0.0}, offset[3];
    if (m->memory.phase != SP_MANAGER_GRASP) {
        sp_copy(pose, m->knots[m->knot_count - 1].pose_w, 4);
        com_at(robot, m, state, pose[3], offset);
        for (int i = 0; i < 3; i++) pose[i] -= offset[i];
        enter(m, SP_MANAGER_GRASP);
    }
    sp_grasp_steer(robot, &m->grasper, target, action, pose, m->flight.memory.joint_position, seconds);
}

/* Put a command that is being executed before the others. */
static void put_first(sp_manager *m, int32_t kind)
{
    memmove(m->commands + 1, m->commands, (size_t)m->count * sizeof m->commands[0]);
    memset(&m->commands[0], 0, sizeof m->commands[0]);
    m->commands[0].kind = kind;
    m->count++;
}

/* Stop the present command of a grasp; without an object held, leave it. */
static void regrasp(sp_manager *m)
{
    sp_grasper *g = &m->grasper;
    if (sp_grasp_presses(g) && !sp_grasp_leaves(g)) {
        sp_grasp_stop(g);
        m->memory.begun = g->memory.phase != SP_GRASP_HOLD;
        if (m->memory.begun) put_first(m, SP_LOCOMOTION_GRASP); /* a grip that is not tested yet is completed */
    } else {
        sp_grasp_abandon(g);
        put_first(m, SP_LOCOMOTION_RELEASE); /* the way out is completed */
        m->memory.begun = 1;
    }
}

/* Write the flight controller's reference of a grasp, and the grip. */
static void hold(sp_manager *m, const sp_robot *robot, const sp_robot_state *state, const sp_seen *seen)
{
    sp_reference *r = &m->reference;
    sp_setting aim;
    double R[9], rate[4], offset[3], flow[3], moved[3], lift = robot->weight;
    sp_from_quat(state->quat_wb, R);
    if (m->flight.ticked) lift = sp_dot(R + 6, m->flight.wrench_desired);
    sp_grasp_step(robot, &m->grasper, state, atan2(R[3], R[0]), lift, seen, m->flight.dt, &aim, rate);
    sp_snapshot_at(robot, state->joint_position, R, state->vectoring, &m->snapshot);
    sp_apply(R, m->snapshot.com_b, offset);
    for (int i = 0; i < 3; i++) flow[i] = sp_row(m->snapshot.momentum_map + SP_JOINTS * i, state->joint_velocity, SP_JOINTS);
    sp_apply(R, flow, moved);
    memset(r, 0, sizeof *r);
    for (int i = 0; i < 3; i++) {
        r->position_w[i] = aim.pose_w[i] + offset[i];
        r->velocity_w[i] = rate[i] + moved[i] / m->snapshot.mass; /* the joints' motion moves the CoG, not the torso */
    }
    level(aim.pose_w[3], r->quat_wb);
    r->omega_b[2] = rate[3];
    sp_copy(r->joint_target, aim.form, SP_JOINTS);
}

static void lie(const sp_robot *robot, sp_manager *m, const sp_robot_state *state)
{
    sp_command last;
    double R[9];
    if (m->count == 0) return;
    if (m->commands[0].kind != SP_LOCOMOTION_CRAWL_TO) {
        begin_spool(robot, m, state);
        return;
    }
    last_command(m, &last);
    enter(m, SP_MANAGER_CRAWL);
    sp_from_quat(state->quat_wb, R);
    give_to_crawler(m, state, &last);
    sp_pose2 way = then(inverse(planar_pose(state->position_w, R)), m->commands[0].pose);
    way.yaw = wrapped(way.yaw);
    sp_gait_move(robot, &m->crawl, way, 0);
}

static void take_form(sp_manager *m, const sp_robot_state *state)
{
    sp_manager_memory *memory = &m->memory;
    const sp_waypoint *command = &m->commands[0];
    double told = 0.0, off = 0.0, here[4], rate[4], acceleration[4], way[3];
    for (int j = 0; j < SP_JOINTS; j++) {
        told = sp_max(told, fabs(m->flight.memory.joint_position[j] - memory->form[j]));
        off = sp_max(off, fabs(state->joint_position[j] - memory->form[j]));
    }
    if (told > 1e-6) return;
    memory->believed += m->flight.dt;
    if (off > SP_MANAGER_ARRIVED && memory->believed < SP_MANAGER_PATIENCE) return;
    sp_path_at(m->knots, m->knot_count, memory->time, here, rate, acceleration);
    if (command->kind == SP_LOCOMOTION_LAND) {
        sp_copy(memory->begin_w, here, 3);
        memory->velocity = 0.0;
        memory->floor = command->floor + m->lying_height;
        enter(m, SP_MANAGER_DESCEND);
        return;
    }
    for (int i = 0; i < 3; i++) way[i] = command->position_w[i] - here[i];
    if (sp_norm(way) < 1e-6) {
        drop_command(m);
        hover(m);
        return;
    }
    straight(m, here, command->position_w, command->speed, command->along);
    memory->yaw = m->knots[m->knot_count - 1].pose_w[3];
    enter(m, SP_MANAGER_FLY);
}

static void descend(const sp_robot *robot, sp_manager *m, const sp_robot_state *state)
{
    sp_manager_memory *memory = &m->memory;
    const sp_manager_config *c = &m->config;
    double com_w[3], dt = m->flight.dt;
    memory->velocity = sp_min(c->descent_speed, memory->velocity + c->descent_ease * dt);
    memory->begin_w[2] -= memory->velocity * dt;
    com_of(robot, m, state, com_w);
    int pushed = m->flight.memory.compensation.external_w[2] > c->touch_force * robot->weight;
    int slow = state->velocity_w[2] > -c->touch_speed * c->descent_speed;
    int found = memory->velocity >= c->descent_speed && slow && (com_w[2] - memory->begin_w[2] > c->touch_error || pushed);
    memory->believed = found ? memory->believed + dt : 0.0;
    if (memory->believed >= c->touch_time) {
        memory->floor = memory->begin_w[2];
        sp_copy(memory->begin_w, com_w, 3);
        enter(m, SP_MANAGER_UNLOAD);
    } else if (memory->begin_w[2] < memory->floor - c->search) {
        break_off(m);
    }
}

static void unload(const sp_robot *robot, sp_manager *m, const sp_robot_state *state, double tilt)
{
    sp_manager_memory *memory = &m->memory;
    const sp_manager_config *c = &m->config;
    sp_command last;
    double com_w[3];
    if (memory->time < 0.5 * c->unload_time && state->velocity_w[2] < -c->lost_fall) { /* the touchdown was a gust */
        memory->begin_w[2] = memory->floor;
        enter(m, SP_MANAGER_DESCEND);
        memory->velocity = c->descent_speed;
    } else if (tilt > c->most_tilt && memory->failures == 0) {
        break_off(m);
    } else if (memory->time >= c->unload_time) {
        memory->failures = 0;
        com_of(robot, m, state, com_w);
        memory->floor = com_w[2];
        drop_command(m);
        last_command(m, &last);
        sp_zero(last.thrust, SP_ROTORS);
        give_to_crawler(m, state, &last);
        enter(m, SP_MANAGER_LIE);
    }
}

/* Enter the next phase if the present one has ended. */
static void go_on(const sp_robot *robot, sp_manager *m, const sp_robot_state *state, const sp_seen *seen)
{
    sp_manager_memory *memory = &m->memory;
    double R[9], top[3];
    sp_from_quat(state->quat_wb, R);
    if (memory->rises) {
        memory->rises = 0;
        begin_spool(robot, m, state);
    }
    if (!on_ground(m) && memory->phase != SP_MANAGER_CUT && tilt_of(R) > m->config.cut_tilt) {
        enter(m, SP_MANAGER_CUT);
        m->count = 0;
        return;
    }
    switch (memory->phase) {
    case SP_MANAGER_LIE: lie(robot, m, state); break;
    case SP_MANAGER_CRAWL:
        if (!sp_gait_done(&m->crawl) || m->crawl.memory.gap != 0.0) break;
        drop_command(m);
        enter(m, SP_MANAGER_LIE);
        break;
    case SP_MANAGER_SPOOL:
        if (memory->time < m->config.spool_time) break;
        sp_copy(top, memory->begin_w, 3);
        top[2] += m->commands[0].height;
        straight(m, memory->begin_w, top, m->config.climb_speed, 0);
        enter(m, SP_MANAGER_CLIMB);
        break;
    case SP_MANAGER_CLIMB:
        com_of(robot, m, state, top);
        if (top[2] > memory->floor + SP_MANAGER_LEVEL_TO) sp_copy(memory->form, m->lying, SP_JOINTS);
        /* fall through */
    case SP_MANAGER_FLY:
        if (memory->time < path_end(m)) break;
        /* a FLY phase with a LAND command follows an aborted landing: keep the command */
        if (!(memory->phase == SP_MANAGER_FLY && m->commands[0].kind == SP_LOCOMOTION_LAND)) drop_command(m);
        hover(m);
        break;
    case SP_MANAGER_HOVER:
        if (m->count == 0 || memory->time < path_end(m)) break;
        if (m->commands[0].kind == SP_LOCOMOTION_FLY_TO && m->commands[0].at_once) {
            steer(m, &m->commands[0]);
            break;
        }
        if (m->commands[0].kind == SP_LOCOMOTION_GRASP) {
            begin_grasp(robot, m, state, seen);
            break;
        }
        if (m->commands[0].kind == SP_LOCOMOTION_LAND) sp_copy(memory->form, m->lying, SP_JOINTS);
        else if (m->commands[0].has_form) sp_copy(memory->form, m->commands[0].form, SP_JOINTS);
        stay(m);
        enter(m, SP_MANAGER_FORM);
        break;
    case SP_MANAGER_FORM: take_form(m, state); break;
    case SP_MANAGER_DESCEND: descend(robot, m, state); break;
    case SP_MANAGER_UNLOAD: unload(robot, m, state, tilt_of(R)); break;
    case SP_MANAGER_GRASP: grasp(robot, m, state); break;
    default: break;
    }
}

/* Write the flight controller's reference for the present phase. */
static void refer(const sp_manager *m, const sp_robot_state *state, sp_reference *r)
{
    const sp_manager_memory *memory = &m->memory;
    const sp_manager_config *c = &m->config;
    double t = memory->time;
    memset(r, 0, sizeof *r);
    sp_copy(r->position_w, memory->begin_w, 3);
    sp_copy(r->joint_target, memory->form, SP_JOINTS);
    if (memory->phase == SP_MANAGER_SPOOL) {
        sp_copy(r->quat_wb, memory->quat_wb, 4);
        r->support = 1.0 - sp_ease(t / c->spool_time);
    } else if (memory->phase == SP_MANAGER_UNLOAD) {
        double left = 1.0 - sp_ease(t / (0.5 * c->unload_time));
        sp_copy(r->quat_wb, state->quat_wb, 4);
        r->position_w[2] += left * (memory->floor - memory->begin_w[2]);
        r->velocity_w[2] = left * -memory->velocity;
        r->support = sp_max(sp_ease(t / c->unload_time), 1e-3);
    } else if (memory->phase == SP_MANAGER_DESCEND) {
        level(memory->yaw, r->quat_wb);
        r->velocity_w[2] = -memory->velocity;
    } else {
        sp_follow_path(m->knots, m->knot_count, t, r);
        if (memory->phase != SP_MANAGER_CLIMB) return;
        double risen = r->position_w[2] - memory->floor, R[9], R_d[9], way[9], turn[3], part[9];
        double share = sp_ease((risen - SP_MANAGER_LEVEL_FROM) / (SP_MANAGER_LEVEL_TO - SP_MANAGER_LEVEL_FROM));
        sp_from_quat(memory->quat_wb, R); /* from the floor's attitude to level */
        sp_from_quat(r->quat_wb, R_d);
        sp_product_t(R, R_d, way);
        sp_log(way, turn);
        for (int i = 0; i < 3; i++) turn[i] *= share;
        sp_exp(turn, part);
        sp_product(R, part, way);
        sp_to_quat(way, r->quat_wb);
    }
}

/* Limit the rate of Σλ near the floor and at the start of the climb, so that foot contacts cause no jump; with observed
   motion a descent is limited only near the expected floor or at signs of one. */
static void limit(const sp_robot *robot, sp_manager *m, sp_command *command)
{
    int32_t phase = m->memory.phase;
    double total = 0.0, slew = m->config.most_slew, before = m->memory.thrust;
    for (int i = 0; i < SP_ROTORS; i++) total += command->thrust[i];
    int lifts = phase == SP_MANAGER_CLIMB && m->memory.time <= m->flight.dt;
    int observed = m->flight.config.motion == SP_CONTROLLER_CONFIG_MOTION_OBSERVED;
    /* near the floor of the command, not of a mistaken touch */
    double above = m->memory.begin_w[2] - (m->commands[0].floor + m->lying_height);
    int near = above < SP_MANAGER_NEAR_FLOOR || m->memory.believed > 0.0;
    int falls = phase == SP_MANAGER_DESCEND && (near || !observed);
    if (!(phase == SP_MANAGER_SPOOL || phase == SP_MANAGER_UNLOAD || falls || lifts) || total <= 0.0) return;
    double share = sp_min(sp_max(total, before - slew), before + slew) / total;
    double most = sp_min(robot->max_thrust, m->flight.thrust_limit);
    for (int i = 0; i < SP_ROTORS; i++) command->thrust[i] = sp_min(most, command->thrust[i] * share);
    if (observed) { /* the observer takes note */
        for (int i = 0; i < SP_FORCES; i++) m->flight.memory.forces_l[i] *= share;
        for (int i = 0; i < 6; i++) m->flight.allocation.wrench[i] *= share;
    }
}

/* ---- commands ---- */

void sp_manager_init(const sp_robot *robot, sp_manager *m, const sp_manager_config *config)
{
    static const double level_R[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, still[2 * SP_ROTORS] = {0.0};
    double home[3 * SP_LEGS];
    memset(m, 0, sizeof *m);
    m->config = *config;
    sp_flight_init(&m->flight, &config->flight);
    sp_crawl_init(robot, &m->crawl, &config->crawl);
    sp_home(robot, &config->crawl.gait, home);
    sp_leg_angles(robot, home, m->lying);
    m->grasper.config = config->grasp;
    m->grasper.joint_speed = config->flight.joint_speed;
    sp_snapshot_at(robot, m->lying, level_R, still, &m->snapshot);
    m->lying_height = m->snapshot.com_b[2] + robot->peg_depth;
}

void sp_manager_reset(const sp_robot *robot, sp_manager *m, const sp_robot_state *state)
{
    sp_flight_reset(robot, &m->flight, state, state->joint_position, NULL);
    sp_crawl_reset(&m->crawl, state);
    memset(&m->memory, 0, sizeof m->memory);
    m->memory.phase = SP_MANAGER_LIE;
    m->memory.quat_wb[0] = 1.0;
    sp_copy(m->memory.form, m->lying, SP_JOINTS);
    com_of(robot, m, state, m->memory.begin_w);
    m->memory.floor = m->memory.begin_w[2];
    memset(&m->grasper.memory, 0, sizeof m->grasper.memory);
    m->count = m->knot_count = 0;
}

int sp_manager_airborne(const sp_manager *m)
{
    return !on_ground(m) && m->memory.phase != SP_MANAGER_UNLOAD && m->memory.phase != SP_MANAGER_CUT;
}

int32_t sp_manager_situation(const sp_manager *m)
{
    const sp_grasper *g = &m->grasper;
    if (m->memory.phase == SP_MANAGER_GRASP && sp_grasp_presses(g) && !sp_grasp_leaves(g))
        return g->memory.placed ? SP_ON_PLACED : SP_ON_GRIP;
    return sp_manager_airborne(m) ? SP_ON_AIR : SP_ON_FLOOR;
}

/* Where the robot is after a command. */
static int32_t after(int32_t kind)
{
    switch (kind) {
    case SP_LOCOMOTION_CRAWL_TO:
    case SP_LOCOMOTION_LAND: return SP_ON_FLOOR;
    case SP_LOCOMOTION_GRASP:
    case SP_LOCOMOTION_CARRY_TO: return SP_ON_GRIP;
    case SP_LOCOMOTION_PLACE: return SP_ON_PLACED;
    default: return SP_ON_AIR;
    }
}

/* Whether a command can follow from where the robot is. */
static int can_follow(int32_t kind, int32_t situation)
{
    switch (kind) {
    case SP_LOCOMOTION_CRAWL_TO:
    case SP_LOCOMOTION_TAKE_OFF: return situation == SP_ON_FLOOR;
    case SP_LOCOMOTION_CARRY_TO:
    case SP_LOCOMOTION_PLACE: return situation == SP_ON_GRIP;
    case SP_LOCOMOTION_RELEASE: return situation == SP_ON_GRIP || situation == SP_ON_PLACED;
    default: return situation == SP_ON_AIR;
    }
}

const char *sp_cannot_follow(int32_t kind, int32_t *situation)
{
    int32_t here = *situation;
    *situation = after(kind);
    if (can_follow(kind, here)) return NULL;
    if (here == SP_ON_FLOOR) return "take_off first: the robot is on the floor there";
    if (here != SP_ON_AIR) return "release first: the legs hold an object there";
    int holds = kind == SP_LOCOMOTION_CARRY_TO || kind == SP_LOCOMOTION_PLACE || kind == SP_LOCOMOTION_RELEASE;
    return holds ? "grasp first: the legs hold nothing there" : "land first: the robot is in the air there";
}

int sp_manager_done(const sp_manager *m)
{
    int32_t phase = m->memory.phase;
    if (m->count > 0) return 0;
    if (phase == SP_MANAGER_HOVER) return m->memory.time >= path_end(m);
    if (phase == SP_MANAGER_GRASP) return sp_grasp_waits(&m->grasper);
    return phase == SP_MANAGER_LIE || phase == SP_MANAGER_CUT;
}

/* Append a command; returns 0 if the queue is full or the command cannot follow the previous one. */
int sp_manager_command(sp_manager *m, const sp_waypoint *command)
{
    int32_t situation = m->count > 0 ? after(m->commands[m->count - 1].kind) : sp_manager_situation(m);
    if (m->count == SP_MAX_WAYPOINTS || sp_cannot_follow(command->kind, &situation) != NULL) return 0;
    m->commands[m->count++] = *command;
    return 1;
}

/* Replace the queued commands by these n; returns 0 and changes nothing if they cannot follow from here. */
int sp_manager_interrupt(sp_manager *m, const sp_waypoint *commands, int n)
{
    sp_manager_memory *memory = &m->memory;
    int32_t phase = memory->phase, situation = sp_manager_situation(m);
    int rises = n > 0 && commands[0].kind == SP_LOCOMOTION_TAKE_OFF;
    int ends = (phase == SP_MANAGER_CRAWL || phase == SP_MANAGER_UNLOAD) && !rises;
    double pose[4], rate[4], acceleration[4];
    if (n + 1 > SP_MAX_WAYPOINTS) return 0;
    for (int k = 0; k < n; k++)
        if (sp_cannot_follow(commands[k].kind, &situation) != NULL) return 0;
    memory->ends = 0;
    if (phase == SP_MANAGER_CLIMB && n > 0 && commands[0].kind == SP_LOCOMOTION_FLY_TO) {
        moving(m, pose, rate, acceleration);
        ends = pose[2] < memory->floor + SP_MANAGER_LEVEL_TO;
    }
    /* A crawl cycle and a landing are completed first, and a climb until the legs are clear of the floor. */
    m->count = ends && m->count > 0;
    for (int k = 0; k < n; k++) m->commands[m->count++] = commands[k];
    if (phase == SP_MANAGER_CRAWL) m->crawl.gait.count = m->crawl.gait.count > 0;
    if (phase == SP_MANAGER_SPOOL && (n == 0 || commands[0].kind == SP_LOCOMOTION_LAND)) {
        if (n == 0) {
            memset(&m->commands[0], 0, sizeof m->commands[0]);
            m->commands[0].kind = SP_LOCOMOTION_LAND;
            m->count = 1;
        }
        memory->floor = memory->begin_w[2];
        memory->velocity = 0.0;
        enter(m, SP_MANAGER_UNLOAD);
    } else if (!ends && (phase == SP_MANAGER_FLY || phase == SP_MANAGER_FORM || phase == SP_MANAGER_CLIMB ||
                         phase == SP_MANAGER_HOVER || phase == SP_MANAGER_DESCEND)) {
        if (n > 0 && commands[0].kind == SP_LOCOMOTION_FLY_TO && commands[0].at_once) steer(m, &m->commands[0]);
        else hover(m);
    } else if (phase == SP_MANAGER_GRASP) {
        regrasp(m);
    }
    memory->rises = rises && (phase == SP_MANAGER_CRAWL || phase == SP_MANAGER_UNLOAD);
    return 1;
}

void sp_manager_end(sp_manager *m)
{
    sp_manager_memory *memory = &m->memory;
    sp_waypoint orders[4];
    double floor_w = memory->floor - m->lying_height, surface;
    int n = 0;
    if (m->count > 0 && m->commands[0].kind == SP_LOCOMOTION_LAND) {
        m->count = 1;
        return;
    }
    memset(orders, 0, sizeof orders);
    if (memory->phase != SP_MANAGER_GRASP) {
        orders[0].kind = SP_LOCOMOTION_LAND;
        orders[0].floor = floor_w;
        sp_manager_interrupt(m, orders, sp_manager_airborne(m));
        return;
    }
    if (sp_grasp_put_down(&m->grasper, &surface)) {
        orders[n].kind = SP_LOCOMOTION_PLACE;
        orders[n++].floor = surface < HUGE_VAL ? surface : floor_w;
    }
    const double *from = m->knots[m->knot_count - 1].pose_w;
    int free = sp_manager_situation(m) == SP_ON_AIR;
    const double *where = free ? m->grasper.grip.position_w : m->grasper.memory.end.pose_w;
    if (!free) orders[n++].kind = SP_LOCOMOTION_RELEASE;
    double dx = from[0] - where[0], dy = from[1] - where[1], far = sqrt(dx * dx + dy * dy);
    if (far < 1e-3) dx = -cos(from[3]), dy = -sin(from[3]), far = 1.0;
    double share = sp_max(far, SP_MANAGER_ASIDE) / far;
    orders[n].kind = SP_LOCOMOTION_FLY_TO;
    orders[n].position_w[0] = where[0] + share * dx;
    orders[n].position_w[1] = where[1] + share * dy;
    orders[n].position_w[2] = from[2];
    orders[n++].speed = 0.5;
    orders[n].kind = SP_LOCOMOTION_LAND;
    orders[n++].floor = floor_w;
    if (sp_manager_interrupt(m, orders, n)) memory->ends = 1;
}

/* One control tick. */
void sp_manager_step(sp_manager *m, const sp_robot_state *state, const sp_residual *residual, const sp_seen *seen,
                     sp_room *room, sp_command *command)
{
    sp_manager_memory *memory = &m->memory;
    if (sp_valid_state(state)) {
        go_on(room->robot, m, state, seen);
        memory->time += m->flight.dt;
    }
    if (on_ground(m)) {
        sp_crawl_step(&m->crawl, state, residual, room, command);
    } else if (memory->phase == SP_MANAGER_CUT) {
        last_command(m, command);
        sp_zero(command->thrust, SP_ROTORS);
    } else if (memory->phase == SP_MANAGER_GRASP) {
        hold(m, room->robot, state, seen);
        sp_flight_step(&m->flight, state, &m->reference, residual, NULL, &m->grasper.grip, room, command);
    } else {
        refer(m, state, &m->reference);
        sp_flight_step(&m->flight, state, &m->reference, residual, NULL, NULL, room, command);
        limit(room->robot, m, command);
    }
    memory->thrust = 0.0;
    for (int i = 0; i < SP_ROTORS; i++) memory->thrust += command->thrust[i];
}
