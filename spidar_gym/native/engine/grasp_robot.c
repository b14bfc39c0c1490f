/* Grasping: samples the scene of an episode, simulates a step, computes the quantities that `tasks/grasp.py` uses. */
#include "episode.h"
#include "spidar_math.h"

#define OBJECT_TURN 0.5 /* length that a radian of the object's heading counts as in a distance [m] */

/* ---- the scene ---- */

static double between(sp_generator *generator, const double *bounds)
{
    return sp_uniform(generator, bounds[0], bounds[1]);
}

static double between_logs(sp_generator *generator, const double *bounds)
{
    double drawn = sp_uniform(generator, log(bounds[0]), log(bounds[1]));
    return bounds[0] == bounds[1] ? bounds[0] : exp(drawn);
}

static double top_of(const sp_grasp_scene *scene) { return scene->half_size[scene->shape == SP_OBJECT_BALL ? 0 : 2]; }

/* As `needed_force` in Python. */
static double needed_force(const sp_grasp_scene *scene)
{
    double off = (fabs(scene->com[0]) + fabs(scene->com[1])) / scene->half_size[0];
    return scene->mass * SP_GRAVITY * (1.0 + off) / (4.0 * scene->friction);
}

/* Sample a scene that can be held: the least equal force of the feet, with a reserve, is within what object and robot
 * bear. */
void sp_draw_scene(const sp_grasp_rules *rules, sp_generator *generator, sp_grasp_scene *scene)
{
    for (int tries = 0; tries < 1000; tries++) {
        memset(scene, 0, sizeof *scene);
        double share = sp_uniform(generator, 0.0, 1.0);
        while (scene->shape < SP_OBJECT_BALL && share >= rules->shapes[scene->shape]) share -= rules->shapes[scene->shape++];
        double a = between(generator, rules->half_width), h = between(generator, rules->half_height);
        scene->half_size[0] = scene->half_size[1] = a;
        scene->half_size[2] = scene->shape == SP_OBJECT_BALL ? a : h;
        scene->mass = between_logs(generator, rules->mass);
        scene->friction = between(generator, rules->friction);
        scene->most_force = between(generator, rules->most_force);
        for (int i = 0; i < 3; i++)
            scene->com[i] = scene->half_size[i] * sp_uniform(generator, -rules->off_centre, rules->off_centre);
        double far = between(generator, rules->distance), turn = between(generator, rules->turn);
        scene->start = (sp_pose2){far * cos(turn), far * sin(turn), sp_uniform(generator, -SP_PI, SP_PI)};
        far = between(generator, rules->goal_distance);
        turn += between(generator, rules->goal_turn);
        scene->goal.x = scene->start.x + far * cos(turn);
        scene->goal.y = scene->start.y + far * sin(turn);
        scene->goal.yaw = scene->start.yaw + between(generator, rules->goal_yaw);
        scene->stand = between(generator, rules->stand);
        scene->floor = between(generator, rules->floor);
        for (int i = 0; i < 3; i++) scene->bias[i] = sp_uniform(generator, -rules->bias, rules->bias);
        double most = SP_GRASP_SAFE_GRIP - SP_SCENE_LESS_PER_KG * scene->mass;
        if (rules->reserve * needed_force(scene) <= sp_min(scene->most_force, most)) return;
    }
}

/* Stands are along the axes of the world, whatever the heading of the object. */
static double *put_stand(double *row, sp_pose2 at, double half_width, double height)
{
    const double box[7] = {at.x, at.y, 0.5 * height, half_width, half_width, 0.5 * height, 0.0};
    if (!(height > 0.0)) return row;
    sp_copy(row, box, 7);
    return row + 7;
}

/* Blocks around the foot of a ball, which keep it in its place. */
static double *put_chocks(double *row, sp_pose2 at, double radius, double floor)
{
    const double thick = SP_SCENE_CHOCK;
    double far = radius * sin(SP_SCENE_LEAN) + thick, high = radius * (1.0 - cos(SP_SCENE_LEAN));
    for (int k = 0; k < 4; k++) {
        double turn = at.yaw + k * SP_HALF_PI;
        const double box[7] = {at.x + far * cos(turn), at.y + far * sin(turn), floor + 0.5 * high,
                               thick, 0.5 * far, 0.5 * high, 0.0};
        sp_copy(row, box, 7);
        if (k % 2 == 1) row[3] = box[4], row[4] = box[3];
        row += 7;
    }
    return row;
}

