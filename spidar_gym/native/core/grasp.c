/* The claw and the phases of a grasp; the Python twins are `control/grasp/claw.py` and `control/grasp/phases.py`. */
#include "ground.h"

/* ---- the claw ---- */

/* Height of feet on a circle from the torso's origin. */
static double claw_height(const sp_robot *r, double radius)
{
    double inner = r->pitch_to_yaw + r->yaw_to_pitch, outer = r->pitch_to_foot;
    double out = radius - sqrt(2.0) * r->yaw_axis_xy - r->yaw_to_pitch;
    double square = inner * inner + outer * outer + 2.0 * inner * outer * cos(SP_CLAW_KNEE) - out * out;
    return sp_min(SP_CLAW_HIGHEST, r->yaw_axis_z - sqrt(sp_max(square, 0.0)));
}

/* Joint angles with all feet on a circle; 0 if they do not reach it. */
static int claw_form(const sp_robot *r, double radius, double height, double *q)
{
    double hip = sqrt(2.0) * r->yaw_axis_xy + r->yaw_to_pitch;
    double inner = r->pitch_to_yaw + r->yaw_to_pitch, outer = r->pitch_to_foot;
    double out = radius - hip, down = r->yaw_axis_z - height;
    double bend = (out * out + down * down - inner * inner - outer * outer) / (2.0 * inner * outer);
    double knee = acos(sp_clip(bend, -1.0, 1.0));
    double pitch = atan2(down, out) - atan2(outer * sin(knee), inner + outer * cos(knee));
    for (int leg = 0; leg < SP_LEGS; leg++) {
        q[4 * leg] = q[4 * leg + 2] = 0.0;
        q[4 * leg + 1] = pitch;
        q[4 * leg + 3] = knee;
    }
    return fabs(bend) <= 1.0 && sp_max(fabs(pitch), knee) <= r->joint_limit;
}

void sp_open_claw(const sp_robot *robot, double half_width, double *form)
{
    double foot = half_width + robot->foot_radius;
    claw_form(robot, foot + SP_CLAW_OPEN, claw_height(robot, foot - SP_CLAW_PRESS), form);
}

const char *sp_refuse_object(const sp_robot *robot, const sp_waypoint *o)
{
    double a = o->half_size[0], foot = a + robot->foot_radius, form[SP_JOINTS];
    if (o->shape == SP_OBJECT_BOX && fabs(a - o->half_size[1]) > 0.02)
        return "a box with equal length and width: all feet move alike";
    if (!(a >= SP_CLAW_NARROWEST && a <= SP_CLAW_WIDEST)) return "half a width within 0.14 … 0.42 m";
    double height = claw_height(robot, foot - SP_CLAW_PRESS);
    if (!claw_form(robot, foot + SP_CLAW_OPEN, height, form) || !claw_form(robot, foot - SP_CLAW_PRESS, height, form))
        return "feet within reach of the legs";
    return NULL;
}

static void plan_contact(const sp_robot *robot, const sp_waypoint *o, const double *quat_wo, double yaw, sp_contact *plan)
{
    double foot = o->half_size[0] + robot->foot_radius, height = claw_height(robot, foot - SP_CLAW_PRESS);
    double facing = 2.0 * atan2(quat_wo[3], quat_wo[0]) + 0.25 * SP_PI, turn = SP_HALF_PI;
    plan->yaw = o->shape == SP_OBJECT_BOX ? facing + turn * rint((yaw - facing) / turn) : yaw;
    claw_form(robot, foot + SP_CLAW_OPEN, height, plan->open);
    claw_form(robot, foot, height, plan->closed);
    claw_form(robot, foot - SP_CLAW_PRESS, height, plan->pressed);
    plan->height = -height;
}

/* ---- settings ---- */

static double wrap(double angle) { return angle - SP_TWO_PI * floor((angle + SP_PI) / SP_TWO_PI); }

static void turned(double yaw, const double *v, double *w)
{
    double c = cos(yaw), s = sin(yaw), x = c * v[0] - s * v[1], y = s * v[0] + c * v[1];
    w[0] = x, w[1] = y, w[2] = v[2];
}

static double heading_of(const double *q)
{
    return atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]));
}

static double top_of(const sp_waypoint *o) { return o->half_size[o->shape == SP_OBJECT_BALL ? 0 : 2]; }

