/* Courses: samples and builds the course of an episode, simulates a step, computes the quantities that
 * `tasks/course.py` uses. */
#include "episode.h"

/* ---- the course ---- */

static int pick(const int32_t *kinds, int count, sp_generator *generator, int *which)
{
    *which = (int)sp_integer(generator, 0, count);
    return kinds[*which];
}

static double between(sp_generator *generator, const double *bounds)
{
    return sp_uniform(generator, bounds[0], bounds[1]);
}

/* Draw a course. */
void sp_draw_course(const sp_course_rules *rules, sp_generator *generator, sp_course *course)
{
    double x = 0.0;
    int has_beam = 0, which, count = (int)sp_integer(generator, rules->count[0], rules->count[1] + 1);
    memset(course, 0, sizeof *course);
    for (int k = 0; k < count; k++) {
        sp_gate *gate = &course->gates[course->count++];
        gate->kind = pick(rules->kinds, rules->kind_count, generator, &which);
        if (has_beam && gate->kind == SP_GATE_BEAM) /* two beams would take longer than an episode */
            gate->kind = rules->kinds[(which + 1) % rules->kind_count];
        has_beam = has_beam || gate->kind == SP_GATE_BEAM;
        gate->begin = x + between(generator, k > 0 ? rules->gap : rules->first_gap);
        gate->size = between(generator, rules->size[gate->kind]);
        double side = sp_uniform(generator, -rules->middle, rules->middle);
        x = gate->end = gate->begin + rules->depth[gate->kind];
        if (gate->kind == SP_GATE_SLOT) gate->middle = side;
    }
    int floor = pick(rules->floors, rules->floor_count, generator, &which);
    double begin = x + rules->floor_gap, size = 0.0;
    if (floor != SP_GATE_KINDS) {
        sp_gate *gate = &course->gates[course->count++];
        size = between(generator, rules->size[floor]);
        *gate = (sp_gate){.kind = floor, .begin = begin, .end = begin + rules->floor_length, .size = size};
    }
    course->goal.x = begin + between(generator, rules->goal_way);
    course->goal.y = sp_uniform(generator, -rules->goal_side, rules->goal_side);
    course->goal.yaw = sp_uniform(generator, -rules->goal_yaw, rules->goal_yaw);
    for (int k = 0; floor == SP_GATE_TILES && k < SP_TILE_ROWS * SP_TILE_COLUMNS; k++)
        course->tiles[k] = sp_uniform(generator, 0.0, size);
}

static double *put_box(double *row, const double *box)
{
    sp_copy(row, box, 7);
    return row + 7;
}

/* Append a box of a gate, between two heights and two lateral positions. */
static double *put_part(double *row, const sp_gate *gate, double right, double left, double bottom, double top)
{
    const double box[7] = {0.5 * (gate->begin + gate->end), 0.5 * (right + left), 0.5 * (bottom + top),
                           0.5 * (gate->end - gate->begin), 0.5 * (left - right), 0.5 * (top - bottom), 0.0};
    return put_box(row, box);
}

static double *put_tiles(double *row, const sp_gate *gate, const double *tiles)
{
    const double wide = 2.0 * SP_COURSE_HALF_WIDTH / SP_TILE_COLUMNS, length = SP_COURSE_ROW;
    int rows = (int)rint((gate->end - gate->begin) / length);
    for (int k = 0; k < rows * SP_TILE_COLUMNS; k++) {
        const double box[7] = {gate->begin + length * (k / SP_TILE_COLUMNS + 0.5),
                               wide * (k % SP_TILE_COLUMNS + 0.5) - SP_COURSE_HALF_WIDTH, 0.5 * tiles[k],
                               0.5 * length, 0.5 * wide, 0.5 * tiles[k], 0.0};
        row = put_box(row, box);
    }
    return row;
}

/* Append a slab whose top rises along the course. */
static double *put_slope(double *row, const sp_gate *gate)
{
    const double c = cos(gate->size), s = sin(gate->size), half = 0.5 * (gate->end - gate->begin);
    const double box[7] = {gate->begin + half + SP_COURSE_THICK * s, 0.0, half * s / c - SP_COURSE_THICK * c,
                           half / c, SP_COURSE_HALF_WIDTH, SP_COURSE_THICK, -gate->size};
    return put_box(row, box);
}

