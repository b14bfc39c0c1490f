/* Courses: the map, the rule that chooses gait and form from the map, and the pilot that commands the manager of both
 * gaits to follow a target. The Python twin `control/course` documents the reasons. */
#include "ground.h"

/* ---- the map ---- */

static int is_passed(const sp_gate *gate) { return gate->kind <= SP_GATE_SLOT; }

/* Height of the ground at x [m]. */
double sp_course_floor(const sp_course *course, double x)
{
    for (int k = 0; k < course->count; k++) {
        const sp_gate *gate = &course->gates[k];
        if (is_passed(gate) || !(gate->begin <= x && x <= gate->end)) continue;
        return gate->kind == SP_GATE_SLOPE ? (x - gate->begin) * tan(gate->size) : gate->size;
    }
    return 0.0;
}

/* End of the field in x [m]. */
double sp_course_end(const sp_course *course)
{
    double end = course->goal.x;
    for (int k = 0; k < course->count; k++) end = sp_max(end, course->gates[k].end);
    return SP_COURSE_BEYOND + end;
}

/* ---- the target ---- */

/* Joint angles of the target's form. */
void sp_target_form(const sp_target *target, double *q)
{
    const int joints = SP_JOINTS / SP_LEGS;
    for (int j = 0; j < SP_JOINTS; j++) {
        int k = j % joints;
        q[j] = SP_TARGET_STRETCHED[k] + target->narrow * (SP_TARGET_BELOW[k] - SP_TARGET_STRETCHED[k]);
        if (k == 0) q[j] += target->sweep * SP_TARGET_TURNS[j / joints];
    }
}

static double farthest(const double *a, const double *b)
{
    double far = 0.0;
    for (int j = 0; j < SP_JOINTS; j++) far = sp_max(far, fabs(a[j] - b[j]));
    return far;
}

static int is_same_flight(const sp_target *target, const sp_pilot *pilot)
{
    const sp_target *last = &pilot->last;
    double off[3] = {target->x - last->x, target->y - last->y, target->z - last->z}, q[SP_JOINTS], before[SP_JOINTS];
    if (!pilot->has_target || !last->flies) return 0;
    sp_target_form(target, q);
    sp_target_form(last, before);
    return sp_norm(off) <= SP_PILOT_SAME_PLACE && farthest(q, before) <= SP_PILOT_SAME_FORM &&
           fabs(target->speed - last->speed) <= SP_PILOT_SAME_SPEED;
}

static int is_same_pose(const sp_target *target, sp_pose2 pose, double step, double turn)
{
    return length(target->x - pose.x, target->y - pose.y) <= step && fabs(wrapped(target->yaw - pose.yaw)) <= turn;
}

static void keep(const sp_target *target, sp_pilot *pilot)
{
    pilot->has_target = 1;
    pilot->last = *target;
}

static void fly(const sp_target *target, const sp_course *course, sp_manager *m, sp_pilot *pilot)
{
    int32_t phase = m->memory.phase;
    double floor = sp_max(sp_course_floor(course, target->x), m->memory.floor);
    sp_waypoint command;
    memset(&command, 0, sizeof command);
    if (phase == SP_MANAGER_LIE || phase == SP_MANAGER_CRAWL || phase == SP_MANAGER_UNLOAD) {
        command.kind = SP_LOCOMOTION_TAKE_OFF;
        command.height = sp_max(SP_PILOT_LEAST_RISE, target->z - m->memory.floor);
        sp_manager_interrupt(m, &command, 1);
        memset(pilot, 0, sizeof *pilot);
        return;
    }
    if (phase != SP_MANAGER_HOVER && phase != SP_MANAGER_FORM && phase != SP_MANAGER_FLY && phase != SP_MANAGER_DESCEND)
        return;
    if (is_same_flight(target, pilot)) return;
    command.kind = SP_LOCOMOTION_FLY_TO;
    command.position_w[0] = target->x;
    command.position_w[1] = target->y;
    command.position_w[2] = sp_max(target->z, floor + SP_PILOT_FLY_LOWEST);
    command.has_form = command.at_once = 1;
    sp_target_form(target, command.form);
    command.speed = target->speed;
    sp_manager_interrupt(m, &command, 1);
    keep(target, pilot);
}

static void crawl(const sp_target *target, const sp_robot_state *state, sp_manager *m, sp_pilot *pilot)
{
    sp_waypoint command;
    const sp_target *last = &pilot->last;
    double R[9];
    int same;
    if (m->memory.phase == SP_MANAGER_LIE) {
        sp_from_quat(state->quat_wb, R);
        same = is_same_pose(target, planar_pose(state->position_w, R), SP_PILOT_THERE, SP_PILOT_THERE_TURN);
    } else {
        sp_pose2 pose = {last->x, last->y, last->yaw};
        same = pilot->has_target && is_same_pose(target, pose, SP_PILOT_SAME_STEP, SP_PILOT_SAME_TURN);
    }
    if (same) return;
    memset(&command, 0, sizeof command);
    command.kind = SP_LOCOMOTION_CRAWL_TO;
    command.pose = (sp_pose2){target->x, target->y, target->yaw};
    sp_manager_interrupt(m, &command, 1);
    keep(target, pilot);
}

