/* Stages of the runner: wait, drive, hold for at most 100 ms, force the landing, released. course_drive.c adds two. */
#include "runner.h"
#include "spidar_math.h"

#define HEADING_RATE 0.2 /* of the reference's heading [rad/s] */
#define CONTENTION 0.5 /* time allowed for the robot's own stack to stop commanding [s] */
#define TRIM_SECONDS 0.5

static const char *const STAGES[] = {
    "waiting", "driving", "holding", "forcing the landing", "released", "ending the mission", "resting",
};

const char *sp_fault_words(int32_t fault)
{
    return SP_FAULT_WORDS[fault >= 0 && fault < SP_FAULTS ? fault : 0];
}

const char *sp_stage_words(int32_t stage)
{
    return STAGES[stage >= 0 && stage <= SP_RESTING ? stage : 0];
}

/* Reset the crawl and queue the mission's moves; returns 0 if a move is out of reach. */
static int begin_crawl(sp_loop *l, const sp_robot_state *state)
{
    sp_crawl_reset(&l->crawl, state);
    for (int k = 0; k < l->mission.move_count; k++)
        if (!sp_gait_move(&l->mission.robot, &l->crawl, l->mission.moves[k].way, l->mission.moves[k].cycles)) return 0;
    return 1;
}

const char *sp_loop_init(sp_loop *l, const sp_mission *mission)
{
    memset(l, 0, sizeof *l);
    l->mission = *mission;
    sp_sense_init(&l->sense, mission);
    sp_health_init(&l->health);
    sp_flight_init(&l->flight, &mission->controller);
    sp_crawl_init(&l->mission.robot, &l->crawl, &mission->crawler);
    int kind = sp_policy_kind(), flies = kind == SP_POLICY_FLIGHT || kind == SP_POLICY_DIRECT;
    int fits = mission->kind == SP_MISSION_CRAWL ? kind == SP_POLICY_CRAWL : mission->kind == SP_MISSION_FLIGHT && flies;
    if (mission->residual && !fits)
        return "there is no residual for this mission; valid: residual off, or an export with --residual of its kind";
    if (mission->residual && !sp_is_own_robot(&mission->robot))
        return "the residual was learned on another robot; valid: residual off, or the robot of the export";
    if (mission->kind == SP_MISSION_FLIGHT || mission->kind == SP_MISSION_BENCH) return NULL;
    if (mission->kind == SP_MISSION_COURSE) return sp_course_init(l);
    sp_robot_state nominal;
    memset(&nominal, 0, sizeof nominal);
    nominal.quat_wb[0] = 1.0;
    sp_leg_angles(&l->mission.robot, l->crawl.home_b, nominal.joint_position);
    return begin_crawl(l, &nominal) ? NULL : "a move of the mission is out of reach; valid: shorter ones";
}

/* Check attitude, position and tick rate against the limits. */
static sp_fault check_limits(const sp_loop *l, double now)
{
    const sp_limits *limits = &l->mission.limits;
    const sp_robot_state *x = &l->sense.state;
    double R[9];
    sp_from_quat(x->quat_wb, R);
    if (acos(sp_clip(R[8], -1.0, 1.0)) > limits->tilt) return SP_TILTED;
    for (int i = 0; i < 3; i++)
        if (!(x->position_w[i] >= limits->fence_low[i] && x->position_w[i] <= limits->fence_high[i])) return SP_OUTSIDE;
    return l->has_last && now - l->last > limits->gap ? SP_LATE : SP_FINE;
}

/* Estimate the hover wrench beyond the weight from the robot's own commands; it initialises the integrals. */
static void learn_trim(sp_loop *l, const sp_loop_input *input)
{
    if (!sp_thrust_within_limits(&l->mission.robot, input->thrust)) return;
    sp_snapshot snapshot;
    double R[9], Q[6 * SP_FORCES], forces[SP_FORCES], rate = (input->time - l->last) / TRIM_SECONDS;
    const sp_robot_state *x = &l->sense.state;
    sp_from_quat(x->quat_wb, R);
    sp_snapshot_at(&l->mission.robot, x->joint_position, R, x->vectoring, &snapshot);
    sp_thrust_map(&snapshot, Q, SP_FORCES);
    sp_vectoring_to_force(input->thrust, x->vectoring, forces);
    if (!l->has_trim || rate > 1.0) rate = 1.0;
    for (int r = 0; r < 6; r++) {
        double w = r < 3 ? -snapshot.mass * l->mission.robot.gravity * R[6 + r] : 0.0;
        for (int k = 0; k < SP_FORCES; k++) w += Q[r * SP_FORCES + k] * forces[k];
        l->trim[r] += rate * (w - l->trim[r]);
    }
    l->has_trim = 1;
}

