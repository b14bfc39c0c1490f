/* The robot's health: battery, servos, motors. Messages → fault, and the largest thrust at the battery's voltage. */
#include <stdlib.h>
#include <string.h>

#include "runner.h"
#include "spidar_math.h"

#define NEVER (-HUGE_VAL)

const char *sp_read_health(sp_mission *m, char **words, int count)
{
    sp_health_limits *l = &m->limits.health;
    double v[3];
    if (strcmp(words[0], "voltage") == 0) {
        if (!sp_numbers(words, count, 2, v) || !(v[1] >= SP_VOLTAGES[0] && v[1] <= v[0] && v[0] <= SP_VOLTAGES[1]))
            return "voltage LOW CRITICAL [V] within 10 … 30, the critical one at most the low one";
        l->voltage_low = v[0], l->voltage_critical = v[1];
    } else if (strcmp(words[0], "servos") == 0) {
        if (!sp_numbers(words, count, 3, v) || !(v[0] > 0.0 && v[0] <= SP_HOTTEST && v[1] > 0.0 && v[2] > 0.0))
            return "servos TEMPERATURE [°C] of at most 120, LOAD over that at stall and SECONDS above it, all above 0";
        l->temperature = v[0], l->load = v[1], l->load_time = v[2];
    } else if (strcmp(words[0], "motors") == 0) {
        if (!sp_numbers(words, count, 2, v) || !(v[0] > 0.0 && v[0] <= 1.0 && v[1] > 0.0))
            return "motors DUTY within 0 … 1, and SECONDS at it above 0";
        l->output = v[0], l->output_time = v[1];
    } else {
        if (!sp_numbers(words, count, 1, v) || !(v[0] > 0.0)) return "health SECONDS without a valid message, above 0";
        l->age = v[0];
    }
    return NULL;
}

void sp_health_init(sp_health *h)
{
    memset(h, 0, sizeof *h);
    for (int k = 0; k < SP_TOPICS - SP_FIRST_HEALTH; k++) h->newest_time[k] = h->good_time[k] = NEVER;
    h->thrust_limit = HUGE_VAL;
}

/* Whether a message is new; notes it, and whether its values are valid. The first message starts the clock. */
static int is_new(sp_health *h, int topic, double time, double now, int valid)
{
    int k = topic - SP_FIRST_HEALTH, first = h->good_time[k] == NEVER;
    if (!(time > 0.0) || time == h->newest_time[k]) return 0;
    h->newest_time[k] = time;
    valid = valid && time <= now + SP_AHEAD && (first || time > h->good_time[k]);
    if (first) h->good_time[k] = sp_min(time, now);
    if (valid) h->good_time[k] = time;
    return valid;
}

static int within(const int32_t *x, int n, int least, int most)
{
    for (int k = 0; k < n; k++)
        if (x[k] < least || x[k] > most) return 0;
    return 1;
}

/* Filter the voltage, and let the largest thrust follow it, not below that at which the landing is forced. */
static void follow_voltage(sp_health *h, const sp_mission *mission, double volts, double since)
{
    double share = h->voltage > 0.0 ? 1.0 - exp(-since / SP_VOLTAGE_TIME) : 1.0;
    h->voltage += share * (volts - h->voltage);
    const double least = mission->limits.health.voltage_critical, most = mission->robot.max_thrust;
    h->thrust_limit = sp_min(most * sp_battery_thrust(sp_max(h->voltage, least)) / SP_DESCRIBED_THRUST, most);
}

/* Advance the time for which a limit has been exceeded. */
static void count(double *time, int exceeds, double since) { *time = exceeds ? *time + since : 0.0; }

/* The worst fault; `errors`: whether a servo reports one. */
static sp_fault worst_of(const sp_health *h, const sp_health_limits *limits, int errors, double now)
{
    if (h->voltage > 0.0 && h->voltage < limits->voltage_critical) return SP_VOLTAGE_CRITICAL;
    if (errors) return SP_SERVO_ERROR;
    if (h->voltage > 0.0 && h->voltage < limits->voltage_low) return SP_VOLTAGE_LOW;
    if (h->hot > SP_HOT_TIME) return SP_SERVO_HOT;
    for (int k = 0; k < SP_SERVOS; k++)
        if (h->loaded[k] > limits->load_time) return SP_SERVO_LOADED;
    for (int k = 0; k < SP_ROTORS; k++)
        if (h->at_limit[k] > limits->output_time) return SP_MOTOR_LIMIT;
    for (int k = 0; k < SP_TOPICS - SP_FIRST_HEALTH; k++)
        if (now - h->good_time[k] > limits->age && h->good_time[k] > NEVER)
            return now - h->newest_time[k] > limits->age ? SP_HEALTH_STALE : SP_HEALTH_INVALID;
    return SP_FINE;
}

sp_fault sp_health_update(sp_health *h, const sp_mission *mission, const sp_health_input *in, double now, double since)
{
    const sp_health_limits *limits = &mission->limits.health;
    const double before = h->good_time[SP_TOPIC_VOLTAGE - SP_FIRST_HEALTH];
    int errors = 0;
    const int volts = sp_finite(&in->voltage, 1) && in->voltage >= SP_VOLTAGES[0] && in->voltage <= SP_VOLTAGES[1];
    const int servos = in->servo_count == SP_SERVOS && within(in->servo_temperature, SP_SERVOS, 0, SP_HOTTEST) &&
                       within(in->servo_load, SP_SERVOS, -SP_MOST_LOAD, SP_MOST_LOAD);
    const int motors = in->motor_count == SP_ROTORS && within(in->motor_output, SP_ROTORS, 0, SP_MOTOR_FULL);
    if (is_new(h, SP_TOPIC_VOLTAGE, in->voltage_time, now, volts))
        follow_voltage(h, mission, in->voltage, in->voltage_time - before);
    is_new(h, SP_TOPIC_SERVOS, in->servo_time, now, servos);
    is_new(h, SP_TOPIC_MOTORS, in->motor_time, now, motors);
    if (servos && in->servo_time == h->good_time[SP_TOPIC_SERVOS - SP_FIRST_HEALTH]) {
        int hot = 0;
        for (int k = 0; k < SP_SERVOS; k++) {
            errors = errors || (in->servo_error[k] & ~SP_SERVO_OVERLOAD);
            hot = hot || in->servo_temperature[k] > limits->temperature;
            count(&h->loaded[k], abs(in->servo_load[k]) > limits->load * SP_SERVO_STALL, since);
        }
        count(&h->hot, hot, since);
    }
    if (motors && in->motor_time == h->good_time[SP_TOPIC_MOTORS - SP_FIRST_HEALTH])
        for (int k = 0; k < SP_ROTORS; k++) count(&h->at_limit[k], in->motor_output[k] >= limits->output * SP_MOTOR_FULL, since);
    return worst_of(h, limits, errors, now);
}

int sp_ends_mission(sp_fault fault)
{
    return fault == SP_VOLTAGE_LOW || fault == SP_SERVO_HOT || fault == SP_SERVO_LOADED || fault == SP_MOTOR_LIMIT ||
           fault == SP_HEALTH_STALE || fault == SP_HEALTH_INVALID;
}
