/* Refuse a robot that is not the one whose parameters are in force. */
#include "runner.h"

#include <stdio.h>
#include <string.h>

#define LOW (1.0 - SP_RATE_TOLERANCE)
#define HIGH (1.0 + SP_RATE_TOLERANCE)

static const char *expected(int k)
{
    return k < SP_JOINTS ? SP_JOINT_NAMES[k] : SP_GIMBAL_NAMES[k - SP_JOINTS];
}

int sp_agree(const sp_found *robot, const char *model, int32_t odometry, char *reason, size_t size)
{
    for (int t = 0; t < SP_FIRST_HEALTH; t++) {
        if (odometry ? t == SP_TOPIC_IMU || t == SP_TOPIC_POSE : t == SP_TOPIC_ODOMETRY) continue;
        double rate = robot->rates[t], due = SP_TOPIC_RATES[t];
        if (!(rate > 0.0)) {
            snprintf(reason, size, "nothing comes on %s; valid: a robot that publishes it", SP_TOPIC_NAMES[t]);
            return 0;
        }
        if (due > 0.0 && (rate < LOW * due || rate > HIGH * due)) {
            snprintf(reason, size, "%s comes at %.0f Hz; valid: %.0f … %.0f", SP_TOPIC_NAMES[t], rate, LOW * due, HIGH * due);
            return 0;
        }
    }
    if (robot->name_count != SP_NAMES) {
        snprintf(reason, size, "joint_states names %d angles; valid: 16 joints, then 16 gimbals", (int)robot->name_count);
        return 0;
    }
    for (int k = 0; k < SP_NAMES; k++)
        if (strcmp(robot->names[k], expected(k)) != 0) {
            snprintf(reason, size, "joint_states has %s in place %d; valid: %s", robot->names[k], k + 1, expected(k));
            return 0;
        }
    if (robot->model == NULL || strcmp(robot->model, model) != 0) {
        snprintf(reason, size, "the robot's model is %.12s; valid: %.12s, that of these parameters (`runner about`)",
                 robot->model == NULL || !*robot->model ? "not set" : robot->model, model);
        return 0;
    }
    return 1;
}

void sp_say_absent(const sp_found *robot)
{
    int absent = 0;
    for (int t = SP_FIRST_HEALTH; t < SP_TOPICS; t++) {
        if (robot->rates[t] > 0.0) continue;
        fprintf(stderr, "%s%s", absent++ ? ", " : "runner: the robot's health is not checked: nothing comes on ", SP_TOPIC_NAMES[t]);
    }
    if (absent) fprintf(stderr, "\n");
}