/* Begin to drive; returns 0 if the mission cannot begin here. */
static int take_over(sp_loop *l, const sp_loop_input *input)
{
    const sp_robot_state *x = &l->sense.state;
    l->stage = SP_DRIVING;
    l->taken_over = input->time;
    memset(&l->command, 0, sizeof l->command);
    if (sp_thrust_within_limits(&l->mission.robot, input->thrust)) sp_copy(l->command.thrust, input->thrust, SP_ROTORS);
    sp_make_command(l->command.thrust, x->vectoring, x->joint_position, l->mission.robot.max_joint_torque, &l->command);
    /* A joint that is beyond its limits is commanded to the nearer one. */
    const double limit = l->mission.robot.joint_limit;
    for (int j = 0; j < SP_JOINTS; j++) l->command.joint_position[j] = sp_clip(l->command.joint_position[j], -limit, limit);
    sp_policy_reset(&l->policy);
    sp_snapshot snapshot;
    double R[9], lever[3];
    sp_from_quat(x->quat_wb, R);
    double yaw = atan2(R[3], R[0]);
    if (l->mission.kind == SP_MISSION_COURSE) return sp_course_begin(l, x) == NULL;
    if (l->mission.kind == SP_MISSION_BENCH) {
        sp_bench_begin(l, x);
        return 1;
    }
    if (l->mission.kind == SP_MISSION_CRAWL) {
        if (!begin_crawl(l, x)) return 0;
        const sp_pose2 goal = l->crawl.gait.planned;
        l->goal[0] = goal.x, l->goal[1] = goal.y, l->goal[2] = goal.yaw;
        return 1;
    }
    sp_reference *r = &l->reference;
    sp_snapshot_at(&l->mission.robot, x->joint_position, R, x->vectoring, &snapshot);
    sp_apply(R, snapshot.com_b, lever);
    memset(r, 0, sizeof *r);
    l->first_yaw = l->yaw = yaw;
    r->quat_wb[0] = cos(0.5 * yaw);
    r->quat_wb[3] = sin(0.5 * yaw);
    for (int i = 0; i < 3; i++) r->position_w[i] = x->position_w[i] + lever[i];
    sp_copy(r->joint_target, x->joint_position, SP_JOINTS);
    sp_copy(l->form, x->joint_position, SP_JOINTS);
    sp_flight_reset(&l->mission.robot, &l->flight, x, x->joint_position, l->has_trim && l->mission.trim ? l->trim : NULL);
    return 1;
}

/* Turn the reference's heading towards that of the mission at a time. */
static void turn(sp_loop *l, double t)
{
    const sp_mission *m = &l->mission;
    double way = HEADING_RATE / SP_CONTROL_RATE, target = l->first_yaw;
    if (m->heading_count == 0 || sp_is_over(l)) return;
    for (int k = 0; k < m->heading_count; k++)
        if (t >= m->headings[k].start - 1e-9) target = l->first_yaw + m->headings[k].yaw;
    double step = sp_clip(target - l->yaw, -way, way);
    l->yaw += step;
    l->reference.quat_wb[0] = cos(0.5 * l->yaw);
    l->reference.quat_wb[3] = sin(0.5 * l->yaw);
    l->reference.omega_b[2] = step * SP_CONTROL_RATE;
}

/* Set the reference of a flight mission at a time. */
static void update_reference(sp_loop *l, double t)
{
    const sp_mission *m = &l->mission;
    if (!sp_is_over(l) && sp_is_strained(l)) { /* the robot hovers in the form that it has */
        l->aborted = l->finished = 1;
        sp_copy(l->form, l->command.joint_position, SP_JOINTS);
    }
    sp_next_form(l, t);
    turn(l, t);
    l->reference.mode = SP_REFERENCE_MODE_FLIGHT;
    for (int k = 0; k < m->window_count; k++)
        if (t >= m->windows[k].start - 1e-9 && t < m->windows[k].end - 1e-9)
            l->reference.mode = SP_REFERENCE_MODE_FLIGHT_UNRESTRICTED;
}