/* Write object and stands into a configuration. */
static void build(const sp_grasp_rules *rules, const sp_grasp_scene *scene, sp_plant_config *config)
{
    sp_object_config *o = &config->object;
    o->shape = SP_SHAPE_BOX + scene->shape - SP_OBJECT_BOX;
    sp_copy(o->half_size, scene->half_size, 3);
    sp_copy(o->com, scene->com, 3);
    o->mass = scene->mass;
    o->friction = scene->friction;
    o->inertia = 1.0;
    o->pressure = rules->pressure;
    double *row = config->ground.boxes, a = scene->half_size[0];
    sp_zero(row, 7 * SP_BOXES);
    row = put_stand(row, scene->start, SP_SCENE_STAND_SHARE * a - SP_SCENE_STAND_MARGIN, scene->stand); /* no corner beyond a side */
    row = put_stand(row, scene->goal, a + SP_SCENE_STAND_MARGIN, scene->floor);
    if (scene->shape != SP_OBJECT_BALL) return;
    sp_pose2 start = scene->start, goal = scene->goal;
    start.yaw = goal.yaw = 0.0;
    row = put_chocks(row, start, a, scene->stand);
    put_chocks(row, goal, a, scene->floor);
}

/* ---- progress ---- */

static double heading_of(const double *q)
{
    return atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]));
}

/* Error of the object's heading, up to turns after which it looks the same. */
static double yaw_error(const sp_grasp_scene *scene, const double *quat)
{
    if (scene->shape != SP_OBJECT_BOX) return 0.0;
    return fabs(remainder(scene->goal.yaw - heading_of(quat), SP_HALF_PI));
}

static double tilt_of(const double *quat)
{
    double R[9];
    sp_from_quat(quat, R);
    return acos(sp_clip(R[8], -1.0, 1.0));
}

static double place_error(const sp_grasp_robot *g)
{
    double off[3];
    for (int i = 0; i < 3; i++) off[i] = g->place_w[i] - g->plant.object.position_w[i];
    return sp_norm(off);
}

/* Horizontal distance of each foot from the object's sides, and its distance from the object. */
static void feet_from(const sp_robot *robot, const sp_grasp_robot *g, double *gap, double *clear)
{
    const sp_robot_state *state = &g->plant.state;
    const sp_object_state *o = &g->plant.object;
    const double *half = g->scene.half_size;
    double R[9], R_o[9], feet[3 * SP_LEGS], at[3], own[3], top = top_of(&g->scene);
    sp_from_quat(state->quat_wb, R);
    sp_from_quat(o->quat_wo, R_o);
    sp_feet_at(robot, state->joint_position, feet);
    *gap = 0.0;
    *clear = HUGE_VAL;
    for (int leg = 0; leg < SP_LEGS; leg++) {
        double away, over;
        sp_apply(R, feet + 3 * leg, at);
        for (int i = 0; i < 3; i++) at[i] += state->position_w[i] - o->position_w[i];
        sp_apply_t(R_o, at, own);
        double round = sqrt(own[0] * own[0] + own[1] * own[1]);
        if (g->scene.shape == SP_OBJECT_BALL) {
            away = sp_norm(own) - half[0];
            over = 0.0;
        } else {
            away = g->scene.shape == SP_OBJECT_BOX ? sp_max(fabs(own[0]) - half[0], fabs(own[1]) - half[1]) : round - half[0];
            over = fabs(own[2]) - top;
        }
        *gap += 0.25 * sp_max(0.0, away - robot->foot_radius);
        double apart = over > 0.0 ? sqrt(over * over + sp_max(away, 0.0) * sp_max(away, 0.0)) : away;
        *clear = sp_min(*clear, apart - robot->foot_radius);
    }
}

