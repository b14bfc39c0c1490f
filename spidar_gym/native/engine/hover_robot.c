/* Flights: samples the schedule of an episode, simulates a tick, computes the quantities that `tasks/hover.py` uses. */
#include "episode.h"

static double time_of(const sp_hover_robot *h) { return h->flown / SP_CONTROL_RATE; }

/* ---- forms ---- */

/* Draw a form. */
static void sample_form(const sp_hover_rules *rules, int32_t forms, sp_generator *generator, double *q)
{
    if (forms == SP_FORMS_MIXED) {
        double kind = sp_random(generator);
        if (kind < rules->mixture[0]) {
            sp_copy(q, rules->form[sp_integer(generator, 1, 4) - 1], SP_JOINTS);
            return;
        }
        forms = kind < rules->mixture[1] ? SP_FORMS_EQUAL : SP_FORMS_INDEPENDENT;
    }
    int which = forms - SP_FORMS_EQUAL, legs = rules->drawn_legs[which];
    for (int j = 0; j < 4 * legs; j++)
        q[j] = sp_uniform(generator, rules->range[which][0][j % 4], rules->range[which][1][j % 4]);
    for (int j = 4 * legs; j < SP_JOINTS; j++) q[j] = q[j % (4 * legs)];
}

/* Set the start of a goal, the first tick from `start` on, and its deadline; its joint target is already set. */
static void append_goal(const sp_hover_rules *rules, sp_goal *goals, int k, double start)
{
    double travel = 0.0;
    for (int j = 0; k > 0 && j < SP_JOINTS; j++)
        travel = sp_max(travel, fabs(goals[k].joint_target[j] - goals[k - 1].joint_target[j]));
    goals[k].start = k > 0 ? ceil(start * SP_CONTROL_RATE - 1e-9) / SP_CONTROL_RATE : 0.0;
    goals[k].deadline = goals[k].start + travel / rules->joint_speed;
}

/* Write the episode's forms in order, the first due at time 0; returns their number. */
static int draw_goals(const sp_hover_rules *rules, int32_t forms, sp_generator *generator, sp_goal *goals, int64_t room)
{
    int paper = forms == SP_FORMS_PAPER, held = forms > SP_FORMS_PAPER && forms < SP_FORMS_EQUAL, n = 1;
    if (paper || held) sp_copy(goals[0].joint_target, rules->form[paper ? 0 : forms - 1], SP_JOINTS);
    else sample_form(rules, forms, generator, goals[0].joint_target);
    append_goal(rules, goals, 0, 0.0);
    if (held) return 1;
    for (; n < room; n++) {
        double start = paper ? (n == 1 ? rules->paper_pause : goals[n - 1].deadline)
                             : goals[n - 1].deadline + sp_uniform(generator, rules->pause[0], rules->pause[1]);
        if (paper ? n == SP_FORMS_EQUAL - 1 : !(start < rules->horizon_s)) break;
        if (paper) sp_copy(goals[n].joint_target, rules->form[n], SP_JOINTS);
        else sample_form(rules, forms, generator, goals[n].joint_target);
        append_goal(rules, goals, n, start);
    }
    return n;
}

/* ---- the path ---- */

/* Sample a point at an angle around `middle`; returns the angle of the next point. */
static double draw_point(sp_generator *generator, const double *middle, double angle, const double *radius,
                         const double *turn, double sign, double climb, double *point)
{
    double r = sp_uniform(generator, radius[0], radius[1]);
    point[0] = middle[0] + r * cos(angle);
    point[1] = middle[1] + r * sin(angle);
    point[2] = middle[2] + sp_uniform(generator, 0.0, climb);
    return angle + sign * sp_uniform(generator, turn[0], turn[1]);
}

