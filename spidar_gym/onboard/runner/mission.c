/* Read a mission's text line by line. */
#include <stdio.h>
#include <string.h>

#include "runner.h"
#include "spidar_math.h"

#define MAX_SPEED 1.62 /* of a joint without load [rad/s] [ROBOTIS] */

static const char NO_KIND[] = "flight PRESET, crawl PRESET, course FLIGHT CRAWL or bench first";

/* Each line's reader returns what would have been valid, or NULL. */
static const char *read_form(sp_mission *m, char **words, int count)
{
    double v[1 + SP_JOINTS];
    if (!sp_numbers(words, count, 1 + SP_JOINTS, v) || v[0] < 0.0) return "form SECONDS and 16 angles [rad]";
    if (m->form_count == SP_MAX_FORMS || (m->form_count > 0 && v[0] < m->forms[m->form_count - 1].start))
        return "at most 64 forms, in the order of their times";
    for (int j = 0; j < SP_JOINTS; j++)
        if (!(fabs(v[1 + j]) <= m->robot.joint_limit + 1e-3)) return "form angles within ± 90 degrees";
    m->forms[m->form_count].start = v[0];
    for (int j = 0; j < SP_JOINTS; j++) /* a rounded right angle is clipped */
        m->forms[m->form_count].joint_target[j] = sp_clip(v[1 + j], -m->robot.joint_limit, m->robot.joint_limit);
    m->form_count++;
    return NULL;
}

static const char *read_move(sp_mission *m, char **words, int count)
{
    double v[4];
    if (!sp_numbers(words, count, 4, v) || v[3] < 0.0 || v[3] > 100.0 || v[3] != floor(v[3]))
        return "move X Y [m] YAW [rad] CYCLES (0: as many as it takes)";
    if (m->move_count == SP_MAX_MOVES) return "at most 16 moves";
    sp_move *move = &m->moves[m->move_count++];
    move->way.x = v[0], move->way.y = v[1], move->way.yaw = v[2], move->cycles = (int32_t)v[3];
    return NULL;
}

/* Append a preset's name to a list of those that are valid. */
static void append(char *list, size_t size, int k, const char *name)
{
    size_t n = strlen(list);
    snprintf(list + n, size - n, "%s%s", k == 0 ? "" : ", ", name);
}

static const char *read_kind(const sp_parameters *p, sp_mission *m, char **words, int count)
{
    static char valid[512];
    if (strcmp(words[0], "bench") == 0) {
        m->kind = SP_MISSION_BENCH;
        return count == 1 ? NULL : "bench alone";
    }
    const int course = strcmp(words[0], "course") == 0, flies = course || strcmp(words[0], "flight") == 0;
    const int crawls = course || !flies, whole = count == 2 + course;
    const sp_controller_config *controller = sp_find_flight(p, whole ? words[1] : "");
    const sp_crawler_config *crawler = sp_find_crawl(p, whole ? words[count - 1] : "");
    if ((flies && controller == NULL) || (crawls && crawler == NULL)) {
        snprintf(valid, sizeof valid, "%s", course ? "course, one of " : flies ? "flight and one of " : "crawl and one of ");
        for (int k = 0; flies && k < p->flight_count; k++) append(valid, sizeof valid, k, p->flights[k].name);
        if (course) append(valid, sizeof valid, 1, "and one of ");
        for (int k = 0; crawls && k < p->crawl_count; k++) append(valid, sizeof valid, k, p->crawls[k].name);
        return valid;
    }
    m->kind = course ? SP_MISSION_COURSE : flies ? SP_MISSION_FLIGHT : SP_MISSION_CRAWL;
    if (flies) m->controller = *controller;
    if (crawls) m->crawler = *crawler;
    return NULL;
}

static const char *read_order(sp_mission *m, char **words, int count)
{
    int32_t situation = SP_ON_FLOOR;
    if (m->kind != SP_MISSION_COURSE) return "crawl_to, take_off, fly_to, land, grasp, carry_to, place, release for a course";
    if (m->order_count > 0) sp_cannot_follow(m->orders[m->order_count - 1].kind, &situation); /* after it */
    if (m->order_count == SP_MAX_WAYPOINTS) return "at most 64 orders at once";
    sp_waypoint *order = &m->orders[m->order_count];
    const char *valid = sp_read_order(m, words, count, order);
    if (valid == NULL) valid = sp_cannot_follow(order->kind, &situation);
    if (valid == NULL) m->order_count++;
    return valid;
}

