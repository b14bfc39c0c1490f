/* A course: the manager of both gaits, and the reaction to every fault in each of its phases. */
#define _POSIX_C_SOURCE 200809L
#include <string.h>

#include "runner.h"
#include "spidar_math.h"

int sp_sees_with(sp_fault fault)
{
    return fault == SP_FINE || fault == SP_NO_STATE || fault == SP_LOW_BATTERY || fault == SP_OUTSIDE ||
           fault == SP_SERVO_ERROR || sp_ends_mission(fault);
}

/* Whether the floor carries the robot, or part of it, so that the rotors may fade. */
static int on_floor(const sp_manager *m)
{
    int32_t phase = m->memory.phase;
    return phase == SP_MANAGER_LIE || phase == SP_MANAGER_CRAWL || phase == SP_MANAGER_SPOOL ||
           phase == SP_MANAGER_UNLOAD || phase == SP_MANAGER_CUT;
}

/* Whether the manager uses the flight controller. */
static int flies(const sp_manager *m)
{
    int32_t phase = m->memory.phase;
    return phase != SP_MANAGER_LIE && phase != SP_MANAGER_CRAWL && phase != SP_MANAGER_CUT;
}

const char *sp_phase_words(int32_t phase)
{
    return SP_MANAGER_PHASE_WORDS[phase >= SP_MANAGER_LIE && phase <= SP_MANAGER_CUT ? phase : SP_MANAGER_LIE];
}

const char *sp_course_begin(sp_loop *l, const sp_robot_state *state)
{
    const sp_mission *mission = &l->mission;
    sp_manager_reset(&mission->robot, &l->manager, state);
    const char *why = sp_refuse_orders(&mission->robot, &l->manager, state, mission->orders, mission->order_count, 0);
    for (int k = 0; why == NULL && k < mission->order_count; k++) sp_manager_command(&l->manager, &mission->orders[k]);
    l->told = mission->order_count > 0;
    l->by_map = mission->has_goal;
    l->undecided = 0;
    memset(&l->pilot, 0, sizeof l->pilot);
    return why;
}

const char *sp_course_init(sp_loop *l)
{
    sp_manager_config config = l->mission.manager;
    sp_robot_state nominal;
    config.flight = l->mission.controller;
    config.crawl = l->mission.crawler;
    sp_manager_init(&l->mission.robot, &l->manager, &config);
    memset(&nominal, 0, sizeof nominal);
    nominal.quat_wb[0] = 1.0;
    nominal.position_w[2] = l->mission.robot.peg_depth;
    sp_copy(nominal.joint_position, l->manager.lying, SP_JOINTS);
    return sp_course_begin(l, &nominal);
}

void sp_say_why(sp_loop *l, const char *why)
{
    memset(l->reason, 0, sizeof l->reason);
    memcpy(l->reason, why, strnlen(why, sizeof l->reason - 1));
    l->answer.heard = SP_HEARD_REFUSED;
}

/* Pass orders that a link received to the manager. */
static void hear(sp_loop *l, const char *text)
{
    if (text[0] == 0) return;
    const char *why = l->ending != SP_FINE ? "no orders after a fault that ends the course"
                                           : sp_take_orders(&l->manager, &l->mission, &l->sense.state, text);
    if (why != NULL) {
        sp_say_why(l, why);
        return;
    }
    memset(l->reason, 0, sizeof l->reason);
    l->answer.heard = SP_HEARD_TAKEN;
    l->told = 1;
    l->by_map = 0; /* orders replace the map */
}

/* One tick of the manager; returns the fault. */
static sp_fault step(sp_loop *l)
{
    sp_manager *m = &l->manager;
    sp_command command;
    sp_go_by_map(l);
    sp_manager_step(m, &l->sense.state, NULL, NULL, sp_own_room(&l->mission.robot), &command);
    l->answer.phase = m->crawl.gait.phase;
    l->answer.timeouts = m->crawl.gait.timeouts;
    if (flies(m)) l->reference = m->reference;
    l->finished = l->told && sp_manager_done(m);
    return sp_answer(l, flies(m) ? &m->flight.allocation : &m->crawl.allocation, &command);
}

/* Bring the robot to rest by the manager: a crawl cycle is completed, a flight ends with a landing here. */
static void begin_to_end(sp_loop *l, sp_fault fault)
{
    l->ending = fault;
    l->by_map = 0;
    l->held = 0.0;
    sp_manager_end(&l->manager);
}

/* Hold the joints and fade the remaining thrust. */
static void rest(sp_loop *l)
{
    double before = l->left;
    l->left = sp_max(0.0, before - 1.0 / (SP_CONTROL_RATE * l->manager.config.unload_time));
    for (int i = 0; i < SP_ROTORS; i++) l->command.thrust[i] = before > 0.0 ? l->command.thrust[i] * (l->left / before) : 0.0;
    l->finished = l->left == 0.0;
}

static void begin_to_rest(sp_loop *l)
{
    l->stage = SP_RESTING;
    if (l->ending == SP_FINE) l->ending = l->fault;
    l->fault = l->ending;
    l->left = 1.0;
}

void sp_course_tick(sp_loop *l, const sp_loop_input *input, sp_fault fault)
{
    const sp_manager *m = &l->manager;
    int sees = sp_sees_with(fault);
    if (l->stage == SP_RESTING) {
        rest(l);
        return;
    }
    hear(l, input->orders);
    if (sees) {
        sp_fault own = step(l);
        if (own != SP_FINE) fault = own, sees = 0;
        else if (l->ending != SP_FINE) fault = SP_FINE; /* the course is already ending for this fault */
    }
    if (sees) sp_note_carried(l, !on_floor(m));
    else if (!on_floor(m)) sp_hold_level(l);
    sp_hold(l, input->time, fault);
    if (l->stage == SP_HOLDING && sees) l->stage = SP_DRIVING; /* the command is new */
    if (l->stage == SP_LANDING && fault != SP_CONTENDED) {
        if (sees) begin_to_end(l, fault), l->stage = SP_DRIVING;
        else if (on_floor(m)) begin_to_rest(l);
    }
    if (l->stage == SP_DRIVING && l->ending != SP_FINE) {
        l->stage = SP_ENDING;
        l->fault = l->ending;
        if (m->memory.phase == SP_MANAGER_LIE && m->count == 0) begin_to_rest(l);
        else if (sp_manager_done(m) && m->memory.phase != SP_MANAGER_CUT) l->stage = SP_LANDING; /* no landing */
    }
    if (l->stage != SP_RESTING && m->memory.phase == SP_MANAGER_CUT) {
        l->fault = l->ending = SP_TILTED;
        begin_to_rest(l);
    }
}
