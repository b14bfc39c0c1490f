/* Crawls: samples displacement and floor of an episode, simulates a tick, computes the quantities that `tasks/crawl.py`
 * uses. */
#include "episode.h"
#include "ground.h"

/* ---- goal and floor ---- */

static int is_blocked(const sp_crawl_rules *rules, sp_pose2 way)
{
    for (int k = 0; k < rules->obstacles; k++) {
        const double *block = rules->obstacle[k];
        if (length(way.x - block[0], way.y - block[1]) < block[2] + rules->goal_clearance) return 1;
    }
    return 0;
}

/* Sample a displacement whose end no obstacle covers, in at most `most` attempts; returns whether one was found. */
int32_t sp_draw_way(const sp_crawl_rules *rules, sp_generator *generator, int64_t most, sp_pose2 *drawn_way)
{
    for (int64_t draw = 0; draw < most; draw++) {
        int paper = sp_random(generator) < rules->share;
        double drawn[3] = {sp_uniform(generator, rules->distance[0], rules->distance[1]), 0.0, 0.0};
        drawn[1] = sp_uniform(generator, -SP_PI, SP_PI);
        drawn[2] = sp_uniform(generator, -rules->turn, rules->turn);
        if (paper) drawn[0] = rules->way.x, drawn[1] = drawn[2] = 0.0;
        for (int k = 0; k < 3; k++)
            if (rules->is_given[k]) drawn[k] = rules->given[k];
        /* On an arc the chord points in the given direction. */
        sp_pose2 way = {drawn[0] * cos(drawn[1]), drawn[0] * sin(drawn[1]), drawn[2]};
        *drawn_way = way;
        if (!is_blocked(rules, way)) return 1;
    }
    return 0;
}

/* Write tiles of random heights, or stairs ahead of the robot. */
static void draw_steps(const sp_crawl_rules *rules, sp_generator *generator, double *tiles)
{
    int terrain = rules->terrain;
    if (terrain == SP_TERRAIN_MIXED) terrain = sp_random(generator) < 0.5 ? SP_TERRAIN_STAIRS : SP_TERRAIN_TILES;
    for (int k = 0; k < SP_TILES * SP_TILES; k++) {
        int beyond = k / SP_TILES - SP_STAIR_ROW, stair = beyond < 0 ? 0 : beyond / SP_STAIR_ROWS + 1;
        if (terrain == SP_TERRAIN_TILES) tiles[k] = sp_uniform(generator, 0.0, rules->steps);
        else tiles[k] = (stair < SP_STAIRS ? stair : SP_STAIRS) * rules->steps;
    }
}

/* Write the heights of the tiles: steps, then obstacles. */
static void draw_floor(const sp_crawl_rules *rules, sp_generator *generator, double *tiles)
{
    if (rules->steps > 0.0) draw_steps(rules, generator, tiles);
    for (int b = 0; b < rules->obstacles; b++) {
        const double *block = rules->obstacle[b];
        for (int k = 0; k < SP_TILES * SP_TILES; k++) {
            double x = (k / SP_TILES + 0.5 - SP_TILES / 2) * SP_TILE, y = (k % SP_TILES + 0.5 - SP_TILES / 2) * SP_TILE;
            if (length(x - block[0], y - block[1]) <= block[2]) tiles[k] = rules->obstacle_height;
        }
    }
}