/* Update the episode's statistics after a control period. */
static void advance(const sp_grasp_rules *rules, sp_grasp_robot *g)
{
    const sp_object_state *o = &g->plant.object;
    double smoothing = 1.0 - exp(-1.0 / (rules->force_time * SP_CONTROL_RATE)), R[9];
    g->controls++;
    sp_from_quat(g->plant.state.quat_wb, R);
    g->tilt = acos(sp_clip(R[8], -1.0, 1.0));
    for (int leg = 0; leg < SP_LEGS; leg++) {
        g->force[leg] += smoothing * (sp_norm(o->foot_force_w + 3 * leg) - g->force[leg]);
        g->most_force = sp_max(g->most_force, g->force[leg]);
    }
    g->most_lifted = sp_max(g->most_lifted, o->position_w[2] - g->stood);
    g->fall = sp_max(g->fall, -o->velocity_w[2]);
    g->hit = g->hit || o->is_hit || (g->plant.violated & (SP_VIOLATED_DUCT | SP_VIOLATED_PART)) != 0;
    g->charge = 1.0 - (g->plant.spent_wh + g->plant.energy_wh) / (SP_USABLE * SP_CAPACITY_WH);
}

/* Write the quantities that the task uses for rewards, failures and success. */
static void count(const sp_grasp_rules *rules, const sp_robot *robot, const sp_grasp_robot *g, sp_grasp_quantities *q)
{
    const sp_object_state *o = &g->plant.object;
    const double *position = g->plant.state.position_w;
    double hold[3];
    sp_count_episode(&rules->rules, &g->plant, &g->episode, g->controls, &q->common);
    feet_from(robot, g, &q->gap, &q->clear);
    for (int i = 0; i < 3; i++) hold[i] = o->position_w[i] - position[i];
    hold[2] += g->manager.grasper.plan.height > 0.0 ? g->manager.grasper.plan.height : -SP_CLAW_HIGHEST;
    q->reach = sp_norm(hold);
    q->touching = 0.0;
    for (int leg = 0; leg < SP_LEGS; leg++) q->touching += g->force[leg] > rules->touch;
    q->lifted = o->position_w[2] - g->stood;
    q->most_lifted = g->most_lifted;
    q->position_error = place_error(g);
    q->yaw_error = yaw_error(&g->scene, o->quat_wo);
    q->way = q->position_error + OBJECT_TURN * q->yaw_error;
    q->initial_way = g->initial_way;
    q->object_tilt = g->scene.shape == SP_OBJECT_BALL ? 0.0 : tilt_of(o->quat_wo);
    q->object_speed = sp_norm(o->velocity_w);
    q->fall = g->fall;
    q->force = 0.0;
    for (int leg = 0; leg < SP_LEGS; leg++) q->force = sp_max(q->force, g->force[leg]);
    q->pressed = g->most_force / g->scene.most_force;
    q->is_hit = g->hit != 0;
    q->tilt = g->tilt;
    q->charge = g->charge;
    q->is_cut = g->phase == SP_MANAGER_CUT;
    q->is_outside = fabs(position[0]) > rules->field || fabs(position[1]) > rules->field || position[2] > rules->ceiling;
    q->is_empty = !(g->charge > 0.0);
}

/* ---- an episode ---- */

/* Observe the object: where it was a tick ago, with error and noise. */
static void look(const sp_grasp_rules *rules, sp_grasp_robot *g)
{
    const sp_object_state *o = &g->plant.object;
    sp_generator *generator = &g->plant.generator;
    double turn[3], R[9], R_n[9];
    for (int i = 0; i < 3; i++)
        g->seen.position_w[i] = o->position_w[i] + g->scene.bias[i] + rules->noise * sp_normal(generator);
    for (int i = 0; i < 3; i++) turn[i] = rules->turn_noise * sp_normal(generator);
    sp_from_quat(o->quat_wo, R);
    sp_exp(turn, R_n);
    sp_product(R, R_n, R);
    sp_to_quat(R, g->seen.quat_wo);
}