static const char *read_switch(sp_mission *m, char **words, int count)
{
    const char *word = count == 2 ? words[1] : "";
    if (strcmp(words[0], "estimate") == 0) {
        m->odometry = strcmp(word, "odometry") == 0;
        return m->odometry || strcmp(word, "mocap") == 0 ? NULL : "estimate mocap, or estimate odometry";
    }
    if (strcmp(words[0], "trim") == 0) {
        m->trim = strcmp(word, "on") == 0;
        return m->trim || strcmp(word, "off") == 0 ? NULL : "trim on, or trim off";
    }
    m->residual = strcmp(word, "on") == 0;
    return m->residual || strcmp(word, "off") == 0 ? NULL : "residual on, or residual off";
}

static const char *read_limit(sp_mission *m, char **words, int count)
{
    double v[6];
    sp_limits *l = &m->limits;
    const char *name = words[0];
    if (strcmp(name, "fence") == 0) {
        if (!sp_numbers(words, count, 6, v)) return "fence, then x y z of its low and of its high corner [m]";
        sp_copy(l->fence_low, v, 3);
        sp_copy(l->fence_high, v + 3, 3);
        for (int i = 0; i < 3; i++)
            if (!(v[i] < v[i + 3])) return "a fence whose low corner is below its high one";
        return NULL;
    }
    if (strcmp(name, "ages") == 0) {
        if (!sp_numbers(words, count, 4, v)) return "ages of pose, inertial unit, joints, flight state [s]";
        for (int i = 0; i < 4; i++)
            if (!(v[i] > 0.0 && v[i] <= 0.5)) return "ages within 0 … 0.5 s: beyond that the flight controller lands the robot";
        l->pose_age = v[0], l->imu_age = v[1], l->joint_age = v[2], l->state_age = v[3];
        return NULL;
    }
    if (strcmp(name, "speed") == 0) {
        if (!sp_numbers(words, count, count == 3 ? 2 : 1, v)) return "speed and one number, or a second one of a crawl [rad/s]";
        if (count == 2) v[1] = v[0];
        for (int i = 0; i < 2; i++)
            if (!(v[i] > 0.0 && v[i] <= MAX_SPEED)) return "speed within 0 … 1.62 rad/s, what the servos can do";
        m->controller.joint_speed = v[0], m->crawler.joint_speed = v[1];
        return NULL;
    }
    if (!sp_numbers(words, count, 1, v)) return "one number after settle, tilt, deviation, torque, end";
    if (strcmp(name, "settle") == 0) l->settle = v[0];
    else if (strcmp(name, "tilt") == 0) l->tilt = v[0];
    else if (strcmp(name, "deviation") == 0) l->deviation = v[0];
    else if (strcmp(name, "torque") == 0) l->torque = v[0];
    else m->end = v[0];
    if (!(v[0] > 0.0)) return "a number above 0";
    return l->tilt <= 1.0 ? NULL : "tilt within 0 … 1 rad: beyond that the flight controller lands the robot";
}

static const char *read_heading(sp_mission *m, char **words, int count)
{
    double v[2], last = m->heading_count > 0 ? m->headings[m->heading_count - 1].start : 0.0;
    if (m->kind != SP_MISSION_FLIGHT) return "heading for a flight";
    if (!sp_numbers(words, count, 2, v) || !(v[0] >= last)) return "heading SECONDS YAW [rad], in the order of their times";
    if (!(fabs(v[1]) <= SP_PI)) return "headings within ± 3.14159 rad of that at the take-over";
    if (m->heading_count == SP_MAX_HEADINGS) return "at most 16 headings";
    m->headings[m->heading_count].start = v[0];
    m->headings[m->heading_count++].yaw = v[1];
    return NULL;
}