static double most_force(const sp_grasper *g) { return sp_min(g->target.most_force, SP_GRASP_SAFE_GRIP); }

/* The end of the present phase, higher. */
static sp_setting shifted(const sp_grasper *g, double up)
{
    sp_setting end = g->memory.end;
    end.pose_w[2] += up;
    return end;
}

static sp_setting with_form(sp_setting setting, const double *form)
{
    sp_copy(setting.form, form, SP_JOINTS);
    return setting;
}

static sp_setting with_force(sp_setting setting, double force)
{
    setting.force = force;
    return setting;
}

static sp_setting with_payload(sp_setting setting, double payload)
{
    setting.payload = payload;
    return setting;
}

/* Begin a phase that lasts as long as way, heading, joints and `least` need; `speed` 0: that near an object. */
static void enter(sp_grasper *g, int32_t phase, sp_setting end, double speed, double least)
{
    sp_grasp_memory *m = &g->memory;
    sp_setting begin = m->end;
    double way[4], bend = 0.0;
    for (int i = 0; i < 4; i++) way[i] = end.pose_w[i] - begin.pose_w[i];
    for (int j = 0; j < SP_JOINTS; j++) bend = sp_max(bend, fabs(end.form[j] - begin.form[j]));
    double seconds = sp_max(least, SP_GRASP_QUINTIC_PEAK * sp_norm(way) / (speed > 0.0 ? speed : g->config.near_speed));
    seconds = sp_max(seconds, SP_GRASP_QUINTIC_PEAK * fabs(way[3]) / g->config.turn_speed);
    m->seconds = sp_max(seconds, SP_GRASP_QUINTIC_PEAK * bend / g->joint_speed);
    m->phase = phase;
    m->time = m->total = m->found = 0.0;
    m->count = 0;
    m->begin = begin;
    m->end = end;
}

static void rest_at(sp_grasper *g, sp_setting setting, int32_t phase)
{
    g->memory.end = setting;
    enter(g, phase, setting, 0.0, 0.0);
}

/* The present setting, and the rate of its pose; `fade` later if it came to rest from now on. */
static sp_setting present(const sp_grasp_memory *m, double fade, double *rate)
{
    const sp_setting *a = &m->begin, *b = &m->end;
    sp_setting now = *b;
    sp_zero(rate, 4);
    if (m->seconds <= 0.0) return now;
    double u = sp_min(1.0, m->time / m->seconds), share = u, speed;
    if (m->phase == SP_GRASP_FEEL || m->phase == SP_GRASP_STEERED) {
        speed = m->time < m->seconds ? 1.0 / m->seconds : 0.0;
    } else {
        share = sp_ease(u);
        speed = 30.0 * u * u * (1.0 - u) * (1.0 - u) / m->seconds;
    }
    for (int i = 0; i < 4; i++) {
        rate[i] = speed * (b->pose_w[i] - a->pose_w[i]);
        now.pose_w[i] = a->pose_w[i] + share * (b->pose_w[i] - a->pose_w[i]) + 0.5 * fade * rate[i];
    }
    for (int j = 0; j < SP_JOINTS; j++) now.form[j] = a->form[j] + share * (b->form[j] - a->form[j]);
    now.force = a->force + u * (b->force - a->force);
    now.payload = a->payload + u * (b->payload - a->payload);
    return now;
}

/* ---- orders ---- */

/* Force of each foot that holds a mass, with a reserve. */
static double holding_force(const sp_robot *robot, const sp_grasper *g, double mass)
{
    double known = g->target.friction, least = mass * robot->gravity / (SP_LEGS * (known > 0.0 ? known : g->config.friction));
    return g->config.reserve * least + (known > 0.0 ? g->config.unequal : 0.0);
}

static double first_grip(const sp_robot *robot, const sp_grasper *g)
{
    if (g->target.force > 0.0) return g->target.force;
    return g->target.friction > 0.0 ? holding_force(robot, g, g->target.mass) : g->config.first_grip;
}

