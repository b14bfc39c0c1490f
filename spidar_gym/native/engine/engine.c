/* Runs jobs on robots in MuJoCo's thread pool; results do not depend on the order in which the pool takes robots. */
#include "engine.h"

sp_plant *sp_plant_of(const sp_engine *e, int robot) { return (sp_plant *)(e->first + robot * e->stride); }

const void *sp_rules_of(const sp_engine *e, int robot) { return (const char *)e->rules + robot * e->rules_bytes; }

/* Return the slot of the thread with an mjData of MuJoCo's pool; the first call of a thread claims a free slot. */
static sp_thread *seat_of(const sp_engine *e, const void *pool_data)
{
    for (int64_t k = 0; k < e->thread_count; k++) {
        sp_thread *thread = &e->threads[k];
        const void *unclaimed = NULL;
        if (__atomic_load_n(&thread->seat, __ATOMIC_ACQUIRE) == pool_data) return thread;
        if (__atomic_compare_exchange_n(&thread->seat, &unclaimed, pool_data, 0, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE))
            return thread;
    }
    return NULL; /* more threads than slots */
}

static char *copy_of(const sp_engine *e, int robot)
{
    return e->copies + (e->own_copies ? robot * e->copy_bytes : 0);
}

/* Copy a robot's part of the model into a thread's model. A part that all robots share is copied once. A robot's own
 * part is always copied, since another thread may have changed it. */
void sp_carry(const sp_engine *e, sp_thread *thread, int robot)
{
    const char *copy = copy_of(e, robot);
    if (thread->carries == copy && !e->own_copies) return;
    for (int64_t k = 0; k < e->piece_count; k++)
        memcpy(thread->pieces[k].here, copy + thread->pieces[k].there, (size_t)thread->pieces[k].bytes);
    thread->carries = copy;
}

static void keep_copy(const sp_engine *e, sp_thread *thread, int robot)
{
    char *copy = copy_of(e, robot);
    for (int64_t k = 0; k < e->piece_count; k++)
        memcpy(copy + thread->pieces[k].there, thread->pieces[k].here, (size_t)thread->pieces[k].bytes);
    thread->carries = copy;
}

/* Reset a thread's simulation after an aborted job; the counts of MuJoCo's warnings are kept. */
static void recover(sp_thread *thread)
{
    const sp_sim *sim = &thread->sim;
    char counts[SP_MAX_WARNING_BYTES];
    memcpy(counts, sim->warnings, (size_t)sim->warning_bytes);
    sim->mujoco->reset_data(sim->model, sim->data);
    memcpy(sim->warnings, counts, (size_t)sim->warning_bytes);
    thread->carries = NULL;
}

static void turn(const void *model, void *data, int robot, void *argument)
{
    sp_engine *e = argument;
    sp_thread *thread = seat_of(e, data);
    (void)model;
    if (thread == NULL) return;
    if (thread->busy) recover(thread);
    thread->busy = 1; /* on an error MuJoCo jumps out of the job, and the lines after it do not run */
    e->job(e, thread, robot);
    thread->busy = 0;
}

/* Run a job on robots, on all of them where `ids` is NULL; returns for how many MuJoCo failed. */
int sp_run(sp_engine *e, const int32_t *ids, int n, void (*job)(sp_engine *, sp_thread *, int), void *argument)
{
    e->job = job;
    e->argument = argument;
    return e->apply(e->batch, ids, n, turn, e, 0);
}

/* Apply a configuration to a robot, in a thread's model and in the robot's copy. */
void sp_become(const sp_engine *e, sp_thread *thread, int robot, const sp_plant_config *config)
{
    thread->carries = NULL; /* the model matches no copy until this is done */
    sp_configure(e->world, &thread->sim, config, sp_plant_of(e, robot));
    keep_copy(e, thread, robot);
}

/* Load a robot's part of the model at the start of an episode, without a payload that was added during the last one. */
void sp_put_down(const sp_engine *e, sp_thread *thread, int robot, const sp_plant_config *config)
{
    const sp_body_config *is = &sp_plant_of(e, robot)->config.body, *was = &config->body;
    int moved = is->payload_mass != was->payload_mass;
    for (int x = 0; x < 3; x++) moved = moved || is->payload_position[x] != was->payload_position[x];
    if (moved) sp_become(e, thread, robot, config);
    else sp_carry(e, thread, robot);
}

static void configure_one(sp_engine *e, sp_thread *thread, int robot)
{
    sp_become(e, thread, robot, (const sp_plant_config *)e->argument + robot);
}

/* Apply a configuration within an episode; the robot's state is kept. */
static void change_one(sp_engine *e, sp_thread *thread, int robot)
{
    configure_one(e, thread, robot);
    sp_enter(e->world, &thread->sim, sp_plant_of(e, robot));
}

static void reset_one(sp_engine *e, sp_thread *thread, int robot)
{
    const sp_pose *pose = (const sp_pose *)e->argument + robot;
    sp_plant *p = sp_plant_of(e, robot);
    sp_carry(e, thread, robot);
    sp_plant_reset(e->world, &thread->sim, pose->position_w, pose->quat_wb, pose->joint_position, pose->vectoring,
                   pose->thrust, pose->motion, pose->object, p);
    sp_leave(&thread->sim, p);
}

static void step_one(sp_engine *e, sp_thread *thread, int robot)
{
    sp_plant *p = sp_plant_of(e, robot);
    sp_carry(e, thread, robot);
    sp_enter(e->world, &thread->sim, p);
    sp_plant_step(e->world, &thread->sim, (const sp_command *)e->argument + robot, p);
    sp_leave(&thread->sim, p);
}

static void refresh_one(sp_engine *e, sp_thread *thread, int robot)
{
    sp_carry(e, thread, robot);
    sp_enter(e->world, &thread->sim, sp_plant_of(e, robot));
    if (sp_is_somewhere(e->world, &thread->sim)) thread->sim.mujoco->forward(thread->sim.model, thread->sim.data);
}

/* Store the loaded simulation as the state of the only robot, so that values written into the mjData count. */
void sp_keep_now(const sp_engine *e)
{
    sp_plant *p = sp_plant_of(e, 0);
    if (!p->diverged) sp_leave(&e->threads[0].sim, p);
}

/* Evaluate the floor contacts of the only robot, which must be loaded. */
void sp_touching_now(const sp_engine *e, sp_touch *touch)
{
    sp_touching(e->world, &e->threads[0].sim, sp_plant_of(e, 0), touch);
}

/* Each takes an array with one entry per robot and returns for how many robots MuJoCo failed. */
int sp_configure_plants(sp_engine *e, const int32_t *ids, int n, const sp_plant_config *configs)
{
    return sp_run(e, ids, n, configure_one, (void *)configs);
}

int sp_change_plants(sp_engine *e, const int32_t *ids, int n, const sp_plant_config *configs)
{
    return sp_run(e, ids, n, change_one, (void *)configs);
}

int sp_reset_plants(sp_engine *e, const int32_t *ids, int n, const sp_pose *poses)
{
    return sp_run(e, ids, n, reset_one, (void *)poses);
}

int sp_step_plants(sp_engine *e, const int32_t *ids, int n, const sp_command *commands)
{
    return sp_run(e, ids, n, step_one, (void *)commands);
}

int sp_refresh_plants(sp_engine *e, const int32_t *ids, int n) { return sp_run(e, ids, n, refresh_one, NULL); }