/* Build the course from boxes; the last one marks the field's end. */
static void build(const sp_course *course, double *boxes)
{
    const double wide = SP_COURSE_HALF_WIDTH, sill = SP_COURSE_SILL;
    double *row = boxes;
    sp_zero(boxes, 7 * SP_BOXES);
    for (int k = 0; k < course->count; k++) {
        const sp_gate *gate = &course->gates[k];
        switch (gate->kind) {
        case SP_GATE_BEAM: row = put_part(row, gate, -wide, wide, gate->size, SP_COURSE_CEILING); break;
        case SP_GATE_SLOT:
            row = put_part(row, gate, -wide, gate->middle - 0.5 * gate->size, 0.0, SP_COURSE_CEILING);
            row = put_part(row, gate, gate->middle + 0.5 * gate->size, wide, 0.0, SP_COURSE_CEILING);
            break;
        case SP_GATE_TILES: row = put_tiles(row, gate, course->tiles); break;
        case SP_GATE_SLOPE: row = put_slope(row, gate); break;
        default: row = put_part(row, gate, -wide, wide, 0.0, gate->size); break;
        }
    }
    const double end[7] = {sp_course_end(course) + SP_COURSE_BEHIND, 0.0, sill, sill, wide, sill, 0.0};
    put_box(row, end);
}

/* ---- progress ---- */

static double lacking(const sp_plant *p) { return (p->spent_wh + p->energy_wh) / (SP_USABLE * SP_CAPACITY_WH); }

/* Update the goal error, whether the robot lies on the floor, and the remaining charge. */
static void measure(const sp_course_rules *rules, const sp_robot *robot, sp_course_robot *c)
{
    const double *position = c->plant.state.position_w;
    double R[9];
    sp_from_quat(c->plant.state.quat_wb, R);
    c->tilt = acos(sp_clip(R[8], -1.0, 1.0));
    c->error[0] = c->course.goal.x - position[0];
    c->error[1] = c->course.goal.y - position[1];
    c->error[2] = remainder(c->course.goal.yaw - atan2(R[3], R[0]), SP_TWO_PI);
    c->distance = sqrt(c->error[0] * c->error[0] + c->error[1] * c->error[1]) + rules->turn_length * fabs(c->error[2]);
    double height = position[2] - sp_course_floor(&c->course, position[0]) - robot->peg_depth;
    c->lies = height < rules->lies && sp_norm(c->plant.state.velocity_w) < rules->at_rest &&
              sp_total_thrust(&rules->rules, c->plant.state.thrust) < rules->carried * robot->weight;
    c->charge = 1.0 - lacking(&c->plant);
}

static int is_there(const sp_course_rules *rules, const sp_course_robot *c)
{
    double off = sqrt(c->error[0] * c->error[0] + c->error[1] * c->error[1]);
    return c->lies && off <= rules->success_position && fabs(c->error[2]) <= rules->success_yaw;
}

/* Update the episode's statistics after a control period. */
static void advance(const sp_course_rules *rules, sp_course_robot *c)
{
    int32_t phase = c->phase;
    c->controls++;
    c->crawled += phase == SP_MANAGER_CRAWL;
    c->flown += phase != SP_MANAGER_LIE && phase != SP_MANAGER_CRAWL && phase != SP_MANAGER_CUT;
    c->hit = sp_max(c->hit, c->plant.hit);
    c->most_hit = sp_max(c->most_hit, c->plant.hit);
    if (!is_there(rules, c)) c->arrived = 0.0;
    else if (c->arrived == 0.0) c->arrived = c->controls / SP_CONTROL_RATE;
}

/* Write the quantities that the task uses for rewards, failures and success. */
static void count(const sp_course_rules *rules, const sp_course_robot *c, sp_course_quantities *q)
{
    const double *position = c->plant.state.position_w;
    sp_count_episode(&rules->rules, &c->plant, &c->episode, c->controls, &q->common);
    q->distance = c->distance;
    q->initial_distance = c->initial_distance;
    q->position_error = sqrt(c->error[0] * c->error[0] + c->error[1] * c->error[1]);
    q->yaw_error = fabs(c->error[2]);
    q->hit = c->hit;
    q->tilt = c->tilt;
    q->charge = c->charge;
    q->lies = c->lies != 0;
    q->is_cut = c->phase == SP_MANAGER_CUT;
    q->is_outside = !(-SP_COURSE_BEFORE <= position[0] && position[0] <= sp_course_end(&c->course)) ||
                    fabs(position[1]) > SP_COURSE_HALF_WIDTH || position[2] > SP_COURSE_CEILING;
    q->is_empty = !(c->charge > 0.0);
}

/* ---- an episode ---- */

