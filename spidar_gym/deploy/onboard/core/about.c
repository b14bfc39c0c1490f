/* What this core was made for. */
#include "spidar_core.h"
#include "spidar_model.h"

const char *sp_interface(void) { return SP_INTERFACE; }
const char *sp_model(void) { return SP_MODEL_SHA256; }
const char *sp_joint_name(int index) { return index < 16 ? SP_JOINT_NAMES[index] : SP_GIMBAL_NAMES[index - 16]; }