/* Add the mission's excitations to the thrusts of a command, within what the modules deliver. */
static void excite_thrust(const sp_loop *l, double t, sp_command *command)
{
    if (l->mission.excitation_count == 0 || sp_is_over(l)) return;
    sp_excite(&l->mission, SP_EXCITED_THRUST, t, command->thrust);
    for (int i = 0; i < SP_ROTORS; i++) command->thrust[i] = sp_clip(command->thrust[i], 0.0, l->mission.robot.max_thrust);
}

/* Write the preview of the mission's forms for the policy. */
static void preview_at(const sp_loop *l, double t, sp_preview *preview)
{
    const sp_mission *m = &l->mission;
    sp_copy(preview->joint_target, l->reference.joint_target, SP_JOINTS);
    sp_copy(preview->next_form, l->reference.joint_target, SP_JOINTS);
    preview->time_to_next = SP_NO_NEXT_FORM;
    for (int k = m->form_count - 1; k >= 0 && m->forms[k].start > t + 1e-9; k--) {
        sp_copy(preview->next_form, m->forms[k].joint_target, SP_JOINTS);
        preview->time_to_next = m->forms[k].start - t;
    }
}

/* Compute a flight's command: by the controller, with a learned residual, or by a direct policy. */
static void fly(sp_loop *l, double t, sp_command *command)
{
    const sp_robot_state *x = &l->sense.state;
    sp_preview preview;
    sp_control_state control;
    sp_residual residual;
    update_reference(l, t);
    if (!l->mission.residual) {
        sp_flight_step(&l->flight, x, &l->reference, NULL, NULL, NULL, sp_own_room(&l->mission.robot), command);
        return;
    }
    preview_at(l, t, &preview);
    sp_compute_state(&l->mission.robot, x, &l->reference, &control);
    if (sp_policy_kind() == SP_POLICY_DIRECT) {
        sp_policy_direct(&l->mission.robot, &l->policy, &l->flight, x, &control, &preview, command);
        sp_copy(l->flight.allocation.forces_l, l->flight.memory.forces_l, SP_FORCES);
        return;
    }
    sp_policy_flight(&l->mission.robot, &l->policy, &l->flight, x, &control, &preview, &residual);
    sp_flight_step(&l->flight, x, &l->reference, &residual, &control, NULL, sp_own_room(&l->mission.robot), command);
}

/* One tick of the controller; returns the fault. */
static sp_fault control_tick(sp_loop *l, const sp_loop_input *input)
{
    const sp_robot_state *x = &l->sense.state;
    const sp_allocation *a;
    sp_command command;
    sp_residual residual;
    if (l->mission.kind == SP_MISSION_CRAWL) {
        int with_policy = l->mission.residual;
        if (with_policy) sp_policy_crawl(&l->mission.robot, &l->policy, &l->crawl, x, l->goal, &residual);
        sp_crawl_step(&l->crawl, x, with_policy ? &residual : NULL, sp_own_room(&l->mission.robot), &command);
        l->finished = l->finished || (sp_gait_done(&l->crawl) && l->crawl.memory.gap == 0.0);
        a = &l->crawl.allocation;
        l->answer.phase = l->crawl.gait.phase;
        l->answer.timeouts = l->crawl.gait.timeouts;
    } else {
        double t = input->time - l->taken_over;
        fly(l, t, &command);
        excite_thrust(l, t, &command);
        for (int j = 0; j < SP_JOINTS; j++)
            command.joint_torque_limit[j] = sp_min(command.joint_torque_limit[j], l->mission.limits.torque);
        a = &l->flight.allocation;
    }
    sp_copy(l->answer.policy_action, l->policy.action, SP_MAX_ACTION);
    return sp_answer(l, a, &command);
}

/* The largest thrust of all controllers follows the battery's voltage. */
static void limit_thrust(sp_loop *l)
{
    double most = l->health.thrust_limit;
    l->flight.thrust_limit = l->crawl.thrust_limit = most;
    l->manager.flight.thrust_limit = l->manager.crawl.thrust_limit = most;
}

/* End a flight or a crawl early: the robot hovers in the form that it has, or completes the crawl's cycle and lies. */
static void end_mission(sp_loop *l, sp_fault fault)
{
    if (l->ending != SP_FINE) return;
    l->ending = fault;
    if (l->mission.kind == SP_MISSION_CRAWL) {
        l->crawl.gait.count = l->crawl.gait.count > 0;
        return;
    }
    sp_copy(l->form, l->command.joint_position, SP_JOINTS);
    l->finished = 1;
}

