/* A mission: what the runner does once it drives, and the limits within which it goes on. A text file, a line each. */
#ifndef SPIDAR_MISSION_H
#define SPIDAR_MISSION_H

#include <stddef.h>

#include "spidar_core.h"
#include "spidar_runner.h" /* generated: the runner's words and structs */

/* Read a mission's text; 1, or 0 and a sentence that says what would have been valid. */
int sp_read_mission(const char *text, sp_mission *mission, char *reason, size_t size);

#endif