/* Compute how long the displacement takes on flat ground if joints and torso follow the plan exactly [s]. */
static double rehearse(const sp_robot *robot, const sp_crawl *crawl, const double *lies, sp_pose2 way)
{
    sp_crawl gait;
    double position[3] = {0.0, 0.0, robot->peg_depth}, lying[3] = {0.0, 0.0, robot->peg_depth}, R[9], q[SP_JOINTS];
    int ticks = 0;
    memset(&gait, 0, sizeof gait);
    gait.config = crawl->config;
    gait.dt = crawl->dt;
    sp_copy(gait.home_b, crawl->home_b, 3 * SP_LEGS);
    sp_identity(R);
    sp_gait_reset(&gait, lying, R, lies);
    sp_gait_move(robot, &gait, way, 0);
    sp_copy(q, lies, SP_JOINTS);
    while (!sp_gait_done(&gait)) {
        const sp_gait_memory *m = &gait.gait;
        sp_gait_step(robot, &gait, position, R, q, &SP_NO_RESIDUAL, q);
        ticks++;
        if (m->phase != SP_BRACE && m->phase != SP_UP && m->phase != SP_FORWARD && m->phase != SP_DOWN) continue;
        sp_pose2 pose = arc(m->way, m->share);
        double along[3] = {pose.x, pose.y, sp_max(m->height, 0.0)}, yaw = pose.yaw + atan2(m->floor_R[3], m->floor_R[0]);
        sp_apply(m->floor_R, along, position);
        for (int i = 0; i < 3; i++) position[i] += m->floor_w[i];
        sp_identity(R);
        R[0] = R[4] = cos(yaw), R[3] = sin(yaw), R[1] = -R[3];
    }
    return ticks * crawl->dt;
}

/* ---- errors ---- */

static double to_goal(const sp_crawl_rules *rules, const double *error)
{
    return length(error[0], error[1]) + rules->turn_length * fabs(error[2]);
}

/* Update floor contacts, tilt and goal error of a loaded robot. */
static void update_errors(const sp_engine *e, const sp_crawl_rules *rules, const sp_sim *sim, sp_crawl_robot *c)
{
    const double *floor = c->plant.floor_R, *position = c->plant.state.position_w;
    double R[9];
    sp_from_quat(c->plant.state.quat_wb, R);
    sp_touching(e->world, sim, &c->plant, &c->touch);
    double upright = R[2] * floor[2] + R[5] * floor[5] + R[8] * floor[8];
    c->tilt = acos(sp_clip(upright, -1.0, 1.0));
    c->error[0] = c->goal.x - position[0];
    c->error[1] = c->goal.y - position[1];
    c->error[2] = remainder(c->goal.yaw - atan2(R[3], R[0]), SP_TWO_PI);
    c->distance = to_goal(rules, c->error);
}

/* ---- an episode ---- */

static void start_counting(sp_crawl_robot *c)
{
    c->crawled = c->timeouts = c->rested = c->is_done = 0;
    sp_zero(c->swing_ticks, SP_LEGS);
    memset(c->swinging, 0, sizeof c->swinging);
    c->duct_contact = 0;
    c->finished = c->saturation = c->thrust = c->thrust_peak = c->tilt_legs = c->tilt_torso = 0.0;
    sp_zero(c->airborne_ticks, SP_LEGS);
    sp_zero(c->foot_slip, SP_LEGS);
    sp_zero(c->peg_slip, SP_LEGS);
    c->duct_clearance = HUGE_VAL;
}

static int has_tiles(const sp_plant *p) { return p->highest_tile > 0.0; }

/* Compute the torso height at the start: over the highest tile under torso or feet; from there the robot settles. */
static double lying_height(const sp_robot *robot, const sp_crawl_robot *c)
{
    const sp_ground_config *ground = &c->plant.config.ground;
    double below = -HUGE_VAL;
    if (!has_tiles(&c->plant)) return robot->peg_depth;
    for (int leg = 0; leg < SP_LEGS; leg++)
        below = sp_max(below, sp_floor_height(ground, c->crawl.home_b[3 * leg], c->crawl.home_b[3 * leg + 1]));
    for (int sign = -1; sign <= 1; sign++) {
        below = sp_max(below, sp_floor_height(ground, 0.12 * sign, 0.0));
        below = sp_max(below, sp_floor_height(ground, 0.0, 0.12 * sign));
    }
    return robot->peg_depth + below;
}

