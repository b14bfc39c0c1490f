/* What this core was made for. */
#include "spidar_core.h"
#include "spidar_model.h"

const char *sp_interface(void) { return SP_INTERFACE; }