/* Whether commands of the runner are in force. */
static int drives(int32_t stage)
{
    return stage == SP_DRIVING || stage == SP_HOLDING || stage == SP_ENDING || stage == SP_RESTING;
}

/* Advance the stage. */
static void next_stage(sp_loop *l, const sp_loop_input *input, sp_fault fault, sp_fault health)
{
    const sp_limits *limits = &l->mission.limits;
    const int flight = l->mission.kind == SP_MISSION_FLIGHT, course = l->mission.kind == SP_MISSION_COURSE;
    const int low = course && input->flight_state == SP_STATE_LOW_BATTERY; /* the runner lands the robot */
    const int wanted = low || input->flight_state == (flight ? SP_STATE_HOVER : SP_STATE_ARM_ON);
    double age = input->time - input->flight_state_time;
    if (fault == SP_FINE && !(age <= limits->state_age && age >= -SP_AHEAD)) fault = SP_NO_STATE;
    if (fault == SP_FINE && low) fault = SP_LOW_BATTERY;
    if (fault == SP_FINE) fault = health; /* it lasts, and must not hide others */
    if (l->stage == SP_WAITING) {
        l->fault = fault;
        if (fault != SP_FINE || !wanted || !l->sense.started || !l->has_last) {
            l->good_since = input->time;
            return;
        }
        if (flight && input->has_thrust) learn_trim(l, input);
        if (!(input->time - l->good_since >= limits->settle - 1e-9)) return;
        if (!take_over(l, input)) {
            l->fault = SP_BAD_COMMAND;
            l->stage = SP_RELEASED;
        }
    }
    if (drives(l->stage)) {
        if (!wanted) { /* the robot's own stack or the operator has taken over */
            l->stage = SP_RELEASED;
            return;
        }
        const int sees = course ? sp_sees_with(fault) : fault == SP_FINE || sp_ends_mission(fault);
        if (sees && input->has_thrust && input->time - l->taken_over > CONTENTION) fault = SP_CONTENDED;
        if (course) {
            sp_course_tick(l, input, fault);
        } else if (l->mission.kind == SP_MISSION_BENCH) {
            sp_bench_tick(l, input, fault);
        } else {
            if (sp_ends_mission(fault)) {
                end_mission(l, fault);
                fault = SP_FINE;
            }
            if (fault == SP_FINE) fault = control_tick(l, input);
            sp_hold(l, input->time, fault);
            if (l->stage == SP_DRIVING && l->ending != SP_FINE) l->stage = SP_ENDING, l->fault = l->ending;
        }
    }
    if (l->stage == SP_LANDING && ++l->landing > limits->landing_ticks) l->stage = SP_RELEASED;
}

void sp_loop_tick(sp_loop *l, const sp_loop_input *input, sp_loop_output *output)
{
    sp_fault fault = sp_sense_update(&l->sense, &l->mission, input,
                                     l->stage == SP_WAITING ? input->thrust : l->command.thrust);
    if (fault == SP_FINE && l->sense.started) fault = check_limits(l, input->time);
    if (!sp_finite(&input->time, 1)) fault = SP_NOT_FINITE;
    double since = l->has_last ? sp_max(input->time - l->last, 0.0) : 0.0; /* 0 where it is not a number */
    sp_fault health = sp_health_update(&l->health, &l->mission, &input->health, input->time, since);
    limit_thrust(l);
    l->answer.heard = SP_HEARD_NOTHING;
    if (input->orders[0] != 0) sp_say_why(l, "orders while the runner drives a course");
    next_stage(l, input, fault, health);
    l->last = input->time;
    l->has_last = 1;
    sp_loop_output *a = &l->answer;
    a->stage = l->stage;
    a->fault = l->fault;
    a->action = drives(l->stage) ? SP_PUBLISH : l->stage == SP_LANDING ? SP_FORCE_LANDING : SP_SILENT;
    a->finished = l->finished;
    a->aborted = l->aborted;
    a->manager_phase = l->manager.memory.phase;
    a->to_do = l->manager.count;
    a->mission_time = l->stage == SP_WAITING ? 0.0 : input->time - l->taken_over;
    a->command = l->command;
    a->state = l->sense.state;
    a->reference = l->reference;
    *output = *a;
}