static void begin(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_crawl_rules *rules = sp_rules_of(e, robot);
    const sp_robot *numbers = thread->room->robot;
    const sp_sim *sim = &thread->sim;
    sp_crawl_robot *c = (sp_crawl_robot *)sp_plant_of(e, robot);
    sp_episode *episode = &c->episode;
    double idle[SP_ROTORS] = {0.0}, level[2 * SP_ROTORS] = {0.0}, quat[4], position_w[3], R[9];
    int draws_floor = rules->steps > 0.0 || rules->obstacles > 0;
    sp_plant_config config = rules->rules.plant;
    e->begun[robot] = 1;
    sp_draw_way(rules, &episode->generator, INT64_MAX, &c->way);
    if (draws_floor) draw_floor(rules, &episode->generator, config.ground.tiles);
    if (rules->rules.strength > 0.0) sp_draw_robot(&rules->rules, &episode->generator, &config, episode);
    if (draws_floor || rules->rules.strength > 0.0) sp_become(e, thread, robot, &config);
    else sp_put_down(e, thread, robot, &config);
    sp_crawl_init(numbers, &c->crawl, &rules->controller);
    double lying[3] = {0.0, 0.0, lying_height(numbers, c)};
    sp_apply(c->plant.floor_R, lying, position_w);
    sp_to_quat(c->plant.floor_R, quat);
    /* A separate generator, so that draws of the weather do not change the next episode. */
    sp_spawn(&episode->generator, &c->plant.generator);
    c->plant.disturbances = episode->disturbances;
    sp_charge(1.0, &c->plant);
    sp_plant_reset(e->world, sim, position_w, quat, rules->lies, level, idle, NULL, NULL, &c->plant);
    if (has_tiles(&c->plant)) {
        sp_command still;
        sp_make_command(idle, level, rules->lies, rules->controller.joint_torque_limit, &still);
        for (int k = 0; k < rules->settle_ticks; k++) sp_plant_step(e->world, sim, &still, &c->plant);
        c->plant.violated = 0;
    }
    episode->ticks = 0;
    episode->failure = -1;
    episode->has_command = episode->truncated = episode->over = 0;
    sp_zero(episode->action, SP_MAX_ENTRIES);
    sp_first_look(numbers, &rules->rules, &c->plant, episode);
    sp_crawl_reset(&c->crawl, &episode->seen);
    c->cycles = sp_gait_move(numbers, &c->crawl, c->way, 0);
    c->nominal_time = c->cycles ? rehearse(numbers, &c->crawl, rules->lies, c->way) : 0.0;
    /* The controller received the displacement from its estimated pose; goal and error use the true pose. */
    sp_from_quat(c->plant.state.quat_wb, R);
    sp_pose2 here = {c->plant.state.position_w[0], c->plant.state.position_w[1], atan2(R[3], R[0])};
    c->goal = then(here, c->way);
    start_counting(c);
    c->phase = c->crawl.gait.phase;
    update_errors(e, rules, sim, c);
    c->initial_distance = sp_max(c->distance, 1e-6);
    sp_leave(sim, &c->plant);
}