void sp_grasp_begin(const sp_robot *robot, sp_grasper *g, const sp_waypoint *target, const sp_seen *seen,
                    const double *pose_w, const double *form)
{
    sp_grasp_memory *m = &g->memory;
    plan_contact(robot, target, seen->quat_wo, pose_w[3], &g->plan);
    g->target = *target;
    memset(m, 0, sizeof *m);
    sp_copy(m->end.pose_w, pose_w, 4);
    sp_copy(m->end.form, form, SP_JOINTS);
    m->mass = target->mass;
    m->force = sp_min(first_grip(robot, g), most_force(g));
    sp_setting rise = with_form(m->end, g->plan.open);
    rise.pose_w[2] = sp_max(seen->position_w[2] + g->plan.height + g->config.above, pose_w[2]);
    enter(g, SP_GRASP_RISE, rise, 0.0, 0.0);
}

void sp_grasp_carry(sp_grasper *g, const sp_waypoint *order)
{
    sp_grasp_memory *m = &g->memory;
    sp_setting end = m->end;
    double before = m->end.pose_w[3], yaw = order->has_yaw ? order->yaw - m->turn : before, way[3];
    turned(yaw, m->place_b, way);
    for (int i = 0; i < 3; i++) end.pose_w[i] = order->position_w[i] - way[i];
    end.pose_w[3] = before + wrap(yaw - before);
    enter(g, SP_GRASP_CARRY, end, order->speed, 0.0);
}

void sp_grasp_place(sp_grasper *g, double floor_w)
{
    const sp_grasp_memory *m = &g->memory;
    double z = floor_w + top_of(&g->target) - m->place_b[2];
    enter(g, SP_GRASP_LOWER, shifted(g, sp_min(0.0, z + g->config.feel_height - m->end.pose_w[2])), 0.0, 0.0);
}

/* Hold the object where the present phase would come to rest. */
static void hold_here(sp_grasper *g)
{
    double rate[4];
    g->memory.height = 0.0;
    rest_at(g, present(&g->memory, g->config.load_time, rate), SP_GRASP_HOLD);
}

void sp_grasp_stop(sp_grasper *g)
{
    int32_t phase = g->memory.phase;
    if (phase == SP_GRASP_LIFT || phase == SP_GRASP_CARRY || phase == SP_GRASP_LOWER || phase == SP_GRASP_FEEL) hold_here(g);
}

void sp_grasp_release(sp_grasper *g)
{
    sp_grasp_stop(g);
    g->memory.held = g->memory.placed = 0;
    enter(g, SP_GRASP_UNLOAD, with_payload(g->memory.end, 0.0), 0.0, g->config.load_time);
}

int sp_grasp_presses(const sp_grasper *g)
{
    return g->memory.phase >= SP_GRASP_GRIP && g->memory.phase < SP_GRASP_OPEN;
}

int sp_grasp_leaves(const sp_grasper *g)
{
    return g->memory.phase >= SP_GRASP_UNLOAD && g->memory.phase <= SP_GRASP_LEAVE;
}

int sp_grasp_waits(const sp_grasper *g)
{
    return g->memory.phase == SP_GRASP_NONE || g->memory.phase == SP_GRASP_HOLD;
}

int sp_grasp_put_down(sp_grasper *g, double *surface_w)
{
    const sp_grasp_memory *m = &g->memory;
    int32_t phase = m->phase;
    if (!sp_grasp_presses(g) || sp_grasp_leaves(g) || m->placed) return 0;
    if (phase != SP_GRASP_HOLD) hold_here(g);
    if (phase == SP_GRASP_GRIP || phase == SP_GRASP_LOAD) return 0;
    int stood = phase == SP_GRASP_TEST || phase == SP_GRASP_BACK || phase == SP_GRASP_SETTLE || phase == SP_GRASP_LIFT;
    *surface_w = stood ? m->stood - top_of(&g->target) : HUGE_VAL;
    return 1;
}

void sp_grasp_abandon(sp_grasper *g)
{
    double rate[4];
    if (sp_grasp_presses(g) || sp_grasp_leaves(g) || g->memory.phase == SP_GRASP_NONE) return;
    g->memory.end = with_payload(with_force(present(&g->memory, g->config.load_time, rate), 0.0), 0.0);
    enter(g, SP_GRASP_LEAVE, with_form(shifted(g, g->config.above), g->plan.open), 0.0, 0.0);
}