static void begin(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_grasp_rules *rules = sp_rules_of(e, robot);
    const sp_robot *numbers = thread->room->robot;
    sp_grasp_robot *g = (sp_grasp_robot *)sp_plant_of(e, robot);
    sp_episode *episode = &g->episode;
    sp_plant_config config = rules->rules.plant;
    double thrust[SP_ROTORS], form[SP_JOINTS], vectoring[2 * SP_ROTORS], quat[4] = {1.0, 0.0, 0.0, 0.0}, object[7];
    double position_w[3] = {0.0, 0.0, rules->begin_height};
    e->begun[robot] = 1;
    if (!g->is_given) sp_draw_scene(rules, &episode->generator, &g->scene);
    build(rules, &g->scene, &config);
    if (rules->rules.strength > 0.0) sp_draw_robot(&rules->rules, &episode->generator, &config, episode);
    sp_become(e, thread, robot, &config);
    sp_manager_init(numbers, &g->manager, &rules->manager);
    /* A separate generator, so that draws of noise and weather do not change the next episode. */
    sp_spawn(&episode->generator, &g->plant.generator);
    g->plant.disturbances = episode->disturbances;
    sp_charge(1.0, &g->plant);
    for (int i = 0; i < SP_ROTORS; i++) thrust[i] = numbers->hover_thrust;
    sp_open_claw(numbers, g->scene.half_size[0], form);
    sp_rest_vectoring(numbers, &rules->manager.flight, form, vectoring);
    g->stood = g->scene.stand + top_of(&g->scene);
    const double at[7] = {g->scene.start.x, g->scene.start.y, g->stood,
                          cos(0.5 * g->scene.start.yaw), 0.0, 0.0, sin(0.5 * g->scene.start.yaw)};
    sp_copy(object, at, 7);
    sp_plant_reset(e->world, &thread->sim, position_w, quat, form, vectoring, thrust, NULL, object, &g->plant);
    sp_leave(&thread->sim, &g->plant);
    episode->ticks = 0;
    episode->failure = -1;
    episode->has_command = episode->truncated = episode->over = 0;
    sp_zero(episode->action, SP_MAX_ENTRIES);
    sp_first_look(numbers, &rules->rules, &g->plant, episode);
    sp_manager_reset(numbers, &g->manager, &episode->seen);
    sp_manager_begin_in_air(numbers, &g->manager, &episode->seen);
    g->phase = g->manager.memory.phase;
    g->grasp_phase = SP_GRASP_NONE;
    memset(&g->rule, 0, sizeof g->rule);
    g->rule.mass = SP_GRASP_RULE_FIRST_MASS;
    g->place_w[0] = g->scene.goal.x;
    g->place_w[1] = g->scene.goal.y;
    g->place_w[2] = g->scene.floor + top_of(&g->scene);
    g->controls = g->hit = 0;
    g->arrived = g->most_force = g->most_lifted = g->fall = g->tilt = 0.0;
    sp_zero(g->force, SP_LEGS);
    g->charge = 1.0;
    g->initial_way = place_error(g) + OBJECT_TURN * yaw_error(&g->scene, g->plant.object.quat_wo);
    look(rules, g);
}