/* Command the manager to follow a target; does nothing if it follows the target already. */
void sp_pilot_follow(const sp_target *target, const sp_robot_state *state, const sp_course *course, sp_manager *m,
                     sp_pilot *pilot)
{
    int32_t phase = m->memory.phase;
    sp_waypoint command;
    if (target->flies) {
        fly(target, course, m, pilot);
    } else if (phase == SP_MANAGER_LIE || phase == SP_MANAGER_CRAWL) {
        crawl(target, state, m, pilot);
    } else if (sp_manager_airborne(m) && phase != SP_MANAGER_DESCEND &&
               !(m->count > 0 && m->commands[m->count - 1].kind == SP_LOCOMOTION_LAND)) {
        memset(&command, 0, sizeof command);
        command.kind = SP_LOCOMOTION_LAND;
        command.floor = sp_course_floor(course, state->position_w[0]);
        sp_manager_interrupt(m, &command, 1);
        keep(target, pilot);
    }
}

/* ---- the rule ---- */

static sp_target flight(double x, double y, double z, double speed, double narrow)
{
    return (sp_target){.flies = 1, .x = x, .y = y, .z = z, .speed = speed, .narrow = narrow};
}

static sp_target on_floor(double x, double y, double yaw)
{
    return (sp_target){.x = x, .y = y, .yaw = yaw, .speed = SP_RULE_SLOW};
}

static int has_form(const double *q, const sp_target *target)
{
    double form[SP_JOINTS];
    sp_target_form(target, form);
    return farthest(q, form) < SP_RULE_FORMED;
}

static sp_target above(double to_x, double to_y, double floor, double x, double y, int stays)
{
    if (!stays && length(to_x - x, to_y - y) < SP_RULE_NEAR) return on_floor(x, y, 0.0);
    return flight(to_x, to_y, floor + SP_RULE_ABOVE, SP_RULE_FAST, 0.0);
}

static sp_target over(const sp_gate *gate, double x, double z, const double *q)
{
    sp_target over = flight(gate->end + SP_RULE_FLOWN, 0.0, sp_min(gate->size + SP_RULE_OVER, SP_COURSE_CEILING), SP_RULE_FAST, 0.0);
    if (z > over.z - SP_RULE_BENEATH && has_form(q, &over)) return over;
    return flight(sp_min(x, gate->begin - SP_RULE_FLOWN), 0.0, over.z, SP_RULE_FAST, 0.0);
}

static sp_target through(const sp_gate *gate, double x, double y, const double *q)
{
    double before = gate->begin - SP_RULE_FLOWN;
    sp_target through = flight(gate->end + SP_RULE_FLOWN, gate->middle, SP_RULE_THROUGH, SP_RULE_SLOW, 1.0);
    int in_line = fabs(x - before) < SP_RULE_NEAR && fabs(y - gate->middle) < SP_RULE_ALIGNED;
    if (has_form(q, &through) && (x >= before + SP_RULE_NEAR || in_line)) return through;
    return flight(before, gate->middle, SP_RULE_THROUGH, SP_RULE_FAST, 1.0);
}

/* Choose the next target. */
sp_target sp_course_rule(const sp_course *course, const double *position_w, const double *q, int32_t phase, int flies,
                         int crawls)
{
    double x = position_w[0], y = position_w[1], z = position_w[2];
    sp_pose2 goal = course->goal;
    int lies = phase == SP_MANAGER_LIE || phase == SP_MANAGER_CRAWL;
    int lands = phase == SP_MANAGER_DESCEND || phase == SP_MANAGER_UNLOAD;
    const sp_gate *gate = NULL;
    if (!flies) return on_floor(goal.x, goal.y, goal.yaw);
    for (int k = 0; k < course->count && gate == NULL; k++) {
        const sp_gate *next = &course->gates[k]; /* in the air a beam is passed at its end */
        double behind = next->kind == SP_GATE_BEAM && !lies ? 0.0 : SP_RULE_PASSED;
        if (is_passed(next) && x < next->end + behind) gate = next;
    }
    if (gate == NULL || gate->begin > goal.x) {
        if (lands || (lies && !crawls)) return on_floor(x, y, 0.0);
        if (lies && length(goal.x - x, goal.y - y) < SP_RULE_CRAWLS / 3.0) return on_floor(goal.x, goal.y, goal.yaw);
        return above(goal.x, goal.y, sp_course_floor(course, goal.x), x, y, lies);
    }
    if (gate->kind == SP_GATE_WALL) return over(gate, x, z, q);
    if (gate->kind == SP_GATE_SLOT) return through(gate, x, y, q);
    if (lands) return on_floor(x, y, 0.0);
    if (lies && crawls && gate->begin - x < SP_RULE_CRAWLS) return on_floor(gate->end + SP_RULE_CRAWLED, 0.0, 0.0);
    return above(gate->begin - SP_RULE_FLOWN, 0.0, 0.0, x, y, lies || !crawls);
}

/* Convert an action to a target: gait, displacement from here, height, heading, speed, form and sweep. */
void sp_take_target(const double *action, const sp_course *course, const double *position_w, sp_target *target)
{
    double far = SP_COURSE_HALF_WIDTH - SP_TARGET_MARGIN;
    memset(target, 0, sizeof *target);
    target->flies = action[0] > 0.0;
    target->x = sp_clip(position_w[0] + SP_TARGET_WAY * action[1], SP_TARGET_MARGIN - SP_COURSE_BEFORE,
                        sp_course_end(course) - SP_TARGET_MARGIN);
    target->y = sp_clip(position_w[1] + SP_TARGET_WAY * action[2], -far, far);
    target->z = 0.5 * SP_COURSE_CEILING * (1.0 + action[3]);
    target->yaw = SP_PI * action[4];
    target->speed = 0.5 * (SP_TARGET_SPEEDS[0] + SP_TARGET_SPEEDS[1] +
                           (SP_TARGET_SPEEDS[1] - SP_TARGET_SPEEDS[0]) * action[5]);
    target->narrow = 0.5 * (1.0 + action[6]);
    target->sweep = SP_TARGET_SWEEP * action[7];
}