void sp_grasp_steer(const sp_robot *robot, sp_grasper *g, const sp_waypoint *target, const double *action,
                    const double *pose_w, const double *form, double seconds)
{
    sp_grasp_memory *m = &g->memory;
    double a[SP_STEER_SIZE], rate[4], way[3];
    sp_setting now = m->end, end;
    if (m->phase == SP_GRASP_STEERED) {
        now = present(m, 0.0, rate);
    } else {
        memset(&now, 0, sizeof now);
        sp_copy(now.pose_w, pose_w, 4);
        sp_copy(now.form, form, SP_JOINTS);
    }
    for (int k = 0; k < SP_STEER_SIZE; k++) a[k] = sp_clip(action[k], -1.0, 1.0);
    turned(now.pose_w[3], a, way);
    end = now;
    for (int i = 0; i < 3; i++) end.pose_w[i] += seconds * SP_STEER_SPEED * way[i];
    end.pose_w[3] += seconds * SP_STEER_TURN * a[3];
    double radius = SP_STEER_RADIUS[0] + 0.5 * (a[4] + 1.0) * (SP_STEER_RADIUS[1] - SP_STEER_RADIUS[0]);
    claw_form(robot, radius, claw_height(robot, radius), end.form);
    end.force = 0.5 * (a[5] + 1.0) * SP_GRASP_SAFE_GRIP;
    end.payload = 0.0;
    g->target = *target;
    m->phase = SP_GRASP_STEERED;
    m->time = 0.0;
    m->seconds = seconds;
    m->begin = now;
    m->end = end;
}

/* ---- the rule ---- */

int sp_grasp_rule(const sp_grasp_scene *scene, const sp_seen *seen, int idle, double grip, sp_rule_memory *memory,
                  sp_waypoint *orders)
{
    double dx = seen->position_w[0] - scene->goal.x, dy = seen->position_w[1] - scene->goal.y;
    if (!idle || memory->tries >= SP_GRASP_TRIES) return 0;
    if (memory->tries > 0 && length(dx, dy) < SP_GRASP_RULE_DELIVERED) return 0;
    memory->tries++;
    memset(orders, 0, 4 * sizeof *orders);
    sp_grasp_order(scene, memory->mass, &orders[0]);
    if (grip == SP_TOLD) {
        orders[0].mass = scene->mass;
        orders[0].friction = scene->friction;
    } else {
        orders[0].force = grip;
    }
    orders[1].kind = SP_LOCOMOTION_CARRY_TO;
    orders[1].position_w[0] = scene->goal.x;
    orders[1].position_w[1] = scene->goal.y;
    orders[1].position_w[2] = scene->floor + top_of(&orders[0]) + SP_GRASP_RULE_ABOVE_GOAL;
    orders[1].has_yaw = 1;
    orders[1].yaw = scene->goal.yaw;
    orders[1].speed = SP_GRASP_RULE_CARRY_SPEED;
    orders[2].kind = SP_LOCOMOTION_PLACE;
    orders[2].floor = scene->floor;
    orders[3].kind = SP_LOCOMOTION_RELEASE;
    return 4;
}

/* The order to grasp the object of a scene. */
void sp_grasp_order(const sp_grasp_scene *scene, double mass, sp_waypoint *order)
{
    memset(order, 0, sizeof *order);
    order->kind = SP_LOCOMOTION_GRASP;
    order->shape = scene->shape;
    sp_copy(order->half_size, scene->half_size, 3);
    order->most_force = scene->most_force;
    order->mass = mass;
    order->height = SP_GRASP_RULE_LIFT;
}

/* ---- a tick ---- */

/* Open and climb without grip and payload, from the present pose. */
static void leave(sp_grasper *g, const double *position_w, const double *q)
{
    sp_setting here = with_form(with_payload(with_force(g->memory.end, 0.0), 0.0), q);
    sp_copy(here.pose_w, position_w, 3);
    g->memory.end = here;
    enter(g, SP_GRASP_LEAVE, with_form(shifted(g, g->config.above), g->plan.open), 0.0, 0.0);
}