/* Sample the episode's path; returns its number of knots. */
static int draw_path(const sp_hover_rules *rules, sp_generator *generator, sp_knot *knots, int64_t room)
{
    int32_t kind = rules->path, heading = rules->heading;
    const double *origin = rules->position_w;
    if (kind == SP_PATHS_MIXED) {
        double which = sp_random(generator);
        kind = which < rules->path_mixture[0] ? SP_PATHS_LEGS : which < rules->path_mixture[1] ? SP_PATHS_LEMNISCATE
                                                                                              : SP_PATHS_SPLINE;
    }
    double speed = rules->speed[0] < rules->speed[1] ? sp_uniform(generator, rules->speed[0], rules->speed[1])
                                                     : rules->speed[0];
    if (heading == SP_HEADING_MIXED) heading = sp_random(generator) < 0.5 ? SP_HEADING_ALONG : SP_HEADING_KEPT;
    int along = heading == SP_HEADING_ALONG;
    double way = sp_uniform(generator, -SP_PI, SP_PI), point[3];
    if (kind == SP_PATHS_LEMNISCATE)
        return sp_path_lemniscate(rules->half_width, speed, rules->horizon_s + 2.0 * speed / SP_PATH_EASE, origin, way,
                                  along, rules->path_begin, knots, (int)room);
    if (kind == SP_PATHS_LEGS) {
        sp_legs legs;
        sp_begin_legs(origin, speed, along, along ? way : 0.0, rules->path_begin, knots, (int)room, &legs);
        while (legs.seconds < rules->horizon_s) {
            way = draw_point(generator, origin, way, rules->corner_radius, rules->corner_turn, 1.0, rules->climb, point);
            sp_leg_to(point, knots, (int)room, &legs);
        }
        return legs.count;
    }
    double sign = sp_random(generator) < 0.5 ? 1.0 : -1.0, away = way + sign * SP_HALF_PI;
    double radius = sp_uniform(generator, rules->bend_radius[0], rules->bend_radius[1]), seconds = rules->path_begin;
    double middle[3] = {origin[0] + radius * cos(away), origin[1] + radius * sin(away), origin[2]};
    int n = 1;
    sp_copy(knots[0].pose_w, origin, 3);
    way = way - sign * SP_HALF_PI + sign * sp_uniform(generator, rules->bend_turn[0], rules->bend_turn[1]);
    for (; (seconds < rules->horizon_s || n < 3) && n < room; n++) {
        double step[3];
        way = draw_point(generator, middle, way, rules->bend_radius, rules->bend_turn, sign, rules->climb,
                         knots[n].pose_w);
        for (int i = 0; i < 3; i++) step[i] = knots[n].pose_w[i] - knots[n - 1].pose_w[i];
        seconds += sp_norm(step) / speed;
    }
    sp_path_spline(knots, n, speed, along, 0.0, rules->path_begin);
    return n;
}

/* Compute the joint angles of the schedule now, linear from form to form. */
static void plan(const sp_hover_robot *h, const sp_goal *goals, double *q)
{
    const sp_goal *goal = &goals[h->current];
    sp_copy(q, goal->joint_target, SP_JOINTS);
    if (h->current == 0 || time_of(h) >= goal->deadline || goal->deadline <= goal->start) return;
    const double *from = goals[h->current - 1].joint_target;
    double share = (time_of(h) - goal->start) / (goal->deadline - goal->start);
    for (int j = 0; j < SP_JOINTS; j++) q[j] = from[j] + share * (goal->joint_target[j] - from[j]);
}

/* ---- reference, errors and trim ---- */

/* Write the reference of this tick. */
static void refer(const sp_hover_rules *rules, const sp_goal *goals, const sp_knot *knots, sp_hover_robot *h)
{
    const sp_disturbances *fault = &h->episode.disturbances;
    sp_reference *r = &h->reference;
    double time = time_of(h);
    int restricts = rules->avoids;
    for (int k = 0; k < rules->windows; k++)
        if (rules->window[k][0] <= time && time < rules->window[k][1]) restricts = 0;
    memset(r, 0, sizeof *r);
    sp_copy(r->position_w, rules->position_w, 3);
    r->quat_wb[0] = 1.0;
    if (h->knots) sp_follow_path(knots, h->knots, time, r);
    sp_copy(r->joint_target, goals[h->current].joint_target, SP_JOINTS);
    r->mode = restricts ? SP_REFERENCE_MODE_FLIGHT : SP_REFERENCE_MODE_FLIGHT_UNRESTRICTED;
    if (fault->lost_rotor && time >= fault->fault_time - 1e-9) {
        int thrust = fault->fault == SP_DISTURBANCES_FAULT_THRUST;
        (thrust ? r->lost_thrust : r->lost_vectoring)[fault->lost_rotor - 1] = 1;
    }
}

