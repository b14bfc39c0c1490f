/* Workspace of the runner, in static memory; nothing in it outlives a tick. */
#include "runner.h"
#include "spidar_solvers.h"

sp_room *sp_own_room(const sp_robot *robot)
{
    static sp_room room;
    static double solvers[SP_SOLVERS_BYTES / sizeof(double)];
    if (room.robot == NULL) sp_make_room(robot, solvers, &room);
    room.robot = robot;
    return &room;
}
