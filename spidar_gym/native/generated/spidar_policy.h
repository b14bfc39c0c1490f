/* Generated: no policy. */
#ifndef SPIDAR_POLICY_H
#define SPIDAR_POLICY_H

#include "spidar_constants.h"

#define SP_POLICY_KIND SP_POLICY_NONE
#define SP_POLICY_NAME ""
#define SP_POLICY_PRESET "" /* preset of the controller that it adds to */
#define SP_POLICY_LAYERS 0
#define SP_POLICY_SIZES {0}
#define SP_POLICY_WIDTH 32 /* of the widest layer, in whole blocks */
#define SP_POLICY_SEES 0
#define SP_POLICY_TRACES 0
#define SP_POLICY_SKIP 0
#define SP_POLICY_TORSO 0
#define SP_POLICY_KEPT_SIZE 0
#define SP_POLICY_EXTERNAL 0
#define SP_POLICY_ROTOR_SHARE 0.0
#define SP_POLICY_FORCE 0.0
#define SP_POLICY_OFFSET 0.0
#define SP_POLICY_SPEED 0.0
#define SP_POLICY_ACCELERATION 0.0
#define SP_POLICY_SURE 0.0
#define SP_POLICY_JOINT_LIMIT 0.0
#define SP_POLICY_AT_JOINTS 0
#define SP_POLICY_AT_SINE 0
#define SP_POLICY_AT_COSINE 0
#define SP_POLICY_AT_THRUST 0
#define SP_POLICY_AT_COMMAND_SINE 0
#define SP_POLICY_AT_COMMAND_COSINE 0
#define SP_POLICY_AT_ACTION 0
#define SP_POLICY_AT_SPEEDS 0
#define SP_POLICY_AT_ASIDE 0
#define SP_POLICY_AT_VELOCITY 0
#define SP_POLICY_AT_ATTITUDE 0
#define SP_POLICY_AT_INTEGRAL 0
#define SP_POLICY_ACTIONS 0
#define SP_POLICY_CHANNELS (0)
#define SP_POLICY_RELU 0
#define SP_POLICY_SQUASH 0
#define SP_POLICY_CLIP 0.0
#define SP_POLICY_STEP 0.0
#define SP_POLICY_SCALED 0
#define SP_POLICY_IN_TORSO_AXES 0
#define SP_POLICY_TRIM 0.0
#define SP_POLICY_HOLD 1

static const int SP_POLICY_TRACED[1] = {
    0,
};

static const int SP_POLICY_KEPT[1] = {
    0,
};

static const double SP_POLICY_MEAN[1] = {
    0x0.0p+0,
};

static const double SP_POLICY_DEVIATION[1] = {
    0x0.0p+0,
};

static const double SP_POLICY_BOUND[1] = {
    0x0.0p+0,
};

static const double SP_POLICY_GAIN[1] = {
    0x0.0p+0,
};

static const double SP_POLICY_WASHOUT[1] = {
    0x0.0p+0,
};

static const double SP_POLICY_AUTHORITY[1] = {
    0x0.0p+0,
};

static const double SP_POLICY_TRACE_SHARE[1] = {
    0x0.0p+0,
};

static const float SP_POLICY_WEIGHTS[1] = {
    0x0.0p+0f,
};

#endif