/* Compute the command of this tick. */
static void act(const sp_crawl_rules *rules, sp_room *room, sp_crawl_robot *c)
{
    sp_episode *episode = &c->episode;
    sp_crawl_memory *memory = &c->crawl.memory;
    const sp_action_mode *mode = &rules->rules.mode;
    if (mode->is_in_torso_axes) {
        double R_bl[SP_ROTORS][9], target[SP_JOINTS];
        sp_link_attitudes(room->robot, episode->seen.joint_position, R_bl);
        sp_act_in_torso_axes(episode->action, mode->authority, mode->size, mode->trim, R_bl[0], room->robot,
                             memory->vectoring, memory->forces_l, target, &episode->command);
        for (int j = 0; j < SP_JOINTS; j++) target[j] += rules->lies[j];
        sp_command_joints(target, room->robot, rules->controller.joint_speed, memory->joint_position, NULL, &episode->command);
    } else if (mode->is_direct) {
        sp_act_directly(episode->action, room->robot, rules->controller.joint_speed, memory->vectoring,
                        memory->forces_l, memory->joint_position, NULL, &episode->command);
    } else {
        sp_make_residual(episode->action, mode->authority, mode->size, mode->channels, &episode->residual);
        sp_crawl_step(&c->crawl, &episode->seen, &episode->residual, room, &episode->command);
        for (int leg = 0; leg < SP_LEGS; leg++) c->swinging[leg] = c->crawl.gait.phase == SP_SWING;
        c->is_done = sp_gait_done(&c->crawl) && c->crawl.memory.gap == 0.0;
        c->phase = c->crawl.gait.phase;
        c->timeouts = c->crawl.gait.timeouts;
    }
    episode->has_command = 1;
}

/* Whether torso and legs rest at the goal with the thrust off. */
static int rests(const sp_crawl_rules *rules, const sp_robot *robot, const sp_crawl_robot *c)
{
    const sp_robot_state *state = &c->plant.state;
    int lies = 0;
    for (int peg = SP_LEGS; peg < 2 * SP_LEGS; peg++) lies = lies || c->touch.balls[peg];
    for (int j = 0; j < SP_JOINTS; j++)
        if (!(fabs(state->joint_velocity[j]) < rules->rest_joint_speed)) return 0;
    return lies && sp_norm(state->velocity_w) < rules->rest_speed && sp_norm(state->omega_b) < rules->rest_turn &&
           sp_total_thrust(&rules->rules, c->episode.command.thrust) < rules->rest_thrust * robot->weight &&
           length(c->error[0], c->error[1]) <= rules->success_position && fabs(c->error[2]) <= rules->success_yaw;
}

/* Update the episode's statistics after a tick. */
static void advance(const sp_crawl_rules *rules, const sp_robot *robot, sp_crawl_robot *c)
{
    const double dt = 1.0 / SP_CONTROL_RATE;
    c->crawled++;
    for (int leg = 0; leg < SP_LEGS; leg++) {
        c->swing_ticks[leg] += c->swinging[leg];
        c->airborne_ticks[leg] += c->swinging[leg] && !c->touch.balls[leg];
    }
    for (int leg = 0; leg < SP_LEGS; leg++) {
        c->foot_slip[leg] += dt * c->touch.slip[leg];
        c->peg_slip[leg] += dt * c->touch.slip[SP_LEGS + leg];
    }
    c->duct_clearance = sp_min(c->duct_clearance, c->touch.duct_clearance);
    c->duct_contact = c->duct_contact || c->touch.ducts;
    if (c->finished == 0.0) {
        double limit = sp_min(rules->controller.joint_torque_limit, c->plant.config.actuators.max_joint_torque);
        double share = sp_total_thrust(&rules->rules, c->episode.command.thrust) / robot->weight;
        int saturated = 0;
        for (int j = 0; j < SP_JOINTS; j++)
            saturated += fabs(c->plant.state.joint_torque[j]) >= limit - rules->saturated;
        c->saturation += (double)saturated / SP_JOINTS;
        c->thrust += share;
        c->thrust_peak = sp_max(c->thrust_peak, share);
    }
    if (c->phase == SP_SPOOL || c->phase == SP_RAISE || c->phase == SP_SWING || c->phase == SP_LOWER)
        c->tilt_legs = sp_max(c->tilt_legs, c->tilt);
    else if (c->phase != SP_DONE)
        c->tilt_torso = sp_max(c->tilt_torso, c->tilt);
    c->rested = rules->rules.mode.is_direct && rests(rules, robot, c) ? c->rested + 1 : 0;
    int is_done = rules->rules.mode.is_direct ? c->rested / SP_CONTROL_RATE >= rules->rest_time : c->is_done;
    if (is_done && c->finished == 0.0)
        c->finished = c->crawled / SP_CONTROL_RATE;
}

