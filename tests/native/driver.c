/* The engine under sanitizers: robots on this program's threads, with the uninstrumented MuJoCo library.
 *
 * `driver FILE MODEL LIBRARY`: Python writes the simulated robots into FILE, in the order in which this program reads
 * them, each part preceded by its size in bytes. The program prints a hash of all observations. BROKEN inserts a bug,
 * to check that the sanitizers detect it.
 */
#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#include "engine.h"

#ifndef BROKEN
#define BROKEN 0
#endif
#define RACE 1
#define OVERFLOW 2
#define UNDEFINED 3

enum { ROBOTS, TICKS, KIND, STRIDE, COPY_BYTES, OWN_COPIES, ACTION, OBSERVATION, INFO_BYTES, QUANTITY_BYTES, GOAL_ROOM,
       STATE, CONTACT_OFF, NUMBERS };
enum { OF_DATA, OF_MODEL, ITSELF }; /* base of the offset of a member of sp_sim */

/* ---- threads ---- */

typedef struct {
    void (*job)(const void *, void *, int, void *);
    void *argument;
    const int32_t *ids;
    int n, next;
} work;

typedef struct {
    work *shared;
    pthread_t thread;
} seat;

static void *serve(void *argument)
{
    seat *own = argument;
    work *shared = own->shared;
    for (;;) {
        int k = __atomic_fetch_add(&shared->next, 1, __ATOMIC_RELAXED);
        if (k >= shared->n) return NULL;
        shared->job(NULL, own, shared->ids ? shared->ids[k] : k, shared->argument);
    }
}

static void *serve_another(void *argument) /* BROKEN: use the slot of the first thread */
{
    seat *own = argument, *first = own - 1;
    return serve(BROKEN == RACE ? first : own);
}

static seat seats[2];

/* Replace mjb_apply, with two threads. */
static int apply(void *batch, const int32_t *ids, int n, void (*job)(const void *, void *, int, void *), void *argument,
                 int save)
{
    work shared = {job, argument, ids, n, 0};
    (void)batch, (void)save;
    seats[0].shared = seats[1].shared = &shared;
    pthread_create(&seats[1].thread, NULL, serve_another, &seats[1]);
    serve(&seats[0]);
    pthread_join(seats[1].thread, NULL);
    return 0;
}

/* ---- input from Python ---- */

static void *part(FILE *file, int64_t *bytes)
{
    int64_t size = 0;
    if (fread(&size, sizeof size, 1, file) != 1) abort();
    void *data = malloc((size_t)size + (size == 0)); /* exact size, so that reads beyond it are detected */
    if (size && fread(data, (size_t)size, 1, file) != 1) abort();
    if (bytes != NULL) *bytes = size;
    return data;
}

typedef struct {
    int64_t from, is_pointer, at;
} member;

static void find(sp_sim *sim, const member *members, int64_t count)
{
    uint64_t *value = (uint64_t *)sim + 3; /* after functions, model, data */
    for (int64_t k = 0; k < count; k++) {
        const member *m = &members[k];
        char *place = (m->from == OF_DATA ? (char *)sim->data : (char *)sim->model) + m->at;
        value[k] = m->from == ITSELF ? (uint64_t)m->at : m->is_pointer ? *(uint64_t *)place : (uint64_t)place;
    }
}

static void *symbol(void *library, const char *name)
{
    void *found = dlsym(library, name);
    if (found == NULL) abort();
    return found;
}