static int is_lost(const sp_grasper *g, const double *position_w, double yaw, const double *q, const sp_seen *seen)
{
    double off[3] = {0.0}, place[3], bent = 0.0;
    if (seen != NULL) {
        turned(yaw, g->memory.place_b, place);
        for (int i = 0; i < 3; i++) off[i] = seen->position_w[i] - position_w[i] - place[i];
    }
    for (int j = 0; j < SP_JOINTS; j++) bent = sp_max(bent, fabs(q[j] - g->plan.closed[j]));
    return bent > g->config.bent || sp_norm(off) > g->config.away;
}

/* Take the means that a phase measures, and detect the floor. */
static void watch(sp_grasper *g, const double *position_w, double lift, double dt)
{
    sp_grasp_memory *m = &g->memory;
    double rate[4];
    int late = m->time > m->seconds - 0.5 * g->config.test_time;
    if ((m->phase == SP_GRASP_DOWN || m->phase == SP_GRASP_TEST) && late) {
        m->total += lift;
        m->count++;
    } else if (m->phase == SP_GRASP_HOLD) {
        m->height += sp_min(1.0, dt / 0.5) * (position_w[2] - m->end.pose_w[2] - m->height);
    } else if (m->phase == SP_GRASP_FEEL) {
        double above = position_w[2] - present(m, 0.0, rate).pose_w[2] - m->height;
        m->found = above > g->config.touch_error ? m->found + dt : 0.0;
        if (m->found >= g->config.touch_time) m->time = m->seconds;
    }
}

/* Decide after the test lift: lift, grip harder, carry more, or let go. */
static void judge(const sp_robot *robot, sp_grasper *g, double risen, double sag)
{
    sp_grasp_memory *m = &g->memory;
    const sp_grasp_config *c = &g->config;
    int count = m->count > 1 ? m->count : 1;
    double carried = sp_max(0.0, robot->weight / robot->gravity * (m->total / count / sp_max(m->hover, 1.0) - 1.0));
    int slips = sag < -c->slip, is_given = g->target.force > 0.0;
    m->tests++;
    if (!slips && risen > 0.5 * c->test_height) {
        m->mass = carried;
        m->held = 1;
        if (!is_given) m->force = sp_min(sp_max(m->force, holding_force(robot, g, carried)), most_force(g));
        enter(g, SP_GRASP_SETTLE, with_payload(with_force(m->end, m->force), m->mass), 0.0, c->load_time);
    } else if (m->tests >= c->most_tests || (slips && (is_given || m->force >= most_force(g) - 1e-6))) {
        m->refused = 1;
        enter(g, SP_GRASP_UNLOAD, with_payload(shifted(g, -c->test_height), 0.0), 0.0, 0.0);
    } else {
        if (slips) m->force = sp_min(m->force + c->more_grip, most_force(g));
        m->mass = sp_max(m->mass, carried);
        enter(g, SP_GRASP_BACK, with_payload(shifted(g, -c->test_height), 0.0), 0.0, 0.0);
    }
}

/* Remember where the object is held. */
static void note_place(sp_grasp_memory *m, const double *position_w, double yaw, const double *where, const sp_seen *seen)
{
    double way[3];
    for (int i = 0; i < 3; i++) way[i] = where[i] - position_w[i];
    turned(-yaw, way, m->place_b);
    if (seen != NULL) m->turn = wrap(heading_of(seen->quat_wo) - yaw);
}