static const char *read_window(sp_mission *m, char **words, int count)
{
    double v[2];
    if (!sp_numbers(words, count, 2, v) || !(v[0] >= 0.0 && v[0] < v[1])) return "unrestricted START END [s]";
    if (m->window_count == SP_MAX_WINDOWS) return "at most 8 windows";
    m->windows[m->window_count].start = v[0];
    m->windows[m->window_count++].end = v[1];
    return NULL;
}

static const struct {
    const char *word;
    const char *(*read)(sp_mission *, char **, int); /* NULL: read_kind */
} LINES[] = {
    {"flight", NULL}, {"crawl", NULL}, {"course", NULL}, {"bench", NULL}, {"form", read_form},
    {"heading", read_heading}, {"excite", sp_read_excitation}, {"move", read_move}, {"gate", sp_read_gate},
    {"goal", sp_read_goal}, {"crawl_to", read_order}, {"take_off", read_order}, {"fly_to", read_order},
    {"land", read_order}, {"grasp", read_order}, {"carry_to", read_order}, {"place", read_order}, {"release", read_order},
    {"unrestricted", read_window}, {"estimate", read_switch}, {"residual", read_switch}, {"trim", read_switch},
    {"fence", read_limit}, {"ages", read_limit}, {"settle", read_limit}, {"tilt", read_limit},
    {"deviation", read_limit}, {"torque", read_limit}, {"speed", read_limit}, {"end", read_limit},
    {"voltage", sp_read_health}, {"servos", sp_read_health}, {"motors", sp_read_health}, {"health", sp_read_health},
};

/* Read a line; returns NULL, or what would have been valid. `kinds` counts lines with flight, crawl or course. */
static const char *read_line(const sp_parameters *p, sp_mission *m, char *line, int *kinds)
{
    char *words[SP_WORDS];
    size_t k = 0;
    int count = sp_split(line, words);
    if (count < 0) return "fewer words";
    if (count == 0) return NULL;
    while (k < sizeof LINES / sizeof *LINES && strcmp(words[0], LINES[k].word) != 0) k++;
    if (k == sizeof LINES / sizeof *LINES)
        return "flight, crawl, course, bench, form, heading, excite, move, crawl_to, take_off, fly_to, land, grasp, "
               "carry_to, place, release, gate, goal, unrestricted, estimate, residual, trim, fence, ages, settle, tilt, deviation, torque, speed, end, voltage, servos, "
               "motors, health";
    const int is_kind = LINES[k].read == NULL;
    *kinds += is_kind;
    if (*kinds > 1) return "one flight, crawl, course or bench";
    const char *valid = is_kind ? read_kind(p, m, words, count) : LINES[k].read(m, words, count);
    return valid == NULL && *kinds == 0 ? NO_KIND : valid;
}

int sp_read_mission(const char *text, const sp_parameters *p, sp_mission *m, char *reason, size_t size)
{
    char line[1024];
    const char *valid = NULL;
    int number_of_line = 0, kinds = 0;
    memset(m, 0, sizeof *m);
    m->robot = p->robot;
    m->limits = p->limits;
    m->controller = p->flights[0].config;
    m->crawler = p->crawls[0].config;
    m->trim = 1;
    m->estimator = p->estimator;
    m->manager = p->manager;
    while (*text != 0 && valid == NULL) {
        size_t length = strcspn(text, "\n");
        number_of_line++;
        if (length >= sizeof line) valid = "a line of at most 1023 characters";
        else {
            memcpy(line, text, length);
            line[length] = 0;
            valid = read_line(p, m, line, &kinds);
        }
        text += length + (text[length] != 0);
    }
    if (valid == NULL && kinds == 0) valid = NO_KIND;
    int flies = m->kind == SP_MISSION_FLIGHT, moves = m->form_count > 0 || m->end > 0.0;
    if (valid == NULL && ((!flies && m->window_count > 0) || (!flies && m->kind != SP_MISSION_BENCH && moves) ||
                          (m->kind != SP_MISSION_CRAWL && m->move_count > 0)))
        valid = "form, end for a flight or a bench test; unrestricted for a flight; move for a crawl";
    if (valid == NULL) valid = sp_refuse_map(m);
    if (valid == NULL) return 1;
    snprintf(reason, size, "mission, line %d; valid: %s", number_of_line, valid);
    return 0;
}
