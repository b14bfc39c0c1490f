/* A course with a map: read gates and goal, refuse maps that cannot be passed, and apply the rule twice a second.
 * `control/course/gates.py` has the same checks. */
#include <string.h>

#include "ground.h"
#include "runner.h"

static const char *const NOT_SIZE[SP_GATE_KINDS] = {
    "gate wall of 0 … 2 m", "gate beam with a clearance of 0.5 … 3 m", "gate slot of 1.25 … 6 m",
    "gate platform of 0 … 0.6 m", "gate tiles of up to 0.03 m", "gate slope of 0 … 0.209 rad",
};

static int is_passed(const sp_gate *gate) { return gate->kind <= SP_GATE_SLOT; }

static int kind_of(const char *word)
{
    for (int k = 0; k < SP_GATE_KINDS; k++)
        if (strcmp(word, SP_GATE_WORDS[k]) == 0) return k;
    return -1;
}

const char *sp_read_gate(sp_mission *m, char **words, int count)
{
    double v[4] = {0.0};
    sp_course *map = &m->map;
    int kind = count > 1 ? kind_of(words[1]) : -1;
    if (m->kind != SP_MISSION_COURSE) return "gate and goal for a course";
    if (kind < 0 || count < 5 || count > 6 || !sp_numbers(words + 1, count - 1, count - 2, v))
        return "gate, one of wall, beam, slot, platform, tiles, slope, then BEGIN END SIZE [m, rad] and a slot's MIDDLE [m]";
    if (map->count == SP_MAX_GATES) return "at most 8 gates";
    sp_gate *gate = &map->gates[map->count];
    const sp_gate *before = map->count > 0 ? gate - 1 : NULL;
    *gate = (sp_gate){.kind = kind, .begin = v[0], .end = v[1], .size = v[2], .middle = v[3]};
    if (!(v[0] >= -SP_MAP_FARTHEST && v[1] <= SP_MAP_FARTHEST && v[0] < v[1]))
        return "a gate that ends behind its begin, within ± 60 m";
    if (!(v[2] >= SP_GATE_LEAST[kind] && v[2] <= SP_GATE_MOST[kind])) return NOT_SIZE[kind];
    if (fabs(v[3]) + (kind == SP_GATE_SLOT ? 0.5 * v[2] : 0.0) > SP_COURSE_HALF_WIDTH)
        return "a slot between the field's sides at ± 3 m";
    /* Between a beam and a platform the robot takes off: the whole robot must fit there. */
    int takes_off = before != NULL && before->kind == SP_GATE_BEAM && kind == SP_GATE_PLATFORM;
    int is_wide = takes_off || (before != NULL && is_passed(gate) && is_passed(before));
    double room = is_wide ? SP_MAP_ROOM : SP_MAP_REACH;
    if (v[0] < (before != NULL ? before->end + room : SP_MAP_REACH))
        return "gates in their order, with 2.4 m between two, and 1.2 m before the first and before and behind a floor, "
               "but 2.4 m from a beam to a platform";
    map->count++;
    return NULL;
}

const char *sp_read_goal(sp_mission *m, char **words, int count)
{
    double v[3], side = SP_COURSE_HALF_WIDTH - SP_MAP_REACH;
    if (m->kind != SP_MISSION_COURSE) return "gate and goal for a course";
    if (m->has_goal) return "one goal";
    if (!sp_numbers(words, count, 3, v) || !(v[0] >= -SP_COURSE_BEFORE && v[0] <= SP_MAP_FARTHEST) ||
        !(fabs(v[1]) <= side) || !(fabs(v[2]) <= SP_PI))
        return "goal X Y [m] YAW [rad], where the torso comes to lie, 1.2 m from the field's sides";
    m->map.goal.x = v[0], m->map.goal.y = v[1], m->map.goal.yaw = v[2];
    m->has_goal = 1;
    return NULL;
}

const char *sp_refuse_map(const sp_mission *m)
{
    const sp_course *map = &m->map;
    if (!m->has_goal) return map->count > 0 ? "a goal behind the gates" : NULL;
    if (m->order_count > 0) return "orders, or a goal with gates, not both";
    for (int k = 0; k < map->count; k++) {
        const sp_gate *gate = &map->gates[k];
        double off = sp_max(gate->begin - map->goal.x, map->goal.x - gate->end);
        int hits = is_passed(gate) && gate->kind != SP_GATE_BEAM && off < SP_MAP_REACH;
        if (hits || (!is_passed(gate) && fabs(off) < SP_MAP_REACH)) return "a goal 1.2 m from walls, slots, and edges of floors";
    }
    return NULL;
}

/* Choose the next target and follow it. The course is over when the robot lies at the goal without commands. */
static void decide(sp_loop *l)
{
    const sp_robot_state *seen = &l->sense.state;
    const sp_course *map = &l->mission.map;
    sp_manager *m = &l->manager;
    sp_target target = sp_course_rule(map, seen->position_w, seen->joint_position, m->memory.phase, 1, 1);
    sp_pilot_follow(&target, seen, map, m, &l->pilot);
    int is_goal = !target.flies && target.x == map->goal.x && target.y == map->goal.y && target.yaw == map->goal.yaw;
    l->told = is_goal && m->memory.phase == SP_MANAGER_LIE && sp_manager_done(m);
}

void sp_go_by_map(sp_loop *l)
{
    if (!l->by_map) return;
    if (l->undecided-- > 0) return;
    l->undecided = SP_DECIDE - 1;
    decide(l);
}
