/* Workspace of a thread (`sp_room`): copies of OSQP's generated workspaces in the memory that the caller provides. */
#include "spidar_core.h"
#include "spidar_math.h"
#include "spidar_solvers.h"

size_t sp_solvers_size(void) { return SP_SOLVERS_BYTES; }

/* Copy a workspace and relocate its pointers into the copy; returns the solver in it. */
static OSQPSolver *settle(const sp_pattern *pattern, char **memory)
{
    char *copy = *memory;
    if (pattern->space == NULL) return NULL;
    memcpy(copy, pattern->space, pattern->bytes);
    for (int32_t k = 0; k < pattern->pointer_count; k++) {
        char *at;
        memcpy(&at, copy + pattern->pointers[k], sizeof at);
        at = copy + (at - (const char *)pattern->space);
        memcpy(copy + pattern->pointers[k], &at, sizeof at);
    }
    *memory += SP_ALIGNED(pattern->bytes);
    return (OSQPSolver *)(copy + pattern->solver);
}

void sp_make_room(const sp_robot *robot, void *memory, sp_room *room)
{
    char *next = memory;
    memset(room, 0, sizeof *room);
    room->robot = robot;
    for (int kind = 0; kind < SP_PROGRAMS; kind++) {
        room->hard[kind] = settle(&SP_PATTERNS[kind].hard, &next);
        room->soft[kind] = settle(&SP_PATTERNS[kind].soft, &next);
    }
}