static void begin(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_course_rules *rules = sp_rules_of(e, robot);
    const sp_robot *numbers = thread->room->robot;
    sp_course_robot *c = (sp_course_robot *)sp_plant_of(e, robot);
    sp_episode *episode = &c->episode;
    double idle[SP_ROTORS] = {0.0}, level[2 * SP_ROTORS] = {0.0}, quat[4] = {1.0, 0.0, 0.0, 0.0};
    double position_w[3] = {0.0, 0.0, numbers->peg_depth}, charge = rules->charge[0];
    sp_plant_config config = rules->rules.plant;
    e->begun[robot] = 1;
    if (!c->is_given) sp_draw_course(rules, &episode->generator, &c->course);
    if (rules->charge[0] < rules->charge[1]) charge = between(&episode->generator, rules->charge);
    build(&c->course, config.ground.boxes);
    if (rules->rules.strength > 0.0) sp_draw_robot(&rules->rules, &episode->generator, &config, episode);
    sp_become(e, thread, robot, &config);
    sp_manager_init(numbers, &c->manager, &rules->manager);
    /* A separate generator, so that draws of the weather do not change the next episode. */
    sp_spawn(&episode->generator, &c->plant.generator);
    c->plant.disturbances = episode->disturbances;
    sp_charge(charge, &c->plant);
    sp_plant_reset(e->world, &thread->sim, position_w, quat, c->manager.lying, level, idle, NULL, NULL, &c->plant);
    sp_leave(&thread->sim, &c->plant);
    episode->ticks = 0;
    episode->failure = -1;
    episode->has_command = episode->truncated = episode->over = 0;
    sp_zero(episode->action, SP_MAX_ENTRIES);
    sp_first_look(numbers, &rules->rules, &c->plant, episode);
    sp_manager_reset(numbers, &c->manager, &episode->seen);
    c->phase = c->manager.memory.phase;
    memset(&c->pilot, 0, sizeof c->pilot);
    c->controls = c->flown = c->crawled = 0;
    c->arrived = c->hit = c->most_hit = 0.0;
    measure(rules, numbers, c);
    c->initial_distance = sp_max(c->distance, 1e-6);
}

/* Compute the command of this tick. */
static void act(const sp_course_rules *rules, sp_room *room, sp_course_robot *c)
{
    sp_episode *episode = &c->episode;
    sp_flight_memory *memory = &c->manager.flight.memory;
    const sp_action_mode *mode = &rules->rules.mode;
    const sp_robot_state *seen = &episode->seen;
    const sp_residual *residual = &SP_NO_RESIDUAL;
    sp_target target;
    if (mode->is_in_torso_axes) {
        double R_bl[SP_ROTORS][9], joints[SP_JOINTS];
        sp_link_attitudes(room->robot, seen->joint_position, R_bl);
        sp_act_in_torso_axes(episode->action, mode->authority, mode->size, mode->trim, R_bl[0], room->robot,
                             memory->vectoring, memory->forces_l, joints, &episode->command);
        for (int j = 0; j < SP_JOINTS; j++) joints[j] += c->manager.lying[j];
        sp_command_joints(joints, room->robot, rules->manager.flight.joint_speed, memory->joint_position, NULL, &episode->command);
        episode->has_command = 1;
        return;
    }
    if (mode->is_direct && !rules->is_waypoint) {
        sp_act_directly(episode->action, room->robot, rules->manager.flight.joint_speed, memory->vectoring,
                        memory->forces_l, memory->joint_position, NULL, &episode->command);
        episode->has_command = 1;
        return;
    }
    if (c->controls % rules->decide == 0) {
        if (rules->is_waypoint) sp_take_target(episode->action, &c->course, seen->position_w, &target);
        else target = sp_course_rule(&c->course, seen->position_w, seen->joint_position, c->manager.memory.phase, 1, 1);
        sp_pilot_follow(&target, seen, &c->course, &c->manager, &c->pilot);
    }
    if (!rules->is_waypoint) {
        sp_make_residual(episode->action, mode->authority, mode->size, mode->channels, &episode->residual);
        residual = &episode->residual;
    }
    sp_manager_step(&c->manager, seen, residual, NULL, room, &episode->command);
    c->phase = c->manager.memory.phase;
    episode->has_command = 1;
}

