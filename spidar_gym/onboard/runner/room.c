/* Workspace of the runner, in static memory. */
#include "runner.h"
#include "spidar_model.h"
#include "spidar_solvers.h"

sp_room *sp_own_room(void)
{
    static sp_room room;
    static double solvers[SP_SOLVERS_BYTES / sizeof(double)];
    if (room.robot == NULL) sp_make_room(&SP_ROBOT, solvers, &room);
    return &room;
}
