/* Orders for the manager of both gaits: read lines of text, and refuse orders that cannot be followed from here. */
#define _POSIX_C_SOURCE 200809L
#include <string.h>

#include "ground.h"
#include "runner.h"

static const char NOT_FORM[] = "form and 16 angles within ± 90 degrees [rad], as the end of the line";

/* Joint angles of the mission's crawl configuration when lying on the floor. */
static void lying_form(const sp_mission *m, double *q)
{
    double home[3 * SP_LEGS];
    sp_home(&m->robot, &m->crawler.gait, home);
    sp_leg_angles(&m->robot, home, q);
}

static void snapshot_of(const sp_robot *robot, const double *form, sp_snapshot *snapshot)
{
    static const double still[2 * SP_ROTORS] = {0.0};
    double level[9];
    sp_identity(level);
    sp_snapshot_at(robot, form, level, still, snapshot);
}

/* Smallest width that a form passes, with clearance on both sides. */
static double narrowest(const sp_robot *robot, const double *form, double clearance)
{
    sp_snapshot s;
    double radius = 0.0;
    snapshot_of(robot, form, &s);
    for (int i = 0; i < SP_ROTORS; i++)
        radius = sp_max(radius, length(s.rotor_c[i][0] + s.com_b[0], s.rotor_c[i][1] + s.com_b[1]) + robot->duct_reach);
    for (int leg = 0; leg < SP_LEGS; leg++)
        radius = sp_max(radius, length(s.feet_b[leg][0], s.feet_b[leg][1]) + robot->foot_radius);
    return 2.0 * (radius + clearance);
}

/* Height of the CoG when the feet of a form touch the floor. */
static double standing_height(const sp_robot *robot, const double *form)
{
    sp_snapshot s;
    double lowest = HUGE_VAL;
    snapshot_of(robot, form, &s);
    for (int leg = 0; leg < SP_LEGS; leg++) lowest = sp_min(lowest, s.feet_b[leg][2]);
    return s.com_b[2] + robot->foot_radius - lowest;
}

static int within(double x, double low, double high) { return x >= low && x <= high; }

static int in_field(const double *x, int n)
{
    for (int i = 0; i < n; i++)
        if (!within(x[i], -SP_ORDER_FIELD, SP_ORDER_FIELD)) return 0;
    return 1;
}

static const char *read_crawl_to(sp_waypoint *o, char **words, int count)
{
    double v[3];
    if (!sp_numbers(words, count, 3, v) || !in_field(v, 2) || !within(v[2], -1e3, 1e3))
        return "crawl_to X Y [m] YAW [rad], where the torso comes to lie, within ± 100 m";
    o->kind = SP_LOCOMOTION_CRAWL_TO;
    o->pose.x = v[0], o->pose.y = v[1], o->pose.yaw = v[2];
    return NULL;
}

static const char *read_take_off(sp_waypoint *o, char **words, int count)
{
    if (!sp_numbers(words, count, 1, &o->height) || !within(o->height, SP_ORDER_LEAST_HEIGHT, SP_ORDER_MOST_HEIGHT))
        return "take_off HEIGHT, by which it rises, within 0.1 … 10 m";
    o->kind = SP_LOCOMOTION_TAKE_OFF;
    return NULL;
}

static const char *read_land(sp_waypoint *o, char **words, int count)
{
    double v[2] = {0.0, 0.0};
    if (count > 3 || !sp_numbers(words, count, count - 1, v) || !in_field(v, 1))
        return "land [FLOOR, its height [m] [SLOPE [rad]]]";
    if (!within(v[1], 0.0, SP_ORDER_STEEPEST)) return "land on a slope within 0 … 0.209 rad, where a robot stays";
    o->kind = SP_LOCOMOTION_LAND;
    o->floor = v[0];
    return NULL;
}