static void tell(const sp_world *world, const sp_rules *rules, const sp_course_robot *c, sp_course_info *info)
{
    const sp_episode *episode = &c->episode;
    const sp_plant *plant = &c->plant;
    const sp_manager *m = &c->manager;
    int crawls = c->phase == SP_MANAGER_LIE || c->phase == SP_MANAGER_CRAWL;
    const sp_allocation *allocation = crawls ? &m->crawl.allocation : &m->flight.allocation;
    sp_tell(rules, plant, episode, episode->has_command ? episode->command.vectoring : plant->state.vectoring,
            (crawls ? m->crawl.ticked : m->flight.ticked) ? allocation : NULL, SP_ON_THE_FLOOR, &info->info);
    sp_copy(info->goal_error, c->error, 3);
    info->distance_m = c->distance;
    info->time_s = c->arrived > 0.0 ? c->arrived : c->controls / SP_CONTROL_RATE;
    info->flown_s = c->flown / SP_CONTROL_RATE;
    info->crawled_s = c->crawled / SP_CONTROL_RATE;
    info->charge = c->charge;
    info->hit_n = c->hit;
    info->most_hit_n = c->most_hit;
    info->tilt_rad = c->tilt;
    info->thrust_fraction = episode->has_command ? sp_total_thrust(rules, episode->command.thrust) / world->weight : 0.0;
    info->phase_code = c->phase;
    info->gate = 0;
    for (int k = 0; k < c->course.count; k++) info->gate += plant->state.position_w[0] > c->course.gates[k].end;
    info->lies = (uint8_t)c->lies;
    info->finished = c->arrived > 0.0;
    info->is_success = 0; /* set by the task */
}

static void observe(const sp_course_rules *rules, const sp_robot *robot, const sp_course_robot *c, float *observation)
{
    const sp_episode *episode = &c->episode;
    const sp_robot_state *seen = &episode->seen;
    sp_command still;
    if (c->plant.diverged) {
        memset(observation, 0, (size_t)rules->rules.size * sizeof *observation);
        return;
    }
    if (rules->rules.is_commanded) return; /* Python writes the observation of a Python controller */
    sp_make_command(seen->thrust, seen->vectoring, seen->joint_position, 0.0, &still);
    sp_observe_course(robot, &c->manager, &c->pilot, &c->course, seen, episode->has_command ? &episode->command : &still,
                      c->charge, 1.0 - (double)episode->ticks / rules->rules.horizon, episode->action,
                      rules->rules.mode.size, rules->rules.bound, observation);
    sp_scale(&rules->rules, observation);
}

static void show(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_course_rules *rules = sp_rules_of(e, robot);
    sp_course_robot *c = (sp_course_robot *)sp_plant_of(e, robot);
    tell(e->world, &rules->rules, c, (sp_course_info *)e->infos + robot);
    count(rules, c, (sp_course_quantities *)e->quantities + robot);
    observe(rules, thread->room->robot, c, e->observations + (int64_t)robot * e->observation_size);
}

static void reset_robot(sp_engine *e, sp_thread *thread, int robot)
{
    begin(e, thread, robot);
    show(e, thread, robot);
}

/* Simulate a control period; the robot's part of the model is in place. Returns whether the step continues. */
static int move(sp_engine *e, const sp_course_rules *rules, sp_thread *thread, sp_course_robot *c)
{
    sp_course_quantities now;
    if (rules->rules.is_commanded) c->episode.has_command = 1;
    else act(rules, thread->room, c);
    sp_enter(e->world, &thread->sim, &c->plant);
    sp_plant_step(e->world, &thread->sim, &c->episode.command, &c->plant);
    sp_leave(&thread->sim, &c->plant);
    if (c->plant.diverged) return 0;
    sp_look(thread->room->robot, &rules->rules, &c->plant, &c->episode);
    measure(rules, thread->room->robot, c);
    advance(rules, c);
    count(rules, c, &now);
    return !sp_stops(&rules->rules, (const double *)&now, sizeof now / sizeof(double));
}

static void step_robot(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_course_rules *rules = sp_rules_of(e, robot);
    sp_course_robot *c = (sp_course_robot *)sp_plant_of(e, robot);
    sp_episode *episode = &c->episode;
    if (episode->over && rules->rules.autoreset == SP_RESET_NEXT_STEP) {
        reset_robot(e, thread, robot);
        return;
    }
    e->begun[robot] = 0;
    episode->ticks++;
    c->hit = 0.0;
    c->plant.violated = 0;
    sp_take_action(&rules->rules, e->actions + (int64_t)robot * rules->rules.mode.size, episode);
    sp_carry(e, thread, robot);
    for (int k = 0; k < sp_periods(&rules->rules); k++)
        if (!move(e, rules, thread, c)) break;
    show(e, thread, robot);
}

/* Simulate one more control period of a step. */
static void hold_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_carry(e, thread, robot);
    move(e, sp_rules_of(e, robot), thread, (sp_course_robot *)sp_plant_of(e, robot));
    show(e, thread, robot);
}

static void lose_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_plant_of(e, robot)->diverged = 1;
    show(e, thread, robot);
}

int sp_show_course_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, show, NULL); }
int sp_reset_course_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, reset_robot, NULL); }
int sp_step_course_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, step_robot, NULL); }
int sp_hold_course_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, hold_robot, NULL); }
int sp_lose_course_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, lose_robot, NULL); }