/* Compute the control states of the observed and of the true state, and the errors. Position errors are those of the
 * described robot's CoG at the true state, since the CoG of a real robot is unknown. */
static void update_errors(const sp_robot *robot, sp_hover_robot *h)
{
    double level[9], desired[9];
    const double *quat = h->reference.quat_wb;
    sp_compute_state(robot, &h->episode.seen, &h->reference, &h->percept);
    if (h->plant.senses) sp_compute_state(robot, &h->plant.state, &h->reference, &h->truth);
    else h->truth = h->percept;
    sp_copy(h->position_error, h->truth.error.position_w, 3);
    for (int i = 0; i < 9; i++) level[i] = h->truth.R_wb[3 * (i % 3) + i / 3]; /* where the reference is level */
    if (quat[1] != 0.0 || quat[2] != 0.0 || quat[3] != 0.0) {
        sp_from_quat(quat, desired);
        sp_product_t(h->truth.R_wb, desired, level);
    }
    sp_log(level, h->attitude_error);
}

/* Compute the wrench in {CoG} that the simulated robot needs at rest beyond that of its description. */
static void compute_trim(const sp_robot *robot, const sp_sim *sim, const sp_hover_robot *h, double *trim)
{
    sp_control_state control;
    double hover[SP_ROTORS], forces[SP_FORCES], Q[6 * SP_FORCES], net_w[3], force_b[3], swing[3];
    sp_compute_state(robot, &h->plant.state, &h->reference, &control);
    for (int i = 0; i < SP_ROTORS; i++) hover[i] = robot->hover_thrust;
    sp_vectoring_to_force(hover, h->plant.state.vectoring, forces);
    sp_zero(Q, 6 * SP_FORCES);
    sp_thrust_map(&control.snapshot, Q, SP_FORCES);
    for (int i = 0; i < 3; i++) net_w[i] = sim->qfrc_actuator[i] - sim->qfrc_bias[i];
    sp_apply_t(control.R_wb, net_w, force_b);
    sp_cross(control.snapshot.com_b, force_b, swing);
    for (int i = 0; i < 3; i++) {
        trim[i] = sp_row(Q + SP_FORCES * i, forces, SP_FORCES) - robot->weight * control.R_wb[6 + i] - force_b[i];
        trim[3 + i] = sp_row(Q + SP_FORCES * (3 + i), forces, SP_FORCES) -
                      (sim->qfrc_actuator[3 + i] - sim->qfrc_bias[3 + i] - swing[i]);
    }
}

/* ---- an episode ---- */

/* Draw forms, offset and path of an episode. */
void sp_draw_flight(const sp_hover_rules *rules, int32_t forms, sp_generator *generator, sp_goal *goals,
                    int64_t goal_room, sp_knot *knots, int64_t knot_room, sp_flight_start *start)
{
    memset(start, 0, sizeof *start);
    start->goals = draw_goals(rules, forms, generator, goals, goal_room);
    for (int i = 0; i < 6; i++) {
        double unit = sp_uniform(generator, -1.0, 1.0) * rules->perturbation;
        if (i < 3) start->position[i] = rules->offset[0] * unit;
        else start->rotation[i - 3] = rules->offset[1] * unit;
    }
    if (rules->path != SP_PATHS_NONE) start->knots = draw_path(rules, generator, knots, knot_room);
}

static sp_goal *goals_of(const sp_engine *e, int robot) { return e->goals + robot * e->goal_room; }
static sp_knot *knots_of(const sp_engine *e, int robot) { return e->knots + robot * e->knot_room; }

