/* The allocation as a library: allocate a wrench to the rotors in form 3, with the paper's and other weights, other
 * limits, and a lost rotor. */
// gcc -std=c99 -O2 -ffp-contract=off -Icore -Iosqp -Igenerated core/*.c osqp/*.c examples/allocate.c -lm -o allocate
#include <math.h>
#include <stdio.h>
#include "spidar_core.h"
#include "spidar_model.h"   /* generated: the robot */
#include "spidar_presets.h" /* generated: the presets */
#include "spidar_solvers.h" /* generated: size of the solvers' memory */

static void show(const char *name, sp_flight *flight, const sp_reference *reference, const double *wrench, sp_room *room)
{
    sp_robot_state state = {.quat_wb = {1.0}};
    double thrust[SP_ROTORS], torque = 0.0;
    for (int leg = 0; leg < SP_LEGS; leg++) {
        state.joint_position[4 * leg + 1] = acos(-1.0) / 4.0; /* form 3: inner links 45°, outer links 90° more */
        state.joint_position[4 * leg + 3] = acos(-1.0) / 2.0;
    }
    sp_flight_reset(room->robot, flight, &state, NULL, NULL);
    for (int tick = 0; tick < 80; tick++) { /* 2 s: the vectoring angles turn at the servos' speed */
        sp_flight_allocate(flight, &state, reference, wrench, room, thrust, state.vectoring);
        for (int i = 0; i < SP_ROTORS; i++) state.thrust[i] = thrust[i];
    }
    for (int j = 0; j < SP_JOINTS; j++) torque = fmax(torque, fabs(flight->allocation.joint_torques[j]));
    printf("%-18s status %d, thrust", name, (int)flight->allocation.status);
    for (int i = 0; i < SP_ROTORS; i++) printf(" %.6f", thrust[i]);
    printf(" N, largest joint torque %.6f Nm\n", torque);
}

int main(void)
{
    static double memory[SP_SOLVERS_BYTES / sizeof(double)];
    static sp_room room;
    static sp_flight flight;
    double wrench[6] = {0.0, 0.0, SP_ROBOT.weight, 0.0, 0.0, 1.5}; /* hover, and turn to the left */
    sp_reference reference = {.quat_wb = {1.0}, .mode = SP_REFERENCE_MODE_FLIGHT};
    sp_make_room(&SP_ROBOT, memory, &room);

    sp_flight_init(&flight, &SP_PRESET_PAPER);
    show("paper", &flight, &reference, wrench, &room);

    for (int k = 0; k < SP_MODE_COSTS; k++) /* a mode is data: set a weight of its costs */
        if (flight.mode.costs[k].kind == SP_JOINT_TORQUE_EFFORT) flight.mode.costs[k].weight = 10.0;
    show("weight", &flight, &reference, wrench, &room);

    sp_flight_init(&flight, &SP_PRESET_PAPER);
    for (int k = 0; k < SP_MODE_ROWS; k++) /* set a limit of its rows */
        if (flight.mode.rows[k].kind == SP_JOINT_TORQUE_LIMIT) flight.mode.rows[k].a = 1.0;
    show("limit", &flight, &reference, wrench, &room);

    sp_flight_init(&flight, &SP_PRESET_PAPER);
    reference.lost_thrust[2] = 1;
    show("lost rotor", &flight, &reference, wrench, &room);
    return 0;
}