int main(int argc, char **argv)
{
    int64_t bytes, member_count, piece_count;
    FILE *file = argc == 4 ? fopen(argv[1], "rb") : NULL;
    void *mujoco = argc == 4 ? dlopen(argv[3], RTLD_NOW) : NULL;
    if (file == NULL || mujoco == NULL) return 2;
    int64_t *number = part(file, NULL), robots = number[ROBOTS];
    void *world = part(file, NULL), *numbers = part(file, NULL), *rules = part(file, NULL);
    char *first = part(file, NULL), *copies = part(file, NULL);
    member *members = part(file, &member_count);
    int64_t *parts = part(file, &piece_count);
    double *actions = part(file, &bytes);
    const int32_t *call = part(file, NULL); /* calls of Python: job, robots; −1 after a tick */
    member_count /= (int64_t)sizeof *members;
    piece_count /= 3 * (int64_t)sizeof *parts;
    fclose(file);

    sp_mujoco functions;
    functions.state_kind = number[STATE], functions.contact_off = number[CONTACT_OFF];
    const char *names[] = {"mj_step",     "mj_forward",  "mj_setConst",    "mj_resetData",
                           "mj_getState", "mj_setState", "mj_contactForce"};
    for (int k = 0; k < 7; k++) ((void **)&functions)[k] = symbol(mujoco, names[k]);
    void *(*load)(const char *, const void *) = symbol(mujoco, "mj_loadModel");
    void *(*make)(const void *) = symbol(mujoco, "mj_makeData");

    sp_thread threads[2];
    sp_piece *pieces = malloc(2 * (size_t)piece_count * sizeof *pieces);
    memset(threads, 0, sizeof threads);
    for (int k = 0; k < 2; k++) {
        sp_sim *sim = &threads[k].sim;
        sim->mujoco = &functions;
        sim->model = load(argv[2], NULL);
        sim->data = make(sim->model);
        find(sim, members, member_count);
        threads[k].room = calloc(1, sizeof(sp_room));
        sp_make_room(numbers, calloc(1, sp_solvers_size()), threads[k].room);
        threads[k].pieces = pieces + k * piece_count;
        for (int64_t i = 0; i < piece_count; i++) {
            char *here = *(char **)((char *)sim->model + parts[3 * i]);
            pieces[k * piece_count + i] = (sp_piece){here, parts[3 * i + 1], parts[3 * i + 2]};
        }
    }

    int64_t seen = robots * number[OBSERVATION], acted = robots * number[ACTION];
    sp_engine e = {0};
    e.world = world, e.apply = apply, e.threads = threads, e.first = first, e.copies = copies, e.rules = rules;
    e.stride = number[STRIDE], e.copy_bytes = number[COPY_BYTES], e.own_copies = number[OWN_COPIES];
    e.thread_count = 2, e.piece_count = piece_count, e.goal_room = number[GOAL_ROOM];
    e.goals = calloc((size_t)(robots * number[GOAL_ROOM]) + 1, sizeof(sp_goal));
    e.observations = calloc((size_t)seen, sizeof(float)), e.observation_size = number[OBSERVATION];
    e.begun = calloc((size_t)robots, 1), e.infos = calloc((size_t)robots, (size_t)number[INFO_BYTES]);
    e.quantities = calloc((size_t)robots, (size_t)number[QUANTITY_BYTES]);
    double *action = malloc((size_t)(acted - (BROKEN == OVERFLOW)) * sizeof *action);
    e.actions = action;

    int (*const jobs[][4])(sp_engine *, const int32_t *, int) = {
        {sp_reset_hover_robots, sp_step_hover_robots, sp_show_hover_robots, sp_hold_hover_robots},
        {sp_reset_crawl_robots, sp_step_crawl_robots, sp_show_crawl_robots, sp_hold_crawl_robots},
        {sp_reset_course_robots, sp_step_course_robots, sp_show_course_robots, sp_hold_course_robots},
        {sp_reset_grasp_robots, sp_step_grasp_robots, sp_show_grasp_robots, sp_hold_grasp_robots},
    };
    uint64_t hash = 0xcbf29ce484222325u; /* FNV-1a */
    for (int64_t tick = 0; tick <= number[TICKS]; tick++) {
        for (; *call >= 0; call += 2 + call[1]) /* no ids: all robots */
            jobs[number[KIND]][call[0]](&e, call[1] ? call + 2 : NULL, call[1] ? call[1] : (int)robots);
        call++;
        for (int64_t k = 0; k < 4 * seen; k++) hash = (hash ^ ((unsigned char *)e.observations)[k]) * 0x100000001b3u;
        if (tick == number[TICKS]) break;
        memcpy(action, actions + tick * acted, (size_t)(acted - (BROKEN == OVERFLOW)) * sizeof *action);
    }
    if (BROKEN == UNDEFINED) printf("%d ", 1 << (int)(number[ROBOTS] + 40));
    printf("%016llx\n", (unsigned long long)hash);
    return 0;
}