/* Place the robot at the start of its episode: in the first form, at the first knot if there is a path. */
static void place(const sp_engine *e, const sp_hover_rules *rules, sp_thread *thread, const double *q,
                  const sp_knot *first, sp_hover_robot *h)
{
    const sp_robot *numbers = thread->room->robot;
    double R[9], quat[4], position_w[3], vectoring[2 * SP_ROTORS], thrust[SP_ROTORS], turning[3], motion[6];
    sp_snapshot snapshot;
    sp_exp(h->rotation, R);
    if (first && first->pose_w[3] != 0.0) { /* start with the heading of the path */
        double turn[3] = {0.0, 0.0, first->pose_w[3]}, heading[9], offset[9];
        sp_copy(offset, R, 9);
        sp_exp(turn, heading);
        sp_product(heading, offset, R);
    }
    sp_to_quat(R, quat);
    sp_rest_vectoring(numbers, &rules->controller, q, vectoring);
    sp_snapshot_at(numbers, q, R, vectoring, &snapshot);
    sp_apply(R, snapshot.com_b, position_w);
    const double *place = first ? first->pose_w : rules->position_w;
    for (int i = 0; i < 3; i++) position_w[i] = place[i] + h->offset[i] - position_w[i];
    /* `velocity` is the CoG's, and legs and rotors are at rest. So the torso's origin moves at v − ω × CoG. */
    sp_cross(h->omega, snapshot.com_b, turning);
    sp_apply(R, turning, motion);
    for (int i = 0; i < 3; i++) motion[i] = h->velocity[i] - motion[i], motion[3 + i] = h->omega[i];
    for (int i = 0; i < SP_ROTORS; i++) thrust[i] = numbers->hover_thrust;
    sp_plant_reset(e->world, &thread->sim, position_w, quat, q, vectoring, thrust, motion, NULL, &h->plant);
    sp_leave(&thread->sim, &h->plant);
}

static void begin(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_hover_rules *rules = sp_rules_of(e, robot);
    const sp_robot *numbers = thread->room->robot;
    sp_hover_robot *h = (sp_hover_robot *)sp_plant_of(e, robot);
    sp_episode *episode = &h->episode;
    sp_goal *goals = goals_of(e, robot);
    sp_knot *knots = knots_of(e, robot);
    const double *q = goals[0].joint_target;
    sp_plant_config config;
    e->begun[robot] = 1;
    if (!h->is_given) {
        sp_flight_start start;
        sp_draw_flight(rules, h->forms, &episode->generator, goals, e->goal_room, knots, e->knot_room, &start);
        h->goals = start.goals;
        h->knots = start.knots;
        sp_copy(h->offset, start.position, 3);
        sp_copy(h->rotation, start.rotation, 3);
        sp_zero(h->velocity, 3);
        sp_zero(h->omega, 3);
    }
    for (int k = 0; k < h->goals; k++) goals[k].reached = 0;
    h->current = h->flown = 0;
    h->position_sum = h->attitude_sum = 0.0;
    if (rules->rules.strength > 0.0) {
        config = rules->rules.plant;
        sp_draw_robot(&rules->rules, &episode->generator, &config, episode);
        sp_become(e, thread, robot, &config);
    } else {
        sp_put_down(e, thread, robot, &rules->rules.plant);
    }
    /* A separate generator, so that draws of the weather do not change the next episode. */
    sp_spawn(&episode->generator, &h->plant.generator);
    h->plant.disturbances = episode->disturbances;
    sp_charge(1.0, &h->plant);
    if (!rules->rules.is_commanded) place(e, rules, thread, q, h->knots ? knots : NULL, h);
    episode->ticks = 0;
    episode->failure = -1;
    episode->has_command = episode->truncated = episode->over = 0;
    sp_zero(episode->action, SP_MAX_ENTRIES);
    sp_first_look(numbers, &rules->rules, &h->plant, episode);
    refer(rules, goals, knots, h);
    /* Where the robot differs from its description, the integrals start at the steady state of a hover. */
    int is_given = h->is_given && h->has_trim, trims = is_given || !rules->rules.is_described;
    sp_flight_init(&h->flight, &rules->controller);
    sp_zero(h->leg_momentum, 3);
    sp_zero(h->leg_momentum_rate, 3);
    sp_zero(h->joint_velocity, SP_JOINTS);
    if (rules->rules.is_commanded) return; /* Python resets its controller and places the robot */
    if (trims && !is_given) compute_trim(numbers, &thread->sim, h, h->trim);
    sp_flight_reset(numbers, &h->flight, &episode->seen, q, trims ? h->trim : NULL);
    update_errors(numbers, h);
}