static const char *read_fly_to(const sp_mission *m, sp_waypoint *o, char **words, int count)
{
    double v[4], room = HUGE_VAL, form[SP_JOINTS];
    int k = 5;
    if (count < 5 || !sp_numbers(words, 5, 4, v) || !in_field(v, 3))
        return "fly_to X Y Z [m] SPEED [m/s] [along] [at_once] [room WIDTH [m]] [form and 16 angles [rad]]";
    if (!within(v[3], SP_ORDER_LEAST_SPEED, SP_ORDER_MOST_SPEED)) return "fly_to with a speed within 0.05 … 1.5 m/s";
    o->kind = SP_LOCOMOTION_FLY_TO;
    sp_copy(o->position_w, v, 3);
    o->speed = v[3];
    if (k < count && strcmp(words[k], "along") == 0) o->along = 1, k++;
    if (k < count && strcmp(words[k], "at_once") == 0) o->at_once = 1, k++;
    if (k < count && strcmp(words[k], "room") == 0) {
        if (k + 1 == count || !sp_numbers(words + k, 2, 1, &room) || !within(room, 0.0, SP_ORDER_FIELD))
            return "room and a width within 0 … 100 m";
        k += 2;
    }
    if (k < count) {
        if (strcmp(words[k], "form") != 0) return "along, at_once, room, form, in this order, after a fly_to's speed";
        if (!sp_numbers(words + k, count - k, SP_JOINTS, o->form)) return NOT_FORM;
        for (int j = 0; j < SP_JOINTS; j++) {
            if (!within(fabs(o->form[j]), 0.0, m->robot.joint_limit + 1e-3)) return NOT_FORM;
            o->form[j] = sp_clip(o->form[j], -m->robot.joint_limit, m->robot.joint_limit);
        }
        o->has_form = 1;
    }
    if (room == HUGE_VAL) return NULL;
    if (o->has_form) sp_copy(form, o->form, SP_JOINTS);
    else lying_form(m, form);
    return room >= narrowest(&m->robot, form, m->manager.clearance) ? NULL : "a wider room: the form does not fit with its clearance";
}

static const char *read_grasp(const sp_mission *m, sp_waypoint *o, char **words, int count)
{
    static const char *const shapes[] = {"box", "cylinder", "ball"};
    double v[8];
    int shape = 0;
    while (count > 1 && shape < 3 && strcmp(words[1], shapes[shape]) != 0) shape++;
    if (count != 10 || shape == 3 || !sp_numbers(words + 1, 9, 8, v))
        return "grasp box|cylinder|ball, half of length, width, height [m], largest FORCE of a foot [N], MASS [kg], HEIGHT [m], "
               "FORCE of a foot [N], 0 as tested, its FRICTION, 0 unknown";
    for (int i = 0; i < 3; i++)
        if (!within(v[i], SP_ORDER_LEAST_SIZE, SP_ORDER_MOST_SIZE)) return "half sizes within 0.05 … 2 m";
    if (!within(v[3], SP_ORDER_LEAST_FORCE, SP_ORDER_MOST_FORCE)) return "a force within 1 … 1000 N";
    if (!within(v[4], 0.0, SP_ORDER_MOST_MASS)) return "a mass within 0 … 20 kg";
    if (!within(v[5], SP_ORDER_LEAST_HEIGHT, SP_ORDER_MOST_HEIGHT)) return "a height of the lift within 0.1 … 10 m";
    if (!within(v[6], 0.0, SP_ORDER_MOST_FORCE)) return "a force within 0 … 1000 N";
    if (!within(v[7], 0.0, SP_ORDER_MOST_FRICTION)) return "a friction within 0 … 10";
    o->kind = SP_LOCOMOTION_GRASP;
    o->shape = shape;
    sp_copy(o->half_size, v, 3);
    o->most_force = v[3], o->mass = v[4], o->height = v[5], o->force = v[6], o->friction = v[7];
    return sp_refuse_object(&m->robot, o);
}

static const char *read_carry_to(sp_waypoint *o, char **words, int count)
{
    double v[5] = {0.0};
    if (count < 5 || count > 6 || !sp_numbers(words, count, count - 1, v) || !in_field(v, 3) || !within(v[4], -1e3, 1e3))
        return "carry_to X Y Z of the object's middle [m] SPEED [m/s] [its YAW [rad]]";
    if (!within(v[3], SP_ORDER_LEAST_SPEED, SP_ORDER_MOST_SPEED)) return "carry_to with a speed within 0.05 … 1.5 m/s";
    o->kind = SP_LOCOMOTION_CARRY_TO;
    sp_copy(o->position_w, v, 3);
    o->speed = v[3];
    o->has_yaw = count == 6;
    o->yaw = v[4];
    return NULL;
}

static const char *read_place(sp_waypoint *o, char **words, int count)
{
    if (!sp_numbers(words, count, 1, &o->floor) || !in_field(&o->floor, 1)) return "place HEIGHT of the surface [m]";
    o->kind = SP_LOCOMOTION_PLACE;
    return NULL;
}

static const char *read_release(sp_waypoint *o, char **words, int count)
{
    (void)words;
    o->kind = SP_LOCOMOTION_RELEASE;
    return count == 1 ? NULL : "release alone";
}

int sp_is_order(const char *word)
{
    static const char *const orders[] = {"crawl_to", "take_off", "fly_to", "land", "grasp", "carry_to", "place", "release"};
    for (size_t k = 0; k < sizeof orders / sizeof orders[0]; k++)
        if (strcmp(word, orders[k]) == 0) return 1;
    return 0;
}