/* Compute the command of this tick. */
static void act(const sp_grasp_rules *rules, sp_room *room, sp_grasp_robot *g)
{
    sp_episode *episode = &g->episode;
    sp_manager *manager = &g->manager;
    sp_flight_memory *memory = &manager->flight.memory;
    const sp_action_mode *mode = &rules->rules.mode;
    const sp_robot_state *seen = &episode->seen;
    const sp_residual *residual = &SP_NO_RESIDUAL;
    sp_waypoint orders[4];
    episode->has_command = 1;
    if (mode->is_in_torso_axes) {
        double R_bl[SP_ROTORS][9], joints[SP_JOINTS], open[SP_JOINTS];
        sp_link_attitudes(room->robot, seen->joint_position, R_bl);
        sp_act_in_torso_axes(episode->action, mode->authority, mode->size, mode->trim, R_bl[0], room->robot,
                             memory->vectoring, memory->forces_l, joints, &episode->command);
        sp_open_claw(room->robot, g->scene.half_size[0], open);
        for (int j = 0; j < SP_JOINTS; j++) joints[j] += open[j];
        sp_command_joints(joints, room->robot, rules->manager.flight.joint_speed, memory->joint_position, NULL, &episode->command);
        return;
    }
    if (mode->is_direct && !rules->is_order) {
        sp_act_directly(episode->action, room->robot, rules->manager.flight.joint_speed, memory->vectoring,
                        memory->forces_l, memory->joint_position, NULL, &episode->command);
        return;
    }
    if (rules->is_order) {
        if (g->controls % rules->decide == 0) {
            sp_grasp_order(&g->scene, 0.0, &orders[0]);
            sp_manager_steer(room->robot, manager, seen, &orders[0], episode->action, rules->decide / SP_CONTROL_RATE);
        }
    } else {
        int idle = manager->memory.phase == SP_MANAGER_HOVER && sp_manager_done(manager);
        if (manager->grasper.memory.held) g->rule.mass = manager->grasper.memory.mass;
        int n = sp_grasp_rule(&g->scene, &g->seen, idle, rules->grip, &g->rule, orders);
        for (int k = 0; k < n; k++) sp_manager_command(manager, &orders[k]);
        sp_make_residual(episode->action, mode->authority, mode->size, mode->channels, &episode->residual);
        residual = &episode->residual;
    }
    sp_manager_step(manager, seen, residual, &g->seen, room, &episode->command);
    g->phase = manager->memory.phase;
    g->grasp_phase = manager->grasper.memory.phase;
}

static int is_there(const sp_grasp_rules *rules, const sp_grasp_quantities *q)
{
    return q->position_error <= rules->placed && q->yaw_error <= rules->turned && q->object_tilt <= rules->upright &&
           q->object_speed <= rules->at_rest && q->clear >= rules->clear_of && q->most_lifted >= rules->high;
}

static void tell(const sp_world *world, const sp_rules *rules, const sp_grasp_robot *g, sp_grasp_info *info)
{
    const sp_episode *episode = &g->episode;
    const sp_plant *plant = &g->plant;
    const sp_manager *m = &g->manager;
    const sp_object_state *o = &plant->object;
    sp_tell(rules, plant, episode, episode->has_command ? episode->command.vectoring : plant->state.vectoring,
            m->flight.ticked ? &m->flight.allocation : NULL, SP_VIOLATED_DUCT | SP_VIOLATED_PART, &info->info);
    for (int i = 0; i < 3; i++) info->object_error[i] = g->place_w[i] - o->position_w[i];
    for (int leg = 0; leg < SP_LEGS; leg++) info->object_force[leg] = sp_norm(o->foot_force_w + 3 * leg);
    sp_copy(info->object_air, o->air_force_w, 3);
    sp_copy(info->object_com, g->scene.com, 3);
    info->object_mass = g->scene.mass;
    info->object_friction = g->scene.friction;
    info->yaw_error_rad = yaw_error(&g->scene, o->quat_wo);
    info->way_m = place_error(g) + OBJECT_TURN * info->yaw_error_rad;
    info->lifted_m = o->position_w[2] - g->stood;
    info->time_s = g->arrived > 0.0 ? g->arrived : g->controls / SP_CONTROL_RATE;
    info->charge = g->charge;
    info->tilt_rad = g->tilt;
    info->thrust_fraction = episode->has_command ? sp_total_thrust(rules, episode->command.thrust) / world->weight : 0.0;
    int holds = g->phase == SP_MANAGER_GRASP;
    info->grip_n = holds ? m->grasper.grip.force : 0.0;
    info->payload_kg = holds ? m->grasper.grip.payload : 0.0;
    info->force_n = 0.0;
    for (int leg = 0; leg < SP_LEGS; leg++) info->force_n = sp_max(info->force_n, g->force[leg]);
    info->most_force_n = g->most_force;
    info->phase_code = g->phase;
    info->grasp_phase_code = g->grasp_phase;
    info->tries = g->rule.tries;
    info->lost = (uint8_t)m->grasper.memory.lost;
    info->refused = (uint8_t)m->grasper.memory.refused;
    info->finished = g->arrived > 0.0;
    info->is_success = 0; /* set by the task */
}