/* Compute what the controller would command. Its integrals and observer advance as in flight, but the stored last
 * command stays the one that is executed. */
static void advise(sp_room *room, sp_hover_robot *h)
{
    sp_flight_memory *memory = &h->flight.memory, before = *memory;
    sp_residual none = {0};
    none.joint_speed_scale = 1.0;
    sp_flight_step(&h->flight, &h->episode.seen, &h->reference, &none, &h->percept, NULL, room, &h->advice);
    if (h->is_led) return;
    sp_copy(memory->vectoring, before.vectoring, 2 * SP_ROTORS);
    sp_copy(memory->forces_l, before.forces_l, SP_FORCES);
    sp_copy(memory->joint_position, before.joint_position, SP_JOINTS);
}

/* Replace the allocated wrench of the advice by that of the executed command, for the observer. */
static void account(sp_hover_robot *h)
{
    const sp_snapshot *s = &h->percept.snapshot;
    double Q[6 * SP_FORCES], change[SP_FORCES];
    sp_vectoring_to_force(h->advice.thrust, h->advice.vectoring, change);
    for (int k = 0; k < SP_FORCES; k++) change[k] = h->flight.memory.forces_l[k] - change[k];
    sp_thrust_map(s, Q, SP_FORCES);
    for (int r = 0; r < 6; r++) h->flight.allocation.wrench[r] += sp_row(Q + SP_FORCES * r, change, SP_FORCES);
}

/* Compute the command of this tick. */
static void act(const sp_hover_rules *rules, sp_room *room, sp_hover_robot *h)
{
    sp_episode *episode = &h->episode;
    sp_flight_memory *memory = &h->flight.memory;
    const sp_action_mode *mode = &rules->rules.mode;
    if (mode->is_direct && rules->rules.is_advised) advise(room, h);
    if (mode->is_direct && rules->rules.is_advised && h->is_led) {
        episode->command = h->advice;
        sp_direct_action(&h->advice, room->robot, episode->action);
        sp_copy(h->joint_velocity, h->flight.joint_velocity, SP_JOINTS);
    } else if (mode->is_in_torso_axes) {
        double target[SP_JOINTS], joints[SP_JOINTS];
        sp_act_in_torso_axes(episode->action, mode->authority, mode->size, mode->trim, h->percept.snapshot.R_bl[0],
                             room->robot, memory->vectoring, memory->forces_l, target, &episode->command);
        for (int j = 0; j < SP_JOINTS; j++) target[j] += h->reference.joint_target[j];
        sp_plan_joints(room->robot, &h->flight, target, 1.0, joints, h->joint_velocity);
        sp_copy(memory->joint_position, joints, SP_JOINTS);
        sp_copy(memory->joint_velocity, h->joint_velocity, SP_JOINTS);
        sp_copy(episode->command.joint_position, joints, SP_JOINTS);
        for (int j = 0; j < SP_JOINTS; j++) episode->command.joint_torque_limit[j] = room->robot->max_joint_torque;
    } else if (mode->is_direct) {
        sp_act_directly(episode->action, room->robot, rules->controller.joint_speed, memory->vectoring,
                        memory->forces_l, memory->joint_position, h->joint_velocity, &episode->command);
        sp_copy(memory->joint_velocity, h->joint_velocity, SP_JOINTS);
        if (rules->rules.is_advised) account(h);
    } else {
        sp_make_residual(episode->action, mode->authority, mode->size, mode->channels, &episode->residual);
        sp_flight_step(&h->flight, &episode->seen, &h->reference, &episode->residual, &h->percept, NULL, room,
                       &episode->command);
        sp_copy(h->joint_velocity, h->flight.joint_velocity, SP_JOINTS);
    }
    episode->has_command = 1;
}