/* Enter the phase after the present one. */
static void go_on(const sp_robot *robot, sp_grasper *g, const double *position_w, double yaw, const double *where,
                  const sp_seen *seen)
{
    sp_grasp_memory *m = &g->memory;
    const sp_grasp_config *c = &g->config;
    const sp_contact *plan = &g->plan;
    sp_setting end = m->end;
    int waits = m->phase == SP_GRASP_RISE || m->phase == SP_GRASP_OVER || m->phase == SP_GRASP_DOWN;
    if (waits && seen == NULL) return; /* for a view of the object */
    switch (m->phase) {
    case SP_GRASP_RISE:
        plan_contact(robot, &g->target, seen->quat_wo, end.pose_w[3], &g->plan);
        sp_copy(end.pose_w, where, 2);
        end.pose_w[2] = sp_max(where[2] + plan->height + c->above, end.pose_w[2]);
        end.pose_w[3] += wrap(plan->yaw - end.pose_w[3]);
        enter(g, SP_GRASP_OVER, with_form(end, plan->open), c->reach_speed, 0.0);
        break;
    case SP_GRASP_OVER:
        sp_copy(end.pose_w, where, 3);
        end.pose_w[2] += plan->height;
        enter(g, SP_GRASP_DOWN, end, 0.0, c->test_time);
        break;
    case SP_GRASP_DOWN:
        m->hover = m->total / (m->count > 1 ? m->count : 1);
        sp_copy(end.pose_w, where, 3);
        end.pose_w[2] += plan->height;
        enter(g, SP_GRASP_CLOSE, with_form(end, plan->pressed), 0.0, c->close_time);
        break;
    case SP_GRASP_CLOSE:
    case SP_GRASP_BACK:
        note_place(m, position_w, yaw, where, seen);
        for (int j = 0; j < SP_JOINTS; j++)
            end.form[j] = plan->closed[j] + c->squeeze / SP_CLAW_PRESS * (plan->pressed[j] - plan->closed[j]);
        enter(g, SP_GRASP_GRIP, with_force(end, m->force), 0.0, c->grip_time);
        break;
    case SP_GRASP_GRIP: enter(g, SP_GRASP_LOAD, with_payload(end, m->mass), 0.0, c->load_time); break;
    case SP_GRASP_LOAD:
        m->stood = where[2];
        m->height = where[2] - position_w[2];
        enter(g, SP_GRASP_TEST, shifted(g, c->test_height), 0.0, 2.0 * c->test_time);
        break;
    case SP_GRASP_TEST: judge(robot, g, where[2] - m->stood, where[2] - position_w[2] - m->height); break;
    case SP_GRASP_SETTLE: enter(g, SP_GRASP_LIFT, shifted(g, g->target.height - c->test_height), 0.0, 0.0); break;
    case SP_GRASP_LIFT:
    case SP_GRASP_CARRY:
        if (seen != NULL) note_place(m, position_w, yaw, where, seen);
        m->height = 0.0;
        rest_at(g, end, SP_GRASP_HOLD);
        break;
    case SP_GRASP_LOWER:
        enter(g, SP_GRASP_FEEL, shifted(g, -(c->feel_height + c->search)), 0.0, 0.0);
        m->seconds = (c->feel_height + c->search) / c->feel_speed;
        break;
    case SP_GRASP_FEEL:
        if (m->found >= c->touch_time) {
            end.pose_w[2] = position_w[2];
            m->placed = 1;
        }
        rest_at(g, end, SP_GRASP_HOLD);
        break;
    case SP_GRASP_UNLOAD: enter(g, SP_GRASP_LET_GO, with_force(shifted(g, c->slack), 0.0), 0.0, c->grip_time); break;
    case SP_GRASP_LET_GO: enter(g, SP_GRASP_OPEN, with_form(end, plan->open), 0.0, 0.0); break;
    case SP_GRASP_OPEN: enter(g, SP_GRASP_LEAVE, shifted(g, c->above), 0.0, 0.0); break;
    case SP_GRASP_LEAVE: rest_at(g, end, SP_GRASP_NONE); break;
    default: break;
    }
}

void sp_grasp_step(const sp_robot *robot, sp_grasper *g, const sp_robot_state *state, double yaw, double lift,
                   const sp_seen *seen, double dt, sp_setting *aim, double *rate)
{
    sp_grasp_memory *m = &g->memory;
    const double *position_w = state->position_w;
    double where[3];
    if (seen == NULL) {
        turned(yaw, m->place_b, where);
        for (int i = 0; i < 3; i++) where[i] += position_w[i];
    } else {
        sp_copy(where, seen->position_w, 3);
    }
    if (sp_grasp_presses(g) && is_lost(g, position_w, yaw, state->joint_position, seen)) {
        m->lost = 1;
        m->held = m->placed = 0;
        leave(g, position_w, state->joint_position);
    } else {
        watch(g, position_w, lift, dt);
        if (m->time >= m->seconds) go_on(robot, g, position_w, yaw, where, seen);
    }
    m->time += dt;
    *aim = present(m, 0.0, rate);
    sp_copy(g->grip.position_w, where, 3);
    g->grip.radius = g->config.avoids ? g->target.half_size[0] : 0.0;
    g->grip.top = top_of(&g->target);
    g->grip.force = g->config.squeeze > 0.0 ? 0.0 : aim->force;
    g->grip.payload = aim->payload;
}
