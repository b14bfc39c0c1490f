/* Random numbers, draw for draw those of numpy's Generator(PCG64(SeedSequence(seed))). */
#ifndef SPIDAR_DRAWS_H
#define SPIDAR_DRAWS_H

#include "spidar_engine_structs.h" /* generated */

const char *sp_library(void); /* digest of structs, robot and sources, the engine's included */

/* PCG64(SeedSequence(n)) of a whole number, given as its 32-bit words, the lowest first; at least one, 0 for n = 0. */
void sp_seed(const uint32_t *words, int32_t count, sp_generator *generator);
/* `child` = parent.spawn(1)[0]; the same place is not allowed. */
void sp_spawn(sp_generator *parent, sp_generator *child);

uint64_t sp_next64(sp_generator *generator);
uint32_t sp_next32(sp_generator *generator);

double sp_random(sp_generator *generator);                            /* in [0, 1) */
double sp_uniform(sp_generator *generator, double low, double high);  /* in [low, high) */
int64_t sp_integer(sp_generator *generator, int64_t low, int64_t high); /* in [low, high), low < high */

#endif