static double farthest(const double *a, const double *b, int n)
{
    double far = 0.0;
    for (int j = 0; j < n; j++) far = sp_max(far, fabs(a[j] - b[j]));
    return far;
}

/* Advance the schedule: mark the forms that were reached in time, switch to the form that is due. */
static void follow_schedule(const sp_hover_rules *rules, sp_goal *goals, sp_hover_robot *h)
{
    double time = time_of(h);
    for (int i = h->current > 0 ? h->current - 1 : 0; i <= h->current; i++) {
        sp_goal *goal = &goals[i];
        int in_time = goal->deadline <= time + 1e-9 && time + 1e-9 <= goal->deadline + rules->arrival_grace;
        if (in_time && farthest(h->plant.state.joint_position, goal->joint_target, SP_JOINTS) <= rules->arrival_tolerance)
            goal->reached = 1;
    }
    if (h->current + 1 < h->goals && time >= goals[h->current + 1].start - 1e-9) h->current++;
}

/* Update the control states and errors; a Python controller has already written its errors. */
static void look_at(const sp_hover_rules *rules, const sp_robot *robot, sp_hover_robot *h)
{
    if (!rules->rules.is_commanded) {
        update_errors(robot, h);
        return;
    }
    sp_compute_state(robot, &h->plant.state, &h->reference, &h->truth);
    h->percept = h->truth;
}

/* Update errors, sums of their squares and momentum of the legs after a tick. */
static void take_note(const sp_hover_rules *rules, const sp_robot *robot, sp_hover_robot *h)
{
    double before[3];
    look_at(rules, robot, h);
    sp_copy(before, h->leg_momentum, 3);
    sp_leg_momentum(&h->percept.snapshot, h->joint_velocity, h->leg_momentum);
    for (int i = 0; i < 3; i++) h->leg_momentum_rate[i] = (h->leg_momentum[i] - before[i]) * SP_CONTROL_RATE;
    h->position_sum += sp_dot(h->position_error, h->position_error);
    h->attitude_sum += sp_dot(h->attitude_error, h->attitude_error);
}

/* Count the forms that were due by now and not reached in time. */
static int overdue(const sp_hover_rules *rules, const sp_goal *goals, const sp_hover_robot *h)
{
    int count = 0;
    for (int i = 1; i < h->goals; i++)
        count += goals[i].deadline + rules->arrival_grace <= time_of(h) && !goals[i].reached;
    return count;
}

/* Write the quantities that the task uses for rewards, failures and success. */
static void count(const sp_hover_rules *rules, const sp_goal *goals, const sp_hover_robot *h, sp_hover_quantities *q)
{
    double joints[SP_JOINTS], ticks = sp_max(1.0, h->flown);
    plan(h, goals, joints);
    sp_count_episode(&rules->rules, &h->plant, &h->episode, h->flown, &q->common);
    q->distance = sp_norm(h->position_error);
    q->angle = sp_norm(h->attitude_error);
    q->joint_error = farthest(joints, h->plant.state.joint_position, SP_JOINTS);
    q->tilt = acos(sp_clip(h->truth.R_wb[8], -1.0, 1.0));
    q->position_rms = sqrt(h->position_sum / ticks);
    q->attitude_rms = sqrt(h->attitude_sum / ticks);
    q->overdue = overdue(rules, goals, h);
}

static void tell(const sp_rules *rules, sp_hover_robot *h, sp_hover_info *info)
{
    const sp_flight *flight = &h->flight;
    sp_tell(rules, &h->plant, &h->episode, flight->memory.vectoring, flight->ticked ? &flight->allocation : NULL,
            SP_IN_THE_AIR, &info->info);
    sp_copy(info->position_error, h->position_error, 3);
    sp_copy(info->attitude_error, h->attitude_error, 3);
    sp_zero(info->wrench_desired, 6);
    if (flight->ticked) sp_copy(info->wrench_desired, flight->wrench_desired, 6);
    for (int i = 0; i < SP_ROTORS; i++)
        info->restricted_rotors[i] = flight->ticked && flight->memory.interference.restricted[i];
    info->is_success = 0; /* set by the task */
}

