/* Generated: numbers and structs of the simulated world. */
#ifndef SPIDAR_ENGINE_STRUCTS_H
#define SPIDAR_ENGINE_STRUCTS_H

#include <stdint.h>
#include "spidar_structs.h"

#define SP_SEED_POOL 4 /* spidar_gym.native.draws */
#define SP_SEED_START 1135663077 /* spidar_gym.native.draws */
#define SP_SEED_FACTOR 2468251765u /* spidar_gym.native.draws */
#define SP_SEED_LEFT 3389127133u /* spidar_gym.native.draws */
#define SP_SEED_RIGHT 1232336661 /* spidar_gym.native.draws */
#define SP_STATE_START 2337405405u /* spidar_gym.native.draws */
#define SP_STATE_FACTOR 1492356589 /* spidar_gym.native.draws */

/* A stream of random numbers: numpy's PCG64, and what spawns others from it. */
typedef struct {
    uint64_t state_high, state_low; /* of PCG64 */
    uint64_t increment_high, increment_low; /* odd; which of its streams */
    uint32_t has_half, half; /* whether the upper half of a draw is left over; that half */
    uint32_t pool[4]; /* the seed and the spawn key, mixed */
    uint32_t hash, spawned; /* constant that goes on mixing; how many were spawned */
} sp_generator;

#endif