static void observe(const sp_grasp_rules *rules, const sp_robot *robot, const sp_grasp_robot *g, float *observation)
{
    const sp_episode *episode = &g->episode;
    sp_command still;
    if (g->plant.diverged) {
        memset(observation, 0, (size_t)rules->rules.size * sizeof *observation);
        return;
    }
    if (rules->rules.is_commanded) return; /* Python writes the observation of a Python controller */
    sp_make_command(episode->seen.thrust, episode->seen.vectoring, episode->seen.joint_position, 0.0, &still);
    sp_observe_grasp(robot, &g->manager, &g->scene, &g->seen, &episode->seen,
                     episode->has_command ? &episode->command : &still, g->charge,
                     1.0 - (double)episode->ticks / rules->rules.horizon, episode->action, rules->rules.mode.size,
                     rules->rules.bound, observation);
    sp_scale(&rules->rules, observation);
}

static void show(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_grasp_rules *rules = sp_rules_of(e, robot);
    sp_grasp_robot *g = (sp_grasp_robot *)sp_plant_of(e, robot);
    tell(e->world, &rules->rules, g, (sp_grasp_info *)e->infos + robot);
    count(rules, thread->room->robot, g, (sp_grasp_quantities *)e->quantities + robot);
    observe(rules, thread->room->robot, g, e->observations + (int64_t)robot * e->observation_size);
}

static void reset_robot(sp_engine *e, sp_thread *thread, int robot)
{
    begin(e, thread, robot);
    show(e, thread, robot);
}

/* Simulate a control period; the robot's part of the model is in place. Returns whether the step continues. */
static int move(sp_engine *e, const sp_grasp_rules *rules, sp_thread *thread, sp_grasp_robot *g)
{
    sp_grasp_quantities now;
    if (rules->rules.is_commanded) g->episode.has_command = 1;
    else act(rules, thread->room, g);
    look(rules, g); /* capture is a tick late */
    sp_enter(e->world, &thread->sim, &g->plant);
    sp_plant_step(e->world, &thread->sim, &g->episode.command, &g->plant);
    sp_leave(&thread->sim, &g->plant);
    if (g->plant.diverged) return 0;
    sp_look(thread->room->robot, &rules->rules, &g->plant, &g->episode);
    advance(rules, g);
    count(rules, thread->room->robot, g, &now);
    if (!is_there(rules, &now)) g->arrived = 0.0;
    else if (g->arrived == 0.0) g->arrived = g->controls / SP_CONTROL_RATE;
    return !sp_stops(&rules->rules, (const double *)&now, sizeof now / sizeof(double));
}

static void step_robot(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_grasp_rules *rules = sp_rules_of(e, robot);
    sp_grasp_robot *g = (sp_grasp_robot *)sp_plant_of(e, robot);
    sp_episode *episode = &g->episode;
    if (episode->over && rules->rules.autoreset == SP_RESET_NEXT_STEP) {
        reset_robot(e, thread, robot);
        return;
    }
    e->begun[robot] = 0;
    episode->ticks++;
    g->plant.violated = 0;
    sp_take_action(&rules->rules, e->actions + (int64_t)robot * rules->rules.mode.size, episode);
    sp_carry(e, thread, robot);
    for (int k = 0; k < sp_periods(&rules->rules); k++)
        if (!move(e, rules, thread, g)) break;
    show(e, thread, robot);
}

/* Simulate one more control period of a step. */
static void hold_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_carry(e, thread, robot);
    move(e, sp_rules_of(e, robot), thread, (sp_grasp_robot *)sp_plant_of(e, robot));
    show(e, thread, robot);
}

static void lose_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_plant_of(e, robot)->diverged = 1;
    show(e, thread, robot);
}

int sp_show_grasp_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, show, NULL); }
int sp_reset_grasp_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, reset_robot, NULL); }
int sp_step_grasp_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, step_robot, NULL); }
int sp_hold_grasp_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, hold_robot, NULL); }
int sp_lose_grasp_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, lose_robot, NULL); }