const char *sp_read_order(const sp_mission *m, char **words, int count, sp_waypoint *order)
{
    memset(order, 0, sizeof *order);
    if (strcmp(words[0], "crawl_to") == 0) return read_crawl_to(order, words, count);
    if (strcmp(words[0], "take_off") == 0) return read_take_off(order, words, count);
    if (strcmp(words[0], "land") == 0) return read_land(order, words, count);
    if (strcmp(words[0], "grasp") == 0) return read_grasp(m, order, words, count);
    if (strcmp(words[0], "carry_to") == 0) return read_carry_to(order, words, count);
    if (strcmp(words[0], "place") == 0) return read_place(order, words, count);
    if (strcmp(words[0], "release") == 0) return read_release(order, words, count);
    return read_fly_to(m, order, words, count);
}

/* Whether the gait's queue can hold the cycles of a displacement. */
static int reachable(const sp_robot *robot, const sp_manager *m, sp_pose2 way)
{
    const sp_gait_config *c = &m->crawl.config.gait;
    way.yaw = wrapped(way.yaw);
    double share = sp_largest_stride(robot, &m->crawl, way);
    return share > 0.0 &&
           sp_max(sp_max(length(way.x, way.y) / c->max_distance, fabs(way.yaw) / c->max_turn), 1.0 / share) < SP_MAX_STEPS;
}

const char *sp_refuse_orders(const sp_robot *robot, const sp_manager *m, const sp_robot_state *state,
                             const sp_waypoint *orders, int n, int now)
{
    const sp_waypoint *last = m->count > 0 && !now ? &m->commands[m->count - 1] : NULL;
    int32_t situation = sp_manager_situation(m);
    double R[9];
    sp_from_quat(state->quat_wb, R);
    sp_pose2 place = planar_pose(state->position_w, R);
    if (n + (now ? 1 : m->count) > SP_MAX_WAYPOINTS) return "at most 64 orders at once";
    if (last != NULL) sp_cannot_follow(last->kind, &situation); /* after it */
    for (int k = now ? 0 : -m->count; k < n; k++) { /* pending orders determine where new ones begin */
        const sp_waypoint *o = k < 0 ? &m->commands[m->count + k] : &orders[k];
        const char *why = k < 0 ? NULL : sp_cannot_follow(o->kind, &situation);
        if (why != NULL) return why;
        if (o->kind == SP_LOCOMOTION_CRAWL_TO) {
            if (k >= 0 && !reachable(robot, m, then(inverse(place), o->pose))) return "a crawl_to within reach: a shorter distance";
            place = o->pose;
        } else if (o->kind == SP_LOCOMOTION_FLY_TO) {
            double least = m->memory.floor - m->lying_height + m->config.clearance;
            double dx = o->position_w[0] - place.x, dy = o->position_w[1] - place.y;
            if (k >= 0 && !(o->position_w[2] >= least + standing_height(robot, o->has_form ? o->form : m->lying)))
                return "a fly_to higher above the floor: the form would touch it";
            if (o->along && length(dx, dy) > SP_MANAGER_LEAST_WAY) place.yaw = atan2(dy, dx);
            place.x = o->position_w[0], place.y = o->position_w[1];
        }
    }
    return NULL;
}

const char *sp_take_orders(sp_manager *m, const sp_mission *mission, const sp_robot_state *state, const char *text)
{
    sp_waypoint orders[SP_MOST_ORDERS];
    char all[SP_ORDER_TEXT], *line = all, *words[SP_WORDS];
    int n = 0, now = 0, first = 1;
    memset(orders, 0, sizeof orders);
    memcpy(all, text, sizeof all);
    all[sizeof all - 1] = 0;
    while (line != NULL) {
        char *end = strchr(line, '\n');
        if (end != NULL) *end++ = 0;
        int count = sp_split(line, words);
        line = end;
        if (count < 0) return "fewer words";
        if (count == 0) continue;
        if (first && count == 1 && strcmp(words[0], "now") == 0) now = 1;
        else if (!sp_is_order(words[0])) return "now as the first line, then crawl_to, take_off, fly_to, land, grasp, carry_to, place, release";
        else if (n == SP_MOST_ORDERS) return "at most 16 orders in a message";
        else {
            const char *valid = sp_read_order(mission, words, count, &orders[n++]);
            if (valid != NULL) return valid;
        }
        first = 0;
    }
    const char *why = sp_refuse_orders(&mission->robot, m, state, orders, n, now);
    if (why != NULL) return why;
    if (now) sp_manager_interrupt(m, orders, n);
    else for (int k = 0; k < n; k++) sp_manager_command(m, &orders[k]);
    return NULL;
}