/* Write the preview: the present form, the next one, and the path ahead. */
static void preview(const sp_goal *goals, const sp_knot *knots, sp_hover_robot *h)
{
    int last = h->current + 1 >= h->goals;
    const sp_goal *goal = &goals[h->current], *next = last ? goal : goal + 1;
    sp_copy(h->preview.joint_target, goal->joint_target, SP_JOINTS);
    sp_copy(h->preview.next_form, next->joint_target, SP_JOINTS);
    h->preview.time_to_next = last ? SP_NO_NEXT_FORM : next->start - time_of(h);
    if (h->knots) sp_preview_path(knots, h->knots, time_of(h), &h->preview);
}

static void observe(const sp_hover_rules *rules, const sp_hover_robot *h, float *observation)
{
    const sp_episode *episode = &h->episode;
    const sp_preview *next = &h->preview;
    if (h->plant.diverged)
        memset(observation, 0, (size_t)rules->rules.size * sizeof *observation);
    else if (!rules->rules.is_commanded) { /* Python writes the observation of a Python controller */
        sp_observe(&h->flight, &episode->seen, &h->percept,
                   episode->has_command ? episode->command.thrust : episode->seen.thrust, h->joint_velocity,
                   h->leg_momentum, h->leg_momentum_rate, next, rules->path != SP_PATHS_NONE, episode->action,
                   rules->rules.mode.size, rules->rules.bound, observation);
        sp_scale(&rules->rules, observation);
    }
}

static void show(sp_engine *e, int robot)
{
    const sp_hover_rules *rules = sp_rules_of(e, robot);
    sp_hover_robot *h = (sp_hover_robot *)sp_plant_of(e, robot);
    const sp_goal *goals = goals_of(e, robot);
    tell(&rules->rules, h, (sp_hover_info *)e->infos + robot);
    count(rules, goals, h, (sp_hover_quantities *)e->quantities + robot);
    if (!rules->rules.is_referred) preview(goals, knots_of(e, robot), h);
    observe(rules, h, e->observations + (int64_t)robot * e->observation_size);
}

static void reset_robot(sp_engine *e, sp_thread *thread, int robot)
{
    begin(e, thread, robot);
    show(e, robot);
}

/* Update the reference and the errors. */
static void update(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_hover_rules *rules = sp_rules_of(e, robot);
    sp_hover_robot *h = (sp_hover_robot *)sp_plant_of(e, robot);
    if (h->plant.diverged) return;
    if (!rules->rules.is_referred) refer(rules, goals_of(e, robot), knots_of(e, robot), h);
    if (e->begun[robot]) look_at(rules, thread->room->robot, h);
    else take_note(rules, thread->room->robot, h);
}

/* Update the reference and the errors, then write `info`, quantities and observation. */
static void regard(sp_engine *e, sp_thread *thread, int robot)
{
    update(e, thread, robot);
    show(e, robot);
}

static void refer_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_hover_robot *h = (sp_hover_robot *)sp_plant_of(e, robot);
    (void)thread;
    refer(sp_rules_of(e, robot), goals_of(e, robot), knots_of(e, robot), h);
    preview(goals_of(e, robot), knots_of(e, robot), h);
}

/* Finish a tick after its physics, up to the outputs. Where references or commands come from Python, Python runs before
 * `regard`. */
static void conclude(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_hover_rules *rules = sp_rules_of(e, robot);
    sp_hover_robot *h = (sp_hover_robot *)sp_plant_of(e, robot);
    if (!h->plant.diverged) {
        sp_look(thread->room->robot, &rules->rules, &h->plant, &h->episode);
        h->flown++;
        follow_schedule(rules, goals_of(e, robot), h);
    }
    if (rules->rules.is_referred) count(rules, goals_of(e, robot), h, (sp_hover_quantities *)e->quantities + robot);
    else if (rules->rules.is_commanded) refer_robot(e, thread, robot);
    else update(e, thread, robot);
}