static double largest(const double *x, int n)
{
    double most = x[0];
    for (int k = 1; k < n; k++) most = sp_max(most, x[k]);
    return most;
}

/* Share of its swing in which the worst foot was in the air; 1 before the first swing. */
static double airborne(const sp_crawl_robot *c)
{
    double least = 1.0;
    for (int leg = 0; leg < SP_LEGS; leg++)
        if (c->swing_ticks[leg] > 0.0) least = sp_min(least, c->airborne_ticks[leg] / c->swing_ticks[leg]);
    return least;
}

/* Write the quantities that the task uses for rewards, failures and success. */
static void count(const sp_crawl_rules *rules, const sp_crawl_robot *c, sp_crawl_quantities *q)
{
    sp_count_episode(&rules->rules, &c->plant, &c->episode, c->crawled, &q->common);
    q->distance = c->distance;
    q->initial_distance = c->initial_distance;
    q->position_error = length(c->error[0], c->error[1]);
    q->yaw_error = fabs(c->error[2]);
    q->tilt = c->tilt;
    q->slip = largest(c->touch.slip, 2 * SP_LEGS);
    q->duct_touches = c->touch.ducts != 0;
    q->duct_touched = c->duct_contact != 0;
    q->finished = c->finished;
    q->nominal_time = c->nominal_time;
    q->timeouts = c->timeouts;
    q->airborne = airborne(c);
    q->foot_slip = largest(c->foot_slip, SP_LEGS);
}

static void tell(const sp_world *world, const sp_rules *rules, const sp_crawl_robot *c, sp_crawl_info *info)
{
    const sp_episode *episode = &c->episode;
    const sp_plant *plant = &c->plant;
    double time = c->crawled / SP_CONTROL_RATE;
    double counted = sp_max(1.0, c->finished > 0.0 ? rint(c->finished * SP_CONTROL_RATE) : c->crawled);
    double way = sp_max(c->initial_distance - c->distance, 1e-3);
    sp_tell(rules, plant, episode, episode->has_command ? episode->command.vectoring : plant->state.vectoring,
            c->crawl.ticked ? &c->crawl.allocation : NULL, SP_ON_THE_FLOOR, &info->info);
    sp_copy(info->goal_error, c->error, 3);
    info->phase_code = c->phase;
    info->finished = c->finished > 0.0;
    info->time_s = c->finished > 0.0 ? c->finished : time;
    info->nominal_time_s = c->nominal_time;
    info->airborne_share = airborne(c);
    for (int leg = 0; leg < SP_LEGS; leg++) info->foot_contact[leg] = c->touch.balls[leg] != 0;
    info->foot_slip_m = largest(c->foot_slip, SP_LEGS);
    info->peg_slip_m = largest(c->peg_slip, SP_LEGS);
    info->duct_clearance_m = sp_min(c->touch.duct_clearance, c->duct_clearance);
    info->saturation_share = c->saturation / counted;
    info->thrust_fraction = episode->has_command ? sp_total_thrust(rules, episode->command.thrust) / world->weight : 0.0;
    info->thrust_fraction_mean = c->thrust / counted;
    info->thrust_fraction_peak = c->thrust_peak;
    info->tilt_rad = c->tilt;
    info->timeouts = c->timeouts;
    info->cost_of_transport = 3600.0 * plant->energy_wh / (world->weight * way);
    info->shortfalls_code = 0; /* set by the task */
    info->is_success = 0;
}

