/* Electrical power and voltage of the batteries: P = P_b + Σ c λ^1.5 + Σ max(τ q̇, 0) / η + Σ k τ². */
#include "engine.h"

/* Electrical power [W] from thrusts in still air [N], joint torques [Nm] and velocities [rad/s]. */
double sp_electrical_power(const double *thrust, const double *joint_torque, const double *joint_velocity)
{
    double lift = 0.0, move = 0.0, hold = 0.0;
    for (int i = 0; i < SP_ROTORS; i++) lift += thrust[i] * sqrt(sp_max(thrust[i], 0.0));
    for (int j = 0; j < SP_JOINTS; j++) {
        move += sp_max(joint_torque[j] * joint_velocity[j], 0.0);
        hold += joint_torque[j] * joint_torque[j];
    }
    return SP_BASE_POWER + SP_THRUST_POWER * lift + move / SP_SERVO_EFFICIENCY + SP_HOLDING_POWER * hold;
}

/* Voltage of a pack [V] after `energy_wh` [Wh] at a load of `power` [W]: linear in the charge, minus the sag. */
double sp_voltage(double energy_wh, double power)
{
    double rest = SP_FULL_VOLTAGE - (SP_FULL_VOLTAGE - SP_EMPTY_VOLTAGE) * energy_wh / (SP_USABLE * SP_CAPACITY_WH);
    return rest - SP_RESISTANCE * power / sp_max(rest, 1.0);
}