/* Simulate a control period; the robot's part of the model is in place. Returns whether the step continues. */
static int move(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_hover_rules *rules = sp_rules_of(e, robot);
    sp_hover_robot *h = (sp_hover_robot *)sp_plant_of(e, robot);
    sp_hover_quantities now;
    if (!rules->rules.is_referred) refer(rules, goals_of(e, robot), knots_of(e, robot), h);
    if (rules->rules.is_commanded) h->episode.has_command = 1;
    else act(rules, thread->room, h);
    sp_enter(e->world, &thread->sim, &h->plant);
    sp_plant_step(e->world, &thread->sim, &h->episode.command, &h->plant);
    sp_leave(&thread->sim, &h->plant);
    conclude(e, thread, robot);
    if (h->plant.diverged || rules->rules.hold == 1) return !h->plant.diverged;
    count(rules, goals_of(e, robot), h, &now);
    return !sp_stops(&rules->rules, (const double *)&now, sizeof now / sizeof(double));
}

static void finish(sp_engine *e, int robot)
{
    const sp_rules *rules = &((const sp_hover_rules *)sp_rules_of(e, robot))->rules;
    if (!(rules->is_referred || rules->is_commanded)) show(e, robot);
}

static void step_robot(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_rules *rules = &((const sp_hover_rules *)sp_rules_of(e, robot))->rules;
    sp_hover_robot *h = (sp_hover_robot *)sp_plant_of(e, robot);
    sp_episode *episode = &h->episode;
    if (episode->over && rules->autoreset == SP_RESET_NEXT_STEP) {
        reset_robot(e, thread, robot);
        return;
    }
    e->begun[robot] = 0;
    episode->ticks++;
    h->plant.violated = 0;
    sp_take_action(rules, e->actions + (int64_t)robot * rules->mode.size, episode);
    sp_carry(e, thread, robot);
    for (int k = 0; k < sp_periods(rules); k++)
        if (!move(e, thread, robot)) break;
    finish(e, robot);
}

/* Simulate one more control period of a step. */
static void hold_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_carry(e, thread, robot);
    move(e, thread, robot);
}

static void lose_robot(sp_engine *e, sp_thread *thread, int robot)
{
    sp_plant_of(e, robot)->diverged = 1;
    conclude(e, thread, robot);
    finish(e, robot);
}

static void show_robot(sp_engine *e, sp_thread *thread, int robot)
{
    (void)thread;
    show(e, robot);
}

/* Compute the schedule's joint angles, and whether a thrusting rotor's jet hits another rotor or the torso. */
static void watch_robot(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_hover_robot *h = (const sp_hover_robot *)sp_plant_of(e, robot);
    const sp_robot_state *state = &h->plant.state;
    sp_watch *watch = (sp_watch *)e->argument + robot;
    sp_interference before = watch->bounds;
    double nominal[2 * SP_ROTORS];
    (void)thread;
    plan(h, goals_of(e, robot), watch->planned);
    sp_nominal_vectoring(&h->truth.snapshot, state->vectoring, nominal);
    sp_find_interference(&h->truth.snapshot, nominal, &before, &watch->config, NULL, &watch->bounds);
    watch->interferes = 0;
    for (int i = 0; i < SP_ROTORS; i++) {
        double theta = state->vectoring[2 * i + 1];
        double beyond = sp_max(watch->bounds.lower[i] - theta, theta - watch->bounds.upper[i]);
        watch->interferes |= watch->bounds.restricted[i] && beyond > watch->tolerance && state->thrust[i] > watch->thrust;
    }
}

int sp_watch_hover_robots(sp_engine *e, const int32_t *ids, int n, sp_watch *watches)
{
    return sp_run(e, ids, n, watch_robot, watches);
}

int sp_refer_hover_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, refer_robot, NULL); }
int sp_regard_hover_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, regard, NULL); }
int sp_show_hover_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, show_robot, NULL); }
int sp_reset_hover_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, reset_robot, NULL); }
int sp_step_hover_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, step_robot, NULL); }
int sp_hold_hover_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, hold_robot, NULL); }
int sp_lose_hover_robots(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, lose_robot, NULL); }