static void observe(const sp_crawl_rules *rules, const sp_crawl_robot *c, float *observation)
{
    const sp_episode *episode = &c->episode;
    const double goal[3] = {c->goal.x, c->goal.y, c->goal.yaw};
    if (c->plant.diverged)
        memset(observation, 0, (size_t)rules->rules.size * sizeof *observation);
    else if (!rules->rules.is_commanded) { /* Python writes the observation of a Python controller */
        sp_observe_crawl(&c->crawl, &episode->seen, goal,
                         episode->has_command ? episode->command.thrust : episode->seen.thrust, episode->action,
                         rules->rules.mode.size, rules->rules.mode.has_clock ? c->crawled : -1,
                         rules->rules.bound, observation);
        sp_scale(&rules->rules, observation);
    }
}

static void show(sp_engine *e, int robot)
{
    const sp_crawl_rules *rules = sp_rules_of(e, robot);
    sp_crawl_robot *c = (sp_crawl_robot *)sp_plant_of(e, robot);
    tell(e->world, &rules->rules, c, (sp_crawl_info *)e->infos + robot);
    count(rules, c, (sp_crawl_quantities *)e->quantities + robot);
    observe(rules, c, e->observations + (int64_t)robot * e->observation_size);
}

static void reset_robot(sp_engine *e, sp_thread *thread, int robot)
{
    begin(e, thread, robot);
    show(e, robot);
}

/* Finish a tick after its physics, up to the outputs; the robot is still loaded or has diverged. */
static void conclude(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_crawl_rules *rules = sp_rules_of(e, robot);
    sp_crawl_robot *c = (sp_crawl_robot *)sp_plant_of(e, robot);
    if (c->plant.diverged) return;
    sp_look(thread->room->robot, &rules->rules, &c->plant, &c->episode);
    update_errors(e, rules, &thread->sim, c);
    advance(rules, thread->room->robot, c);
}

/* Simulate a control period; the robot's part of the model is in place. Returns whether the step continues. */
static int move(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_crawl_rules *rules = sp_rules_of(e, robot);
    sp_crawl_robot *c = (sp_crawl_robot *)sp_plant_of(e, robot);
    sp_crawl_quantities now;
    if (rules->rules.is_commanded) c->episode.has_command = 1;
    else act(rules, thread->room, c);
    sp_enter(e->world, &thread->sim, &c->plant);
    sp_plant_step(e->world, &thread->sim, &c->episode.command, &c->plant);
    sp_leave(&thread->sim, &c->plant);
    conclude(e, thread, robot);
    if (c->plant.diverged || rules->rules.hold == 1) return !c->plant.diverged;
    count(rules, c, &now);
    return !sp_stops(&rules->rules, (const double *)&now, sizeof now / sizeof(double));
}

static void step_robot(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_rules *rules = &((const sp_crawl_rules *)sp_rules_of(e, robot))->rules;
    sp_crawl_robot *c = (sp_crawl_robot *)sp_plant_of(e, robot);
    sp_episode *episode = &c->episode;
    if (episode->over && rules->autoreset == SP_RESET_NEXT_STEP) {
        reset_robot(e, thread, robot);
        return;
    }
    e->begun[robot] = 0;
    episode->ticks++;
    c->plant.violated = 0;
    sp_take_action(rules, e->actions + (int64_t)robot * rules->mode.size, episode);
    sp_carry(e, thread, robot);
    for (int k = 0; k < sp_periods(rules); k++)
        if (!move(e, thread, robot)) break;
    show(e, robot);
}

/* Simulate one more control period of a step. */
static void hold_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_carry(e, thread, robot);
    move(e, thread, robot);
    show(e, robot);
}

static void lose_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_plant_of(e, robot)->diverged = 1;
    conclude(e, thread, robot);
    show(e, robot);
}

static void show_robot(sp_engine *e, sp_thread *thread, int robot)
{
    (void)thread;
    show(e, robot);
}

int sp_show_crawl_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, show_robot, NULL); }
int sp_reset_crawl_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, reset_robot, NULL); }
int sp_step_crawl_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, step_robot, NULL); }
int sp_hold_crawl_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, hold_robot, NULL); }
int sp_lose_crawl_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, lose_robot, NULL); }
